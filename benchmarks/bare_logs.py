"""The literal first command: `sysid fit KIND LOG.csv` on a log alone in a folder.

    python -m benchmarks.bare_logs [--rigs 30] [--seed 7100] [--jobs 2]

Each rig is drawn: its declared constants lie up to 20 % off the reference rig's, every third is
linear. Its logs are fitted bare and then with its true rig file. Of each fit is told: exit status,
both files, whether every assumed constant is said, and which numbers change with the true file
though no assumption was said to touch them.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from datasets.generator.campaign import make_campaign
from datasets.generator.files import write_log
from datasets.generator.rigs import GeneratedRig, random_rig, rig_toml

SPREAD = 0.20
KINDS = {
    "friction": ("friction_static", "friction_sliding"),
    "valve-discrete": ("valve_discrete_a",),
    "valve-pwm": ("valve_pwm_a",),
}
DRAWN = {
    "air": ("temperature_k",),
    "cylinder": ("area_a_m2", "area_b_m2", "pitch_radius_m"),
    "inertia": ("equivalent_kg_m2", "mass_kg"),
    "valves": ("on_delay_s", "off_delay_s"),
    "pwm": ("period_s",),
}
# The period of a timer: what a laboratory sets is a round number.
PERIODS_S = (0.004, 0.005, 0.006)
# Of a number: less is rounding.
CHANGED = 1e-6


def drawn_rig(seed: int) -> GeneratedRig:
    """A rig whose constants lie up to `SPREAD` off the reference's, but the temperature 5 %."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng, motion="linear" if seed % 3 == 2 else "rotary")
    content = {section: dict(table) for section, table in rig.content.items()}
    for section, keys in DRAWN.items():
        for key in keys:
            if key in content[section]:
                spread = 0.05 if key == "temperature_k" else SPREAD
                factor = rng.uniform(1.0 - spread, 1.0 + spread)
                content[section][key] = float(f"{content[section][key] * factor:.4g}")
    content["pwm"]["period_s"] = PERIODS_S[int(rng.integers(len(PERIODS_S)))]
    return replace(rig, content=content)


def run(words: list[str], folder: Path) -> tuple[int, dict[str, Any], str]:
    """Exit status, JSON and standard error of a command in a folder."""
    command = [sys.executable, "-m", "sysid", *words, "--json"]
    environment = {**os.environ, "SYSID_JOBS": "1"}
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=environment)
    return done.returncode, json.loads(done.stdout) if done.stdout else {}, done.stderr


def numbers(content: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """(dotted path, value, standard error) of each parameter of a bundle's parts."""
    if isinstance(content, Mapping):
        if "value" in content and ("unit" in content or content["value"] is None):
            yield path, content["value"], content.get("std")
            return
        for key, value in content.items():
            yield from numbers(value, f"{path}.{key}" if path else key)


def _same(one: Any, other: Any) -> bool:
    """Whether two values, or lists of them, differ by rounding alone."""
    if one is None or other is None:
        return one is other
    return np.shape(one) == np.shape(other) and np.allclose(one, other, rtol=CHANGED, atol=0.0)


def compare(bare: Mapping[str, Any], true: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers that change with the true rig file, and those no assumption was said to touch."""
    marked = {name for one in bare.get("assumed", ()) for name in one["numbers"]}
    parts = {part: true[part] for part in ("friction", "valves") if part in true}
    known = {path: value for path, value, _ in numbers(parts)}
    changed, unmarked = [], {}
    for path, value, std in numbers({part: bare.get(part, {}) for part in parts}):
        other = known.get(path)
        if _same(value, other):
            continue
        changed.append(path)
        if not any(path == name or path.startswith(f"{name}.") for name in marked):
            single = isinstance(value, float) and isinstance(other, float)
            apart = abs(value - other) / std if single and std else None
            unmarked[path] = {"bare": value, "true": other, "standard_errors": apart}
    return {"changed": len(changed), "unmarked": unmarked}


def tell(seed: int) -> Iterator[dict[str, Any]]:
    """One record for each of the three commands on a rig's logs."""
    rig = drawn_rig(seed)
    stems = tuple(stem for own in KINDS.values() for stem in own)
    frequency = 1.0 / rig.content["pwm"]["period_s"]
    campaign = make_campaign(seed, rig=rig, stems=stems, pwm_frequency=frequency)
    rig = campaign.rig
    for kind, own in KINDS.items():
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for log in campaign.logs:
                if log.stem in own:
                    write_log(folder / f"{log.stem}.csv", log.tests, rig)
            logs = [f"{stem}.csv" for stem in own]
            code, bare, said = run(["fit", kind, *logs], folder)
            files = [folder / str(bare.get(key)) for key in ("bundle", "report")]
            assumed = bare.get("rig", {}).get("assumed", [])
            told = {key for one in bare.get("assumed", ()) for key in one["keys"]}
            record = {
                "seed": seed,
                "motion": rig.content["rig"].get("motion", "rotary"),
                "kind": kind,
                "exit": code,
                "files": all(file.is_file() for file in files),
                "assumed": len(assumed),
                "all_said": set(assumed) == told and said.count("assumed: ") > 0,
                "error": said.splitlines()[-1] if code else "",
            }
            (folder / "rig.toml").write_text(rig_toml(rig.content))
            words = ["fit", kind, *logs, "-o", "none", "--no-report"]
            code, true, said = run(words, folder)
            record |= {"exit_with_rig": code, **compare(bare, true)}
            yield record


def main() -> None:
    """Print one JSON line a fit, and a summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=7100)
    parser.add_argument("--jobs", type=int, default=2)
    chosen = parser.parse_args()
    seeds = range(chosen.seed, chosen.seed + chosen.rigs)
    found = []
    with ThreadPoolExecutor(chosen.jobs) as pool:
        for records in pool.map(lambda seed: list(tell(seed)), seeds):
            for record in records:
                print(json.dumps(record), flush=True)
                found.append(record)
    fine = [r for r in found if r["exit"] == 0 and r["files"] and r["all_said"]]
    unmarked = [r for r in found if r["unmarked"]]
    print(
        f"{len(fine)} of {len(found)} fits with exit 0, both files and every assumption said; "
        f"{sum(r['changed'] for r in found)} numbers change with the true rig file, "
        f"{sum(len(r['unmarked']) for r in unmarked)} of them in {len(unmarked)} fits unmarked"
    )


if __name__ == "__main__":
    main()

"""Campaigns of a second plant, with the commands of the samples and effects in forms of its own.

    python benchmarks/second_plant.py make FOLDER [EFFECT ...] [--seed 1] [--scatter 0.02]
    python benchmarks/second_plant.py run RESULTS.jsonl [EFFECT ...] [--first 10] [--scatter 0.02]
    python benchmarks/second_plant.py table RESULTS.jsonl

`make` writes a campaign of a rig drawn from a seed, with the effects given; `run` makes one for
each of the kinds given (`a+b` for two effects at once; all, where none is given), a seed each from
`--first` on, diagnoses it, and appends a line of JSON; `table` says what was named. The plant is
`second_plant.c`, compiled by `cc`; the commands are those of `../shared/samples`. Seeds below 1000
are for development.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import math
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.attribution import is_named, keep, read  # noqa: E402
from benchmarks.history import commit  # noqa: E402

SAMPLES = REPOSITORY.parent / "shared" / "samples" / "rig-1"
SOURCE = Path(__file__).with_suffix(".c")
PERIOD_S, PWM_S, STEPS, STROKE_M = 1e-3, 5e-3, 200, 0.127
COUNTS, NOISE_PA, QUANTUM_PA, TORQUE_PER_VOLT = 80_000, 200.0, 26.0, 0.0795
# Ramps of the friction tests, Nm/s, and how far the shaft then goes, rad.
RAMP, WENT = 0.15, 0.07
FloatArray = np.ndarray[Any, np.dtype[np.float64]]
Numbers = dict[str, float]
Log = tuple[str, str, str | None, str]
LOGS: tuple[Log, ...] = (
    ("friction-static", "friction_static", None, "fit"),
    ("friction-sliding", "friction_sliding", None, "fit"),
    *(
        (kind, f"{kind.replace('-', '_')}_{valve}", valve, "fit")
        for valve in "ab"
        for kind in ("valve-discrete", "valve-pwm")
    ),
    *((f"motion-{m}", f"motion_{m}", None, "fit") for m in ("motor", "pwm", "discrete")),
    *((f"motion-{m}", f"motion_{m}_2", None, "holdout") for m in ("motor", "pwm", "discrete")),
)


def _struct(name: str) -> list[tuple[str, str]]:
    """The fields of a struct of the source, in its order, with their types."""
    text = re.sub(r"/\*.*?\*/", "", SOURCE.read_text(), flags=re.DOTALL)
    body = re.search(r"typedef struct \{([^}]*)\} " + name + ";", text)
    assert body is not None
    found = []
    for line in filter(None, map(str.strip, body[1].split(";"))):
        kind, names = line.split(None, 1)
        found += [(field.strip(), kind) for field in names.split(",")]
    return found


@cache
def plant() -> ctypes.CDLL:
    """The compiled plant."""
    library = Path(tempfile.mkdtemp()) / "plant.so"
    call = ["cc", "-O3", "-shared", "-fPIC", "-o", str(library), str(SOURCE), "-lm"]
    subprocess.run(call, check=True)
    return ctypes.CDLL(str(library))


def _filled(name: str, numbers: Mapping[str, float]) -> Any:
    kinds = {"double": ctypes.c_double, "int": ctypes.c_int}
    fields = [(field, kinds[kind]) for field, kind in _struct(name)]
    kind = type(name, (ctypes.Structure,), {"_fields_": fields})
    return kind(**{field: numbers[field] for field, _ in fields if field in numbers})


def drawn_rig(rng: np.random.Generator) -> Numbers:
    """The numbers of a rig without effects, and its valves' delays."""

    def about(value: float, low: float, high: float, digits: int) -> float:
        return round(value * rng.uniform(low, high), digits)

    found = {
        "inertia": about(0.026, 0.85, 1.2, 6),
        "coulomb_nm": 0.25 * rng.uniform(0.8, 1.2),
        "viscous": 0.045 * rng.uniform(0.8, 1.2),
        "radius": about(0.0375, 0.97, 1.03, 6),
        "max_torque": 0.795,
        "gas": 287.0,
        "heat_ratio": 1.4,
        "temperature": about(295.0, 0.985, 1.02, 1),
        "atmosphere": about(1e5, 0.98, 1.02, -2),
        "supply": about(305e3, 0.98, 1.02, -3),
        "area_a": about(4.524e-4, 0.97, 1.03, 8),
        "area_b": about(4.2e-4, 0.97, 1.03, 8),
        "offset_a": about(0.074, 0.96, 1.05, 5),
        "offset_b": about(0.074, 0.96, 1.05, 5),
        "on_s": about(1.7e-3, 0.85, 1.15, 4),
        "off_s": about(2.1e-3, 0.85, 1.15, 4),
    }
    found["static_nm"] = found["coulomb_nm"] * rng.uniform(1.15, 1.45)
    for side in "ab":
        found |= {
            f"fill_{side}": 8.5e-4 * rng.uniform(0.8, 1.4),
            f"fill_root_{side}": 1.6e-6 * rng.uniform(0.8, 1.15),
            f"dis_{side}": 3.4e-4 * rng.uniform(0.9, 1.1),
            f"dis_linear_{side}": 3.6e-9 * rng.uniform(0.9, 1.1),
        }
    return found


def effects(rng: np.random.Generator, rig: Numbers) -> dict[str, Callable[[], Numbers]]:
    """Each kind's numbers, drawn when asked for: added to the rig's where it has such already."""

    def u(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def either(low: float, high: float) -> float:
        return float(rng.choice([-1.0, 1.0])) * u(low, high)

    def sides(name: str, value: float) -> Numbers:
        own = ("a", "b", "ab")[int(rng.integers(3))]
        return {f"{name}_{side}": value for side in own}

    def waves(name: str, height: float, low: int, high: int) -> Numbers:
        return {
            name: height,
            f"{name}_wave": float(rng.integers(low, high)),
            f"{name}_phase": u(0, 6.28),
        }

    def on_a_spring(inertia: float, hertz: float, damping: float) -> tuple[float, float]:
        """Stiffness and damping with which an inertia swings against the rest of the rig's."""
        rate, reduced = 2.0 * math.pi * hertz, inertia * (1.0 - inertia / rig["inertia"])
        return reduced * rate**2, 2.0 * damping * reduced * rate

    def gap() -> Numbers:
        rotor = u(0.1, 0.25) * rig["inertia"]
        contact, damping = on_a_spring(rotor, 90.0, 0.2)
        return {
            "gap": u(3e-3, 6e-3),
            "rotor": rotor,
            "contact": contact,
            "contact_damping": damping,
        }

    def link() -> Numbers:
        arm = u(0.15, 0.4) * rig["inertia"]
        spring, damping = on_a_spring(arm, 25.0, 0.04)
        return {"link": arm, "link_spring": spring, "link_damping": damping}

    def leak() -> Numbers:
        return {("leak_a", "leak_b")[int(rng.integers(2))]: u(3e-17, 8e-17)}

    return {
        "none": dict,
        "stribeck-friction": lambda: {"stribeck": u(0.06, 0.12), "stribeck_speed": u(0.05, 0.1)},
        "asymmetric-coulomb-friction": lambda: {"asymmetry": either(0.015, 0.025)},
        "position-dependent-friction": lambda: waves("tight", u(0.2, 0.35), 2, 3),
        "seal-friction": lambda: {"seal": u(1.5e-7, 3e-7)},
        "presliding": lambda: {"bristle": u(200, 400), "bristle_damping": u(0.5, 1.0)},
        "quadratic-drag": lambda: {"drag": u(0.004, 0.008)},
        "backlash": gap,
        "gear-mesh-ripple": lambda: waves("mesh", u(0.015, 0.03), 12, 60),
        "pitch-eccentricity": lambda: {"eccentric": u(0.005, 0.012), "eccentric_phase": u(0, 6.28)},
        "link-flexibility": link,
        "cable-spring": lambda: {"spring": u(0.04, 0.08)},
        "mounting-tilt": lambda: {"tilt": u(0.02, 0.05), "tilt_phase": u(0, 0.3)},
        "inertia-mismatch": lambda: {"inertia": either(0.002, 0.004)},
        "torque-ripple": lambda: waves("ripple", u(0.015, 0.035), 4, 30),
        "torque-saturation": lambda: {"saturation": u(0.45, 0.65)},
        "torque-constant-error": lambda: {"gain": either(0.03, 0.06)},
        "amplifier-lag": lambda: {"lag": u(2e-3, 5e-3)},
        "torque-offset": lambda: {"offset": either(0.01, 0.02)},
        "polytropic-exponent": lambda: {"exponent": -u(0.08, 0.15)},
        "wall-heat-transfer": lambda: {"wall": u(0.25, 0.6)},
        "dead-volume-error": lambda: {("dead_a", "dead_b")[int(rng.integers(2))]: u(2e-3, 5e-3)},
        "tube-lag": lambda: {"tube": u(1.5e-3, 3e-3)},
        "piston-leakage": lambda: {"leak": u(3e-17, 8e-17)},
        "atmosphere-leakage": leak,
        "laminar-leakage": lambda: {
            ("laminar", "laminar_a")[int(rng.integers(2))]: u(2e-11, 4e-11)
        },
        "subsonic-flow-shape": lambda: {
            "iso": 1.0,
            "ratio_fill": u(0.2, 0.4),
            "ratio_dis": u(0.2, 0.4),
        },
        "choked-exhaust-scaling": lambda: {"scaled_exhaust": u(0.5, 1.0)},
        "supply-droop": lambda: {"droop": u(0.8e4, 1.5e4) / 7.8e-4},
        "exhaust-back-pressure": lambda: {"back": u(4e3, 8e3) / 3.5e-4},
        "valve-delay": lambda: {"on_s": u(3e-4, 6e-4), "off_s": either(2e-4, 5e-4)},
        "duty-dead-zone": lambda: {"dead_zone_s": u(5e-4, 1.3e-3)},
        "coil-heating": lambda: {"heating_s": u(4e-4, 8e-4), "heating_time_s": u(8, 25)},
        "load-dependent-friction": lambda: {"carried_friction": u(0.04, 0.08)},
        "pressure-offset": lambda: sides("offset_pa", either(1.2e3, 2.2e3)),
        "pressure-gain": lambda: sides("gain", either(0.004, 0.01)),
        "pressure-lag": lambda: sides("pressure_lag", u(2e-3, 4e-3)),
        "time-skew": lambda: sides("late", u(2e-3, 4e-3)),
        "encoder-eccentricity": lambda: {
            "eccentric_encoder": u(4e-3, 8e-3),
            "encoder_phase": u(0, 6.28),
        },
        "temperature-drift": lambda: {"warming": u(0.15, 0.3)},
        "ambient-pressure-error": lambda: {"ambient": either(800, 1500)},
        "area-error": lambda: {"area_error": either(2.5e-6, 5e-6)},
        "outside: eddy brake": lambda: {"eddy": u(0.05, 0.12), "eddy_speed": u(0.4, 0.9)},
        "outside: magnet": lambda: {
            "magnet": either(0.03, 0.06),
            "magnet_place": u(-0.4, 0.4),
            "magnet_width": u(0.08, 0.15),
        },
    }


def _edges(command: FloatArray, is_pwm: bool, start: int, rig: Numbers) -> FloatArray:
    """The instants (n,) at which a valve opens and shuts in turn, s, with its delays."""
    rows = len(command)
    if is_pwm:
        levels = []
        for number in range(math.ceil(rows * PERIOD_S / PWM_S - 1e-9)):
            begins = number * PWM_S
            duty = command[min(round(begins / PERIOD_S), rows - 1)]
            levels.append((begins, int(duty > 0.0)))
            if 0.0 < duty < 1.0:
                levels.append((begins + duty * PWM_S, 0))
    else:
        levels = [(row * PERIOD_S, int(level)) for row, level in enumerate(command)]
    changes, now = list[tuple[float, int]](), start
    for at, level in levels:
        if level != now:
            changes.append((at, level))
            now = level
    if rig.get("dead_zone_s", 0.0) > 0.0:
        changes = _without_short(changes, rig["dead_zone_s"])
    kept = list[tuple[float, int]]()
    for at, level in changes:
        late = rig["on_s"] if level else rig["off_s"]
        if rig.get("heating_s", 0.0) > 0.0:
            late += rig["heating_s"] * (1.0 - math.exp(-at / rig["heating_time_s"]))
        while kept and kept[-1][0] >= at + late:
            kept.pop()
        kept.append((at + late, level))
    found, now = [], start
    for at, level in kept:
        if level != now:
            found.append(at)
            now = level
    return np.array(found, dtype=float)


def _without_short(changes: list[tuple[float, int]], least: float) -> list[tuple[float, int]]:
    """Levels that last less than `least` are not obeyed."""
    found, place = list[tuple[float, int]](), 0
    while place < len(changes):
        if place + 1 < len(changes) and changes[place + 1][0] - changes[place][0] < least:
            place += 2
            continue
        found.append(changes[place])
        place += 1
    return found


def _ran(
    rig: Numbers, test: Numbers, torque: FloatArray, a: FloatArray, b: FloatArray
) -> FloatArray:
    """Angle, pressures and supply (n, 4) of a test, up to where it ends."""
    rows = np.zeros((len(torque), 4))
    own = {"rows": len(torque), "steps": STEPS, "edges_a": len(a), "edges_b": len(b)}
    counts = {"held", "open_a", "open_b"}
    whole = {"period": PERIOD_S} | {n: int(v) if n in counts else v for n, v in test.items()}
    arrays = [np.ascontiguousarray(values, dtype=float) for values in (torque, a, b)]
    pointers = [v.ctypes.data_as(ctypes.c_void_p) for v in (*arrays, rows)]
    done = plant().run(
        ctypes.byref(_filled("Rig", rig)), ctypes.byref(_filled("Test", own | whole)), *pointers
    )
    return rows[:done]


def _shown(found: FloatArray, rig: Numbers, rng: np.random.Generator) -> dict[str, FloatArray]:
    """What the sensors show of it."""
    angle, *pressures = found[:, :3].T
    seen = angle + rig.get("eccentric_encoder", 0.0) * np.sin(angle + rig.get("encoder_phase", 0.0))
    count, at = 2.0 * math.pi / COUNTS, np.arange(len(angle)) * PERIOD_S
    columns = {"theta_rad": count * np.round(seen / count)}
    for side, pressure in zip("ab", pressures, strict=True):
        late = np.interp(at - rig.get(f"late_{side}", 0.0), at, pressure)
        off = rig.get(f"offset_pa_{side}", 0.0) + NOISE_PA * rng.standard_normal(len(at))
        level = late * (1.0 + rig.get(f"gain_{side}", 0.0)) + off
        columns[f"pressure_{side}_pa"] = QUANTUM_PA * np.round(level / QUANTUM_PA)
    return columns


def _test(
    log: Log, rows: pd.DataFrame, rig: Numbers, scatter: float, rng: np.random.Generator
) -> pd.DataFrame:
    """A test of the rig by the commands of a sample's."""
    kind, _, valve, _ = log
    half, held = 0.5 * STROKE_M / rig["radius"], kind.startswith("valve")
    sliding = 1.0 + scatter * rng.standard_normal()
    outside = rig["atmosphere"] + rig.get("ambient", 0.0)
    test = {
        "held": float(held),
        "angle": float(rows["theta_rad"].iloc[0]),
        "pressure_a": outside,
        "pressure_b": outside,
        "sliding": sliding,
        "sticking": sliding * (1.0 + scatter * rng.standard_normal()),
        "end": {"friction-static": math.inf, "friction-sliding": 1.4}.get(kind, 0.985 * half),
    }
    torque = np.zeros(len(rows))
    if "motor_volts" in rows:
        torque = TORQUE_PER_VOLT * rows["motor_volts"].to_numpy()
    if kind == "friction-static":
        most = torque[np.argmax(np.abs(torque))]
        count = round((3.0 * rig["static_nm"] + 0.2) / RAMP / PERIOD_S)
        torque = np.sign(most) * np.minimum(np.arange(count) * PERIOD_S * RAMP, 1.0)
    if held:
        test["angle"] = half if valve == "a" else -half
        if kind == "valve-pwm" and rows[f"pressure_{valve}_pa"].iloc[0] > 2e5:
            test |= {f"pressure_{valve}": rig["supply"], f"open_{valve}": 1.0}
    names = [name for name in ("duty_a", "duty_b", "valve_a", "valve_b") if name in rows]
    commands = {name[-1]: rows[name].to_numpy(dtype=float) for name in names}
    is_pwm = "duty_a" in names
    edges = [
        _edges(commands.get(side, np.zeros(1)), is_pwm, int(test.get(f"open_{side}", 0)), rig)
        for side in "ab"
    ]
    found = _ran(rig, test, torque, *edges)
    if kind == "friction-static":
        away = np.abs(found[:, 0] - test["angle"]) > WENT
        found = found[: int(np.argmax(away))] if away.any() else found
    count = len(found)
    columns: dict[str, Any] = {"time_s": np.arange(count) * PERIOD_S}
    columns |= {name: rows[name].to_numpy()[:count] for name in names}
    if "motor_volts" in rows:
        columns["motor_volts"] = torque[:count] / TORQUE_PER_VOLT
    return pd.DataFrame(columns | _shown(found, rig, rng))


def make(folder: Path, kinds: Sequence[str], seed: int, scatter: float) -> dict[str, Numbers]:
    """Write a campaign, and give what it lacks: each kind's numbers."""
    rng = np.random.default_rng(seed)
    rig = drawn_rig(rng)
    known = effects(np.random.default_rng((seed, 77)), rig)
    lacks = {kind: known[kind]() for kind in kinds}
    own = dict(rig)
    for numbers in lacks.values():
        own |= {name: own.get(name, 0.0) + value for name, value in numbers.items()}
    folder.mkdir(parents=True, exist_ok=True)
    entries = ['rig = "rig.toml"']
    for log in LOGS:
        kind, name, valve, use = log
        rows = pd.read_csv(SAMPLES / f"{name}.csv", comment="#")
        tests = rows.groupby("test", sort=False) if "test" in rows else [(1, rows)]
        parts = [_test(log, part, own, scatter, rng).assign(test=label) for label, part in tests]
        long = [part for part in parts if len(part) >= 200]
        pd.concat(long).to_csv(folder / f"{name}.csv", index=False, float_format="%.7g")
        entry = f'[[log]]\nkind = "{kind}"\nfile = "{name}.csv"\nuse = "{use}"'
        entries.append(entry + (f'\nvalve = "{valve}"' if valve else ""))
    (folder / "campaign.toml").write_text("\n\n".join(entries) + "\n")
    (folder / "rig.toml").write_text(rig_file(rig))
    return lacks


def rig_file(rig: Numbers) -> str:
    """What is declared: the rig without effects."""
    tables: dict[str, dict[str, Any]] = {
        "rig": {"name": "second plant", "orientation": "horizontal"},
        "air": {
            "gas_constant_j_per_kg_k": rig["gas"],
            "heat_capacity_ratio": rig["heat_ratio"],
            "temperature_k": rig["temperature"],
            "atmospheric_pressure_pa": rig["atmosphere"],
            "supply_pressure_pa": rig["supply"],
        },
        "cylinder": {
            **{f"area_{side}_m2": rig[f"area_{side}"] for side in "ab"},
            **{f"offset_{side}_m": rig[f"offset_{side}"] for side in "ab"},
            "stroke_m": STROKE_M,
            "pitch_radius_m": rig["radius"],
        },
        "inertia": {"equivalent_kg_m2": rig["inertia"]},
        "motor": {"torque_per_volt_nm": TORQUE_PER_VOLT, "max_torque_nm": rig["max_torque"]},
        "pwm": {"period_s": PWM_S},
        "valves": {"on_delay_s": rig["on_s"], "off_delay_s": rig["off_s"]},
        "sampling": {"period_s": PERIOD_S},
        "sensors": {"encoder_counts_per_rev": COUNTS, "pressure_noise_pa": NOISE_PA},
    }
    return "\n".join(
        f"[{table}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in content.items())
        for table, content in tables.items()
    )


def diagnosed(kinds: Sequence[str], seed: int, scatter: float) -> dict[str, Any]:
    """A campaign's verdict and effects, and what was to be found."""
    import sysid as si

    with tempfile.TemporaryDirectory() as folder:
        lacks = make(Path(folder), kinds, seed, scatter)
        began = time.process_time()
        campaign = si.read_campaign(Path(folder) / "campaign.toml")
        result = si.diagnose(campaign, si.fit(campaign))
    found = [
        {"id": effect.id, "ambiguous_with": list(effect.ambiguous_with)}
        for effect in result.effects
    ]
    return {
        "seed": seed,
        "kinds": list(kinds),
        "lacks": lacks,
        "scatter": scatter,
        "commit": commit(),
        "verdict": str(result.verdict),
        "found": found,
        "cpu_s": round(time.process_time() - began, 1),
    }


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line for each campaign, those first in which something else was named."""
    lines = []
    for row in rows:
        wanted = [k for k in row["kinds"] if k != "none" and not k.startswith("outside")]
        missed = [kind for kind in wanted if not any(is_named(kind, e) for e in row["found"])]
        more = len(row["found"]) - len(wanted) + len(missed)
        names = ", ".join(effect["id"] for effect in row["found"]) or "-"
        mark = "missed" if missed else "more" if more > 0 else "named" if wanted else ""
        kinds = " and ".join(row["kinds"])
        lines.append(
            (mark == "named", f"{mark:7}{row['seed']:6}  {kinds}: {row['verdict']} ({names})")
        )
    return "\n".join(line for _, line in sorted(lines))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("action", choices=("make", "run", "table"))
    parser.add_argument("path", type=Path)
    parser.add_argument("kinds", nargs="*")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=10)
    parser.add_argument("--scatter", type=float, default=0.02)
    given = parser.parse_args()
    if given.action == "make":
        made = make(given.path, given.kinds, given.seed, given.scatter)
        print(json.dumps(made, indent=1))
        return
    if given.action == "table":
        print(table(read(given.path)))
        return
    rng = np.random.default_rng(0)
    for number, job in enumerate(given.kinds or effects(rng, drawn_rig(rng))):
        row = diagnosed(job.split("+"), given.first + number, given.scatter)
        with given.path.open("a") as file:
            keep(file, row)
        print(table([row]), flush=True)


if __name__ == "__main__":
    main()

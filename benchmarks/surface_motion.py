"""The valves' mean-flow surfaces in motion: where they are wrong, and what that costs.

    python -m benchmarks.surface_motion where --seeds 7301 7302
    python -m benchmarks.surface_motion both --seeds 7401 7402 ... 7420

Generated campaigns with nothing undeclared (lab size) and, first, the bundled one.

`where`: each surface's flow as the simulation takes it (`plant.averaged_flow`) less the on/off
law's over a PWM period, at the duties and pressures of the campaign's motion under PWM; by how
near to zero flow, by whether both directions' domains hold the point, and what of it remains if
each direction counts only where the law fills or exhausts; and the pressure at which a duty
holds the chamber, by surface less by law. `motion`: RMSE of the open-loop position over whole
held-out tests under PWM, by valve model, over that of the on/off law; and RMSE in duty of the
averaged law and the network on held-out PWM tests, and of the samples' noise alone. `both`: all.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.validation import written  # noqa: E402
from datasets.generator.campaign import make_campaign, size_of  # noqa: E402
from sysid.io.campaign import Campaign, read_campaign  # noqa: E402
from sysid.parameters import Bundle, read_bundle, write_bundle  # noqa: E402
from sysid.parameters.assembled_model import surfaces_from_bundle  # noqa: E402
from sysid.parameters.valves import DIRECTIONS  # noqa: E402
from sysid.pipeline.fit import fit_campaign  # noqa: E402
from sysid.surfaces.averaged import AveragedLaw  # noqa: E402
from sysid.types import FloatArray  # noqa: E402
from sysid.validation.open_loop import validate  # noqa: E402

KINDS = ("friction-static", "friction-sliding", "valve-discrete", "valve-pwm", "motion-pwm")
SURFACES = ("bipolynomial", "ann")
NEAR = 0.05  # of the largest flow of the law


def campaigns(seeds: Sequence[int], keep: Path | None) -> Iterator[tuple[str, Campaign, Bundle]]:
    """The bundled campaign and generated ones, each with its bundle (kept in a folder)."""
    yield fitted("bundled", read_campaign(REPOSITORY / "datasets/bundled/campaign.toml"), keep)
    for seed in seeds:
        generated = make_campaign(seed, size=size_of("lab"), kinds=KINDS)
        with tempfile.TemporaryDirectory() as folder:
            yield fitted(f"seed {seed}", written(generated, Path(folder)), keep)


def fitted(name: str, campaign: Campaign, keep: Path | None) -> tuple[str, Campaign, Bundle]:
    """The campaign's bundle: read, where an earlier run has kept it."""
    file = None if keep is None else keep / f"{name.replace(' ', '-')}.json"
    if file is not None and file.exists():
        return name, campaign, read_bundle(file)
    bundle = fit_campaign(campaign).bundle
    if file is not None:
        write_bundle(bundle, file)
    return name, campaign, bundle


# --- where ------------------------------------------------------------------------------


def visited(campaign: Campaign, side: str) -> tuple[FloatArray, FloatArray]:
    """Duties and pressures (n,) of a valve in the motion tests under PWM."""
    trials = [t for e in campaign.select(["motion-pwm"], use=None) for t in campaign.read(e).trials]
    duty = np.concatenate([t[f"duty_{side}"] for t in trials])
    pressure = np.concatenate([t[f"pressure_{side}_pa"] for t in trials])
    return duty, pressure


def holds(bundle: Bundle, side: str, kind: str, at: tuple[FloatArray, FloatArray]) -> FloatArray:
    """(2, n): whether each direction's domain holds each point."""
    duty, pressure = at
    inside = []
    for direction in DIRECTIONS:
        domain = bundle.valve(side).surfaces(direction).surface(kind).model().domain_
        low, high = domain.duty_limits(pressure)
        bottom, top = domain.pressure_range
        inside.append((duty >= low) & (duty <= high) & (pressure >= bottom) & (pressure <= top))
    return np.array(inside)


def rms(values: FloatArray) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def held_pressure(law: Any, duty: FloatArray, grid: FloatArray) -> FloatArray:
    """Pressure (n,) at which the mean flow of each duty is zero; NaN where it is nowhere."""
    flow = np.maximum(law.fill(duty[:, None], grid), 0.0)
    flow = flow + np.minimum(law.discharge(duty[:, None], grid), 0.0)
    found = np.full(len(duty), np.nan)
    for i, row in enumerate(flow):
        crossed = np.flatnonzero((row[:-1] > 0.0) & (row[1:] <= 0.0))
        if len(crossed):
            k = crossed[0]
            share = row[k] / (row[k] - row[k + 1])
            found[i] = grid[k] + share * (grid[k + 1] - grid[k])
    return found


def where(name: str, campaign: Campaign, bundle: Bundle) -> None:
    """Print a row a valve and surface."""
    p = bundle.model(campaign.rig).parameters
    for i, side in enumerate("ab"):
        law = AveragedLaw.of(p, side)
        duty, pressure = visited(campaign, side)
        true = law.flow(duty, pressure)
        largest = float(np.abs(true).max())
        near = np.abs(true) < NEAR * largest
        for kind in SURFACES:
            surfaces = surfaces_from_bundle(bundle, campaign.rig, kind)
            if surfaces is None:
                print(f"| {name} | {side.upper()} | {kind} | not identified |")
                continue
            s = surfaces[i]
            fill, out = s.fill(duty, pressure), s.discharge(duty, pressure)
            error = (np.maximum(fill, 0.0) + np.minimum(out, 0.0) - true) / largest
            own = (np.where(true > 0.0, fill, out) - true) / largest
            both = (fill > 0.0) & (out < 0.0)
            neither = (fill <= 0.0) & (out >= 0.0)
            inside = holds(bundle, side, kind, (duty, pressure))
            needed = np.where(true > 0.0, inside[0], inside[1])
            duties = np.linspace(0.02, 0.98, 97)
            grid = np.linspace(p.atmosphere, p.supply, 801)
            shift = 1e-3 * (held_pressure(s, duties, grid) - held_pressure(law, duties, grid))
            shift = shift[np.isfinite(shift)]
            cells = (
                name, side.upper(), kind, f"{near.mean():.0%}",
                f"{100 * rms(error):.1f}", f"{100 * rms(error[near]):.1f}",
                f"{100 * error[near].mean():+.1f}", f"{100 * rms(own):.1f}",
                f"{100 * rms(own[near]):.1f}",
                f"{both.mean():.0%}", f"{neither.mean():.0%}", f"{1 - needed.mean():.0%}",
                f"{100 * rms(error[~needed]):.1f}", f"{rms(shift):.1f}", f"{shift.mean():+.1f}",
            )  # fmt: skip
            print("| " + " | ".join(cells) + " |", flush=True)


# --- motion -----------------------------------------------------------------------------


def motion(name: str, campaign: Campaign, bundle: Bundle) -> None:
    """Print a row a campaign: position RMSE of each valve model over the on/off law's."""
    result = validate(campaign, bundle, kinds=["motion-pwm"])
    squares: dict[str, list[float]] = {}
    for log in result.logs:
        for test in log.tests if log.use == "holdout" else ():
            squares.setdefault(test.model, []).append(
                test.channels[campaign.rig.position_channel].errors.rmse ** 2
            )
    found = {model: float(np.sqrt(np.mean(values))) for model, values in squares.items()}
    base = found["discrete"]
    cells = [f"{m}: {v / base:.2f}" for m, v in found.items() if m != "discrete"]
    print(f"| {name} | {1e3 * base:.2f} mrad | " + " | ".join(cells) + " |", flush=True)


def duty(name: str, bundle: Bundle) -> None:
    """Print a row a valve and direction: RMSE in duty on held-out PWM tests."""
    for side in "ab":
        law = bundle.valve(side).averaged()
        for direction in DIRECTIONS:
            held = bundle.valve(side).surfaces(direction)
            judged = law and law.errors(direction, "held_out")
            if held is None or held.ann is None or not judged:
                print(f"| {name} | {side.upper()} {direction} | not identified |", flush=True)
                continue
            network = held.ann.errors("held_out").rmse
            noise = held.comparison.noise_rmse
            print(
                f"| {name} | {side.upper()} {direction} | {judged.rmse:.5f} | {network:.5f} | "
                f"{noise:.5f} | {judged.rmse / network:.2f} | {noise / network:.2f} |",
                flush=True,
            )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["where", "motion", "both"])
    parser.add_argument("--seeds", type=int, nargs="*", default=[])
    parser.add_argument("--keep", type=Path, help="folder of bundles fitted by earlier runs")
    given = parser.parse_args()
    for case in campaigns(given.seeds, given.keep):
        if given.what in ("where", "both"):
            where(*case)
        if given.what in ("motion", "both"):
            motion(*case)
            duty(case[0], case[2])


if __name__ == "__main__":
    main()

"""Coverage of the bands on open-loop motion: `sysid simulate --draws` against held-out tests.

    python -m benchmarks.bands --seeds 9300 9306 [--draws 60] [--results FILE.jsonl]

For each seed a generated campaign (2 % scatter of friction from test to test) and its fit. The
bands of every held-out motion test are drawn, and the share of its samples that lie within them is
counted, by channel and over all. Nothing is tuned on these seeds.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.sweeps import accumulated
from sysid.io.campaign import MOTION_KINDS, read_campaign
from sysid.pipeline.fit import fit_campaign
from sysid.refinement.draws import posterior_draws
from sysid.refinement.prediction_bands import open_loop_bands

KINDS = ("friction-static", "friction-sliding", "valve-discrete", *MOTION_KINDS)


def one_rig(seed: int, draws: int) -> dict[str, Any]:
    """The share of held-out samples in the band, by channel, and how many there are."""
    with tempfile.TemporaryDirectory() as name:
        words = ["-o", name, "--seed", str(seed), "--size", "small", "--kinds", ",".join(KINDS)]
        subprocess.run([sys.executable, "-m", "datasets.generator", *words], check=True)
        campaign = read_campaign(Path(name) / "campaign.toml")
        bundle = fit_campaign(campaign, surface="bipolynomial").bundle
        rig = campaign.rig
        drawn = posterior_draws(bundle, rig, bundle.model(rig), draws, seed)
        inside: dict[str, list[np.ndarray]] = {}
        for entry in campaign.select(MOTION_KINDS, use="holdout"):
            log = campaign.read(entry)
            bands = open_loop_bands(bundle, rig, drawn, log.trials, seed)
            for trial, own in zip(log.trials, bands, strict=True):
                for channel, band in own.items():
                    inside.setdefault(channel, []).append(band.holds(trial[channel]))
    shares = {channel: float(np.concatenate(held).mean()) for channel, held in inside.items()}
    return {"seed": seed, "shares": shares, "tests": len(next(iter(inside.values())))}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(9300, 9306), help="first, end")
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--results", type=Path, default=Path("bands.jsonl"))
    options = parser.parse_args()
    results = accumulated(options.results, options.seeds, lambda seed: one_rig(seed, options.draws))
    every: dict[str, list[float]] = {}
    for r in results:
        for channel, share in r["shares"].items():
            every.setdefault(channel, []).append(share)
    for channel, shares in every.items():
        print(f"{channel}: mean {np.mean(shares):.3f}, {min(shares):.2f} to {max(shares):.2f}")
    print(
        f"{len(results)} rigs, all channels: {np.mean([s for v in every.values() for s in v]):.3f}"
    )


if __name__ == "__main__":
    main()

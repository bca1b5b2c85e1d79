"""Where a simulation runs on a machine with an accelerator, and how fast.

    python benchmarks/accelerator.py [--runs 64] [--seconds 10] [--diagnose]

For a jax with an accelerator, as of `pip install "jax[cuda12]"`. Prints jax's devices; the device
of the arrays that `simulate` makes and of the user's own before and after it; times real time of
one batch, compiled before, as the program places it and (for comparison) with the accelerator in
the processor's place. --diagnose: the bundled campaign's fit and diagnosis too, in processes of
their own. Without an accelerator the comparison is left out.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.rigs import random_runs  # noqa: E402
from sysid.io.bundled import bundled_campaign  # noqa: E402
from sysid.plant import jax_setup, simulator  # noqa: E402
from sysid.plant.jax_setup import jax, jnp  # noqa: E402

SEED = 1


def devices_of(value: Any) -> set[str]:
    """Those on which the arrays of jax in a nest of tuples lie."""
    arrays = [leaf for leaf in jax.tree.leaves(value) if isinstance(leaf, jax.Array)]
    return {str(device) for array in arrays for device in array.devices()}


def times_real_time(runs: int, seconds: float) -> tuple[float, set[str]]:
    """Of one batch, after another one that compiles; and the devices of its arrays."""
    inputs, models = random_runs(SEED, runs, seconds)
    seen: set[str] = set()
    chunk = simulator._advance_chunk

    def watched(*given: Any, **named: Any) -> Any:
        found = chunk(*given, **named)
        seen.update(devices_of(found))
        return found

    simulator._advance_chunk = watched  # type: ignore[assignment]
    try:
        simulator.simulate(inputs[: min(runs, 32)], models[: min(runs, 32)])
        start = time.perf_counter()
        simulator.simulate(inputs, models)
        return runs * seconds / (time.perf_counter() - start), seen
    finally:
        simulator._advance_chunk = chunk


def diagnosis() -> None:
    """The bundled campaign by the command line: seconds, verdict, effects."""
    campaign = str(bundled_campaign())
    own = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    with tempfile.TemporaryDirectory() as folder:
        bundle = str(Path(folder) / "bundle.json")
        fit = ["fit", campaign, "-o", bundle]
        diagnose = ["diagnose", campaign, "--bundle", bundle, "--json"]
        for arguments in (fit, diagnose):
            start = time.perf_counter()
            command = [sys.executable, "-m", "sysid", *arguments]
            done = subprocess.run(command, capture_output=True, text=True, env=own)
            print(f"{arguments[0]}: {time.perf_counter() - start:.1f} s, exit {done.returncode}")
            if done.returncode:
                print(done.stderr[-2000:])
                return
    found = json.loads(done.stdout)
    print(f"diagnose: {found['verdict']}, {[effect['id'] for effect in found['effects']]}")


def main() -> None:
    """All of it, in this process but for the diagnosis."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--diagnose", action="store_true")
    given = parser.parse_args()
    print(f"python {platform.python_version()}, jax {jax.__version__}, {os.cpu_count()} cores")
    print(f"devices: {', '.join(map(str, jax.devices()))}")
    own = jnp.arange(3.0)
    before = devices_of(own)
    speed, seen = times_real_time(given.runs, given.seconds)
    print(f"as placed: on {sorted(seen)}, {speed:.0f} times real time", flush=True)
    after = devices_of((own + 1.0, jnp.ones(3)))
    print(f"the user's own arrays: on {sorted(before)} before, {sorted(after)} after")
    default = jax.devices()[0]
    if default.platform != "cpu":
        memory = default.memory_stats() or {}
        print(f"in use on {default}: {memory.get('bytes_in_use', 'unknown')} bytes")
        jax_setup._processor = lambda: default  # type: ignore[assignment]
        speed, seen = times_real_time(given.runs, given.seconds)
        print(f"for comparison: on {sorted(seen)}, {speed:.0f} times real time", flush=True)
    if given.diagnose:
        diagnosis()


if __name__ == "__main__":
    main()

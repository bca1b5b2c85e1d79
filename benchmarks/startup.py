"""How quickly the commands start: whole processes, in turn, median of several.

    python benchmarks/startup.py

Prints, for each pair, both medians of processor time and their ratio. The processes of a pair take
turns, so that a machine that slows down slows both.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.history import in_turn  # noqa: E402

RUNS = 5
LOG_BYTES = 2_000_000


def compare(
    name: str,
    ours: Sequence[str],
    theirs: Sequence[str],
    limit: float,
    folder: Path | None = None,
) -> None:
    """Print and record the medians of both and of the ratio pair by pair."""
    in_turn(f"startup, {name}", ours, theirs, folder, RUNS)
    print(f"  (at most {limit:g})")


def two_megabyte_log(folder: Path) -> Path:
    """Generated friction ramps (seed 1), repeated until the file holds 2 MB."""
    from datasets.generator.campaign import make_friction_tests
    from datasets.generator.files import write_log
    from datasets.generator.rigs import rig_toml

    (folder / "rig.toml").write_text(rig_toml(make_friction_tests(1).rig))
    path = folder / "friction_static.csv"
    for repeats in range(3, 40, 2):
        tests = make_friction_tests(1, repeats=repeats, kinds=("friction-static",))
        write_log(path, tests.kinds["friction-static"], tests.generated_rig)
        if path.stat().st_size >= LOG_BYTES:
            return path
    raise RuntimeError("the generated ramps do not fill 2 MB")


def main() -> None:
    """The figures of issue 2's item 5, issue 13's point 6, issue 50: with bundle and page."""
    python, sysid = sys.executable, str(Path(sys.executable).with_name("sysid"))
    compare("import sysid", [python, "-c", "import sysid"], [python, "-c", "import numpy"], 0.3)
    compare("sysid --help", [sysid, "--help"], [python, "-c", "import numpy"], 3.0)
    with tempfile.TemporaryDirectory() as folder:
        log = two_megabyte_log(Path(folder))
        print(f"log: {log.stat().st_size / 1e6:.2f} MB")
        compare(
            "sysid fit friction, 2 MB",
            [sysid, "fit", "friction", str(log)],
            [python, "-c", "import pandas, scipy.signal"],
            3.0,
            log.parent,
        )
        compare(
            "sysid fit friction, 2 MB, against reading",
            [sysid, "fit", "friction", str(log)],
            [python, "-c", f"import sysid; sysid.read_log({str(log)!r})"],
            2.0,
            log.parent,
        )


if __name__ == "__main__":
    main()

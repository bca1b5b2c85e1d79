"""The release check: `make dist`.

    python tools/release_check.py [--into dist]

Builds the source distribution and, from it, the wheel; looks into both; installs the wheel into an
empty environment in a folder elsewhere and runs `sysid demo` there, so that nothing of the
repository is in reach. Prints sizes and times; fails, with one line, at the first thing that is
not as it should be.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import venv
import zipfile
from collections.abc import Sequence
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.history import record  # noqa: E402

# In the wheel: what the commands need of the data.
NEEDED = ("sysid/_bundled/campaign.toml", "sysid/_bundled/rig.toml", "sysid/py.typed")
UNWANTED = ("tests/", "benchmarks/", "datasets/", "reports/", "docs/", "tools/")
RESULTS = ("bundle.json", "report.html", "diagnosis.json", "export/model.h", "export/model.mat")


def run(words: Sequence[str | Path], folder: Path) -> float:
    """Run a command elsewhere than in the repository; its wall time, s."""
    own = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    start = time.perf_counter()
    done = subprocess.run([str(w) for w in words], cwd=folder, env=own, check=False)
    if done.returncode:
        raise SystemExit(f"release check: exit {done.returncode} of {' '.join(map(str, words))}")
    return time.perf_counter() - start


def built(into: Path) -> tuple[Path, Path]:
    """The source distribution, and the wheel that is built from it."""
    shutil.rmtree(into, ignore_errors=True)
    run([sys.executable, "-m", "build", "--outdir", into, REPOSITORY], Path(tempfile.gettempdir()))
    (source,), (wheel,) = into.glob("*.tar.gz"), into.glob("*.whl")
    return source, wheel


def check_content(source: Path, wheel: Path) -> None:
    """The wheel holds the package and the bundled campaign alone; the source can be tested."""
    names = zipfile.ZipFile(wheel).namelist()
    missing = [name for name in NEEDED if name not in names]
    logs = {p.name for p in (REPOSITORY / "datasets" / "bundled").iterdir()}
    missing += [f"sysid/_bundled/{n}" for n in logs if f"sysid/_bundled/{n}" not in names]
    if missing:
        raise SystemExit(f"release check: {wheel.name} lacks {', '.join(missing)}")
    foreign = [n for n in names if n.startswith(UNWANTED) or "/test_" in n]
    foreign += [n for n in names if not n.startswith(("sysid/", "sysid-"))]
    if foreign:
        raise SystemExit(f"release check: {wheel.name} holds {', '.join(foreign[:5])}")
    with tarfile.open(source) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    for name in ("pyproject.toml", "README.md", "tests/test_cli.py", "datasets/bundled/rig.toml"):
        if name not in inside:
            raise SystemExit(f"release check: {source.name} lacks {name}")


def demonstrated(wheel: Path, folder: Path) -> tuple[float, float]:
    """Seconds of the installation into an empty environment, and of `sysid demo` from it."""
    place = folder / "environment"
    venv.create(place, with_pip=True)
    binaries = place / ("Scripts" if os.name == "nt" else "bin")
    constraints: list[str | Path] = ["-c", REPOSITORY / "constraints.txt"]
    installing = run(
        [binaries / "python", "-m", "pip", "install", "-q", *constraints, wheel], folder
    )
    code = "import sysid, sys; sys.exit(not sysid.__file__.startswith(sys.prefix))"
    run([binaries / "python", "-c", code], folder)
    demo = run([binaries / "sysid", "demo", "-o", folder / "demo"], folder)
    for name in RESULTS:
        if not (folder / "demo" / name).is_file():
            raise SystemExit(f"release check: sysid demo wrote no {name}")
    return installing, demo


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--into", type=Path, default=REPOSITORY / "dist")
    into = parser.parse_args().into.resolve()
    start = time.perf_counter()
    source, wheel = built(into)
    building = time.perf_counter() - start
    check_content(source, wheel)
    with tempfile.TemporaryDirectory(prefix="sysid-release-") as folder:
        installing, demo = demonstrated(wheel, Path(folder))
    for path in (source, wheel):
        print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB")
    record("wheel, size", wheel.stat().st_size / 1e6, "MB")
    record("wheel, sysid demo from it", demo, "s")
    print(f"built in {building:.0f} s, installed in {installing:.0f} s, demo in {demo:.0f} s")


if __name__ == "__main__":
    main()

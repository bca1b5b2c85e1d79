"""Runs measured sets with the ordinary command line, each command in a separate process.

    sysid convert SOURCE --spec recipe.toml -o WORK/set/log.csv [--rows FIRST:LAST]
    sysid fit CAMPAIGN -o bundle.json
    sysid diagnose CAMPAIGN --bundle bundle.json -o extended.json --report report.html --json

Nothing here depends on a particular set. The commands' output is kept, without machine paths.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from datasets.measured.sets import (
    PROJECT,
    SET_FILE,
    Conversion,
    MeasuredSet,
    SetCampaign,
    read_set,
    set_folders,
)
from sysid import __version__
from sysid.errors import InputError, SysidError, input_error
from sysid.estimation.linear import Estimate
from sysid.parameters import Bundle, read_bundle
from sysid.parameters.base import Part
from sysid.types import Progress

# Conversions at a time.
_PROCESSES = 2


class CommandFailedError(SysidError):
    """A failed `sysid` command: its error line and exit status."""

    def __init__(self, line: str, status: int) -> None:
        super().__init__(line)
        self.status = status


def chosen(root: Path, only: Sequence[str], data: Path) -> list[Path]:
    """The folders under `root` of the sets to run: all, or those named.

    Raises InputError for an unknown set, and if a set needs the data folder and it is missing.
    """
    folders = set_folders(root)
    names = [folder.name for folder in folders]
    for name in only:
        if name not in names:
            known = ", ".join(names) or "none"
            raise input_error(f"--only {name}", "is not a measured set", f"there are: {known}")
    picked = [folder for folder in folders if not only or folder.name in only]
    if not picked:
        raise input_error(root, f"no folder with a {SET_FILE}", "add a set (see README.md)")
    if not data.is_dir() and any(_needs_shared(folder) for folder in picked):
        raise input_error(
            data,
            "the folder of the measured data is missing",
            "name it with --data (the data are not part of the project)",
        )
    return picked


def _needs_shared(folder: Path) -> bool:
    try:
        return read_set(folder).data == "shared"
    except InputError:
        return False  # reports the error itself when it is run


def run_sets(
    folders: Sequence[Path], data: Path, work: Path, progress: Progress = lambda line: None
) -> dict[str, Any]:
    """Run sets one after another: `version` and, under `sets`, what `run_set` gives of each."""
    root = work.resolve()
    if root.is_relative_to(PROJECT / "datasets"):
        raise input_error(work, "is inside the project", "name a folder outside it")
    found = []
    for folder in folders:
        start = time.monotonic()
        found.append(run_set(folder, data.resolve(), root / folder.name, progress))
        progress(f"{folder.name}: done in {time.monotonic() - start:.0f} s")
    return {"sysid_version": __version__, "sets": found}


def run_set(folder: Path, data: Path, work: Path, progress: Progress) -> dict[str, Any]:
    """One set in the folder `work`: its description, `problem` or None, and its campaigns.

    A failure is reported under `problem` (of the set, or of one campaign); the others continue.
    """
    try:
        measured = read_set(folder)
    except InputError as error:
        problem = _without_paths(str(error), (folder, PROJECT))
        progress(f"{folder.name}: failed: {problem}")
        return {"name": folder.name, "title": folder.name, "problem": problem, "campaigns": []}
    said = {
        key: getattr(measured, key)
        for key in ("name", "title", "question", "source", "licence", "folder", "data", "notices")
    }
    said |= {"notices": list(measured.notices), "problem": None, "campaigns": []}
    base = data if measured.data == "shared" else PROJECT
    hidden = (work, base, folder, PROJECT)
    try:
        work.mkdir(parents=True, exist_ok=True)
        for file in sorted(folder.glob("*.toml")):
            shutil.copyfile(file, work / file.name)
        convert_all(measured, base, work, progress)
    except (SysidError, OSError) as error:
        said["problem"] = _without_paths(str(error), hidden)
        progress(f"{measured.name}: failed: {said['problem']}")
        return said
    for campaign in measured.campaigns:
        said["campaigns"].append(_run_campaign(measured, campaign, work, hidden, progress))
    return said


def convert_all(measured: MeasuredSet, base: Path, work: Path, progress: Progress) -> None:
    """Every log of a set, several at a time: most of a conversion is process start-up."""
    from concurrent.futures import ThreadPoolExecutor

    def convert(conversion: Conversion) -> None:
        progress(f"{measured.name}: converting {', '.join(conversion.sources)}")
        _convert(conversion, base, work)

    with ThreadPoolExecutor(_PROCESSES) as pool:
        waiting = [pool.submit(convert, conversion) for conversion in measured.conversions]
        try:
            for conversion in waiting:
                conversion.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _convert(conversion: Conversion, base: Path, work: Path) -> None:
    sources = [base / conversion.folder / source for source in conversion.sources]
    options = ["--spec", conversion.recipe, "-o", conversion.log]
    if conversion.test is not None:
        options += ["--set", f"test={conversion.test}"]
    if conversion.rows is not None:
        options += ["--rows", conversion.rows]
    _sysid(["convert", *map(str, sources), *options], work)


def _run_campaign(
    measured: MeasuredSet,
    campaign: SetCampaign,
    work: Path,
    hidden: Sequence[Path],
    progress: Progress,
) -> dict[str, Any]:
    """`fit` and `diagnose` of one campaign: the law, the diagnosis, or what went wrong."""
    said: dict[str, Any] = {
        "file": campaign.file,
        "name": campaign.name,
        "repeat": campaign.repeat,
        "of": campaign.of,
        "known": campaign.known,
        "problem": None,
        "status": 0,
        "law": {},
        "diagnosis": None,
    }
    results = Path("results") / Path(campaign.file).stem
    (work / results).mkdir(parents=True, exist_ok=True)
    bundle, extended = str(results / "bundle.json"), str(results / "extended.json")
    try:
        progress(f"{measured.name}: fitting {campaign.file} ({campaign.name})")
        _sysid(["fit", campaign.file, "-o", bundle], work)
        said["law"] = law_of(read_bundle(work / bundle))
        progress(f"{measured.name}: diagnosing {campaign.file}")
        report = str(results / "report.html")
        options = ["--bundle", bundle, "-o", extended, "--report", report, "--json"]
        found = _sysid(["diagnose", campaign.file, *options], work)
        found.pop("written", None)
        said["diagnosis"] = found
    except CommandFailedError as error:
        said["problem"] = _without_paths(str(error), hidden)
        said["status"] = error.status
        progress(f"{measured.name}: {campaign.file}: failed: {said['problem']}")
    return said


def _sysid(arguments: Sequence[str], folder: Path) -> dict[str, Any]:
    """The JSON that a `sysid` command prints, run in `folder`; {} if it prints none.

    Raises CommandFailedError with the command's own line.
    """
    path = os.pathsep.join(filter(None, (str(PROJECT), os.environ.get("PYTHONPATH", ""))))
    done = subprocess.run(
        [sys.executable, "-m", "sysid", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    command = f"sysid {arguments[0]}"
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        said = [line for line in lines if line.startswith(("sysid: error:", "sysid: fault:"))]
        line = (said or lines or ["nothing on standard error"])[-1]
        line = line.removeprefix("sysid: ").strip()
        raise CommandFailedError(f"{command}: {line}", done.returncode)
    if "--json" not in arguments:
        return {}
    try:
        content = json.loads(done.stdout)
    except json.JSONDecodeError as error:
        raise CommandFailedError(f"{command} printed no JSON: {error}", 1) from None
    if not isinstance(content, dict):
        raise CommandFailedError(f"{command} printed no JSON object", 1)
    return content


def law_of(bundle: Bundle) -> dict[str, dict[str, Any]]:
    """The estimates of a bundle's laws by their dotted names, as `Estimate.to_json` has them."""
    laws = {"friction": bundle.friction, "valves": bundle.valves}
    return {
        name: estimate.to_json()
        for key in bundle.given()
        for name, estimate in _estimates(laws.get(key), key)
    }


def _estimates(part: Any, name: str) -> Iterator[tuple[str, Estimate]]:
    """The estimates of a part and of the parts in it, in the file's order."""
    if isinstance(part, Estimate):
        yield name, part
    elif isinstance(part, Part):
        for key in part.given():
            yield from _estimates(getattr(part, key), f"{name}.{key}")
    elif isinstance(part, Mapping):
        for key, inner in part.items():
            yield from _estimates(inner, f"{name}.{key}")


def _without_paths(line: str, folders: Sequence[Path]) -> str:
    """A line in which file names are relative to the set's or the data's folder."""
    for folder in folders:
        line = line.replace(f"{folder}{os.sep}", "").replace(str(folder), folder.name)
    return " ".join(line.split())


def failed(results: Mapping[str, Any]) -> bool:
    """Whether a set, or a campaign of one, has failed."""
    return any(
        entry["problem"] is not None
        for measured in results["sets"]
        for entry in (measured, *measured["campaigns"])
    )


__all__ = ["CommandFailedError", "chosen", "failed", "law_of", "run_set", "run_sets"]

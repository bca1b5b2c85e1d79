"""Today's behaviour, frozen: bundles, exports, error lines, what commands print, the schema.

A change that is not meant to be seen by a user may not change any of this. Where a change is
meant, write the golden files again and read their difference:

    SYSID_GOLDEN_WRITE=1 python -m pytest tests/test_golden.py     (without -n)

`golden/bundles`, `golden/inputs` and `golden/bundle.schema.json` are never written again: they
are the past's own files, and stay readable. `created`, versions and folders are left out of the
comparison; numbers out of computations are compared within a tolerance, the rest exactly.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from golden_bundles import BEYOND_SCHEMA, CHANGES, TEXTS, changed
from golden_errors import CASES
from golden_folder import (
    BUNDLES,
    GOLDEN,
    REL_EXPORT,
    Folder,
    as_json,
    differences,
    golden_bundle,
    masked,
    run,
    text_differences,
)
from golden_runs import RUNS, Run
from scipy.io import loadmat
from test_bad_input import CASES as BAD_INPUT
from test_bad_input import Workplace

from sysid.parameters import read_bundle, write_bundle

WRITE = bool(os.environ.get("SYSID_GOLDEN_WRITE"))
EXPORTED = ("diagnosed", "friction_partial", "linear_axis")
EXPORTS = {"c": "h", "mat": "mat", "json": "json"}
# Not the same for every user, or too long to be kept.
_UNKEPT = ("no permission",)
LOG_CASES = {f"log: {c.name}": c for c in BAD_INPUT if c.name not in _UNKEPT}


class Store:
    """A golden JSON file: compared with by default, filled when writing."""

    def __init__(self, name: str) -> None:
        self.path = GOLDEN / name
        self.content: dict[str, Any] = {}
        if self.path.exists() and not WRITE:
            self.content = json.loads(self.path.read_text("utf-8"))

    def wanted(self, name: str, found: Any) -> Any:
        """What is frozen under a name; when writing, what was found."""
        if WRITE:
            self.content[name] = found
        assert name in self.content, f"{name} is not frozen: write the golden files again"
        return self.content[name]

    def save(self) -> None:
        """Write the file, if that is what this run is for."""
        if WRITE and self.content:
            text = json.dumps(self.content, indent=1, ensure_ascii=False, sort_keys=True)
            self.path.write_text(text + "\n", "utf-8")


def _store(name: str) -> Iterator[Store]:
    store = Store(name)
    yield store
    store.save()


@pytest.fixture(scope="module")
def errors() -> Iterator[Store]:
    yield from _store("errors.json")


@pytest.fixture(scope="module")
def bundle_errors() -> Iterator[Store]:
    yield from _store("bundle_errors.json")


@pytest.fixture(scope="module")
def runs() -> Iterator[Store]:
    yield from _store("runs.json")


@pytest.fixture(scope="module")
def schema() -> Any:
    import jsonschema

    content = json.loads((GOLDEN / "bundle.schema.json").read_text("utf-8"))
    return jsonschema.Draft202012Validator(content)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Folder:
    """Sound inputs, and nothing from outside that would change what is printed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("SYSID_DEBUG", "FORCE_COLOR", "NO_COLOR", "LINES"):
        monkeypatch.delenv(name, raising=False)
    return Folder(tmp_path)


def _compare(found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Exit status and standard error, which hold no number out of a fit, exactly."""
    assert found == wanted


# --- bundles -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUNDLES)
def test_a_bundle_is_written_as_it_was_read(name: str, tmp_path: Path) -> None:
    write_bundle(read_bundle(golden_bundle(name)), tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == golden_bundle(name).read_bytes()


@pytest.mark.parametrize("name", BUNDLES)
def test_a_bundle_is_within_the_frozen_schema(name: str, schema: Any) -> None:
    schema.validate(json.loads(golden_bundle(name).read_bytes()))


@pytest.mark.parametrize("name", CHANGES)
def test_the_reader_refuses_what_the_frozen_schema_refuses(
    name: str, schema: Any, tmp_path: Path
) -> None:
    text = changed(name)
    (tmp_path / "bundle.json").write_text(text)
    allowed, accepted = schema.is_valid(json.loads(text)), _is_read(tmp_path / "bundle.json")
    assert accepted == allowed or (allowed and name in BEYOND_SCHEMA)


def _is_read(path: Path) -> bool:
    try:
        read_bundle(path)
    except Exception as error:
        assert type(error).__name__ == "InputError"
        return False
    return True


def _is_settled(name: str, word: str, code: int, path: Path) -> bool:
    """Whether the commands after `word` show nothing that it did not; saves most of the time."""
    if word == "export":
        return code != 0 and not _is_read(path)
    return word == "simulate" and code == 0 and name != "sound"


BUNDLE_COMMANDS = {
    "export": "export bundle.json --format json -o out.json",
    "simulate": "simulate motion.csv --bundle bundle.json -o out.csv",
    "validate": "validate motion.toml --bundle bundle.json",
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", [*CHANGES, *TEXTS])
def test_a_spoilt_bundle(
    name: str, folder: Folder, bundle_errors: Store, capsys: pytest.CaptureFixture[str]
) -> None:
    """What cannot be read gives every command one line; what can be simulated, be validated."""
    data = TEXTS[name] if name in TEXTS else changed(name).encode()
    (folder.path / "bundle.json").write_bytes(data)
    found: dict[str, Any] = {}
    for word, line in BUNDLE_COMMANDS.items():
        found[word] = run(line.split(), folder, capsys)
        del found[word]["stdout"]
        if _is_settled(name, word, found[word]["exit"], folder.path / "bundle.json"):
            break
    wanted = bundle_errors.wanted(name, found)
    assert list(found) == list(wanted)
    for word in found:
        _compare(found[word], wanted[word])


# --- error lines -------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_an_error_line(
    name: str, folder: Folder, errors: Store, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run(CASES[name](folder), folder, capsys)
    del found["stdout"]
    _compare(found, errors.wanted(name, found))


@pytest.mark.parametrize("name", LOG_CASES)
def test_a_spoilt_log(
    name: str, folder: Folder, rig_text: str, errors: Store, capsys: pytest.CaptureFixture[str]
) -> None:
    work = Workplace(folder.path, rig_text)
    LOG_CASES[name].spoil(work)
    found = run(work.arguments, folder, capsys)
    del found["stdout"]
    _compare(found, errors.wanted(name, found))


# --- what succeeds -----------------------------------------------------------------------


@pytest.mark.parametrize("name", RUNS)
def test_a_command(
    name: str, folder: Folder, runs: Store, capsys: pytest.CaptureFixture[str]
) -> None:
    case = RUNS[name]
    found = run(case.prepare(folder), folder, capsys)
    found["written"] = {n: masked(folder.text(n), folder.path) for n in case.written}
    wanted = runs.wanted(name, found)
    assert found["exit"] == wanted["exit"] == 0, found["stderr"]
    assert list(found["written"]) == list(wanted["written"])
    if case.exact:
        assert found == wanted
    else:
        _compare_loosely(found, wanted, case)


def _compare_loosely(found: dict[str, Any], wanted: dict[str, Any], case: Run) -> None:
    texts = [(found[k], wanted[k]) for k in ("stdout", "stderr")]
    texts += [(found["written"][n], wanted["written"][n]) for n in case.written]
    for text, known in texts:
        content = as_json(known)
        if content is None:
            assert text_differences(text, known) == []
        else:
            assert differences(json.loads(text), content) == []


@pytest.mark.parametrize("name", EXPORTED)
@pytest.mark.parametrize("kind", EXPORTS)
def test_an_export(
    name: str, kind: str, folder: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.bundle(name)
    out = folder.path / f"out.{EXPORTS[kind]}"
    words = ["export", "bundle.json", "--format", kind, "-o", out.name]
    assert run(words, folder, capsys)["exit"] == 0
    frozen = GOLDEN / "exports" / f"{name}.{EXPORTS[kind]}"
    if WRITE:
        frozen.write_bytes(out.read_bytes())
    if kind == "mat":
        found, wanted = (loadmat(p, struct_as_record=False)["sysid"] for p in (out, frozen))
        assert _as_read(_plain(found)) == _plain(wanted)
    else:
        assert text_differences(out.read_text(), frozen.read_text(), REL_EXPORT, 0.0) == []


def _as_read(value: Any) -> Any:
    """The same content, its numbers equal to any that is as near as an export's have to be."""
    if isinstance(value, dict):
        return {key: _as_read(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_as_read(item) for item in value]
    return pytest.approx(value, rel=REL_EXPORT, abs=0.0) if isinstance(value, float) else value


def _plain(value: Any) -> Any:
    """A MAT struct's content as what `==` compares; NaN as text, shapes kept."""
    if hasattr(value, "_fieldnames"):
        return {name: _plain(getattr(value, name)) for name in value._fieldnames}
    if isinstance(value, np.ndarray):
        return [list(value.shape), *(_plain(item) for item in value.ravel())]
    return "NaN" if isinstance(value, float) and np.isnan(value) else value


def test_no_case_is_lost(errors: Store, bundle_errors: Store, runs: Store) -> None:
    """What is frozen and no longer tried would be a hole."""
    for store, names in ((errors, {*CASES, *LOG_CASES}), (bundle_errors, {*CHANGES, *TEXTS})):
        assert set(store.content) <= names
    assert set(runs.content) <= set(RUNS)
    assert len(CASES) + len(LOG_CASES) + len(CHANGES) + len(TEXTS) > 300

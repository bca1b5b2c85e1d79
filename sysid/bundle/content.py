"""The parameter bundle: what a controller, a simulator or a later fit needs, in one JSON file.

The contract is `spec/bundle.md`; the schema is `bundle.schema.json` in this package. Every
bundle is checked against it when written and when read. Reading one never runs code.
"""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from sysid import __version__
from sysid.errors import InputError, input_error
from sysid.io.files import write_atomic
from sysid.io.logs import Log
from sysid.io.rig import Rig, rig_from_content
from sysid.io.source import Source
from sysid.io.tables import read_bytes

SCHEMA = "sysid-bundle/1"
# Of a number that a message quotes.
_LONGEST = 40


def new_bundle(
    rig: Rig,
    parts: Mapping[str, Any],
    sources: Iterable[Source],
    *,
    seeds: Mapping[str, int] | None = None,
    options: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """A bundle of the given parts (`friction`, `valves`, ...), unchecked until written."""
    now = datetime.datetime.now(datetime.UTC)
    return {
        "schema": SCHEMA,
        "created": now.isoformat(timespec="seconds"),
        "sysid_version": __version__,
        "rig": rig.content,
        **parts,
        "effects": list(parts.get("effects", [])),
        "provenance": {
            "logs": [s.to_json() for s in sources],
            "seeds": dict(seeds or {}),
            "options": dict(options or {}),
        },
    }


def write_bundle(bundle: Mapping[str, Any], path: Path) -> None:
    """Check a bundle against the schema and write it, whole or not at all."""
    _validate(bundle, path)
    write_atomic(path, bundle_text(bundle))


def bundle_text(bundle: Mapping[str, Any]) -> str:
    """A bundle as its file holds it; ValueError for a number that is not finite."""
    return json.dumps(bundle, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def read_bundle(path: Path) -> dict[str, Any]:
    """Read and check a bundle. Raises InputError naming the key that is wrong."""
    raw = read_bytes(path, "a bundle")
    try:
        bundle = json.loads(
            raw.decode("utf-8-sig"), parse_constant=_finite, parse_float=_finite, parse_int=_whole
        )
    except UnicodeDecodeError:
        raise input_error(path, "is not UTF-8 text", "a bundle is JSON in UTF-8") from None
    except json.JSONDecodeError as error:
        raise input_error(
            f"{path}, line {error.lineno}", f"is not JSON ({error.msg})", "write the bundle again"
        ) from None
    except _NotFiniteError as error:
        raise input_error(path, f"holds {error}", "a bundle holds finite numbers only") from None
    except RecursionError:
        raise input_error(path, "is nested without end", "write the bundle again") from None
    _validate(bundle, path)
    rig_from_content(bundle["rig"], f"{path}, rig")
    return dict(bundle)


def bundle_rig(bundle: Mapping[str, Any], path: Path) -> Rig:
    """The rig that a bundle was fitted for."""
    return rig_from_content(bundle["rig"], f"{path}, rig")


def merge(base: Mapping[str, Any], part: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """`base` (read from `path`) with the parts of `part` added; a part that both hold is replaced.

    The validation of what there was goes with it. Raises InputError where the two were fitted
    for different rigs.
    """
    for section in sorted(set(base["rig"]) | set(part["rig"])):
        if base["rig"].get(section) != part["rig"].get(section):
            raise input_error(
                path,
                f"was fitted with another rig file ([{section}] differs)",
                "fit both with the same rig file, or write a new bundle with -o",
            )
    merged = {**base, **{k: v for k, v in part.items() if k != "effects"}}
    if "valves" in base and "valves" in part:
        merged["valves"] = merge_valves(base["valves"], part["valves"])
    merged["effects"] = part["effects"] or base["effects"]
    merged.pop("validation", None)
    merged["provenance"] = _merge_provenance(base["provenance"], part)
    return merged


def merge_valves(base: Mapping[str, Any], part: Mapping[str, Any]) -> dict[str, Any]:
    """Two `valves` tables in one: by valve, by model, and for PWM by direction."""
    merged = dict(base)
    for valve, models in part.items():
        before = dict(merged.get(valve, {}))
        for model, content in models.items():
            kept = before.get(model, {}) if model == "pwm" else {}
            before[model] = {**kept, **content}
        merged[valve] = before
    return merged


def _merge_provenance(base: Mapping[str, Any], part: Mapping[str, Any]) -> dict[str, Any]:
    """Friction is replaced whole, and its logs with it; valves may come one by one."""
    own = part["provenance"]
    replaced = "friction" in part
    kept = [e for e in base["logs"] if not replaced or _family(e.get("kind", "")) != "friction"]
    return {
        "logs": _without_doubles([*kept, *own["logs"]]),
        "seeds": {**base.get("seeds", {}), **own.get("seeds", {})},
        "options": {**base.get("options", {}), **own.get("options", {})},
    }


def _without_doubles(logs: Iterable[Mapping[str, str]]) -> list[Mapping[str, str]]:
    return list({(e["sha256"], e.get("kind"), e["use"]): e for e in logs}.values())


def add_sources(bundle: dict[str, Any], sources: Iterable[Source]) -> None:
    """Put logs into a bundle's provenance that it does not list yet."""
    provenance = bundle["provenance"]
    known = _without_doubles([*provenance["logs"], *(s.to_json() for s in sources)])
    bundle["provenance"] = {**provenance, "logs": known}


def _family(kind: str) -> str:
    """What a kind of log is fitted to: a partial fit of friction calls all its kinds so."""
    return "friction" if kind.startswith("friction") else kind


def check_log_unchanged(bundle: Mapping[str, Any], log: Log, kind: str, path: Path) -> None:
    """InputError where a log of `kind` has changed since the bundle was fitted on it.

    Logs of several folders may share a name: the bundle has to know one that is like it.
    """
    logs = bundle["provenance"]["logs"]
    fitted = any(
        entry["use"] == "fit"
        and entry["file"] == log.path.name
        and _family(str(entry.get("kind", ""))) == _family(kind)
        for entry in logs
    )
    if fitted and all(entry["sha256"] != log.sha256 for entry in logs):
        raise input_error(
            path,
            f"{log.path.name} has changed since this bundle was fitted on it (SHA-256)",
            "fit again, or bring the old log back",
        )


def check_not_fitted(bundle: Mapping[str, Any], log: Log, path: Path) -> None:
    """InputError where a log that the campaign holds out is one that the bundle was fitted on."""
    for entry in bundle["provenance"]["logs"]:
        if entry["use"] == "fit" and entry["sha256"] == log.sha256:
            raise input_error(
                log.path,
                f"is held out in the campaign, but {path} was fitted on it ({entry['file']})",
                'fit without it, or give it use = "fit"',
            )


class _NotFiniteError(ValueError):
    pass


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise _NotFiniteError(text if len(text) < _LONGEST else f"{text[:_LONGEST]}...")
    return value


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


def _validate(bundle: Any, path: Path) -> None:
    if not isinstance(bundle, Mapping):
        raise input_error(path, "is not a JSON object", "name a bundle that sysid wrote")
    version = bundle.get("schema")
    if version != SCHEMA:
        found = "has no `schema`" if version is None else f"has schema {version!r}"
        raise input_error(path, f"{found}, not {SCHEMA!r}", "fit again with this version of sysid")
    import jsonschema

    text = resources.files("sysid.bundle").joinpath("bundle.schema.json").read_text("utf-8")
    validator = jsonschema.Draft202012Validator(json.loads(text))
    error = jsonschema.exceptions.best_match(validator.iter_errors(bundle))
    if error is not None:
        raise _schema_error(error, path)


def _schema_error(error: Any, path: Path) -> InputError:
    key = ".".join(str(p) for p in error.absolute_path) or "the bundle"
    return input_error(
        path,
        f"{key}: {error.message[:160]}",
        "mend that key, or fit again to write the bundle anew",
    )

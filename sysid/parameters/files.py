"""Bundles in files: read with every key checked, written whole or not at all.

The contract is `docs/reference/bundle.md`; the schema is `bundle.schema.json`, generated from the
classes of this package by `sysid.parameters.schema`. Reading a bundle never runs code.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from sysid.errors import InputError, input_error
from sysid.io.channels import SIDES
from sysid.io.files import write_atomic
from sysid.io.tables import read_bytes
from sysid.parameters.base import FileContext
from sysid.parameters.bundle import Bundle
from sysid.parameters.content import SCHEMA

SCHEMA_FILE = "bundle.schema.json"


def write_bundle(bundle: Bundle, path: Path) -> None:
    """Check a bundle against the schema and write it, whole or not at all."""
    content = bundle.to_json()
    bundle_from_json(content, path)
    write_atomic(path, _text(content), is_bundle=True)


def bundle_text(bundle: Bundle) -> str:
    """A bundle as text of its file; ValueError for a number that is not finite."""
    return _text(bundle.to_json())


def _text(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def read_bundle(path: Path) -> Bundle:
    """Read and check a bundle. Raises InputError naming the key that is wrong."""
    raw = read_bytes(path, "a bundle", is_bundle=True)
    try:
        content = json.loads(
            raw.decode("utf-8-sig"), parse_constant=_finite, parse_float=_finite, parse_int=_whole
        )
    except UnicodeDecodeError:
        raise input_error(path, "is not UTF-8 text", "a bundle is JSON in UTF-8") from None
    except json.JSONDecodeError as error:
        if path.suffix == ".toml":
            said = "is a campaign or rig file, not a bundle"
            raise input_error(path, said, "give the JSON file that sysid fit wrote") from None
        raise input_error(
            f"{path}, line {error.lineno}", f"is not JSON ({error.msg})", "write the bundle again"
        ) from None
    except _NotFiniteError as error:
        raise input_error(path, f"holds {error}", "a bundle holds finite numbers only") from None
    except RecursionError:
        raise input_error(path, "is nested too deeply", "write the bundle again") from None
    bundle = bundle_from_json(content, path)
    _check_flows(bundle, path)
    bundle.rig  # noqa: B018  (raises for implausible constants)
    return bundle


def _check_flows(bundle: Bundle, path: Path) -> None:
    """A flow or flow coefficient below 0 would fill a chamber that empties."""
    for side in SIDES:
        law = bundle.valve(side).discrete
        if law is None:
            continue
        estimates = law.estimates()
        for key in law.flow_keys().values():
            estimate = estimates.get(key)
            if estimate is not None and estimate.identified and estimate.value < 0.0:
                raise input_error(
                    f"{path}, valves.{side}.discrete",
                    f"{key} is {estimate.value:.3g}, but no flow is below 0",
                    "fit the valve again",
                )


def bundle_from_json(content: Any, path: Path) -> Bundle:
    """A bundle from a file's content. Raises InputError, in the schema's words where it has any.

    The classes, from which the schema is generated, are the only validation; they also check what
    a schema cannot express (whether a matrix is a correlation).
    """
    if not isinstance(content, Mapping):
        raise input_error(path, "is not a JSON object", "give a bundle written by sysid")
    version = content.get("schema")
    if version != SCHEMA:
        found = "has no `schema`" if version is None else f"has schema {version!r}"
        raise input_error(path, f"{found}, not {SCHEMA!r}", "fit again with this version of sysid")
    try:
        return Bundle.model_validate(content, context=FileContext()).named(str(path))
    except ValidationError as error:
        raise _unusable(path, *_fault(content, error)) from None


def _fault(content: Any, found: ValidationError) -> tuple[str, str]:
    """The key that is wrong, and what is wrong with it."""
    import jsonschema

    validator = jsonschema.Draft202012Validator(shipped_schema())
    error = jsonschema.exceptions.best_match(validator.iter_errors(content))
    if error is not None:
        return ".".join(str(p) for p in error.absolute_path) or "the bundle", error.message
    first = found.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"])
    return place, first["msg"].removeprefix("Value error, ")


class _NotFiniteError(ValueError):
    pass


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise _NotFiniteError(text if len(text) < 40 else f"{text[:40]}...")
    return value


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


@functools.cache
def shipped_schema() -> dict[str, Any]:
    """The JSON schema in this package."""
    text = resources.files("sysid.parameters").joinpath(SCHEMA_FILE).read_text("utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def _unusable(path: Path, key: str, what: str) -> InputError:
    return input_error(
        path, f"{key}: {what[:160]}", "fix that key, or fit again to rewrite the bundle"
    )


__all__ = ["bundle_from_json", "bundle_text", "read_bundle", "shipped_schema", "write_bundle"]

"""Rig file, campaign file and bundle as pages, from their declarations and the schema."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sysid.io.campaign import CampaignFile, LogEntry
from sysid.io.channels import LOG_COLUMNS
from sysid.io.declaration import ChoiceKey, NumberKey, declared_keys
from sysid.io.rig_file import RIG_TABLES

_HEAD = "| key | unit | plausible | | meaning |\n| --- | --- | --- | --- | --- |\n"


def _rows(model: Any) -> Iterator[str]:
    for name, key in declared_keys(model).items():
        unit = limits = ""
        if isinstance(key, NumberKey):
            unit = key.range.unit
            limits = f"{key.range.lower:g} to {key.range.upper:g}"
        elif isinstance(key, ChoiceKey):
            limits = ", ".join(f"`{c}`" for c in key.allowed)
        field = model.model_fields[name]
        needed = "required" if field.is_required() else _default(field.default)
        yield f"| `{name}` | {unit} | {limits} | {needed} | {key.description} |"


def _default(value: Any) -> str:
    return "optional" if value is None else f"default `{value}`"


def log_columns() -> str:
    """The log format's columns."""
    rows = [f"| `{n}` | {c.si or '-'} | {c.meaning} |" for n, c in LOG_COLUMNS.items()]
    return "| column | unit | meaning |\n| --- | --- | --- |\n" + "\n".join(rows) + "\n"


def rig_file() -> str:
    """The rig file's sections and keys."""
    parts = [
        "# Rig file\n\nWhat is known about a rig before any test. `sysid init rig.toml` writes one "
        "with every key explained (`--linear` for a linear rig). SI units, absolute pressures. "
        "A section that a command does not need may be absent; one that is present is "
        "complete. A value outside what a real rig has is refused as a wrong unit.\n\n"
        "`assumed`, a list before the first section, names constants that nobody declared, as "
        "`sysid init --from LOG` writes it: results say what rests on them, and controllers use "
        "them only with `--accept-assumed`. Take a constant out of it once it is right.\n"
    ]
    for name, section in RIG_TABLES.items():
        about = (section.__doc__ or "").strip().splitlines()[0]
        parts.append(f"## `[{name}]`\n\n{about}\n\n{_HEAD}" + "\n".join(_rows(section)) + "\n")
    return "\n".join(parts)


def campaign_file() -> str:
    """The campaign file's keys."""
    shared = (CampaignFile.model_fields["map"].description or "").strip()
    own = (LogEntry.model_fields["map"].description or "").strip()
    table = "| `map` | | | optional | {} |"
    said = (LogEntry.model_fields["exclude"].description or "").strip()
    excluded = table.replace("map", "exclude").format(said)
    return "\n".join(
        [
            "# Campaign file\n",
            "A rig's tests together. Paths are relative to the campaign file. `sysid init "
            "campaign.toml` writes one to fill in, with a comment on each kind of test.\n",
            "## At the top\n",
            _HEAD + "\n".join([*_rows(CampaignFile), table.format(shared)]) + "\n",
            "## `[[log]]`, one per log\n",
            _HEAD + "\n".join([*_rows(LogEntry), table.format(own), excluded]) + "\n",
            "[A test went wrong](../how-to/test-went-wrong.md) shows what `exclude` does. The "
            "kinds are described under [log format](log-format.md).\n",
        ]
    )


def bundle() -> str:
    """The bundle's schema, a section per definition."""
    import sysid.parameters

    text = (Path(sysid.parameters.__file__).parent / "bundle.schema.json").read_text("utf-8")
    schema = json.loads(text)
    parts = [
        "# Bundle\n\nThe fitted model as one JSON file; `sysid/parameters/bundle.schema.json` is "
        "its JSON schema, from which this page is made. [Reading the bundle](../how-to/"
        "read-the-bundle.md) shows how a controller takes it in.\n",
        "## The file\n",
        schema["description"].replace("`docs/reference/bundle.md`", "this page") + "\n",
        _properties(schema),
    ]
    for name, definition in sorted(schema["$defs"].items()):
        parts.append(f"(bundle-{name.lower()})=\n## {name}\n")
        parts.append(definition.get("description", "").replace("\n", " ") + "\n")
        if definition.get("properties"):
            parts.append(_properties(definition))
    return "\n".join(parts)


def _properties(schema: Mapping[str, Any]) -> str:
    required = set(schema.get("required", ()))
    rows = []
    for name, one in schema.get("properties", {}).items():
        about = one.get("description", "").replace("\n", " ").replace("|", "\\|")
        need = "required" if name in required else ""
        rows.append(f"| `{name}` | {_type(one)} | {need} | {about} |")
    return "| key | type | | |\n| --- | --- | --- | --- |\n" + "\n".join(rows) + "\n"


def _type(one: Any) -> str:
    if not isinstance(one, Mapping) or not one:
        return "any"
    if "$ref" in one:
        name = one["$ref"].rpartition("/")[2]
        return f"[{name}](#bundle-{name.lower()})"
    if "const" in one:
        return f"`{one['const']}`"
    for key in ("anyOf", "oneOf"):
        if key in one:
            return " or ".join(_type(option) for option in one[key])
    if "enum" in one:
        return ", ".join(f"`{value}`" for value in one["enum"])
    kind = one.get("type", "any")
    kind = " or ".join(kind) if isinstance(kind, list) else kind
    if kind == "array" and "items" in one:
        return f"array of {_type(one['items'])}"
    if kind == "object" and isinstance(one.get("additionalProperties"), Mapping):
        return f"object of {_type(one['additionalProperties'])}"
    return str(kind)

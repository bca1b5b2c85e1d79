"""The bundle's JSON schema from its classes: `python -m sysid.parameters.schema` writes it.

Reading a bundle uses the shipped file; a test fails when the two differ.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sysid.parameters.bundle import Bundle
from sysid.parameters.content import SCHEMA
from sysid.parameters.files import SCHEMA_FILE

_NUMBER_OR_NULL = {"type": ["number", "null"]}
_STD = {"type": ["number", "null"], "minimum": 0}
_INTERVAL = {"type": "array", "items": _NUMBER_OR_NULL, "minItems": 2, "maxItems": 2}

# `sysid.estimation.linear.Estimate` in a file: in a bundle's part, and in an effect.
PARAMETER: dict[str, Any] = {
    "oneOf": [
        {
            "type": "object",
            "required": ["value", "std", "unit"],
            "properties": {
                "value": {"type": "number"},
                "std": _STD,
                "unit": {"type": "string"},
                "interval": _INTERVAL,
            },
        },
        {
            "type": "object",
            "required": ["value", "identified", "reason"],
            "properties": {
                "value": {"type": "null"},
                "identified": {"const": False},
                "reason": {"type": "string"},
            },
        },
    ]
}
EFFECT_PARAMETER: dict[str, Any] = {
    "type": "object",
    "required": ["value"],
    "properties": {
        "value": _NUMBER_OR_NULL,
        "std": _STD,
        "unit": {"type": "string"},
        "interval": _INTERVAL,
    },
}


def bundle_schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a bundle."""
    made = _tidy(Bundle.model_json_schema(mode="validation", by_alias=True))
    # The class's example is Python, not part of the schema.
    made["description"] = made["description"].partition("\n\n>>>")[0]
    definitions = {**made.pop("$defs"), "parameter": PARAMETER}
    del definitions["JsonValue"]
    definitions["effect_parameter"] = EFFECT_PARAMETER
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA,
        "title": Bundle.model_config["title"],
        **made,
        "$defs": definitions,
    }


_ORDER = ("$ref", "description", "type", "required", "anyOf", "closed", "properties")


def _tidy(node: Any, is_names: bool = False) -> Any:
    """Without redundant keys (titles of fields, defaults), in reading order."""
    if isinstance(node, list):
        return [_tidy(item) for item in node]
    if not isinstance(node, dict):
        return node
    if is_names:
        return {key: _tidy(value) for key, value in node.items()}
    if "x-ref" in node:
        return {"$ref": f"#/$defs/{node['x-ref']}"}
    if node.get("$ref") == "#/$defs/JsonValue":
        return {}
    kept = {key: value for key, value in node.items() if not _says_nothing(key, value, node)}
    ordered = sorted(kept, key=lambda key: _place(key, kept[key]))
    return {key: _tidy(kept[key], is_names=key in ("properties", "$defs")) for key in ordered}


def _says_nothing(key: str, value: Any, node: dict[str, Any]) -> bool:
    if key == "type":
        return "enum" in node or "const" in node
    if key == "additionalProperties":
        return value is True or value == {"$ref": "#/$defs/JsonValue"}
    return key in ("title", "default")


def _place(key: str, value: Any) -> int:
    name = "closed" if key == "additionalProperties" and value is False else key
    return _ORDER.index(name) if name in _ORDER else len(_ORDER)


def main() -> None:
    """Write the schema file of this package."""
    text = json.dumps(bundle_schema(), indent=2, ensure_ascii=False) + "\n"
    Path(__file__).with_name(SCHEMA_FILE).write_text(text, "utf-8")


if __name__ == "__main__":
    main()

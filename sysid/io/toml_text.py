"""Tables as TOML text: rig and campaign files that the program itself writes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any


def toml_text(content: Mapping[str, Any]) -> str:
    """TOML of keys, of tables of keys, and of lists of such tables (`[[log]]`).

    Values are text, numbers, truth values, and lists of these; a key that holds None is omitted.
    """
    lines = _keys({k: v for k, v in content.items() if not _is_table(v)})
    for name, value in content.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{name}]", *_keys(value)]
        elif _is_table(value):
            for table in value:
                lines += ["", f"[[{name}]]", *_keys(table)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _is_table(value: Any) -> bool:
    if isinstance(value, Mapping):
        return True
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _keys(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {toml_value(value)}" for key, value in table.items() if value is not None]


def toml_value(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are TOML's; beyond ASCII they would be pairs of surrogates.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Sequence):
        return f"[{', '.join(toml_value(v) for v in value)}]"
    return repr(float(value)) if isinstance(value, float) else repr(value)


__all__ = ["toml_text", "toml_value"]

"""Provenance: checksums, seeds, options, versions, the rig file."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from importlib import metadata
from typing import Any

from sysid.blocks.numbers import MISSING
from sysid.blocks.sections import Block, Fold, Section
from sysid.blocks.tables import Table, table
from sysid.blocks.titles import use_word
from sysid.parameters import Bundle, Provenance

_PACKAGES = ("numpy", "scipy", "jax", "torch", "matplotlib", "bokeh")


def provenance_section(bundle: Bundle) -> Section:
    """The section on the bundle's provenance and this program's own versions."""
    source = bundle.provenance
    blocks: list[Block] = [
        Fold("Versions", (_made(bundle),)),
        Fold("Logs and their checksums", (_logs(source),)),
    ]
    seeds, options = _flat(source.seeds), _flat(source.options)
    told: list[Block] = []
    if seeds:
        told.append(table("Seeds", ("Seed", "Value"), seeds))
    if options:
        told.append(table("Options", ("Option", "Value"), options, text=(1,)))
    if told:
        blocks.append(Fold("Seeds and options", tuple(told)))
    blocks.append(Fold("Rig file, as used", (_rig(bundle.rig_content),)))
    return Section("provenance", "Provenance", (), tuple(blocks))


def _made(bundle: Bundle) -> Table:
    rows = [
        ("Bundle fitted", bundle.created),
        ("By sysid", bundle.sysid_version),
        ("Schema", bundle.schema_id),
        ("Python", platform.python_version()),
    ]
    for name in _PACKAGES:
        try:
            rows.append((name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            continue
    return table("Versions", ("What", "Version"), rows, text=(1,))


def _logs(source: Provenance) -> Table:
    rows = [(e.file, e.kind or MISSING, use_word(e.use), e.sha256) for e in source.logs]
    columns = ("Log", "Kind", "Use", "SHA-256")
    return table(
        "Logs of the bundle's campaign",
        columns,
        rows,
        text=(1, 2),
        code=(3,),
    )


# What JSON has for what was not given, and for a switch.
_WORDS = {"null": MISSING, "[]": "none", "true": "yes", "false": "no"}


def _flat(content: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested tables as rows of dotted keys."""
    rows: list[tuple[str, str]] = []
    for key, value in content.items():
        if isinstance(value, Mapping):
            rows += _flat(value, f"{prefix}{key}.")
        else:
            shown = json.dumps(value, ensure_ascii=False)
            shown = value if isinstance(value, str) else _WORDS.get(shown, shown)
            rows.append((f"{prefix}{key}", shown))
    return rows


def _rig(content: Mapping[str, Any]) -> Table:
    return table("Rig file", ("Key", "Value"), _flat(content), text=(1,))

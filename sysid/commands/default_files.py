"""Files that a fit writes unasked: they replace nothing but the same fit of the same logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sysid.document.html import origin_of
from sysid.errors import SysidError, input_error
from sysid.io.source import Source
from sysid.parameters import read_bundle

_Origin = frozenset[tuple[str, str]]
"""Kind of fit and SHA-256 of each log that a result was made from."""


def check_same_fit(path: Path, kind: str, sources: Sequence[Source]) -> None:
    """InputError where a file is in the way that is not of a fit of this kind of these logs."""
    if not path.exists():
        return
    own = frozenset((kind, source.sha256) for source in sources)
    if _origin(path) != own:
        raise input_error(
            path,
            f"is in the way: it is not the result of `sysid fit {kind}` of these logs as they "
            "are now",
            f"move it, or say where to write with {_option(path)}",
        )


def _option(path: Path) -> str:
    return "-o FILE" if path.suffix == ".json" else "--report FILE"


def _origin(path: Path) -> _Origin | None:
    """What a bundle or a report says that it was made from; None where it says nothing."""
    try:
        if path.suffix == ".json":
            return read_bundle(path).provenance.fitted_on
        return origin_of(path.read_text("utf-8", errors="replace"))
    except (SysidError, OSError):
        return None


__all__ = ["check_same_fit"]

"""A component of the user's own in a bundle: where its law is defined, and its numbers."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import WithJsonSchema

from sysid.estimation.linear import Estimate
from sysid.parameters.base import Absent, Part
from sysid.parameters.provenance import Digest
from sysid.parameters.quality import Quality

_PARAMETERS: dict[str, Any] = {
    "type": "object",
    "additionalProperties": {"x-ref": "parameter"},
}


class ComponentRecord(Part):
    """The parameters by name; `kind` of its logs, and class, file and SHA-256 of its definition.

    Reading a bundle runs no code: the file is given again wherever the law is needed.
    """

    kind: str
    name: str
    file: Absent[str] = None
    sha256: Absent[Digest] = None
    parameters: Annotated[dict[str, Estimate], WithJsonSchema(_PARAMETERS)]
    quality: Quality = None

    def estimates(self) -> dict[str, Estimate]:
        """The parameters by name."""
        return dict(self.parameters)


__all__ = ["ComponentRecord"]

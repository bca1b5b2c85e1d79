"""The parameter bundle: what a controller, a simulator or a later fit needs, in one JSON file.

`bundle` is the whole, `friction`, `valves`, `effects`, `validation` and `provenance` are its
parts; `files` reads and writes it, `schema` makes its JSON schema from these classes, and
`assembled_model` is the model that it describes.
"""

from sysid.bundle.base import Unread
from sysid.bundle.bundle import Bundle, Parts
from sysid.bundle.effects import EffectEntry, HeldOutError
from sysid.bundle.files import bundle_text, read_bundle, write_bundle
from sysid.bundle.friction import Friction
from sysid.bundle.provenance import LogRecord, Provenance
from sysid.bundle.validation import Validation
from sysid.bundle.valves import DiscreteLaw, PwmSurfaces, Surface, Valve, Valves

__all__ = [
    "Bundle",
    "DiscreteLaw",
    "EffectEntry",
    "Friction",
    "HeldOutError",
    "LogRecord",
    "Parts",
    "Provenance",
    "PwmSurfaces",
    "Surface",
    "Unread",
    "Validation",
    "Valve",
    "Valves",
    "bundle_text",
    "read_bundle",
    "write_bundle",
]

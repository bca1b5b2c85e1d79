"""The parameter bundle: everything a controller, a simulator or a later fit needs, as JSON.

`content` declares its content (parts: `friction`, `valves`, `component`, `effects`,
`validation`, `refinement`, `provenance`), `bundle` its operations, `assembled_model` the
model that it describes, `assumptions` what its numbers rest on that nobody declared; `files` reads
and writes it, `schema` generates its JSON schema from these classes.
"""

from sysid.bundle.assumptions import Assumption, assumptions, shown_by_logs
from sysid.bundle.base import Unread
from sysid.bundle.bundle import Bundle
from sysid.bundle.component import ComponentRecord
from sysid.bundle.content import Parts
from sysid.bundle.correlation import Correlation
from sysid.bundle.effects import EffectEntry, HeldOutError
from sysid.bundle.files import bundle_text, read_bundle, write_bundle
from sysid.bundle.friction import Friction
from sysid.bundle.provenance import LogRecord, Provenance
from sysid.bundle.refinement import Refinement
from sysid.bundle.validation import Validation
from sysid.bundle.valves import DiscreteLaw, FittedValves, PwmSurfaces, Surface, Valve

__all__ = [
    "Assumption",
    "Bundle",
    "ComponentRecord",
    "Correlation",
    "DiscreteLaw",
    "EffectEntry",
    "FittedValves",
    "Friction",
    "HeldOutError",
    "LogRecord",
    "Parts",
    "Provenance",
    "PwmSurfaces",
    "Refinement",
    "Surface",
    "Unread",
    "Validation",
    "Valve",
    "assumptions",
    "bundle_text",
    "read_bundle",
    "shown_by_logs",
    "write_bundle",
]

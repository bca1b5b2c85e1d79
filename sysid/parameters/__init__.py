"""The parameter bundle: everything a controller, a simulator or a later fit needs, as JSON.

`content` declares its content (parts: `friction`, `valves`, `component`, `effects`,
`validation`, `refinement`, `provenance`), `bundle` its operations, `assembled_model` the
model that it describes, `table` lists every number of it, `declared` those of the rig file,
`fitted_logs` says whether a log can have its use, `assumptions` the assumed constants that its
numbers depend on; `files` reads and writes it, `schema` generates its JSON schema from these
classes.
"""

from sysid.parameters.assumptions import Assumption, assumptions, shown_by_logs
from sysid.parameters.base import Unread
from sysid.parameters.bundle import Bundle
from sysid.parameters.component import ComponentRecord
from sysid.parameters.content import Parts
from sysid.parameters.correlation import Correlation
from sysid.parameters.effects import EffectEntry, HeldOutError
from sysid.parameters.files import bundle_text, read_bundle, write_bundle
from sysid.parameters.friction import Friction
from sysid.parameters.provenance import LogRecord, Provenance
from sysid.parameters.refinement import Refinement
from sysid.parameters.validation import Validation
from sysid.parameters.valves import DiscreteLaw, FittedValves, PwmSurfaces, Surface, Valve

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

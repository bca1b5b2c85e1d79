"""The page of the documentation that helps with an error, by the module that raised it."""

from __future__ import annotations

from types import TracebackType

PAGES = {
    "sysid.io.foreign": "how-to/file-formats",
    "sysid.io.bounds": "how-to/file-formats",
    "sysid.io.file_kinds": "how-to/file-formats",
    "sysid.io.parquet_columns": "how-to/file-formats",
    "sysid.io.conversion": "how-to/file-formats",
    "sysid.io.joining": "how-to/file-formats",
    "sysid.io.units": "how-to/file-formats",
    "sysid.io.unit_text": "how-to/file-formats",
    "sysid.io.sensor_range": "how-to/file-formats",
    "sysid.io.measured_speed": "reference/log-format",
    "sysid.io.logs": "reference/log-format",
    "sysid.io.tables": "reference/log-format",
    "sysid.io.plausibility": "slips",
    "sysid.io.rig": "reference/rig-file",
    "sysid.io.rig_file": "reference/rig-file",
    "sysid.io.declaration": "reference/rig-file",
    "sysid.io.campaign": "reference/campaign-file",
    "sysid.parameters": "reference/bundle",
    "sysid.recording.even": "reference/log-format",
    "sysid.identification": "reference/log-format",
    "sysid.friction": "reference/log-format",
    "sysid.valve_discrete": "reference/log-format",
    "sysid.valve_pwm": "reference/log-format",
    "sysid.diagnosis.bench": "how-to/part-alone",
    "sysid.plant.effects": "how-to/own-effect",
    "sysid.components": "own-components",
    "sysid.controllers": "how-to/own-controller",
    "sysid.exporters": "how-to/read-the-bundle",
}
"""Pages by the modules and packages whose errors they help with, under `docs/`."""

# They raise for whoever calls them.
_HELPERS = ("sysid.errors", "sysid.io.samples", "sysid.io.user_code")
_SHARED = (
    *("check_each_once", "damaged", "decoded", "open_input", "read_as", "read_bytes"),
    *("read_toml", "reject_misspelt", "require"),
)


def page_for(error: BaseException) -> str:
    """The page for an error as raised, "" where none is of help."""
    for module in reversed(_modules(error.__traceback__)):
        if module not in _HELPERS:
            return _page_of(module)
    return ""


def _modules(traceback: TracebackType | None) -> list[str]:
    found = []
    while traceback is not None:
        name = traceback.tb_frame.f_globals.get("__name__", "")
        shared = traceback.tb_frame.f_code.co_name in _SHARED
        if str(name).startswith("sysid.") and not shared:
            found.append(str(name))
        traceback = traceback.tb_next
    return found


def _page_of(module: str) -> str:
    parts = module.split(".")
    for length in range(len(parts), 0, -1):
        page = PAGES.get(".".join(parts[:length]))
        if page is not None:
            return page
    return ""

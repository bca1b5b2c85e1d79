"""The thesis' tables of controllers by their number: title, rows, and what declares the cells."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

from sysid.controllers.modes import Mode
from sysid.errors import input_error
from sysid.thesis.declaration import Declaration, printed
from sysid.thesis.experiments import (
    by_metric,
    by_motor_test,
    by_previous_hardware,
    by_robustness_test,
)
from sysid.thesis.payload import by_payload
from sysid.thesis.tracking import (
    by_compensation,
    by_controller,
    by_horizon,
    by_test,
)
from sysid.thesis.valve import by_valve_model


@dataclass(frozen=True)
class Entry:
    """One table: its title, what a row is, and `declare(number)`, which makes its cells."""

    title: str
    heading: str
    declare: Callable[[str], Declaration]
    is_experiment: bool = False


def _compensation(title: str, mode: Mode, without: int, with_: int) -> Entry:
    declare = functools.partial(by_compensation, mode=mode, types=(without, with_))
    return Entry(title, "trajectory", declare)


def _payload(title: str, heading: str, rows: tuple[str, ...], groups: str) -> Entry:
    return Entry(title, heading, functools.partial(by_payload, rows=rows, groups=groups))


def _types(title: str) -> Entry:
    """Backstepping by mode and type; trajectories 1 and 4 next to each other."""
    return _payload(f"backstepping, {title}", "mode, type", ("mode", "type"), "trajectory")


def _estimated(title: str) -> Entry:
    """Backstepping by mode and type; without and with the estimator next to each other."""
    return _payload(
        f"backstepping with payload estimator, {title}", "mode, type", ("mode", "type"), "estimator"
    )


def _dvmpc(title: str, key: str) -> Entry:
    rows = ("controller_payload_kg", key)
    return _payload(f"DVMPC, {title}", f"payload assumed for carried, {key}", rows, "trajectory")


# 4.4.3 prints the inertia that its controller assumed, 0.0275 kg m2, and that the true one was 1.9
# times that. On this rig they are those of these payloads, kg.
_PREVIOUS_KG = (0.0279, 0.2087)


def _tested(title: str, heading: str, declare: Callable[[str], Declaration]) -> Entry:
    return Entry(title, heading, declare, is_experiment=True)


def _robustness() -> dict[str, Entry]:
    """Tables 6.5.1 to 6.5.22, and appendices A to D, titled by what was tested."""
    found: dict[str, Entry] = {}
    for row in printed("table_6_5"):
        title = f"{_what(row)}, experiment"
        found.setdefault(row["table"], _tested(title, "mode, trajectory", by_robustness_test))
    for row in printed("table_a_to_d"):
        title = f"{_what(row)}, {row['mode']}, trajectory {row['trajectory']}, experiment"
        found.setdefault(row["table"], _tested(title, "metric", by_metric))
    return found


def _what(row: dict[str, str]) -> str:
    name = {"dvmpc": "DVMPC", "backstepping": "backstepping"}[row["controller"]]
    with_ = " with payload estimator" if row["estimator"] == "on" else ""
    return f"{name}{with_}, {row['orientation']}, {row['actual_payload_kg']} kg carried"


ENTRIES: dict[str, Entry] = {
    "4.4.3": _tested(
        "DVMPC with the previous prototype, vertical, trajectory 1",
        "mode, estimator",
        functools.partial(by_previous_hardware, carried_kg=_PREVIOUS_KG),
    ),
    "4.5.1": Entry("pneumatic mode", "controller", by_controller),
    "4.5.2": Entry("motor mode", "controller", by_controller),
    "4.5.3": Entry("hybrid mode", "controller", by_controller),
    "4.5.4": Entry("pneumatic mode, experiment", "controller", by_test, is_experiment=True),
    "4.5.5": Entry("motor mode, experiment", "controller", by_test, is_experiment=True),
    "4.5.6": Entry("hybrid mode, experiment", "controller", by_test, is_experiment=True),
    "5.2.1": _compensation(
        "backstepping, hybrid, without and with the motor's compensation", Mode.HYBRID, 1, 2
    ),
    "5.2.2": _compensation(
        "backstepping, pneumatic, without and with feedforward", Mode.PNEUMATIC, 1, 3
    ),
    "5.3.1": Entry("DVMPC, pneumatic, by its horizon in ticks", "horizon", by_horizon),
    "5.4.4": _types("horizontal, 0.2 kg assumed"),
    "5.4.5": _types("horizontal, 0.5 kg assumed"),
    "5.4.6": _types("horizontal, 0.8 kg assumed"),
    "5.4.7": _estimated("horizontal, 0.2 kg assumed, trajectory 1"),
    "5.4.8": _estimated("horizontal, 0.2 kg assumed, trajectory 4"),
    "5.4.9": _estimated("horizontal, 0.5 kg assumed, trajectory 1"),
    "5.4.10": _estimated("horizontal, 0.5 kg assumed, trajectory 4"),
    "5.4.11": _estimated("horizontal, 0.8 kg assumed, trajectory 1"),
    "5.4.12": _estimated("horizontal, 0.8 kg assumed, trajectory 4"),
    "5.4.14": _dvmpc("horizontal: hybrid (type 1), pneumatic (type 2)", "type"),
    "5.4.15": _dvmpc("horizontal, hybrid, with payload estimator", "estimator"),
    "5.4.16": _types("vertical, 0.2 kg assumed"),
    "5.4.17": _types("vertical, 0.5 kg assumed"),
    "5.4.18": _types("vertical, 0.8 kg assumed"),
    "5.4.19": _estimated("vertical, 0.2 kg assumed, trajectory 1"),
    "5.4.20": _estimated("vertical, 0.2 kg assumed, trajectory 4"),
    "5.4.21": _estimated("vertical, 0.5 kg assumed, trajectory 1"),
    "5.4.22": _estimated("vertical, 0.5 kg assumed, trajectory 4"),
    "5.4.23": _estimated("vertical, 0.8 kg assumed, trajectory 1"),
    "5.4.24": _estimated("vertical, 0.8 kg assumed, trajectory 4"),
    "5.4.25": _dvmpc("vertical: hybrid (type 1), pneumatic (type 2)", "type"),
    "5.4.26": _dvmpc("vertical, hybrid, with payload estimator", "estimator"),
    "5.5.3": Entry(
        "backstepping, hybrid, with an imperfect and a perfect valve model",
        "sine, valve model",
        by_valve_model,
    ),
    "6.3.2": _tested("inverse dynamics alone, horizontal, 0.22 kg", "trajectory", by_motor_test),
    **_robustness(),
}
TABLES = tuple(ENTRIES)


def batches() -> list[tuple[str, ...]]:
    """All of TABLES in batches: an appendix with the tables of chapter 6 whose tests it holds."""
    shared: dict[str, list[str]] = {}
    for row in printed("table_a_to_d"):
        names = shared.setdefault(row["table"][0], [])
        names += [name for name in (row["rmse_table"], row["table"]) if name not in names]
    taken = {name for names in shared.values() for name in names}
    alone = [(name,) for name in TABLES if name not in taken]
    return [*alone, *(tuple(names) for names in shared.values())]


def declared(name: str) -> Declaration:
    """The declaration of one of TABLES. Raises InputError for another number."""
    if name not in ENTRIES:
        known = ", ".join(TABLES)
        raise input_error(f"table {name}", "is not one that is computed", f"give one of {known}")
    return ENTRIES[name].declare(name)


__all__ = ["ENTRIES", "TABLES", "Entry", "batches", "declared"]

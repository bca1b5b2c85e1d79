"""Which part a campaign tests, and that part from its trials."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sysid.diagnosis.bench.axis import axis
from sysid.diagnosis.bench.component import Component
from sysid.diagnosis.bench.friction_readings import KIND as FRICTION_POINTS
from sysid.diagnosis.bench.friction_readings import friction_points
from sysid.diagnosis.bench.restriction import is_over_pressures, restriction
from sysid.diagnosis.bench.tank import KIND as TANK
from sysid.diagnosis.bench.tank import tank
from sysid.diagnosis.bench.valve_flow import KIND as VALVE_FLOW
from sysid.diagnosis.bench.valve_flow import valve_flow
from sysid.diagnosis.bench.valve_time import KIND as VALVE_TIME
from sysid.diagnosis.bench.valve_time import valve_time
from sysid.errors import input_error
from sysid.io.campaign import BENCH_KINDS, MOTION_KINDS
from sysid.io.channels import SIDES
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle

AXIS = "friction-motion"


def _flow(trials: Sequence[Trial], rig: Rig) -> Component:
    """Settled flows: over two pressures, or over the duty."""
    over_pressures = bool(trials) and all(map(is_over_pressures, trials))
    return restriction(trials, rig) if over_pressures else valve_flow(trials, rig)


_BUILDERS: dict[str, Callable[[Sequence[Trial], Rig], Component]] = {
    AXIS: axis,
    TANK: tank,
    VALVE_FLOW: _flow,
    VALVE_TIME: valve_time,
    FRICTION_POINTS: friction_points,
}


def part_tested(kinds: Sequence[str], bundle: Bundle) -> str | None:
    """The kind of test that makes a campaign a part's; None: it is a whole actuator's.

    `kinds` of its training logs. An axis is a part where the bundle lacks the flow law of a valve,
    so that there is no actuator to simulate, and no log moves one. Raises InputError where the logs
    are of several parts.
    """
    bench = sorted(set(kinds) & set(BENCH_KINDS))
    if len(bench) > 1:
        raise input_error(
            "campaign",
            f"holds logs of kinds {' and '.join(bench)}",
            "give each kind its own campaign",
        )
    if bench:
        return bench[0]
    laws = [bundle.valve(side).discrete for side in SIDES]
    whole = None not in laws or set(kinds) & set(MOTION_KINDS)
    return AXIS if AXIS in kinds and not whole else None


def component_of(kind: str, trials: Sequence[Trial], rig: Rig) -> Component:
    """The part that tests of a kind belong to. Raises InputError, NotIdentifiedError."""
    return _BUILDERS[kind](trials, rig)


__all__ = ["AXIS", "component_of", "part_tested"]

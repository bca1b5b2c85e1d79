"""Which part a campaign tests, and that part from its trials."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sysid.campaign import BENCH_KINDS
from sysid.components.axis import axis
from sysid.components.component import Component
from sysid.components.points import KIND as FRICTION_POINTS
from sysid.components.points import friction_points
from sysid.components.tank import KIND as TANK
from sysid.components.tank import tank
from sysid.components.valve_flow import KIND as VALVE_FLOW
from sysid.components.valve_flow import valve_flow
from sysid.components.valve_time import KIND as VALVE_TIME
from sysid.components.valve_time import valve_time
from sysid.errors import input_error
from sysid.logs import Trial
from sysid.rig import Rig

AXIS = "friction-motion"
_BUILDERS: dict[str, Callable[[Sequence[Trial], Rig], Component]] = {
    AXIS: axis,
    TANK: tank,
    VALVE_FLOW: valve_flow,
    VALVE_TIME: valve_time,
    FRICTION_POINTS: friction_points,
}


def part_tested(kinds: Sequence[str], has_both_valves: bool) -> str | None:
    """The kind of test by which a campaign is a part's; None: it is a whole actuator's.

    `kinds` of its logs; `has_both_valves`: whether the flow laws of both valves are known,
    so that a whole actuator can be simulated.
    """
    bench = sorted(set(kinds) & set(BENCH_KINDS))
    if len(bench) > 1:
        raise input_error(
            "campaign", f"holds logs of kinds {' and '.join(bench)}", "give each a campaign"
        )
    if bench:
        return bench[0]
    return AXIS if AXIS in kinds and not has_both_valves else None


def component_of(kind: str, trials: Sequence[Trial], rig: Rig) -> Component:
    """The part that tests of a kind are of. Raises InputError, NotIdentifiedError."""
    return _BUILDERS[kind](trials, rig)


__all__ = ["AXIS", "component_of", "part_tested"]

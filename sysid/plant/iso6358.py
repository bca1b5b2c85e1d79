"""Mass flow through a pneumatic component by ISO 6358-1 (2013): conductance, ratio and index.

Choked flow is proportional to the upstream pressure; beyond the critical ratio of the pressures
it falls along an ellipse (index 1/2, the standard's default) to nothing at equal pressures. The
law and its slope are continuous at the critical ratio. Kinds and units as in `base`.
"""

from __future__ import annotations

from sysid.plant.base import Array, array_namespace

ANR_DENSITY = 1.185
"""Density of air at the standard reference atmosphere ANR (ISO 8778), kg/m3."""
ANR_TEMPERATURE = 293.15
"""Temperature of the standard reference atmosphere ANR (ISO 8778), K."""
DEFAULT_INDEX = 0.5
"""The subsonic index where none is stated (ISO 6358-1)."""
INDICES = (0.2, 1.5)
"""The least and the largest subsonic index that a fit considers."""
USUAL_RATIO = 0.3
"""A data sheet's usual critical ratio: where a fit starts, and where no test identifies it."""
HIGHEST_RATIO = 0.95
"""The largest critical ratio that a fit considers: at 1 the subsonic flow would be a jump."""


def choked_flow(upstream: Array, conductance: Array, temperature: Array = ANR_TEMPERATURE) -> Array:
    """Choked mass flow, kg/s: C rho0 sqrt(T0 / T) p1.

    `upstream` pressure in Pa (absolute), `conductance` in m3/(s Pa) at ANR, `temperature` of the
    upstream air in K.
    """
    xp = array_namespace(temperature)
    return conductance * (ANR_DENSITY * xp.sqrt(ANR_TEMPERATURE / temperature)) * upstream


def subsonic_share(ratio: Array, critical_ratio: Array, index: Array = DEFAULT_INDEX) -> Array:
    """Flow over choked flow, 0 to 1, at a ratio of downstream to upstream pressure (0 to 1).

    1 up to `critical_ratio` b (0 to below 1), then (1 - ((ratio - b) / (1 - b))^2)^m.
    """
    xp = array_namespace(ratio, critical_ratio, index)
    beyond = xp.clip((ratio - critical_ratio) / (1.0 - critical_ratio), 0.0, 1.0)
    # (1 - x)(1 + x): near equal pressures the difference of squares would lose its digits.
    room = (1.0 - beyond) * (1.0 + beyond)
    # Slopes at equal pressures stay finite: a power of 0 has none below index 1.
    inside = room > 0.0
    return xp.where(inside, xp.where(inside, room, 1.0) ** index, 0.0 * room)


def iso6358_flow(
    upstream: Array,
    downstream: Array,
    conductance: Array,
    critical_ratio: Array,
    index: Array = DEFAULT_INDEX,
    temperature: Array = ANR_TEMPERATURE,
) -> Array:
    """Mass flow from `upstream` to `downstream`, kg/s; negative where the latter is higher.

    Pressures in Pa (absolute), at least one of them above 0; `conductance` C in m3/(s Pa) at ANR,
    `critical_ratio` b, subsonic `index` m, `temperature` of the air in K (ISO 6358-1, equations
    of 5.3). A component has the same numbers both ways here: pass those of the direction that
    counts.
    """
    xp = array_namespace(upstream, downstream, conductance, critical_ratio, index)
    forward = upstream >= downstream
    high = xp.where(forward, upstream, downstream)
    low = xp.where(forward, downstream, upstream)
    flow = choked_flow(high, conductance, temperature) * subsonic_share(
        low / high, critical_ratio, index
    )
    return xp.where(forward, flow, -flow)


__all__ = [
    "ANR_DENSITY",
    "ANR_TEMPERATURE",
    "DEFAULT_INDEX",
    "HIGHEST_RATIO",
    "INDICES",
    "USUAL_RATIO",
    "choked_flow",
    "iso6358_flow",
    "subsonic_share",
]

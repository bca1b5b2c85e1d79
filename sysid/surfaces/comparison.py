"""Which surface to use: Tables 3.7.1 to 3.7.4 of the thesis for the data at hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sysid.errors import NotIdentifiedError
from sysid.surfaces.ann import DutyNetwork
from sysid.surfaces.bipolynomial import N_TERMS, Bipolynomial
from sysid.surfaces.domain import Domain, level_flows
from sysid.surfaces.estimator import checked_samples
from sysid.surfaces.holdout import group_folds
from sysid.surfaces.samples import SurfacePoints, surface_points
from sysid.surfaces.zero_flow import apart_from
from sysid.types import FloatArray

# The network has 4.6 times the parameters and no closed inverse; it must earn them.
WORTHWHILE_RATIO = 0.75
NEGLIGIBLE_DUTY = 0.005
RESOLUTION_TOLERANCE = 0.01
# The averaged law's error in duty, over the noise's, up to which a valve obeys it.
OBEYED_UP_TO = 2.0


@dataclass(frozen=True)
class WorstPoint:
    """Where the largest relative error occurs: duty, fitted duty, pressure [Pa], flow [kg/s]."""

    duty: float
    fitted_duty: float
    pressure_pa: float
    flow_kg_s: float


@dataclass(frozen=True)
class SurfaceError:
    """Error of one surface in duty, over `n_points` points of tests held out from it.

    `rmse` (thesis 3.7.4) in duty; `max_relative_error_percent` (3.7.5), which grows without
    bound as the duty goes to 0, and `worst`, where it occurs; also the largest and the
    95th percentile of the absolute error in points of duty (0.01).
    """

    rmse: float
    max_relative_error_percent: float
    worst: WorstPoint
    max_error_points: float
    p95_error_points: float
    n_parameters: int
    n_points: int


@dataclass(frozen=True)
class SurfaceComparison:
    """Both surfaces on the same held-out points of one valve in one direction.

    `noise_rmse`: the RMSE in duty that the samples' own noise of flow would give a perfect
    surface (NaN if unknown). `recommended`: "bipolynomial" or "ann"; `reason` says why.
    """

    bipolynomial: SurfaceError
    network: SurfaceError
    noise_rmse: float
    recommended: str
    reason: str
    n_tests: int
    folds: int
    seed: int

    @property
    def ratio(self) -> float:
        """The network's RMSE over the bipolynomial's."""
        return self.network.rmse / self.bipolynomial.rmse

    def to_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return {
            **asdict(self),
            "noise_rmse": None if np.isnan(self.noise_rmse) else self.noise_rmse,
            "ratio": self.ratio,
        }


def duty_errors(
    fitted: ArrayLike,
    duty: ArrayLike,
    pressure: ArrayLike,
    flow: ArrayLike,
    n_parameters: int,
) -> SurfaceError:
    """Errors of fitted duties against the true ones, all (n,). A duty of exactly 0 has no
    relative error and counts in the others only."""
    fit, u, p, m = (np.asarray(a, dtype=float) for a in (fitted, duty, pressure, flow))
    error = np.abs(fit - u)
    relative = np.divide(error, u, out=np.full_like(u, -np.inf), where=u > 0)
    k = int(np.argmax(relative))
    return SurfaceError(
        rmse=float(np.sqrt(np.mean(error**2))),
        max_relative_error_percent=float(100.0 * relative[k]),
        worst=WorstPoint(float(u[k]), float(fit[k]), float(p[k]), float(m[k])),
        max_error_points=float(100.0 * error.max()),
        p95_error_points=float(100.0 * np.percentile(error, 95)),
        n_parameters=n_parameters,
        n_points=len(u),
    )


def compare_surfaces(
    duty: ArrayLike,
    pressure: ArrayLike,
    flow: ArrayLike,
    test: ArrayLike | None = None,
    std: ArrayLike | None = None,
    folds: int = 4,
    network: DutyNetwork | None = None,
    ties: SurfacePoints | None = None,
    boundaries: Sequence[float] = (),
) -> SurfaceComparison:
    """Compare both surfaces on samples (n,) of one valve in one direction.

    Both get the same domain, are fitted on the same even points (`surface_points`) and are
    judged on points of held-out tests: every test once, in `folds` folds, except
    those at the ends of the duty range, which always train. `network` gives the network's
    parameters. `ties` train with every fold (see `zero_flow`), except those of the duties that
    it holds out; `boundaries` as in `surface_points`. Raises as `Domain.from_samples` does.
    """
    u, p, m = checked_samples(duty, pressure, flow)
    domain = Domain.from_samples(u, p, m)
    points = surface_points(u, p, m, test, std, boundaries=boundaries)
    points = points.select(domain.holds_duty(points.duty))
    if ties is not None:
        domain = domain.with_points(ties.duty, ties.pressure, ties.flow)
    chosen = DutyNetwork(**(network or DutyNetwork()).get_params()).set_params(domain=domain)
    by_duty = np.column_stack((points.duty, points.pressure))
    fitted = np.full((2, len(points.duty)), np.nan)
    for held in group_folds(points.test, points.duty, folds, chosen.seed):
        train = points.select(~held).joined(
            ties if ties is None else ties.select(apart_from(ties, points.duty[held]))
        )
        polynomial = Bipolynomial(domain).fit(
            np.column_stack((train.duty, train.pressure)), train.flow
        )
        fitted[0, held] = polynomial.duty(points.flow[held], points.pressure[held])[0]
        trained = DutyNetwork(**chosen.get_params())
        trained.fit(np.column_stack((train.flow, train.pressure)), train.duty, groups=train.test)
        fitted[1, held] = trained.duty(points.flow[held], points.pressure[held])[0]
    judged = np.isfinite(fitted[0])
    seen = points.select(judged)
    errors = [
        duty_errors(fit[judged], seen.duty, seen.pressure, seen.flow, size)
        for fit, size in zip(fitted, (N_TERMS, 4 * chosen.hidden + 1), strict=True)
    ]
    noise = _noise_in_duty(Bipolynomial(domain).fit(by_duty, points.flow), seen)
    choice, reason = recommend(errors[0], errors[1], noise)
    return SurfaceComparison(
        errors[0], errors[1], noise, choice, reason, len(np.unique(seen.test)), folds, chosen.seed
    )


def _noise_in_duty(surface: Bipolynomial, points: SurfacePoints) -> float:
    """RMS of std(flow)/(dm/du), with dm/du of the fitted surface."""
    c2, c1, _ = surface.law.quadratic(points.pressure)
    slope = np.abs(2.0 * c2 * points.duty + c1)
    floor = 0.1 * np.median(slope)
    noise = points.std / np.maximum(slope, floor)
    known = noise[np.isfinite(noise)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def recommend(
    polynomial: SurfaceError, network: SurfaceError, noise_rmse: float
) -> tuple[str, str]:
    """Which surface to use, and why, from the errors on tests held out from both.

    The bipolynomial where its error is negligible (half a point of duty, or the noise), or
    where the network reduces the RMSE by less than a quarter or raises the 95th percentile;
    else the network.
    """
    ratio = network.rmse / polynomial.rmse if polynomial.rmse > 0 else float("inf")
    figures = (
        f"RMSE on held-out tests {100.0 * network.rmse:.2f} points of duty (network, "
        f"{network.n_parameters} parameters) against {100.0 * polynomial.rmse:.2f} (bipolynomial, "
        f"{polynomial.n_parameters})"
    )
    if polynomial.rmse <= NEGLIGIBLE_DUTY:
        return "bipolynomial", f"{figures}: the bipolynomial's error is under half a duty point"
    if np.isfinite(noise_rmse) and polynomial.rmse <= 1.1 * noise_rmse:
        return (
            "bipolynomial",
            f"{figures}: the bipolynomial is at the noise level, {100.0 * noise_rmse:.2f} points",
        )
    if ratio > WORTHWHILE_RATIO:
        return "bipolynomial", f"{figures}: the network improves on it by less than a quarter"
    if network.p95_error_points > polynomial.p95_error_points:
        return "bipolynomial", (
            f"{figures}, but the network's 95th percentile is the larger: "
            f"{network.p95_error_points:.2f} against {polynomial.p95_error_points:.2f} points"
        )
    return "ann", f"{figures}: the network's error is {ratio:.2f} of the bipolynomial's"


def obeys_averaged_law(law_rmse: float, network_rmse: float, noise_rmse: float | None) -> bool:
    """Whether a valve obeys the averaged law, by RMSE in duty on held-out tests.

    It does not where the law's error is above the network's and over twice what the noise of
    the samples gives (None: unknown).
    """
    noise = 0.0 if noise_rmse is None or not np.isfinite(noise_rmse) else noise_rmse
    return law_rmse <= max(network_rmse, OBEYED_UP_TO * noise)


@dataclass(frozen=True)
class ResolutionStudy:
    """Largest mean flow that each step of duty would have found (Table 3.7.1).

    `steps` (S,) of duty; `max_flow` (S,) [kg/s], the largest absolute flow; `tests` (S,)
    used; `coarsest`: the largest step whose flow is within 1 % of the finest's.
    """

    steps: tuple[float, ...]
    max_flow: tuple[float, ...]
    tests: tuple[int, ...]
    coarsest: float


def resolution_study(
    duty: ArrayLike,
    pressure: ArrayLike,
    flow: ArrayLike,
    steps: Sequence[float] | None = None,
) -> ResolutionStudy:
    """Table 3.7.1 on the data at hand: samples (n,) of one valve in one direction.

    Each step keeps the lowest duty and those a whole number of steps above it, as far as
    the data hold them. `steps` are multiples of the finest step in the data; absent, 1, 2,
    3, 4, 5 and 6 times it. The flow is the largest mean over a sixteenth of the pressure range, so
    that it does not grow with the number of samples. Raises NotIdentifiedError for uneven duties.
    """
    u, p, m = checked_samples(duty, pressure, flow)
    levels = level_flows(u, p, m)
    gaps = np.diff(levels.duty)
    finest = float(np.median(gaps))
    place = (levels.duty - levels.duty[0]) / finest
    index = np.rint(place).astype(int)
    if np.abs(place - index).max() > 0.2:
        raise NotIdentifiedError(
            "the duties are unevenly spaced, so no step of duty can be studied; tests at evenly "
            "spaced duties would allow it"
        )
    peak = np.array([_peak_flow(f[np.isfinite(f)]) for f in levels.flow])
    factors = range(1, 7) if steps is None else [max(1, round(s / finest)) for s in steps]
    found: list[tuple[float, float, int]] = []
    for factor in factors:
        kept = index % factor == 0
        if kept.sum() >= 3:
            found.append((factor * finest, float(peak[kept].max()), int(kept.sum())))
    if not found:
        raise NotIdentifiedError(
            "fewer than three duties remain at each step; tests at more duties are needed"
        )
    best = found[0][1]
    close = [s for s, flow_max, _ in found if abs(flow_max - best) <= RESOLUTION_TOLERANCE * best]
    return ResolutionStudy(
        tuple(s for s, _, _ in found),
        tuple(f for _, f, _ in found),
        tuple(n for _, _, n in found),
        max(close),
    )


def _peak_flow(flow: FloatArray) -> float:
    """Largest absolute mean flow over four neighbouring pressure bins, of flow (B,) by bin."""
    width = min(4, len(flow))
    return float(np.abs(np.convolve(flow, np.full(width, 1.0 / width), mode="valid")).max())

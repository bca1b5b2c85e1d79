"""Network of one hidden tanh layer from (flow, pressure) to duty (thesis 3.7.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.errors import NotIdentifiedError, input_error
from sysid.surfaces.domain import Domain, duty_levels
from sysid.surfaces.estimator import (
    ExportedNumbers,
    Regressor,
    checked_samples,
    checked_weights,
    columns,
)
from sysid.surfaces.holdout import group_folds, hold_out_groups
from sysid.surfaces.inverse import FlagArray, evaluated
from sysid.surfaces.network_law import NetworkLaw
from sysid.surfaces.samples import thin_samples
from sysid.types import FloatArray


class DutyNetwork(Regressor):
    """duty = c + v tanh(W x + b), x the scaled (flow, pressure), for one valve, one direction.

    X (n, 2) is mean flow [kg/s] and absolute chamber pressure [Pa], y (n,) the duty.
    Samples at duties to which the flow does not respond are not used (see
    `sysid.surfaces.domain`); prediction saturates flow, pressure and duty at the domain.

    hidden: tanh neurons (10 in the thesis: 41 weights). restarts: random starts, all
    trained; the one with the lowest held-out error is kept. seed: start of all random
    numbers. max_iter: steps of Levenberg-Marquardt. points: training and held-out samples
    in all, drawn evenly over the surface (`thin_samples`). held_out: share of the tests
    kept for early stopping. patience: steps without improvement before a restart stops. domain: a
    `Domain` to use in place of the one found in the samples.

    Learned: `hidden_weights_` (H, 2), `hidden_bias_` (H,), `output_weights_` (H,),
    `output_bias_`, `scaling_` (3, 2: centre and half range of flow, pressure and duty, each
    scaled to [-1, 1]), `domain_`, `rmse_` and `held_out_rmse_` (duty), `restart_rmse_` (R,)
    held-out, `restart_seeds_`, `held_out_groups_`, `n_parameters_`. Training needs torch;
    prediction numpy only.
    """

    def __init__(
        self,
        hidden: int = 10,
        restarts: int = 20,
        seed: int = 0,
        max_iter: int = 300,
        points: int = 5000,
        held_out: float = 0.2,
        patience: int = 40,
        domain: Domain | None = None,
    ) -> None:
        self.hidden = hidden
        self.restarts = restarts
        self.seed = seed
        self.max_iter = max_iter
        self.points = points
        self.held_out = held_out
        self.patience = patience
        self.domain = domain

    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        groups: ArrayLike | None = None,
    ) -> DutyNetwork:
        """Train by Levenberg-Marquardt from all restarts, early stopping on held-out tests.

        `groups` (n,) names the test of each sample; absent, samples of one duty are one
        test. Tests at either end of the duty range are never held out: they bound the
        domain. Raises InputError for unusable samples, NotIdentifiedError for fewer
        samples than weights.
        """
        flow, pressure, duty = self._samples(X, y)
        weight = checked_weights(sample_weight, len(duty))
        domain = self.domain or Domain.from_samples(duty, pressure, flow)
        rows = np.flatnonzero(domain.holds_duty(duty))
        if weight is not None:
            rows = rows[weight[rows] > 0]
        size = 4 * self.hidden + 1
        if len(rows) <= 2 * size:
            raise NotIdentifiedError(
                f"{size} weights cannot be identified from {len(rows)} samples; longer or more "
                "valve-pwm tests would"
            )
        rows = rows[thin_samples(duty[rows], pressure[rows], flow[rows], self.points, self.seed)]
        flow, pressure, duty = flow[rows], pressure[rows], duty[rows]
        weight = np.ones(len(rows)) if weight is None else weight[rows]
        labels = duty_levels(duty)[1] if groups is None else np.asarray(groups)[rows]
        held = hold_out_groups(labels, duty, self.held_out, self.seed)
        self.held_out_groups_ = np.unique(labels[held]).tolist()
        self.domain_ = domain
        self.scaling_ = np.array([_scaling(v) for v in (flow, pressure, duty)])
        self._train(flow, pressure, duty, np.sqrt(weight), held)
        self.n_features_in_ = 2
        error = self.duty(flow, pressure)[0] - duty
        self.rmse_ = float(np.sqrt(np.mean(error**2)))
        self.n_samples_ = len(rows)
        return self

    def _samples(self, X: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        for name, low in (("hidden", 1), ("restarts", 1), ("max_iter", 1), ("points", 200)):
            if getattr(self, name) < low:
                raise input_error("DutyNetwork", f"{name} = {getattr(self, name)}", f"use {low} up")
        flow, pressure = columns(X, ("flow", "pressure"))
        duty, pressure, flow = checked_samples(y, pressure, flow)
        return flow, pressure, duty

    def _train(
        self,
        flow: FloatArray,
        pressure: FloatArray,
        duty: FloatArray,
        root_weight: FloatArray,
        held: NDArray[np.bool_],
    ) -> None:
        import torch

        from sysid.surfaces import network_training

        scaled = [
            (v - centre) / half
            for v, (centre, half) in zip((flow, pressure, duty), self.scaling_, strict=True)
        ]
        whole = network_training.Samples(
            torch.as_tensor(np.stack(scaled[:2])),
            torch.as_tensor(scaled[2]),
            torch.as_tensor(root_weight / root_weight.mean()),
        )
        children = np.random.SeedSequence(self.seed).generate_state(self.restarts)
        self.restart_seeds_ = [int(s) for s in children]
        with torch.no_grad():
            result = network_training.train(
                network_training.initial_weights(self.restart_seeds_, self.hidden),
                whole.part(torch.as_tensor(np.flatnonzero(~held))),
                whole.part(torch.as_tensor(np.flatnonzero(held))),
                self.max_iter,
                self.patience,
                self.seed,
            )
        best = int(np.argmin(result.held_out))
        self._set_weights(result.weights[best])
        self.restart_rmse_ = result.held_out * self.scaling_[2, 1]
        self.held_out_rmse_ = float(self.restart_rmse_[best])
        self.best_restart_ = best
        self.n_iter_ = int(result.iterations[best])

    def _set_weights(self, weights: FloatArray) -> None:
        hidden = (len(weights) - 1) // 4
        self.hidden_weights_ = weights[: 2 * hidden].reshape(2, hidden).T.copy()
        self.hidden_bias_ = weights[2 * hidden : 3 * hidden].copy()
        self.output_weights_ = weights[3 * hidden : 4 * hidden].copy()
        self.output_bias_ = float(weights[4 * hidden])
        self.n_parameters_ = len(weights)

    @property
    def law(self) -> NetworkLaw:
        """The network as a simulation or a controller takes it."""
        self._require_fitted()
        return NetworkLaw(
            **self.domain_.hull(),
            flow_weights=self.hidden_weights_[:, 0],
            pressure_weights=self.hidden_weights_[:, 1],
            hidden_bias=self.hidden_bias_,
            output_weights=self.output_weights_,
            output_bias=np.asarray(self.output_bias_),
            scaling=self.scaling_,
        )

    def network(self, flow: FloatArray, pressure: FloatArray) -> FloatArray:
        """The bare network's duty (n,), nothing saturated."""
        return np.asarray(self.law.network(flow, pressure)[0])

    def predict(self, X: ArrayLike) -> FloatArray:
        """Duty (n,) at X (n, 2): flow [kg/s], pressure [Pa]; saturated at the domain."""
        self._require_fitted()
        return self.duty(*columns(X, ("flow", "pressure")))[0]

    def duty(self, flow: ArrayLike, pressure: ArrayLike) -> tuple[FloatArray, FlagArray]:
        """Duty for a wanted flow [kg/s] and `Saturation` flags, in the common shape."""
        return evaluated(self.law.bounded_duty, flow, pressure)

    def flow(self, duty: ArrayLike, pressure: ArrayLike) -> tuple[FloatArray, FlagArray]:
        """Mean flow [kg/s] that the network maps to this duty, and `Saturation` flags.

        The forward map for simulation, found by iteration between the lowest and highest flow
        seen at the pressure; where the network is not monotone, the lowest such flow.
        """
        return evaluated(self.law.bounded_flow, duty, pressure)

    def exported(self) -> tuple[ExportedNumbers, ...]:
        """Its numbers for other programs, for centre + half (W2 tanh(W1 x + b1) + b2)."""
        hidden = len(self.hidden_bias_)
        return (
            ExportedNumbers("hidden_weights", self.hidden_weights_, "1", "W1", (hidden, 2)),
            ExportedNumbers("hidden_bias", self.hidden_bias_, "1", "b1", (hidden, 1)),
            ExportedNumbers("output_weights", self.output_weights_, "1", "W2", (1, hidden)),
            ExportedNumbers("output_bias", self.output_bias_, "1", "b2"),
        )

    scaled_units: ClassVar = {"flow_kg_s": "kg/s", "pressure_pa": "Pa", "duty": "1"}
    """Unit of each row of `scaling_`, by its name."""

    def to_dict(self) -> dict[str, Any]:
        """JSON-able: weights, scaling, domain, errors and seeds. `from_dict` reads it."""
        self._require_fitted()

        def dimensionless(value: Any) -> dict[str, Any]:
            # Single weights of a network are not identified: their errors would mean nothing.
            return {"value": value, "std": None, "unit": "1"}

        return {
            "kind": "ann",
            "activation": "tanh",
            "hidden_weights": dimensionless(self.hidden_weights_.tolist()),
            "hidden_bias": dimensionless(self.hidden_bias_.tolist()),
            "output_weights": dimensionless(self.output_weights_.tolist()),
            "output_bias": dimensionless(self.output_bias_),
            "scaling": {
                "flow_kg_s": self.scaling_[0].tolist(),
                "pressure_pa": self.scaling_[1].tolist(),
                "duty": self.scaling_[2].tolist(),
            },
            "domain": self.domain_.to_dict(),
            "rmse_duty": self.rmse_,
            "held_out_rmse_duty": self.held_out_rmse_,
            "n_samples": self.n_samples_,
            "training": {
                "seed": self.seed,
                "restart_seeds": self.restart_seeds_,
                "best_restart": self.best_restart_,
                "iterations": self.n_iter_,
            },
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> DutyNetwork:
        """A network from `to_dict`'s form; numpy only. Raises InputError for a bad one."""
        try:
            parts = [
                np.asarray(content[key]["value"], dtype=float)
                for key in ("hidden_weights", "hidden_bias", "output_weights", "output_bias")
            ]
            training, scaling = content["training"], content["scaling"]
            network = cls(hidden=len(parts[1]), seed=int(training["seed"]))
            network.restarts = len(training["restart_seeds"])
            network.restart_seeds_ = [int(s) for s in training["restart_seeds"]]
            network.best_restart_ = int(training["best_restart"])
            network.n_iter_ = int(training["iterations"])
            scaled = [scaling[k] for k in ("flow_kg_s", "pressure_pa", "duty")]
            network.scaling_ = np.array(scaled, dtype=float)
            network.domain_ = Domain.from_dict(content["domain"])
            network.rmse_ = float(content["rmse_duty"])
            network.held_out_rmse_ = float(content["held_out_rmse_duty"])
            network.n_samples_ = int(content["n_samples"])
        except KeyError as error:
            raise input_error(
                "network surface", f"has no {error.args[0]}", "train the network again"
            ) from None
        hidden = network.hidden
        if [a.shape for a in parts] != [(hidden, 2), (hidden,), (hidden,), ()]:
            raise input_error(
                "network surface", "its weights do not fit together", "train the network again"
            )
        flat = [parts[0].T.ravel(), parts[1], parts[2], parts[3].reshape(1)]
        network._set_weights(np.concatenate(flat))
        network.n_features_in_ = 2
        return network


def _scaling(values: FloatArray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    if high <= low:
        raise NotIdentifiedError(
            "flow, pressure or duty does not vary; valve-pwm tests at several duties would "
            "identify the network"
        )
    return 0.5 * (low + high), 0.5 * (high - low)


@dataclass(frozen=True)
class SizeSweep:
    """Held-out error by number of hidden neurons.

    `sizes` (S,); `rmse` (S,) in duty, pooled over all tests, each held out once;
    `smallest`: the smallest size with an RMSE within 10 % of the best.
    """

    sizes: tuple[int, ...]
    rmse: tuple[float, ...]
    smallest: int


def sweep_hidden_size(
    flow: ArrayLike,
    pressure: ArrayLike,
    duty: ArrayLike,
    groups: ArrayLike | None = None,
    sizes: Sequence[int] = (1, 2, 3, 4, 6, 8, 10, 12, 15),
    folds: int = 3,
    **parameters: Any,
) -> SizeSweep:
    """Which hidden size is enough (thesis 7.3 (3)): held-out RMSE in duty by group folds.

    Samples (n,) as for `DutyNetwork.fit`; `parameters` go to its constructor. The tests
    that a fold holds out stop no training early: those are taken from the others.
    """
    u, p, m = checked_samples(duty, pressure, flow)
    domain = parameters.pop("domain", None) or Domain.from_samples(u, p, m)
    rows = np.flatnonzero(domain.holds_duty(u))
    seed = int(parameters.get("seed", 0))
    labels = duty_levels(u)[1] if groups is None else np.asarray(groups)
    rows = rows[thin_samples(u[rows], p[rows], m[rows], int(parameters.get("points", 5000)), seed)]
    u, p, m, labels = u[rows], p[rows], m[rows], labels[rows]
    rmse = []
    for size in sizes:
        network = DutyNetwork(hidden=size, domain=domain, **parameters)
        error = held_out_duty(network, m, p, u, labels, folds, seed) - u
        rmse.append(float(np.sqrt(np.nanmean(error**2))))
    enough = [size for size, e in zip(sizes, rmse, strict=True) if e <= 1.1 * min(rmse)]
    return SizeSweep(tuple(sizes), tuple(rmse), min(enough))


def held_out_duty(
    network: DutyNetwork,
    flow: FloatArray,
    pressure: FloatArray,
    duty: FloatArray,
    groups: ArrayLike,
    folds: int,
    seed: int,
) -> FloatArray:
    """Duty (n,) predicted for each sample by a network that did not see its test.

    NaN for the tests at the ends of the duty range, which always train.
    """
    predicted = np.full(len(duty), np.nan)
    X = np.column_stack((flow, pressure))
    labels = np.asarray(groups)
    for held in group_folds(labels, duty, folds, seed):
        fitted = DutyNetwork(**network.get_params())
        fitted.fit(X[~held], duty[~held], groups=labels[~held])
        predicted[held] = fitted.predict(X[held])
    return predicted

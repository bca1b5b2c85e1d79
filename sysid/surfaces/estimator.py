"""scikit-learn's estimator interface without importing scikit-learn (which takes 0.7 s).

`sklearn.clone`, `cross_val_score` and `GridSearchCV` ask for `get_params`, `set_params`
and `__sklearn_tags__`; only the last needs scikit-learn, and only scikit-learn calls it. Unusable
samples are a ValueError, and an estimator without a fit a NotFittedError, as it expects. Of
`check_estimator` what needs other columns than a duty and a pressure cannot hold: a surface is of
two, in their ranges (`tests/test_surfaces_sklearn.py` lists those checks, each with the reason).
"""

from __future__ import annotations

import inspect
import sys
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from sysid.errors import InputError, input_error
from sysid.types import FloatArray

_Self = TypeVar("_Self", bound="Regressor")


class SampleError(InputError, ValueError):
    """Samples that a surface cannot be fitted on or evaluated at, which are a ValueError too."""


def sample_error(where: str, what: str, fix: str) -> SampleError:
    """A line that names the place, what is wrong there and the fix."""
    return SampleError(str(input_error(where, what, fix)))


class ExportedNumbers(NamedTuple):
    """Numbers of a surface for another program: `key` in JSON, `matlab` in MAT files (None: not).

    `values` in the shape of the JSON, `shape` that of MATLAB; `unit` one, or a list of each one's.
    """

    key: str
    values: Any
    unit: str | list[str]
    matlab: str | None = None
    shape: tuple[int, ...] = ()


class Regressor:
    """Base of the surfaces: parameters are the arguments of `__init__`, kept as given."""

    n_features_in_: int

    @classmethod
    def _parameter_names(cls) -> list[str]:
        names = list(inspect.signature(cls.__init__).parameters)
        return sorted(name for name in names if name != "self")

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The constructor's arguments by name (`deep` has no effect: none is an estimator)."""
        return {name: getattr(self, name) for name in self._parameter_names()}

    def set_params(self: _Self, **params: Any) -> _Self:
        """Set constructor arguments. Raises ValueError for an unknown name."""
        names = self._parameter_names()
        for name, value in params.items():
            if name not in names:
                raise ValueError(
                    f"{name!r} is not a parameter of {type(self).__name__}; it has {names}"
                )
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self).__init__).parameters
        changed = (
            f"{name}={value!r}"
            for name, value in self.get_params().items()
            if value is not defaults[name].default and value != defaults[name].default
        )
        return f"{type(self).__name__}({', '.join(changed)})"

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "n_features_in_")

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import InputTags, RegressorTags, Tags, TargetTags

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=True),
            regressor_tags=RegressorTags(),
            input_tags=InputTags(),
        )

    def predict(self, X: ArrayLike) -> FloatArray:
        """(n,) predictions for X (n, 2)."""
        raise NotImplementedError

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """Coefficient of determination R2 of `predict(X)` against y (n,), weighted."""
        target = np.asarray(y, dtype=float)
        weight = np.ones_like(target) if sample_weight is None else np.asarray(sample_weight, float)
        mean = np.average(target, weights=weight)
        spread = float(np.sum(weight * (target - mean) ** 2))
        error = float(np.sum(weight * (target - self.predict(X)) ** 2))
        if spread == 0.0:
            return 1.0 if error == 0.0 else 0.0
        return 1.0 - error / spread

    def _require_fitted(self) -> None:
        if self.__sklearn_is_fitted__():
            return
        error = input_error(type(self).__name__, "has not been fitted", "call fit first")
        if "sklearn" not in sys.modules:
            raise error
        from sklearn.exceptions import NotFittedError

        raise type("NotFitted", (InputError, NotFittedError), {})(str(error))


def columns(X: ArrayLike, names: tuple[str, str]) -> tuple[FloatArray, FloatArray]:
    """The two columns of X (n, 2) as float64. Raises InputError for any other shape."""
    fix = f"give two columns, {names[0]} and {names[1]}"
    if hasattr(X, "toarray"):
        raise sample_error("surface", "X is sparse, which is not supported", fix)
    given = np.asarray(X)
    if given.dtype.kind == "c":
        raise sample_error("surface", "Complex data not supported", fix)
    array = np.asarray(given, dtype=float)
    if array.ndim == 2 and array.shape[1] < 2:
        n, k = array.shape
        # In scikit-learn's words, for which its checks look.
        what = f"{k} feature(s) (shape=({n}, {k})) while a minimum of 2 is required."
        raise sample_error("surface", f"X has {what}", fix)
    if array.ndim != 2 or array.shape[1] != 2:
        count = f" (n_samples = {len(array)})" if array.ndim else ""
        raise sample_error("surface", f"X has shape {array.shape}{count}", fix)
    return array[:, 0], array[:, 1]


def checked_samples(
    duty: ArrayLike | None, pressure: ArrayLike, flow: ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Training samples: (n,) each, duty 0 to 1, absolute pressure [Pa], flow [kg/s].

    Raises InputError for other lengths, values that are not finite, or a mistaken unit.
    """
    if duty is None or flow is None:
        what = "requires y to be passed, but the target y is None"
        raise sample_error("surface", what, "give the flow or duty of each sample")
    u, p, m = (np.ascontiguousarray(a, dtype=float) for a in (duty, pressure, flow))
    if u.ndim != 1 or u.shape != p.shape or u.shape != m.shape:
        shapes = f"{u.shape}, {p.shape} and {m.shape}"
        raise sample_error("surface samples", f"have shapes {shapes}", "give (n,) arrays")
    if u.size == 0:
        raise sample_error("surface samples", "there are none", "give samples of a valve-pwm test")
    for name, values in (("duty", u), ("pressure", p), ("flow", m)):
        # A sum is finite when all its terms are; an overflow of finite terms is an error anyway.
        if not np.isfinite(values.sum()):
            row = int(np.argmin(np.isfinite(values)))
            raise sample_error(
                "surface samples", f"{name} is not finite at row {row}", "omit such rows"
            )
    if u.min() < 0.0 or u.max() > 1.0:
        row = int(np.argmax(np.abs(u - 0.5)))
        raise sample_error(
            "surface samples", f"duty = {u[row]:g} at row {row}", "give it from 0 to 1, not percent"
        )
    if p.min() <= 0.0 or p.max() < 2e4:
        raise sample_error(
            "surface samples",
            f"pressure runs from {p.min():g} to {p.max():g}",
            "give absolute pressures in Pa",
        )
    return u, p, m


def checked_weights(sample_weight: ArrayLike | None, n: int) -> FloatArray | None:
    """(n,) finite weights >= 0 with one above 0, or None. Raises InputError otherwise."""
    if sample_weight is None:
        return None
    weight = np.ascontiguousarray(sample_weight, dtype=float)
    if weight.shape != (n,) or not np.isfinite(weight).all() or (weight < 0).any():
        raise sample_error("sample_weight", "is not n finite values >= 0", "give 1/std**2 per row")
    if not weight.any():
        raise sample_error("sample_weight", "is zero everywhere", "give 1/std**2 per row")
    return weight

"""Estimates by the names that a bundle gives them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping

from sysid.estimation.linear import Estimate


class NamedEstimates(ABC):
    """Estimates as items and as attributes: `fit["coulomb_nm"]` is `fit.coulomb_nm`."""

    @abstractmethod
    def by_name(self) -> Mapping[str, Estimate]:
        """All of them, by their names in a bundle."""

    def __getitem__(self, name: str) -> Estimate:
        return self.by_name()[name]

    def __getattr__(self, name: str) -> Estimate:
        # Copying and unpickling ask for attributes of an object that has no fields yet.
        if not name.startswith("_") and self.__dict__:
            known = self.by_name()
            if name in known:
                return known[name]
            raise AttributeError(
                f"{type(self).__name__} has no {name}; it holds {', '.join(known)}"
            )
        raise AttributeError(name)

    def __dir__(self) -> Iterable[str]:
        return [*super().__dir__(), *self.by_name()]


__all__ = ["NamedEstimates"]

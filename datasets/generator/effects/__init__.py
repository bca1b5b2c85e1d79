"""Undeclared effects for the generator's plant: forms, typical sizes, and how they act."""

from datasets.generator.effects.catalogue import (
    FORMS,
    OUT_OF_CATALOGUE,
    Injected,
    name_of,
    parsed,
    typical,
)

__all__ = ["FORMS", "OUT_OF_CATALOGUE", "Injected", "name_of", "parsed", "typical"]

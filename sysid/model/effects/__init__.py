"""The catalogue of effects that the base model lacks, one class each, by subsystem."""

from sysid.model.effects.catalogue import catalogue, class_of, load_user_effects
from sysid.model.effects.entry import CatalogueEffect, Quantity

__all__ = ["CatalogueEffect", "Quantity", "catalogue", "class_of", "load_user_effects"]

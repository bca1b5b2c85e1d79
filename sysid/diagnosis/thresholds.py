"""When an effect is added to a part's law: the numbers, on all of the tests and on parts."""

ACTS = 1e-6
"""Share of what a law predicts that an effect must change at its probing size to count as acting:
far above rounding, far below what any log resolves."""
SIGNIFICANCE = 1e-3
"""Limit of an effect's p-value times the number of effects tried."""
LEAST_REDUCTION = 0.2
"""Share of the mean square prediction error that an effect must remove to be added."""
RIVAL_SHARE = 0.9
"""Share of the winner's reduction above which a rival is indistinguishable in these tests."""
IMITATED = 1e-3
"""Share of its length beyond a model's own slopes below which the model imitates an effect."""
PROBE = 0.3
"""Share of a strength's usual size at which an effect is probed, unless a grid gives others."""
DIGITS = 4
"""Tolerance in comparing shares of the error: two effects may be equivalent on these tests."""

__all__ = ["ACTS", "DIGITS", "IMITATED", "LEAST_REDUCTION", "PROBE", "RIVAL_SHARE", "SIGNIFICANCE"]

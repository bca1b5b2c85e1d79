"""When an effect is added to a part's law: the numbers, on all of the tests and on parts."""

SIGNIFICANCE = 1e-3
"""Of an effect's p-value times the effects that were tried."""
LEAST_GAIN = 0.2
"""Of the mean square error of prediction: what an effect has to take of it to be added."""
RIVAL_SHARE = 0.9
"""Of what the winner takes: more makes a rival that these tests cannot tell from it."""
DIGITS = 4
"""To which shares of the error are compared: two effects may be one and the same here."""

__all__ = ["DIGITS", "LEAST_GAIN", "RIVAL_SHARE", "SIGNIFICANCE"]

"""The assembled model fitted as a whole, by the error of its simulation on the motion logs.

`refine` is the way in. From there: `unknowns` (what may move, its prior and bounds), `runs` (the
stretches that are simulated), `problem` (their errors with slopes, whitened), `settling` and
`reduction` (starts eliminated), `solver` (descent), `scan` (breakaway), `estimation` (all in turn),
`result` and `updating` (what comes out).
"""

"""The assembled model fitted as a whole, by the error of its simulation on the motion logs.

`refine` is the way in. From there: `unknowns` (what may move, its prior and bounds), `runs` (the
stretches that are simulated), `problem` (their errors with slopes, whitened), `settling` and
`reduction` (starts eliminated), `solver` (descent), `scan` (breakaway), `estimation` (all in turn),
`result` and `updating` (what comes out).

`advice` says which test to run next: `candidates`, `bench_candidates` (tests that could be run),
`options` (them and the campaign as one problem), `expected_errors` (the logs refined),
`information` (of a test), `probes` and `effect_sizes` (effects at strength zero), `advice_result`.
"""

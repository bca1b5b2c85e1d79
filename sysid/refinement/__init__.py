"""The assembled model fitted as a whole, by the error of its simulation on the motion logs.

`refine` is the entry point. It uses `unknowns` (parameters with priors and bounds), `runs` (the
stretches that are simulated), `problem` (their whitened residuals with derivatives), `settling` and
`reduction` (start states eliminated), `solver` (descent), `scan` (breakaway), `estimation` (all
steps in order), `result` and `updating` (the outcome).

`advice` says which test to run next: `candidates`, `bench_candidates` (tests that could be run),
`options` (them and the campaign as one problem), `expected_errors` (the logs refined),
`information` (of a test), `probes` and `detectable_effects` (effects at strength zero),
`advice_result`. `motion_errors` says what the errors of the fitted numbers do to the simulated
position, `prediction_bands` and `draws` what they do to every channel.
"""

"""What a fitted model lacks: residuals, screening, refit, verdict.

`search` is the one loop: effects are added and removed round by round, on the `evidence` of
`actuator/`, which judges by simulated twins, or `bench/`, by leave-one-test-out prediction.
`refined` ends with simulation error, by which `rivals` are judged, `lack_of_fit` separates what
repeats from noise, `thresholds` holds what parts are judged by, `search_record` what a search
examined; `result` is the one diagnosis with the effects `found`, `wording` its verdict in words,
`content` what a report shows, as the blocks of `shown` and `shown_part`. `sysid.pipeline.diagnose`
chooses between actuator and parts.
"""

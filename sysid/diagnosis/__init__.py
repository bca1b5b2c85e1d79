"""What a fitted model lacks: residuals, screening, refit, verdict.

`search` is the one loop: effects are added and removed round by round, and `evidence` what it rests
on: `actuator/` judges by simulated twins, `bench/` by tests of a part left out of its fit.
`campaign` chooses between them and extends the bundle, `refined` ends with simulation error,
`remainder` tells what repeats from scatter, `thresholds` holds what parts are judged by, `looked`
what a search looked at; `result` is the one diagnosis with the effects
`found`, `wording` its verdict in words, `content`
what a report shows.
"""

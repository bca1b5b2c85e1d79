"""What the model of a whole actuator lacks, judged against simulated twins.

`diagnose` runs the loop (`loop`): `samples` of the logs and the `breakaways` in them,
`equation_error` and its `whitening`, `starting_friction`, `signatures` of the effects, `twins` and
what they score (`null_distribution`), `screening`, `refit` and `search`, `bias_correction`,
`holdout` errors, `unexplained` structure; `evidence` is what a diagnosis is made of, `figures`
what it shows.
"""

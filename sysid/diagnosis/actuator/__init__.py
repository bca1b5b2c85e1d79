"""What the model of a whole actuator lacks, judged against simulated twins.

`diagnose` runs the loop (`loop`): `samples` of the logs and the `breakaways` in them,
`equation_error` and its `whitening`, `starting_friction`, what `twins` leave
(`null_distribution`), and the search: `signatures` of the effects, all forms `screened` given a
`projection`, as one linear problem (`columns`), the `sets` that explain most by the likelihood of
noise and `misfit`, proposed and fitted (`finder`, `fitted_set`), the best and its rivals
(`search`); then `bias_correction`, `holdout` errors, `unexplained` structure. `evidence` is what a
diagnosis is made of, `figures` what it shows.
"""

"""Parts of a rig tested alone: an axis, a cylinder, a tank, a valve.

Where a campaign holds no whole actuator, no twin can be simulated: what the part's
law lacks is judged by predicting held-out tests. The components are `axis`, `friction_readings`,
`tank` (its logs in `tank_logs`, its gas in `tank_gas`), `restriction`, `valve_flow` and
`valve_time`, entered in `registry`; `component` is what they have in common. `law_choice` picks a
law among a part's, and `diagnose` is the loop over `fitting`, `starting_points`, `selection`,
`stability` and `unexplained`; `evidence` is what a diagnosis is made of.
"""

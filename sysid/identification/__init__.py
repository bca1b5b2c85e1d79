"""The steps of the fits: `friction/`, `valve_discrete/` and `valve_pwm/`, one folder per
pipeline, and their results (`result`).

`sysid.friction`, `sysid.valve_discrete` and `sysid.valve_pwm` are the pipelines that call them.
"""

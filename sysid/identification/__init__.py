"""The steps of the fits: `friction/`, `valve_discrete/` and `valve_pwm/`, a folder a pipeline, and
what they find (`result`).

`sysid.friction`, `sysid.valve_discrete` and `sysid.valve_pwm` are the pipelines that call them.
"""

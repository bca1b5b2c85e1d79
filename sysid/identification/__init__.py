"""The steps of the fits: `friction/`, `valve_discrete/` and `valve_pwm/`, one folder per pipeline;
in each `result.py` is what comes out, `shown.py` its tables and figures.

`sysid.friction`, `sysid.valve_discrete` and `sysid.valve_pwm` are the pipelines that call them.
"""

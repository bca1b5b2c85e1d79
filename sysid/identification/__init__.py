"""The steps of the fits: `friction/`, `valve_discrete/` and `valve_pwm/`, one folder per pipeline;
in each `result.py` is what comes out, `shown.py` its tables and figures. `held_volume.py`: the
error that a held piston's encoder puts into all flows of its chamber. `denied_ratio.py`: whether
tests deny ISO 6358.

`sysid.friction`, `sysid.valve_discrete` and `sysid.valve_pwm` are the pipelines that call them.
"""

"""From constant-duty tests to samples of mean flow; `sysid.valve_pwm` is the pipeline."""

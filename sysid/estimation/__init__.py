"""Statistics: estimates with their uncertainty.

`linear` regression and `Estimate`, `nonlinear` bounded least squares, `autoregression` of errors
that follow one another and `autocovariance` for what they do to standard
errors, `named` estimates as attributes.
"""

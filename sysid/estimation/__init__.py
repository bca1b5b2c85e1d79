"""Statistics: estimates with their uncertainty.

`linear` regression and `Estimate`, `nonlinear` bounded least squares, `autocovariance` for
autocorrelated errors, `named` estimates as attributes.
"""

"""Statistics: estimates with their uncertainty.

`linear` regression and `Estimate`, `nonlinear` bounded least squares, `autocovariance` for
autocorrelated errors, `profile` intervals without a quadratic sum of squares,
`named` estimates as attributes.
"""

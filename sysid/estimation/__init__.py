"""Statistics: estimates with their uncertainty.

`linear` regression and `Estimate`, `nonlinear` bounded least squares, `autocovariance` for
errors that follow one another in time, `profile` intervals without a quadratic sum of squares,
`named` estimates as attributes.
"""

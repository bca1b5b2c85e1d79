"""Which set of effects a residual is evidence for, whatever the part that it is of.

`misfit`: the likelihood of a channel's residual under noise of a known size and a misfit of an
unknown one. `columns`: what every form of every effect would do to it, as normal equations.
`sets`: the sets of effects that explain it best, by their marginal likelihood.
"""

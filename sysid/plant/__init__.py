"""The physics, in one place: equations (`base`), valve timing, ports for effects, simulation.

Importing this package does not import jax: `base` and `valve_timing` need numpy only, and
`simulator` is imported by name where it is used.
"""

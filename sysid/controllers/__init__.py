"""Controllers that read a bundle, and the closed loop that runs them (thesis, chapters 4 to 6).

Importing this package loads numpy only; `sysid.controllers.loop`, which simulates, loads jax.
"""

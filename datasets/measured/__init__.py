"""Measured sets: what turns each into campaigns, and the one command that runs them all.

The data are not here: they lie in ../shared/data, and nothing of them is copied into the
project. See README.md.
"""

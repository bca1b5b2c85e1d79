"""Measured sets: recipes that turn each into campaigns, and one command that runs them all.

The data are not here: they are in ../shared/data, and nothing of them is copied into the
project. See README.md.
"""

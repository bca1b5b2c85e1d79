"""Tests that a rig can play: commands designed for what is asked, and the file that holds them.

`signals.py`: multisines and steps as commands; `limits.py`: what no test may exceed, also on plants
that differ from the model; `design.py`: the tests that say most; `result.py`: what is shown and
written.
"""

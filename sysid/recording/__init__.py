"""Tests as the fits, the balances and the simulations use them.

`recording.py`: one test on a time grid, with its channels by name, what of it is unusable, and the
noise of its position; `even.py`: a logged test brought onto an even grid; `friction_kind.py`: which
kind of friction test one is, and the stretch over which its effort is constant; `encoder.py`: which
of an encoder's readings are rests.

`motion_tests.py`: a motion log's tests with their segments, each from an estimated state
(`start_states.py`), once nothing speaks against it (`motion_checks.py`); `simulation.py`: these
simulated open loop.
"""

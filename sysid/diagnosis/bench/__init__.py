"""Parts of a rig tested alone: an axis, a cylinder, a tank, a valve. Law, lack, verdict.

Where a campaign holds no whole actuator (an axis without chambers, a tank without a piston,
a valve on a bench) there is nothing to simulate a twin of. What the part's law lacks is then
told by predicting tests that were left out.
"""

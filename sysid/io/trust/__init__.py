"""Faults of a log, found in its own samples: `repair` finds and fixes `wraps` of a
position's counter, readings that repeat (`stale`), `jumps` of a position, and rows too far apart
for what they sample (`slow`); `misread` samples are reported once the units are known to be right.
"""

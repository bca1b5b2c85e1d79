"""What a log cannot be trusted in, found in its own samples: `mending` goes through `wraps` of a
position's counter, readings that repeat (`stale`), `jumps` of a position, and rows too far apart
for what they sample (`slow`); `misread` samples are told once the units are known to be right.
"""

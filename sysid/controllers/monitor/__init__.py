"""A monitor on a controller: an observer whose innovations tell when the machine left its bundle.

`drifts.py`: what may drift, and of which kind it is; `terms.py`: the model's rates and their slopes
at a point; `observer.py`: one sample of the observers of shaft and chambers; `design.py`: noise,
scatter and errors of a bundle, as the monitor takes them; `evidence.py`: a cycle's normal
equations, their recursion, the tests and their smallest detectable changes; `strokes.py`: where a
cycle ends; `reference.py`: the cycle on which the changes of a bundle are computed; `logged.py`:
the monitor over recorded tests. The same in C: `sysid/exporters/monitor.h.in`.
"""

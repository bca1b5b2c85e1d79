"""Several bundles: of one rig over time, or of many rigs.

`comparison.py`: bundles next to each other and what moved; `origin.py`: the rig and the date of a
campaign; `rows.py`: one campaign of a fleet; `changes.py`: from which date on a series is another;
`trend.py`: one number's series; `trends.py`: the series of a fleet; `signs.py`: what changes
together mean; `leakage.py`: what a chamber loses; `shown.py`: all of it as blocks.
"""

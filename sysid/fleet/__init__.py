"""Several bundles: of one rig over time, or of many rigs.

`parameters.py`: what a bundle holds, by place; `comparison.py`: bundles next to each other and
what moved; `origin.py`: the rig and the date of a campaign; `rows.py`: one campaign of a fleet;
`changes.py`: from which date on a series is another; `trend.py`: one number's series; `signs.py`:
what changes together mean; `trends.py`: the series of a fleet.
"""

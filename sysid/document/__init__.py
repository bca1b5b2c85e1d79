"""The report: one self-contained HTML page about a campaign, its fits and their validation.

`page` puts the sections together: `opening` (the verdict on top), `quality`, `friction`,
`valves`, `surfaces`, `motion`, `residuals`, `provenance`, and those that results describe in their
own rooms (`shown.py` there). `html` is the frame of a page, `svg` and `interactive` draw its
figures, `shown_tests` says which tests are drawn.
"""

from sysid.document.page import render_report, write_report

__all__ = ["render_report", "write_report"]

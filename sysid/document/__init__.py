"""The report: one self-contained HTML page about a campaign, its fits and their validation.

`page` puts the sections together: `opening` (the verdict on top), `quality`, `friction`,
`valves`, `surfaces`, `motion`, `residuals`, `diagnosis` with `diagnosis_panels`,
`own_component` (one of the user's own), `provenance`. `blocks` is what a section is made of, `html`
the frame of a page, `svg` and `interactive` its figures, `shown_tests` which tests are drawn.
"""

from sysid.document.page import render_report, write_report

__all__ = ["render_report", "write_report"]

"""The report: one self-contained HTML page about a campaign, its fits and their validation."""

from sysid.report.page import render_report, write_report

__all__ = ["render_report", "write_report"]

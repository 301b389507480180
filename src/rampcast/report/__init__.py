"""The report for people who run ramps: one page about this ramp and these minutes, slides, and the numbers."""

from rampcast.report.page import SLIDES, About, report_on, write_picture, write_report

__all__ = ["SLIDES", "About", "report_on", "write_picture", "write_report"]

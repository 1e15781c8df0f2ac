"""The report: fit result and diagnosis as one HTML file that needs nothing else."""

from fit.report.motion import ReportMotion, Run
from fit.report.page import write_report

__all__ = ["ReportMotion", "Run", "write_report"]

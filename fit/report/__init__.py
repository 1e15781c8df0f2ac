"""The report: fit result and diagnosis as one HTML file that needs nothing else."""

from fit.report.motion import ReportMotion
from fit.report.page import write_report

__all__ = ["ReportMotion", "write_report"]

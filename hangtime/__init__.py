"""Use Hangtime from Python: load takes, fit a cloth simulation to them, diagnose it, simulate, report, export.

The work is done in `fit.api`; `docs/tutorial/python.md` is a worked example.
"""

from fit.api.calls import diagnose, export, fit, load, report, simulate
from fit.api.results import DiagnosisOutcome, FitOutcome, Simulation
from formats.errors import HangtimeError
from formats.take import Take

__all__ = [
    "DiagnosisOutcome",
    "FitOutcome",
    "HangtimeError",
    "Simulation",
    "Take",
    "diagnose",
    "export",
    "fit",
    "load",
    "report",
    "simulate",
]

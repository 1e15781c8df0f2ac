"""Use Hangtime from Python: load takes, fit a cloth simulation to them, diagnose it, simulate, report, export.

The work is done in `fit.api`; `docs/tutorial/python.md` is a worked example. Each name is imported when it is first
used, so that `python -m hangtime` starts as quickly as `hangtime`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
_MODULES = {
    "fit.api.calls": ("diagnose", "export", "fit", "load", "report", "simulate"),
    "fit.api.results": ("DiagnosisOutcome", "FitOutcome", "Simulation"),
    "formats.errors": ("HangtimeError",),
    "formats.take": ("Take",),
}


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            globals()[name] = found = getattr(import_module(module), name)
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__

"""A plugin of pytest for mutmut: run the shortest tests first, and show which test fails without a mutant.

The first test that fails ends the test of a mutant. mutmut hands over the tests of a function in any order. The tests
of one file stay together, since they may share what a fixture made. The files come by their tests' mean duration.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

SHOWN = 1500  # characters of the end of a traceback; our choice: fewer than the last words that the program prints


@cache
def durations() -> dict[str, float]:
    """Return the durations [s] that mutmut measured without a mutant, by test; none before it has measured them."""
    path = Path("mutmut-stats.json")  # pytest runs in mutmut's folder
    return dict(json.loads(path.read_text())["duration_by_test"]) if path.exists() else {}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    took, files = durations(), defaultdict[Path, list[float]](list)
    for item in items:
        files[item.path].append(took.get(item.nodeid, 0.0))
    items.sort(key=lambda item: (sum(of := files[item.path]) / len(of), str(item.path), took.get(item.nodeid, 0.0)))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Write past mutmut, which swallows what pytest prints."""
    if report.failed and os.environ.get("MUTANT_UNDER_TEST") in ("stats", ""):  # while it learns, and before mutants
        os.write(2, f"\n{report.nodeid} fails without a mutant:\n{report.longreprtext[-SHOWN:]}\n".encode())

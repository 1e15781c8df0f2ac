"""What every test of this folder shares."""

from __future__ import annotations

import pytest

from fit.gap import power
from fit.gap.detectable import smallest_detectable
from fit.observer.residuals import Observer


@pytest.fixture(autouse=True)
def _evidence_of_made_up_figures_hides_no_effect(monkeypatch):
    """`tests/fit/gap/verdict_scene.py` makes up errors and no residuals, from which nothing detectable follows."""

    def real_or_nothing(evidence):
        return smallest_detectable(evidence) if isinstance(evidence.observer, Observer) else {}

    monkeypatch.setattr(power, "smallest_detectable", real_or_nothing)

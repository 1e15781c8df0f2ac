"""The benchmarks are listed and load, and the demo does what the README states."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

from formats.results import load_diagnosis

ROOT = Path(__file__).parents[1]
BENCHMARKS = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py"))


def test_every_benchmark_is_in_the_table_and_nothing_else_is():
    text = (ROOT / "benchmarks/README.md").read_text()
    assert set(re.findall(r"`(\w+)\.py`", text)) == set(BENCHMARKS)


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_loads(name):
    module = importlib.import_module(f"benchmarks.{name}")
    assert module.__doc__


def ran(name):
    done = subprocess.run(
        [sys.executable, f"benchmarks/{name}.py"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout


@pytest.mark.slow
def test_an_archive_is_as_small_as_it_is_said_to_be():
    size = re.search(r"2 mm: ([0-9.]+) bytes a frame", ran("archive"))
    assert size is not None
    assert 0 < float(size[1]) <= 30


@pytest.mark.slow
def test_a_diagnosis_costs_no_more_simulations_than_it_may():
    said = ran("diagnosis_cost")
    assert "air drag" in said.lower()
    cost = re.search(r"simulations, ([0-9]+) a take", said)
    assert cost is not None
    assert 0 < float(cost[1]) <= 400


@pytest.mark.slow
@pytest.mark.processor_time(1200)
def test_the_demo_names_the_drag_that_was_planted_and_is_quick_the_second_time():
    first = subprocess.run(["scripts/demo"], cwd=ROOT, capture_output=True, text=True, check=True)
    found = load_diagnosis(ROOT / "demo/diagnosis.json")
    assert f"demo: verdict: {found.sentence}" in first.stdout
    assert (found.verdict, found.named) == ("effect", ["air_drag"])
    (drag,) = (f for f in found.effects if f.id == "air_drag")
    assert drag.amplitude_interval is not None
    low, high = drag.amplitude_interval
    assert low <= 1.2 <= high
    page = (ROOT / "demo/report.html").read_text()
    assert found.sentence.split(".")[0] in page
    second = subprocess.run(["scripts/demo"], cwd=ROOT, capture_output=True, text=True, check=True, timeout=600)
    assert second.stdout.count("up to date, skipped") == 4

"""A batch that a signal ends writes its summary, and no library writes to the user's terminal."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from tests.fit.batch.night import make_takes, said, start, wait_for
from tests.repository import ROOT

LONG = ("--method", "kinect-skirt", "--iterations", 100_000, "--spacing", 0.05)  # hours: a signal ends it
LEAK = (
    "from fit.runtime import start_tracker\n"
    "from multiprocessing import resource_tracker\n"
    "{start}\n"
    "resource_tracker.register('/hangtime-absent', 'semaphore')\n"
)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_batch_that_a_signal_ends_prints_its_own_words_alone(tmp_path, number):
    (tmp_path / "takes").mkdir()
    make_takes(tmp_path / "takes", 1)
    process = start(
        "batch", "takes", "--out", "out", "--workers", 1, "--dashboard-port", 0, *LONG, folder=tmp_path, PYTHONPATH=ROOT
    )
    wait_for(lambda: list((tmp_path / "out/unfinished").glob("*.json")))
    os.kill(process.pid, number)
    code = process.wait(60)
    wait_for(lambda: not members(process.pid))  # what it has started may still write
    lines = said(tmp_path).splitlines()
    own = ("1 take", "Dashboard: ", "batch: ", "Summary: ", "Interrupted; the same command continues.")
    assert [line for line in lines if not line.startswith(own)] == []
    if number != signal.SIGKILL:
        assert code == 130
        assert (tmp_path / "out/summary.csv").exists()
        assert lines[-1] == "Interrupted; the same command continues."


def members(group):
    """Processes of a session, the tracker of semaphores among them; none is left to be waited for."""
    found = subprocess.run(["ps", "-o", "pid=,stat=", "-s", str(group)], capture_output=True, text=True, check=False)
    return [line for line in found.stdout.splitlines() if "Z" not in line.split()[1]]


@pytest.mark.parametrize(
    ("begin", "is_told"), [("start_tracker()", False), ("resource_tracker.ensure_running()", True)]
)
def test_the_tracker_of_a_command_says_nothing_of_what_is_left(tmp_path, begin, is_told):
    """Without the silent start Python's own process warns, so this test would fail for another Python's wording."""
    done = subprocess.run(
        [sys.executable, "-c", LEAK.format(start=begin)], capture_output=True, text=True, check=True, cwd=ROOT
    )  # its tracker holds stderr open, so that its words are waited for
    assert ("leaked" in done.stderr) is is_told

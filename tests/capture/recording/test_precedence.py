"""Real-time priority: real threads under the kernel's scheduler, with and without the privilege."""

from __future__ import annotations

import ctypes
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from capture.recording.precedence import FETCHING, TRACKING

LIMITS = Path(__file__).parents[3] / "systemd/limits.d/55-hangtime.conf"
DROP_FROM_BOUNDS, SYS_NICE = 24, 23  # prctl(PR_CAPBSET_DROP, CAP_SYS_NICE): of root's rights, too, this one is taken
ASK = """
import json, os, threading
from capture.recording.precedence import Precedence

def rank():
    return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority

seen = {}
with Precedence() as precedence:
    thread = threading.Thread(target=lambda: seen.update(fetching=rank()))
    thread.start()
    thread.join()
    precedence.begin_tracking()
    seen |= {"tracking": rank(), "granted": precedence.is_granted}
print(json.dumps(seen | {"after": rank()}))
"""


def asked(prepare=None):
    """Request real-time priority in a separate process, which begins with the ordinary schedule."""

    def begin():
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # not that of tests before, in this process
        if prepare is not None:
            prepare()

    done = subprocess.run(
        [sys.executable, "-c", ASK], preexec_fn=begin, capture_output=True, text=True, check=True,
        cwd=Path(__file__).parents[3],
    )  # fmt: skip
    return json.loads(done.stdout)


def give_up_the_right():
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    ctypes.CDLL(None).prctl(DROP_FROM_BOUNDS, SYS_NICE)


def test_fetching_precedes_tracking_and_both_precede_all_others():
    if os.geteuid() != 0 and resource.getrlimit(resource.RLIMIT_RTPRIO)[0] < FETCHING:
        pytest.skip("this user may not have real-time priorities")
    assert asked() == {
        "granted": True, "fetching": [os.SCHED_RR, FETCHING], "tracking": [os.SCHED_RR, TRACKING],
        "after": [os.SCHED_OTHER, 0],
    }  # fmt: skip


def test_a_process_without_the_right_to_precedence_keeps_its_ordinary_schedule():
    ordinary = [os.SCHED_OTHER, 0]
    assert asked(give_up_the_right) == {"granted": False, "fetching": ordinary, "tracking": ordinary, "after": ordinary}


def test_the_limits_that_are_shipped_are_those_that_are_asked_for():
    lines = [line.split() for line in LIMITS.read_text().splitlines() if line and not line.startswith("#")]
    assert lines == [["@plugdev", "-", "rtprio", str(FETCHING)]]

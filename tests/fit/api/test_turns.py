"""Calls of several threads: one computes at a time, and a progress may wait for a call of another thread."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
import time

import pytest

from fit.api import watched
from fit.api.watched import one_at_a_time
from tests.fit.batch.night import make_takes

HANGS = 60.0  # s; a call that waits for itself ends by this time, on a busy machine too

WAITING = """
import sys, threading
import hangtime

def fit(progress=False):
    outcome = hangtime.fit(sys.argv[1], spacing=0.2, method="kinect-skirt", iterations=40, progress=progress)
    return [one.fitted for one in outcome.result.parameters]

found = []
def wait_for_another(done, total, best):
    if len(found) < 2:
        thread = threading.Thread(target=lambda: found.append(fit()), daemon=True)
        thread.start()
        thread.join(120)
        found or sys.exit("the thread's call hangs")

whole = fit()
disturbed = fit(wait_for_another)
print(len(found), found[0] == found[-1] == whole == disturbed)
"""


def in_thread(work):
    """Run some work in another thread; whether it ended."""
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(HANGS)
    return not thread.is_alive()


@pytest.mark.parametrize("shown", [watched.diagnosis_shown, lambda progress: watched.fit_shown(progress, None)])
def test_a_progress_may_wait_for_a_call_of_another_thread(shown):
    ended = []

    @one_at_a_time
    def call(progress):
        with shown(progress) as show:
            return show("stage", 0.5)

    assert call(lambda stage, share: ended.append(in_thread(one_at_a_time(lambda: None))) or share) == 0.5
    assert ended == [True]


def test_a_call_goes_on_after_the_calls_that_began_during_its_progress():
    order, inside, leave = [], threading.Event(), threading.Event()

    @one_at_a_time
    def other():
        order.append("other begins")
        inside.set()
        leave.wait(HANGS)
        order.append("other ends")

    @one_at_a_time
    def call():
        with watched.diagnosis_shown(lambda stage, share: (thread.start(), inside.wait(HANGS))) as show:
            threading.Timer(0.2, leave.set).start()
            show("stage", 0.5)
            order.append("goes on")

    thread = threading.Thread(target=other)
    call()
    thread.join()
    assert order == ["other begins", "other ends", "goes on"]


def test_a_progress_that_only_shows_figures_lets_no_other_call_begin():
    """The first of several fits would end last, and the memory of all would be needed at once."""
    order, threads = [], [threading.Thread(target=one_at_a_time(lambda: order.append("other"))) for _ in range(3)]

    @one_at_a_time
    def call():
        with watched.diagnosis_shown(lambda stage, share: (time.sleep(1e-3), order.append(share))) as show:
            for thread in threads:
                thread.start()
            for done in range(50):
                show("stage", done)

    call()
    for thread in threads:
        thread.join()
    assert order == [*range(50), *["other"] * 3]


def test_a_call_whose_progress_is_done_goes_on_before_any_other_call_begins():
    order, inside = [], threading.Event()
    further = threading.Thread(target=one_at_a_time(lambda: order.append("further")))

    def begin_two():
        one_at_a_time(lambda: (inside.set(), time.sleep(0.3)))()
        one_at_a_time(lambda: order.append("second of the other"))()

    other = threading.Thread(target=begin_two)

    @one_at_a_time
    def call():
        with watched.diagnosis_shown(lambda stage, share: (other.start(), inside.wait(HANGS), further.start())) as show:
            show("stage", 0.5)
            time.sleep(0.3)
            order.append("goes on")

    call()
    other.join()
    further.join()
    assert order[0] == "goes on"
    assert len(order) == 3


def test_a_call_outside_of_any_progress_is_waited_for():
    order, inside, leave = [], threading.Event(), threading.Event()
    first = threading.Thread(target=one_at_a_time(lambda: (inside.set(), leave.wait(HANGS), order.append("first"))))
    second = threading.Thread(target=one_at_a_time(lambda: order.append("second")))
    first.start()
    assert inside.wait(HANGS)
    second.start()
    second.join(0.2)
    assert order == []
    leave.set()
    first.join()
    second.join()
    assert order == ["first", "second"]


def test_a_progress_may_call_hangtime_itself_and_one_that_fails_leaves_no_call_behind():
    @one_at_a_time
    def call(progress):
        with watched.diagnosis_shown(progress) as show:
            show("stage", 0.5)

    met = []
    call(lambda stage, share: one_at_a_time(lambda: met.append(share))())
    assert met == [0.5]
    with contextlib.suppress(ZeroDivisionError):
        call(lambda stage, share: 1 / 0)
    assert in_thread(lambda: call(lambda stage, share: met.append(share)))
    assert met == [0.5, 0.5]


def test_a_fit_whose_progress_waits_for_a_fit_of_another_thread_gives_the_same_numbers(tmp_path):
    make_takes(tmp_path, 1)
    done = subprocess.run(
        [sys.executable, "-c", WAITING, tmp_path / "swing0.mcap"], capture_output=True, text=True, check=False
    )
    assert done.stdout == "2 True\n", done.stderr

"""A call from Python shows its progress where somebody sees it, and Ctrl-C ends it in one sentence."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import subprocess
import sys
import threading
import types

import msgspec
import pytest

import hangtime
from fit.api import watched
from formats import terminal
from tests.fit.batch.night import make_takes

QUICK = {"method": "kinect-skirt", "search": "annealing", "iterations": 12, "spacing": 0.2, "seed": 3}
SCRIPT = """
import hangtime, os, signal
def after_a_third(done, total, best):
    if done * 3 >= total: os.kill(os.getpid(), signal.SIGINT)
hangtime.fit("swing0.mcap", checkpoint={checkpoint!r}, progress=after_a_third, **{options!r})
"""


@pytest.fixture(scope="module")
def take(tmp_path_factory):
    return make_takes(tmp_path_factory.mktemp("watched"), 1) / "swing0.mcap"


class Terminal(io.StringIO):
    """A stream that a person sees."""

    def isatty(self):
        return True


def in_a_notebook():
    """The stream of a notebook's cell, as ipykernel makes it: no terminal."""
    kind = types.new_class(
        "OutStream", (io.StringIO,), exec_body=lambda body: body.update(__module__="ipykernel.iostream")
    )
    return kind()


def fitted(take, stream, monkeypatch, **options):
    monkeypatch.setattr(sys, "stderr", stream)
    result = hangtime.fit(take, **QUICK, **options).result
    return msgspec.structs.replace(result, created="", seconds=0.0), stream.getvalue()


def test_a_fit_shows_the_commands_line_where_it_is_seen_and_its_numbers_stay_the_same(take, monkeypatch):
    quiet, said = fitted(take, io.StringIO(), monkeypatch)
    assert said == ""
    for stream in (Terminal(), in_a_notebook()):
        shown, said = fitted(take, stream, monkeypatch)
        assert shown == quiet
        assert "\rannealing [##########] 100 %" in said
        assert "mm mean distance on fitted takes, 12/12" in said
        assert said.endswith("\n")
    shown, said = fitted(take, Terminal(), monkeypatch, progress=False)
    assert (shown, said) == (quiet, "")


def test_a_diagnosis_shows_stage_and_share_on_a_terminal_alone(monkeypatch):
    for stream, progress, is_shown in (
        (Terminal(), None, True), (Terminal(), True, True), (Terminal(), False, False), (io.StringIO(), None, False),
    ):  # fmt: skip
        monkeypatch.setattr(sys, "stderr", stream)
        with watched.diagnosis_shown(progress) as show:
            show("noise floor", 0.3)
        assert ("\rdiagnosis [###......." in stream.getvalue()) is is_shown
        assert ("noise floor" in stream.getvalue()) is is_shown


@pytest.mark.parametrize(
    ("checkpoint", "sentence"),
    [
        ("kept.json", "Interrupted; finished work is kept in kept.json. The same call continues."),
        (None, "Interrupted; nothing is kept. With checkpoint=PATH, the same call would continue."),
    ],
)
def test_ctrl_c_is_one_sentence_without_inner_frames_and_the_same_call_continues(take, tmp_path, checkpoint, sentence):
    script = SCRIPT.format(checkpoint=checkpoint, options=QUICK)
    (tmp_path / "swing0.mcap").symlink_to(take)
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0
    assert done.stderr.splitlines()[-1] == f"KeyboardInterrupt: {sentence}"
    assert done.stderr.count("  File ") == 2  # the caller's line, and the call
    assert "calibrate" not in done.stderr
    assert (tmp_path / "kept.json").exists() is (checkpoint is not None)
    if checkpoint is not None:
        steps = []
        again = hangtime.fit(
            take, checkpoint=tmp_path / checkpoint, progress=lambda done, *_: steps.append(done), **QUICK
        )
        assert steps[0] >= 4
        whole = hangtime.fit(take, progress=False, **QUICK)
        assert again.result.parameters == whole.result.parameters
        assert again.result.error == whole.result.error


def test_ctrl_c_that_a_library_swallows_ends_the_call_at_its_next_progress_and_pythons_handler_is_back(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    before = signal.getsignal(signal.SIGINT)

    @watched.ends_in_a_sentence
    def call(*, checkpoint=None):
        with watched.diagnosis_shown(None) as show:
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            show("noise floor", 0.3)
            pytest.fail("it went on")

    with pytest.raises(KeyboardInterrupt, match=r"^Interrupted; nothing was finished yet\. The same call begins anew"):
        call(checkpoint="nowhere")
    assert signal.getsignal(signal.SIGINT) is before


def test_a_call_of_another_thread_leaves_the_handler_of_the_main_one():
    met = []
    call = watched.ends_in_a_sentence(lambda: met.append(signal.getsignal(signal.SIGINT)))
    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    assert met == [signal.getsignal(signal.SIGINT)]


def test_an_interrupted_call_ends_no_later_one_and_none_of_another_thread(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    ended = []

    def work():
        with watched.diagnosis_shown(None) as show:
            show("noise floor", 0.3)
        ended.append(threading.current_thread().name)

    @watched.ends_in_a_sentence
    def interrupted():
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        other = threading.Thread(target=watched.ends_in_a_sentence(work), name="beside")
        other.start()
        other.join()
        work()

    with pytest.raises(KeyboardInterrupt, match=r"^Interrupted; nothing is kept\."):
        interrupted()
    later = threading.Thread(target=watched.ends_in_a_sentence(work), name="later")
    later.start()
    later.join()
    work()
    assert ended == ["beside", "later", "MainThread"]


@pytest.mark.parametrize("progress", [7, "yes", []])
def test_a_progress_that_is_neither_function_nor_truth_is_refused(take, progress):
    with pytest.raises(hangtime.HangtimeError, match=r"^progress: cannot be called; give a function, True or False$"):
        hangtime.fit(take, progress=progress)


def test_a_stream_of_ipykernel_is_a_notebooks(monkeypatch):
    for stream, is_one in ((in_a_notebook(), True), (io.StringIO(), False), (None, False)):
        monkeypatch.setattr(sys, "stderr", stream)
        assert terminal.is_in_notebook() is is_one


THREADS = """
import sys, threading
import hangtime

found = []
def fit():
    outcome = hangtime.fit(sys.argv[1], spacing=0.2, method="kinect-skirt", iterations=2)
    found.append([one.fitted for one in outcome.result.parameters])

threads = [threading.Thread(target=fit) for _ in range(2)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(len(found), found[0] == found[-1])
"""


def test_two_fits_in_threads_of_a_new_process_come_one_after_the_other(take):
    done = subprocess.run([sys.executable, "-c", THREADS, take], capture_output=True, text=True, check=False)
    assert done.stdout == "2 True\n", done.stderr


def test_a_forked_process_waits_for_no_thread_of_its_parent():
    inside, leave = threading.Event(), threading.Event()
    thread = threading.Thread(target=watched.one_at_a_time(lambda: (inside.set(), leave.wait(30))))
    thread.start()
    assert inside.wait(30)
    child = os.fork()
    if not child:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(10)  # a process that waits ends by this signal
        watched.one_at_a_time(lambda: None)()
        os._exit(0)
    try:
        assert os.waitpid(child, 0)[1] == 0
    finally:
        leave.set()
        thread.join()

"""Ctrl-C in this process: obeyed at once, kept for later where a library swallows it, and held while one loads."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from formats.interrupts import end_undisturbed, ended_like_ctrl_c, held, raise_swallowed, remember_interruptions


@pytest.fixture(autouse=True)
def handler():
    """Python's own, also where `nohup` runs the tests with SIGHUP ignored, and afterwards the one that was there."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    hung_up = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, hung_up)
    signal.signal(signal.SIGINT, before)
    remember_interruptions()
    signal.signal(signal.SIGINT, before)


def test_an_interruption_ends_the_work_and_is_known_until_the_next_command():
    remember_interruptions()
    raise_swallowed()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            raise_swallowed()
    remember_interruptions()
    raise_swallowed()


def test_a_handler_of_somebody_else_stays():
    met = []
    signal.signal(signal.SIGINT, lambda number, frame: met.append(number))
    remember_interruptions()
    signal.raise_signal(signal.SIGINT)
    assert met == [signal.SIGINT]
    raise_swallowed()


def test_an_interruption_waits_for_the_end_of_what_is_held():
    done = []

    def work():
        with held():
            signal.raise_signal(signal.SIGINT)
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["all of it"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with held():
        done.append("more")
    assert done == ["all of it", "more"]


def test_an_interruption_that_is_ignored_stays_so_and_one_that_is_handled_is_handled_afterwards():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with held():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        signal.raise_signal(signal.SIGINT)
    met = []
    signal.signal(signal.SIGINT, lambda number, frame: met.append((number, frame)))
    with held():
        signal.raise_signal(signal.SIGINT)
        assert met == []
    assert met == [(signal.SIGINT, None)]


def test_a_handler_that_a_library_brings_stays():
    def own(number, frame):
        raise AssertionError

    with held():
        signal.signal(signal.SIGINT, own)
    assert signal.getsignal(signal.SIGINT) is own


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("is_ignored", [False, True])
def test_the_first_signal_that_ends_a_command_is_a_ctrl_c_and_the_second_nothing(number, is_ignored):
    """A shell ignores Ctrl-C for a command in the background, which SIGTERM ends all the same."""
    if is_ignored:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    before, done = signal.getsignal(number), []
    with ended_like_ctrl_c():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        signal.raise_signal(number)
        done.append("tidied up")
    assert done == ["tidied up"]
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("is_ignored", [False, True])
def test_a_signal_that_ends_a_command_waits_where_ctrl_c_waits(is_ignored):
    """Also where a shell ignores Ctrl-C."""
    if is_ignored:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    done = []

    def work():
        with held():
            signal.raise_signal(signal.SIGTERM)
            done.append("all of it")

    with ended_like_ctrl_c(), pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["all of it"]


def test_a_hang_up_that_nohup_ignores_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with ended_like_ctrl_c():
        signal.raise_signal(signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    signal.signal(signal.SIGHUP, before)


INTERRUPTED_AT = """
import signal, sys

def interrupt(event, details):
    if event == "import" and details[0] == {module!r}:
        signal.raise_signal(signal.SIGINT)

sys.addaudithook(interrupt)
from formats.start import main
{before}
main()
"""


@pytest.mark.parametrize("module", ["formats.interrupts", "typer", "formats.terminal"])
def test_an_interruption_while_the_command_is_imported_ends_it_in_one_line(module):
    code = INTERRUPTED_AT.format(module=module, before="")
    done = subprocess.run([sys.executable, "-c", code, "takes"], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "Interrupted.\n")


def test_an_interruption_while_the_command_is_imported_ends_it_where_nobody_reads():
    code = INTERRUPTED_AT.format(module="typer", before="import os; os.close(2)")
    done = subprocess.run([sys.executable, "-c", code, "takes"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, "")


ENDING = """
import atexit, signal, sys

def keep():
    for _ in range({times}):
        signal.raise_signal(signal.SIGINT)
    print("kept", flush=True)

atexit.register(keep)
from formats.start import main
main()
"""


@pytest.mark.parametrize(("times", "told"), [(1, (0, "kept\n")), (2, (-signal.SIGINT, ""))])
def test_an_interruption_at_the_end_of_the_process_prints_no_stack(times, told):
    """The first leaves what libraries do then, and the exit code; the second ends it all."""
    words = [sys.executable, "-c", ENDING.format(times=times), "--version"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert (done.returncode, done.stdout.partition("\n")[2], done.stderr) == (*told, "")


def test_an_interruption_that_a_shell_ignores_stays_so_at_the_end_of_the_process():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_undisturbed()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN

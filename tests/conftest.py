"""Limit the processor time of every test, report the slowest tests, and group tests by process.

A limit on wall time ends healthy tests on a busy machine, where each process gets a share of a processor. Here the
limit is on the processor time of the test's process and of its child processes. A test that waits for an event
that never comes uses no processor time. It ends after ten minutes without progress.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import inspect
import os
import resource
import signal
import sys
from collections.abc import Iterator
from typing import Any

import psutil
import pytest
import typer.testing
from _pytest.runner import runtestprotocol

from tests.whole_errors import whole_errors  # noqa: F401

# Taichi asks of each of its 150 functions in which class it is, and so for the source of Python's importer, which has
# none. Unless `inspect` knows whose file that is, it looks at all modules each time, which makes 1 s in every process.
inspect.modulesbyfile["<frozen importlib._bootstrap>"] = "importlib._bootstrap"

# Arrays of pictures are made and freed all the time. By default the C library gives their memory back each time, and
# the kernel clears it anew: a fifth of what it takes to draw a frame. This holds in this process, not in its children.
TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # numbers of the parameters, <malloc.h> of glibc
with contextlib.suppress(AttributeError, OSError):  # another C library
    ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, 32 << 20)  # bytes; the most that glibc takes
    ctypes.CDLL(None).mallopt(TRIM_THRESHOLD, 256 << 20)

LIMIT = 300.0  # s of processor time: ten times what the longest of the quick tests takes
LOOK = 2.0  # s of wall time between two checks
STILL = 600.0  # s of wall time; a process that can run at all gets more than PROGRESS in that
PROGRESS = 0.5  # s of processor time
NAME = "processor_time"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--processor-time", type=int, default=0, metavar="N", help="show the N tests that took the most")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "processor_time(seconds): the limit of this test instead of 300 s")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell starts a job in the background like this
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:  # `nohup` starts a command like this
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Exclude the collected tests and modules from garbage collection, since they stay until the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_sessionfinish() -> None:
    """Unfreeze objects, so that Taichi is freed and writes its compiled kernels to the cache."""
    if taichi := sys.modules.get("taichi"):
        taichi.reset()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Under `--dist loadfile`, keep the tests of a room in one process, since each process compiles or parses anew."""
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Rooms(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return room_of(nodeid)

    return Rooms(config, log)


READERS = {f"tests/test_{name}.py" for name in ("docstrings", "repository", "shown_sentences")}


def room_of(nodeid: str) -> str:
    """Return a test's room in `fit`, or else its file; the tests that parse all modules form one room."""
    file = nodeid.partition("::")[0]
    if file in READERS:
        return "all modules"
    return file.rpartition("/")[0] if file.startswith("tests/fit/") else file


def done() -> float:
    """Return the processor time [s] of this process and of its finished children."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in both)


def used() -> float:
    """Return the processor time [s] of this process and of all its children, running ones included."""
    running = 0.0
    for child in psutil.Process(os.getpid()).children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it has just ended
            times = child.cpu_times()
            running += times.user + times.system
    return done() + running


class Watch:
    """Checks a test's processor time every two seconds, and ends the test if it is too long or makes no progress.

    begun [s]: processor time at the test's beginning. Querying the children takes 3 ms, as long as many tests.
    """

    def __init__(self, limit: float, begun: float | None = None) -> None:
        self.limit, self.begun = limit, used() if begun is None else begun
        self.seen, self.still = self.begun, 0.0

    def look(self, *_: object) -> None:
        now = used()
        if now - self.begun > self.limit:
            pytest.fail(f"took more than {self.limit:g} s of processor time", pytrace=True)
        self.still = 0.0 if abs(now - self.seen) > PROGRESS else self.still + LOOK
        if self.still == 0.0:
            self.seen = now
        if self.still >= STILL:
            pytest.fail(f"stood still for {STILL:g} s", pytrace=True)


WATCH, SPENT = pytest.StashKey[Watch](), pytest.StashKey[float]()


@contextlib.contextmanager
def watched(item: pytest.Item) -> Iterator[None]:
    """Watch one phase of a test; between phases the watch would end pytest itself."""
    if WATCH not in item.stash:
        marker = item.get_closest_marker(NAME)
        item.stash[WATCH] = Watch(float(marker.args[0]) if marker else LIMIT, done())
    before = signal.signal(signal.SIGALRM, item.stash[WATCH].look)
    signal.setitimer(signal.ITIMER_REAL, LOOK, LOOK)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    with watched(item):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    with watched(item):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Iterator[None]:
    with watched(item):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Write a test's processor time, pytest's share included, into its last report."""
    report = yield
    if report.when == "teardown":
        before, item.session.stash[SPENT] = item.session.stash.get(SPENT, 0.0), done()
        report.user_properties = [*report.user_properties, (NAME, item.session.stash[SPENT] - before)]
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """With several processes, send one report instead of three for a passed test, and none of its beginning.

    Sending and showing a message took more than half of a short test's time.
    """
    if not hasattr(item.config, "workerinput"):
        return None
    reports = runtestprotocol(item, log=False, nextitem=nextitem)
    for report in one_report(reports):
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def one_report(reports: list[pytest.TestReport]) -> list[pytest.TestReport]:
    """Return the test's own report with the data of the last one if all passed, else all reports."""
    if [report.when for report in reports if report.passed] != ["setup", "call", "teardown"]:
        return reports
    _, itself, last = reports
    itself.user_properties = last.user_properties
    return [itself]


@pytest.hookimpl(wrapper=True)
def pytest_report_to_serializable(report: Any) -> Iterator[None]:
    """Drop the unused keywords of passed tests, which are most of the data that a process sends."""
    sent = yield
    if sent and getattr(report, "passed", False):
        sent["keywords"] = {}
    return sent


@pytest.fixture(scope="session", autouse=True)
def _one_tree_of_commands() -> Iterator[None]:
    """Typer puts the tree together for every command that it runs, which takes a tenth of a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", functools.cache(typer.testing._get_command))
        yield


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    spent: dict[str, float] = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            for name, seconds in getattr(report, "user_properties", []):
                if name == NAME:
                    spent[report.nodeid] = spent.get(report.nodeid, 0.0) + seconds
    terminalreporter.write_line(f"processor time: {sum(spent.values()):.0f} s")
    for test in sorted(spent, key=lambda one: -spent[one])[: config.getoption("--processor-time")]:
        terminalreporter.write_line(f"{spent[test]:7.1f} s  {test}")

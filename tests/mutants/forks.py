"""A plugin of pytest that tests mutants, each in a process that is forked once the tests have been collected.

A mutant's process runs the tests that reach the mutant's function, and ends at the first that fails. First comes the
test that killed the function's last mutant, then those that killed others of its module. No process collects, and none
forks from one that has run a test: from such a one it would lack Taichi's threads, and wait for them.

One mutant that lives takes as long as hundreds that die. So each first gets a few seconds of its tests. Those that are
undecided then get the others, after all mutants have had their first turn. A mutant that no test reaches has its turn
as well: all results by any time are then a sample.

Before the mutants, one process runs the tests on the code itself. It measures how long each takes.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
from mutmut.mutation.trampoline import set_mutant_under_test

from tests.mutants.kept import SURVIVED, UNDECIDED, WITHOUT_TESTS, function_of, module_of

# Times what a test takes without a mutant, and s beyond that: a mutant that takes longer never ends, and is dead.
# Processor time counts, so that a busy machine ends no mutant; STILL times that of wall time ends one that only waits.
# Our choice: with mutmut's own 15 times all tests together, a mutant took 15 minutes in some rooms.
SLOWER, SPARE, STILL = 5.0, 3.5, 4.0
LOOK = 0.25  # s between two looks at whether a process lives; our choice: a hundredth of what mutants take together
LEAST = 0.05  # s that any test takes, with its setup; our choice: else one of no time would outdo a hundred kills
TURN = 2.0  # s of tests in a mutant's first turn; our choice: nine in ten of those that die do so in 0.3 s
KILLED, INTERRUPTED, BROKEN, TIMEOUT = 1, 2, 3, 36  # mutmut's codes
SHARED = "shared"  # beside the tests' names: the durations of what fixtures make for several files


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--mutants", type=Path, metavar="FILE", help="test the mutants that a file of JSON names")


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> bool | None:
    path = session.config.getoption("--mutants")
    if path is None or session.testsfailed:  # pytest itself ends with the errors of a collection
        return None
    work = json.loads(path.read_text())
    forks = Forks(session, Path(work["took"]), Path(work["results"]), work["killers"])
    signal.signal(signal.SIGTERM, forks.end)
    if work["clean"]:
        forks.test_clean(work["clean"])
    forks.test(work["mutants"], work["tests"], work["processes"])
    return True


@dataclass
class Child:
    """A process that tests one mutant.

    - `said`: the pipe's end that tells which test begins, and at what processor time [s], or the exit code
    - `begun`, `limit`, `spent`: wall time [s] of the test's beginning, its limit [s] and the processor time before
    """

    mutant: str
    items: Sequence[pytest.Item]
    said: int
    folder: Path
    started: float
    begun: float = 0.0
    limit: float = 0.0
    spent: float = 0.0
    until: float = 0.0
    at: int = 0
    code: int | None = None
    text: bytes = b""
    left: Sequence[pytest.Item] = ()  # tests of its second turn, should it live


@dataclass
class Forks:
    """Forks a process for each mutant, ends it in time, and writes down its result.

    - `took`: file of the durations [s] of each test's setup, call and teardown
    - `results`: file of a line for each mutant
    - `killers`: the test that killed each mutant of earlier runs
    """

    session: pytest.Session
    took: Path
    results: Path
    killers: dict[str, str]
    children: dict[int, Child] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.by_name = {item.nodeid: item for item in self.session.items}
        self.place = {name: number for number, name in enumerate(self.by_name)}
        self.durations: dict[str, dict[str, float]] = json.loads(self.took.read_text()) if self.took.exists() else {}
        self.beside: dict[Path, float] = {}  # s of the longest setup and teardown in each file
        self.last: dict[str, str] = {}  # the test that killed each function's last mutant
        self.deadly = defaultdict[str, Counter[str]](Counter)  # how many mutants of each module each test has killed
        for mutant, killer in self.killers.items():
            self.note(mutant, killer)

    def note(self, mutant: str, killer: str) -> None:
        """Take note of which test killed a mutant."""
        self.last[function_of(mutant)] = killer
        self.deadly[module_of(mutant)][killer] += 1

    def test_clean(self, names: Sequence[str]) -> None:
        """Run tests on the code itself, and write down how long they take; end pytest if one fails."""
        wanted = set(names)
        items = [item for item in self.session.items if item.nodeid in wanted]
        child = self.fork("", items)
        while self.children:
            select.select([child.said], [], [], LOOK)
            self.hear(child, is_limited=False)
        if child.code != SURVIVED:
            pytest.exit("a test fails without a mutant", returncode=1)
        self.durations = json.loads(self.took.read_text())

    def test(self, mutants: dict[str, int], tests: Sequence[Sequence[str]], processes: int) -> None:
        """Test mutants, each given with the number of its list of tests, in this order."""
        for name, took in self.durations.items():
            if name in self.by_name:
                path, beside = self.by_name[name].path, took.get("setup", 0.0) + took.get("teardown", 0.0)
                self.beside[path] = max(beside, self.beside.get(path, 0.0))
        waiting, second = deque(mutants), dict[str, Sequence[pytest.Item]]()
        while waiting or self.children:
            while waiting and len(self.children) < processes:
                name = waiting.popleft()
                if name in second:
                    self.fork(name, self.ordered(name, second[name]))
                elif some := [self.by_name[test] for test in tests[mutants[name]] if test in self.by_name]:
                    few, others = self.turns(self.ordered(name, some))
                    self.fork(name, few).left = others
                else:
                    self.write(name, WITHOUT_TESTS, None, 0.0)
            if self.children:
                select.select([child.said for child in self.children.values()], [], [], LOOK)
                for child in list(self.children.values()):
                    self.hear(child)
                    if child.code == UNDECIDED:
                        second[child.mutant] = child.left
                        waiting.append(child.mutant)

    def turns(self, items: Sequence[pytest.Item]) -> tuple[Sequence[pytest.Item], Sequence[pytest.Item]]:
        """Return the tests of a mutant's first turn, and of its second: the first, and what has room behind it."""
        few, others, until = list(items[:1]), list[pytest.Item](), self.call(items[0])
        for item in items[1:]:
            if until + self.call(item) <= TURN:
                few.append(item)
                until += self.call(item)
            else:
                others.append(item)
        return few, others

    def call(self, item: pytest.Item) -> float:
        """Return how long a test takes [s], without its setup."""
        return self.durations.get(item.nodeid, {}).get("call", 0.0)

    def ordered(self, mutant: str, items: Sequence[pytest.Item]) -> list[pytest.Item]:
        """Return tests in the order in which they may kill a mutant.

        First comes the test that killed the function's last mutant, then those that killed others of the module, the
        most in a second first. Then come the tests of the module's own file, and the others as in the session.
        """
        last, module = self.last.get(function_of(mutant)), module_of(mutant)
        deadly, own = self.deadly[module], f"test_{module.rpartition('.')[2]}.py"

        def key(item: pytest.Item) -> tuple[bool, float, bool, int]:
            rate = deadly[item.nodeid] / (LEAST + self.call(item))
            return item.nodeid != last, -rate, item.path.name != own, self.place[item.nodeid]

        return sorted(items, key=key)

    def fork(self, mutant: str, items: Sequence[pytest.Item]) -> Child:
        folder = Path(tempfile.mkdtemp(prefix="mutant-"))
        said, tell = os.pipe()
        os.set_blocking(said, False)
        sys.stdout.flush()
        if not (pid := os.fork()):
            os.setpgid(0, 0)
            took = None if mutant else self.took
            os._exit(tested(self.session, mutant, items, folder, lambda text: os.write(tell, text.encode()), took))
        with contextlib.suppress(OSError):  # it has ended, or done so itself
            os.setpgid(pid, pid)
        os.close(tell)
        now = time.monotonic()
        self.children[pid] = child = Child(mutant, items, said, folder, now, now, until=now + 60.0 * SPARE)
        return child

    def hear(self, child: Child, *, is_limited: bool = True) -> None:
        """Take in what a process says, and end it where its test takes too long."""
        pid = next(pid for pid, one in self.children.items() if one is child)
        with contextlib.suppress(BlockingIOError):
            while part := os.read(child.said, 65536):
                child.text += part
        *lines, child.text = child.text.split(b"\n")
        for line in lines:
            word, number = line.split()
            if word == b"end":
                child.code = int(number)
            else:
                child.at, child.spent, child.begun = int(word), float(number), time.monotonic()
                child.limit = self.limit(child)
                child.until = child.begun + child.limit
        ended, status = os.waitpid(pid, 0 if child.code is not None else os.WNOHANG)
        if ended:
            if child.code is None:  # without having said so, thus by a signal or by a test's `os._exit`
                child.code = os.waitstatus_to_exitcode(status) or BROKEN
            self.close(pid, child)
        elif is_limited and (now := time.monotonic()) > child.until:
            if now > child.begun + STILL * child.limit or (used := used_by(pid) - child.spent) > 0.9 * child.limit:
                child.code = TIMEOUT
                self.close(pid, child)
            else:
                child.until = now + max(child.limit - used, LOOK)

    def limit(self, child: Child) -> float:
        """Return the limit [s] of a process's present test, which may be the first that needs a shared fixture."""
        item = child.items[child.at]
        shared = self.durations.get(SHARED, {}).get("setup", 0.0)
        return SPARE + SLOWER * (self.call(item) + self.beside.get(item.path, 0.0) + shared)

    def close(self, pid: int, child: Child) -> None:
        """End a process with those that its tests have left, and write down its result."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(pid, 0)
        os.close(child.said)
        shutil.rmtree(child.folder, ignore_errors=True)
        del self.children[pid]
        if not child.mutant:
            return
        if child.code == SURVIVED and child.left:
            child.code = UNDECIDED
        killer = child.items[child.at].nodeid if child.code not in {SURVIVED, UNDECIDED} else None
        if killer:
            self.note(child.mutant, killer)
        self.write(child.mutant, child.code, killer, time.monotonic() - child.started)

    def write(self, mutant: str, code: int, killer: str | None, took: float) -> None:
        """Write down a mutant's result, the test that killed it, and how long that took [s]."""
        with self.results.open("a") as file:
            print(json.dumps([mutant, code, killer, took]), file=file)

    def end(self, *_: object) -> None:
        """End all processes, and this one."""
        for pid, child in self.children.items():
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            shutil.rmtree(child.folder, ignore_errors=True)
        os._exit(128 + signal.SIGTERM)


def used_by(pid: int) -> float:
    """Return the processor time [s] of a process with its children, ended or not."""
    total = 0.0
    with contextlib.suppress(psutil.Error):
        process = psutil.Process(pid)
        own = process.cpu_times()
        total = own.user + own.system + own.children_user + own.children_system
        for child in process.children(recursive=True):
            with contextlib.suppress(psutil.Error):
                times = child.cpu_times()
                total += times.user + times.system
    return total


def spent() -> float:
    """Return the processor time [s] of this process and of its ended children."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in both)


class Durations:
    """Adds up how long each phase of each test takes, and what fixtures make for several files."""

    def __init__(self) -> None:
        self.took: dict[str, dict[str, float]] = {SHARED: {"setup": 0.0}}

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
        begun = time.perf_counter()
        try:
            return (yield)
        finally:
            if fixturedef.scope in {"session", "package"}:
                self.took[SHARED]["setup"] += time.perf_counter() - begun

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.took.setdefault(report.nodeid, {})[str(report.when)] = report.duration


def tested(
    session: pytest.Session, mutant: str, items: Sequence[pytest.Item], folder: Path, tell: Callable[[str], object],
    took: Path | None,
) -> int:  # fmt: skip
    """Run tests in this forked process until one fails, and return mutmut's exit code.

    took: file for the durations of the tests, if they are wanted
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    capture = session.config.pluginmanager.getplugin("capturemanager")
    capture.stop_global_capturing()  # its files are shared with the other processes
    if mutant:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
    capture.start_global_capturing()
    capture.suspend_global_capture()
    session.config._tmp_path_factory._basetemp = folder.resolve()  # type: ignore[attr-defined]
    set_mutant_under_test(mutant)
    session.items = list(items)
    durations = Durations()
    session.config.pluginmanager.register(durations)
    code = SURVIVED
    try:
        for number, item in enumerate(items):
            tell(f"{number} {spent()}\n")
            following = items[number + 1] if number + 1 < len(items) else None
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if session.shouldfail or session.testsfailed:
                code = KILLED
                break
        with contextlib.suppress(Exception):
            session._setupstate.teardown_exact(None)
        if took and code == SURVIVED:
            took.write_text(json.dumps(durations.took))
            if taichi := sys.modules.get("taichi"):
                taichi.reset()  # writes compiled kernels to the cache
    except (KeyboardInterrupt, pytest.exit.Exception):
        code = INTERRUPTED
    except BaseException:  # pytest's own fault, or one that a mutant causes there
        code = BROKEN
    tell(f"end {code}\n")
    return code

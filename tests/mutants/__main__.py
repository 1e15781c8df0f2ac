"""Mutate the code in one place at a time and check whether a test fails: the program of `scripts/mutants`.

The mutation tester mutmut makes the mutants and learns which tests reach which function. A plugin of pytest, `forks`,
runs these tests on each mutant. Which folder is tested with which tests stands in pyproject.toml,
`[tool.hangtime.mutants]`. Each folder gets a copy of the checkout in `build/mutants/`. Results are kept: a second run
goes on where the first ended, and tests again where what a result rests on has changed (`kept`).

The mutants come in an order that is drawn by their names, so that those tested by any time are a sample of the folder.
Those that may live come last, since they need all their tests.

The type check of `scripts/check` then looks at the mutants that no test noticed. Those that it refuses count as dead.
A surviving mutant either needs a test, or is listed in `survivors.toml` with a reason. A rule there accepts all mutants
of one kind: mutants whose two sides are equal without the parts that the rule's pattern matches outside its group.

Where a library is not installed, the tests of what needs it skip. Mutants of that are neither drawn nor counted.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
import re
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile

from tests.mutants import kept
from tests.mutants.changes import Functions, change_of, is_wording, named
from tests.mutants.reach import forget_what_changed
from tests.mutants.types import Change, refused

ROOT = Path(__file__).parents[2]
COPIES = ROOT / "build/mutants"
SURVIVORS = Path(__file__).with_name("survivors.toml")
COPIED = ("formats", "firmware_host", "capture", "fit", "hangtime", "benchmarks", "tests", "docs", "scripts", "systemd")
LOOK = 60.0  # s between two looks at what mutmut has found; our choice: a night that is cut off loses a minute
PLUGIN, FORKS = "tests.mutants.plugin", "tests.mutants.forks"
NOT_RUN = ["-m", "not slow and not unmutated", "-p", "no:cacheprovider", "-p", PLUGIN]
NO_MUTANT, MATCHES_NOTHING = "no.mutant.*", "nothing matches"  # mutmut's message after it has made all mutants
NEEDS = {"formats.exporters.rerun_file": "rerun"}  # library without which all tests of a module skip
WANTED = 0.9  # share of the mutants that tests must notice
KILLED = {"killed", "timeout", "segfault", "caught by type check"}


class MutmutError(Exception):
    """mutmut, or pytest, ended with an error."""


@dataclass
class Tally:
    """The results for one folder: the number of killed mutants, and the survivors' diffs by function.

    - `refused`: mutants that only the type check noticed, before or after their second turn
    - `wording`: mutants of the wording of a text, which do not count
    - `undecided`: other mutants that passed the tests of their first turn
    - `untested`: mutants without a result
    """

    killed: int = 0
    refused: int = 0
    listed: int = 0
    wording: int = 0
    undecided: int = 0
    untested: int = 0
    alive: list[tuple[str, str]] = field(default_factory=list)

    @property
    def total(self) -> int:
        """All mutants that were tested."""
        return self.killed + self.refused + self.listed + self.undecided + len(self.alive)


def main() -> int:
    """Test the mutants of the named folders or modules; return 0 if enough are killed and the others are listed."""
    areas = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hangtime"]["mutants"]
    parser = argparse.ArgumentParser(prog="scripts/mutants")
    parser.add_argument("path", nargs="*", help=f"folder or module; by default all of {', '.join(areas)}")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="mutants tested side by side")
    parser.add_argument("--report", action="store_true", help="show the results that are kept, test nothing")
    parser.add_argument("--sample", type=int, metavar="N", help="test N mutants of each folder, drawn at random")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--keep", type=Path, default=COPIES / "kept", metavar="DIR", help="folder of the results")
    parser.add_argument("--minutes", type=float, default=math.inf, metavar="N", help="test no mutant after N minutes")
    asked = parser.parse_args()
    for path in asked.path:
        if not (ROOT / path).exists() or not any(is_within(path, area) for area in areas):
            parser.error(f"{path}: is no tested folder or module; name one of, or one within, {', '.join(areas)}")
    if not asked.minutes > 0.0:  # nan included
        parser.error(f"--minutes: {asked.minutes:g} is no time; give a number above 0")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # ends mutmut too, and keeps its results
    listed, untested = (
        is_listed(SURVIVORS.read_text()),
        [name for name, needed in NEEDS.items() if not find_spec(needed)],
    )
    is_well, end, keep = True, time.monotonic() + 60.0 * asked.minutes, asked.keep.resolve()
    for area, tests in areas.items():
        paths = [p.rstrip("/") for p in asked.path if is_within(p, area)] if asked.path else [area]
        if not paths:
            continue
        if time.monotonic() >= end:
            print(f"\n{area}: left for another run, since the minutes are over")
            continue
        if asked.report and not kept.metas(copy_of(area), area):
            print(f"\n{area}: no run has tested it yet")
            is_well = False
            continue
        patterns = [path.removesuffix(".py").replace("/", ".") + ".*" for path in paths]
        try:
            if not asked.report:
                make_mutants(area, tests)
                names = mutants_of(area, patterns, untested)
                if asked.sample is not None:
                    patterns = names = random.Random(asked.seed).sample(names, min(asked.sample, len(names)))
                test_mutants(area, tests, names, asked.processes, keep, end, listed)
        except MutmutError as failed:  # such as a test that fails without a mutant; the other folders still have theirs
            print(failed, file=sys.stderr)
            is_well = False
            continue
        is_well &= show(area, tally(area, patterns, untested, listed))
        for name in untested:
            if name.startswith(area.replace("/", ".")):
                print(f"{name} is left out: {NEEDS[name]} is not installed, and its tests skip")
    return 0 if is_well else 1


def is_within(path: str, area: str) -> bool:
    """Return whether a path, as the checkout names it, is a folder of `areas` or within it."""
    return f"{path.rstrip('/')}/".startswith(f"{area}/")


def is_listed(text: str) -> Callable[[str, str], bool]:
    """Return whether a survivor is accepted by the entries and rules of a text such as `survivors.toml`."""
    read = tomllib.loads(text)
    entries = {(one["function"], one["change"].strip()) for one in read.get("survivor", [])}
    rules = [(one["functions"], re.compile(one["pattern"])) for one in read.get("rule", [])]

    def listed(function: str, change: str) -> bool:
        if (function, change) in entries:
            return True
        sides = ["\n".join(line[2:] for line in change.splitlines() if line[0] == sign) for sign in "-+"]
        for functions, pattern in rules:
            removed, added = (pattern.sub(lambda found: "".join(found.groups()), side) for side in sides)
            if fnmatch(function, functions) and removed == added:
                return True
        return False

    return listed


def copy_of(area: str) -> Path:
    """Return the path of the checkout's copy for one folder."""
    return COPIES / area.replace("/", "-")


def make_mutants(area: str, tests: list[str]) -> None:
    """Bring the copy up to date, make its mutants, and learn which tests reach which function."""
    copy = copy_of(area)
    copy.mkdir(parents=True, exist_ok=True)
    subprocess.run(["cp", "-ru", *(ROOT / name for name in (*COPIED, "README.md", "pyproject.toml")), copy], check=True)
    kept.tidy(copy, ROOT, COPIED)
    lists = {
        "source_paths": [area.split("/")[0]],
        "only_mutate": [f"{area}/*"],
        "pytest_add_cli_args_test_selection": tests,
        "pytest_add_cli_args": NOT_RUN,
        "also_copy": [name for name in (*COPIED, "README.md") if name not in (area.split("/")[0], "tests")],
    }
    written = "".join(f"{name}=\n" + "".join(f"    {value}\n" for value in values) for name, values in lists.items())
    (copy / "setup.cfg").write_text(f"[mutmut]\nprocess_isolation=forkserver\n{written}")
    forget_what_changed(copy, tests)
    code, words = run([sys.executable, "-m", "mutmut", "run", "--max-children", "1", NO_MUTANT], copy)
    if code and MATCHES_NOTHING not in words:
        raise ended(area, "mutmut", code, words)


def mutants_of(area: str, patterns: list[str], untested: list[str]) -> list[str]:
    """Return the names of the mutants of a folder that match, in order."""
    return sorted(
        name
        for meta in kept.metas(copy_of(area), area)
        for name in kept.exit_codes(meta)
        if any(fnmatch(name, pattern) for pattern in patterns) and not is_of(name, untested)
    )


def test_mutants(
    area: str, tests: list[str], names: list[str], processes: int, keep: Path, end: float,
    listed: Callable[[str, str], bool],
) -> None:  # fmt: skip
    """Test the mutants that have no kept result, until a time of the monotonic clock, and keep each result."""
    copy, store = copy_of(area), keep / f"{area.replace('/', '-')}.json"
    now, wanted = kept.now(copy, area, tests), set(names)
    codes, left = kept.known(store, now), {name: some for name, some in kept.left(store, now).items() if name in wanted}
    missing = in_order(copy, area, list(left), listed)
    kept.put(copy, area, codes, missing)
    tested = {name: left[name] for name in missing}
    results, killers = copy / "results.jsonl", kept.killers(store)

    def look() -> None:
        lines = [json.loads(line) for line in results.read_text().splitlines(keepends=True) if line[-1] == "\n"]
        kept.take(copy, area, {name: code for name, code, *_ in lines})
        found = killers | {name: killer for name, _, killer, _ in lines if killer}
        kept.keep(store, copy, area, now, found)

    results.write_text("")
    if not tested:
        look()
        return
    took, stamp, seen = copy / "took.json", copy / "took.sha256", kept.stamp(copy, COPIED)
    if not (is_measured := took.exists() and stamp.exists() and stamp.read_text() == seen):
        took.unlink(missing_ok=True)
        stamp.write_text(seen)
    numbers: dict[tuple[str, ...], int] = {}  # all mutants of a function need the same tests, thousands of names
    work = {
        "mutants": {name: numbers.setdefault(tuple(some), len(numbers)) for name, some in tested.items()},
        "tests": list(numbers), "processes": processes, "results": str(results), "took": str(took),
        "killers": killers,
        "clean": [] if is_measured else sorted({test for some in now.reached.values() for test in some}),
    }  # fmt: skip
    (copy / "work.json").write_text(json.dumps(work))
    pytest = [sys.executable, "-m", "pytest", "--rootdir=.", "--tb=native", "-x", "-q", *tests, *NOT_RUN, "-p", FORKS]
    code, words = run([*pytest, "--mutants", str(copy / "work.json")], copy / "mutants", look, end)
    if code:
        raise ended(area, "pytest", code, words)


def in_order(copy: Path, area: str, names: Sequence[str], listed: Callable[[str, str], bool]) -> list[str]:
    """Return the mutants that count, as drawn by their names, those last that may live."""
    wanted, keys = set(names), dict[str, tuple[bool, bytes]]()
    for meta in kept.metas(copy, area):
        if some := [name for name in kept.exit_codes(meta) if name in wanted]:
            functions = Functions(meta.with_suffix(""))
            for name in some:
                if not is_wording(diff := functions.diff(name)):
                    may_live = listed(".".join(named(name)), change_of(diff))
                    keys[name] = (may_live, sha256(name.encode()).digest())
    return sorted(keys, key=lambda name: keys[name])


def run(
    command: Sequence[str], folder: Path, look: Callable[[], None] = lambda: None, end: float = math.inf
) -> tuple[int, str]:
    """Run a command, and look again and again at what it has found, for the last time after its end.

    Return its exit code and what it said; 0 where the time is over.
    """
    with TemporaryFile() as said:
        running = subprocess.Popen(
            command, cwd=folder, stdout=said, stderr=subprocess.STDOUT, start_new_session=True,
            env={**os.environ, "PYTHONPATH": "", "OPENBLAS_NUM_THREADS": "1", "MUTANT_UNDER_TEST": "",
                 "PY_IGNORE_IMPORTMISMATCH": "1"},
        )  # fmt: skip
        try:
            while running.poll() is None and (left := end - time.monotonic()) > 0:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    running.wait(min(LOOK, left))
                look()
        finally:
            if is_cut := running.poll() is None:
                os.killpg(running.pid, signal.SIGTERM)  # it ends the processes of its mutants
                running.wait()
            look()
        said.seek(0)
        return 0 if is_cut else running.returncode, said.read().decode(errors="replace")


def ended(area: str, program: str, code: int, words: str) -> MutmutError:
    """Return the error of a program that failed, after its last words."""
    sys.stderr.write(words[-4000:])
    return MutmutError(f"mutants: {area}: {program} ended with {code}; its last words are above")


def is_of(name: str, modules: list[str]) -> bool:
    """Whether a mutant, by its name, is of one of these modules."""
    return any(name.startswith(f"{module}.") for module in modules)


def tally(area: str, patterns: list[str], untested: list[str], listed: Callable[[str, str], bool]) -> Tally:
    """Count the stored results of a folder's mutants whose names match."""
    copy, found = copy_of(area), Tally()
    unnoticed: list[tuple[str, str, bool, Change]] = []
    from mutmut.stats import status_by_exit_code

    for meta in kept.metas(copy, area):
        source, functions = (
            str(meta.relative_to(copy / "mutants")).removesuffix(".meta"),
            Functions(meta.with_suffix("")),
        )
        for name, code in kept.exit_codes(meta).items():
            if is_of(name, untested) or not any(fnmatch(name, pattern) for pattern in patterns):
                continue
            module, own = named(name)
            function = f"{module}.{own}"
            diff = functions.diff(name)
            if is_wording(diff):
                found.wording += 1
            elif code is None:
                found.untested += 1
            elif status_by_exit_code[code] in KILLED:
                found.killed += 1
            elif listed(function, change := change_of(diff)):
                found.listed += 1
            else:
                text = Change(source, own, functions.source(name))
                unnoticed.append((function, change, code == kept.UNDECIDED, text))
    are_refused = refused(copy, [one for *_, one in unnoticed])
    left = [one for one, is_refused in zip(unnoticed, are_refused, strict=True) if not is_refused]
    found.refused = sum(are_refused)
    found.undecided = sum(is_undecided for _, _, is_undecided, _ in left)
    found.alive = [(where, what) for where, what, is_undecided, _ in left if not is_undecided]
    return found


def show(area: str, found: Tally) -> bool:
    """Print a folder's figures and its unlisted survivors; return whether they are acceptable."""
    for function, change in found.alive:
        print(f"\n{function}\n{change}")
    killed = found.killed + found.refused
    share = killed / found.total if found.total else 0.0
    died = f"{killed} of {found.total} mutants die ({100 * share:.1f} %), {found.refused} by the type check alone"
    print(
        f"\n{area}: {died}, {found.listed} live for a listed reason, {len(found.alive)} live unlisted, "
        f"{found.undecided} are undecided; "
        f"{found.wording} of wording do not count, {found.untested} are not tested yet"
    )
    return share >= WANTED and not found.alive


if __name__ == "__main__":
    sys.exit(main())

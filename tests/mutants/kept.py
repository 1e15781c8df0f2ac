"""Keep the results of mutants from run to run, as long as nothing has changed that they rest on.

- A mutant that died rests on its module, and on the file of the test that killed it.
- One that lives rests on its module, and on the files of all tests that reach its function. Where some of these files
  have changed, their tests alone are to be run again.
- Both rest on the files beside the tests that hold no tests, and on mutmut's version, which numbers the mutants.

Each folder's results are one file, `fit-search.json`. `mutants` has, of each, the digest of what it rests on, mutmut's
exit code, the test that killed it, and the number of its entry in `states`: the digests of files of tests.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

SKIPPED = 34  # mutmut's code of a mutant that is not to be tested
SURVIVED, WITHOUT_TESTS = 0, 33  # mutmut's codes of one that lives
UNDECIDED = 35  # mutmut's code of a suspicious one; here, of one that has had some of its tests
SHORT = 16  # hexadecimal digits of a digest; our choice: two of a million files agree once in 10^7 projects


@dataclass(frozen=True)
class Now:
    """What a copy's results rest on.

    - `base`: the digest of module, files beside the tests and mutmut, by mutant
    - `reached`: the names of the tests that reach it, by function
    - `files`: the digests of these tests' files, by function and file
    """

    base: dict[str, str]
    reached: dict[str, list[str]]
    files: dict[str, dict[str, str]]

    def of_tests(self, mutant: str) -> dict[str, str]:
        """Return the digests of the files of tests that reach a mutant."""
        return self.files.get(function_of(mutant), {})


def now(copy: Path, area: str, tests: Sequence[str]) -> Now:
    """Return what the results of a folder's mutants rest on."""
    digest = cache(lambda path: sha256(path.read_bytes()).hexdigest()[:SHORT])
    reaching = reached(copy)
    beside = {path for name in tests for path in (copy / name).rglob("*.py") if not path.name.startswith("test_")}
    base = {}
    for meta in metas(copy, area):
        module = copy / meta.relative_to(copy / "mutants").with_suffix("")
        parts = [version("mutmut"), *(f"{path.relative_to(copy)} {digest(path)}" for path in [module, *sorted(beside)])]
        key = sha256("\n".join(parts).encode()).hexdigest()[:SHORT]
        base |= dict.fromkeys(exit_codes(meta), key)
    files = {
        function: {file: digest(copy / file) for file in sorted({file_of(test) for test in some})}
        for function, some in reaching.items()
    }
    return Now(base, reaching, files)


def function_of(mutant: str) -> str:
    """Return mutmut's name for the function of a mutant."""
    return mutant.rsplit("__mutmut_", 1)[0]


def module_of(mutant: str) -> str:
    """Return the module of a mutant."""
    return function_of(mutant).rpartition(".")[0]


def file_of(test: str) -> str:
    """Return the file of a test."""
    return test.partition("::")[0]


def reached(copy: Path) -> dict[str, list[str]]:
    """Return the names of the tests that reach each function, by mutmut's name for it."""
    return dict(json.loads((copy / "mutants/mutmut-stats.json").read_text())["tests_by_mangled_function_name"])


def stamp(copy: Path, folders: Sequence[str]) -> str:
    """Return a digest of all that the tests of a copy run."""
    files = sorted(path for name in folders for path in (copy / name).rglob("*.py"))
    return sha256(b"".join(sha256(path.read_bytes()).digest() for path in files)).hexdigest()


def metas(copy: Path, area: str) -> list[Path]:
    """Return mutmut's files of results of a folder."""
    return sorted((copy / "mutants" / area).rglob("*.py.meta"))


def exit_codes(meta: Path) -> dict[str, int | None]:
    """Return the exit code of the tests on each mutant of one file of results; none while mutmut writes."""
    try:
        codes = json.loads(meta.read_text())["exit_code_by_key"]
    except json.JSONDecodeError:
        return {}
    return {name: None if code == SKIPPED else code for name, code in codes.items()}


def read(store: Path) -> tuple[dict[str, list[object]], list[dict[str, str]]]:
    """Return the kept results, and the digests of files of tests that they name."""
    text = json.loads(store.read_text()) if store.exists() else {}
    return text.get("mutants", {}), text.get("states", [])


def known(store: Path, at: Now) -> dict[str, int]:
    """Return the kept exit codes that still hold."""
    return {name: code for name, (code, tests) in _kept(store, at).items() if not tests}


def left(store: Path, at: Now) -> dict[str, list[str]]:
    """Return the tests that each mutant without a result needs; of one that lived, those that have changed."""
    kept = _kept(store, at)
    every = {name: (None, at.reached.get(function_of(name), [])) for name in at.base if name not in kept}
    return {name: tests for name, (code, tests) in (kept | every).items() if tests or code is None}


def _kept(store: Path, at: Now) -> dict[str, tuple[int, list[str]]]:
    """Return the kept exit codes, and the tests that have to be run before they hold."""
    found = {}
    results, states = read(store)
    for name, (base, code, killer, state) in results.items():
        if base != at.base.get(name) or code == UNDECIDED:
            continue
        files, before, reaching = at.of_tests(name), states[state], at.reached.get(function_of(name), [])
        if code not in {SURVIVED, WITHOUT_TESTS}:
            if killer in reaching and before == {(file := file_of(killer)): files[file]}:
                found[name] = (code, [])
            continue
        found[name] = (code, [one for one in reaching if before.get(file_of(one)) != files[file_of(one)]])
    return found


def killers(store: Path) -> dict[str, str]:
    """Return the test that killed each mutant, whatever has changed: most often it will kill the mutant again."""
    return {name: killer for name, (_, _, killer, _) in read(store)[0].items() if killer}


def put(copy: Path, area: str, codes: dict[str, int], missing: Sequence[str]) -> None:
    """Make these the only results that mutmut has of a folder, and let it test the mutants that are missing."""
    without = dict.fromkeys(missing)
    for meta in metas(copy, area):
        read = json.loads(meta.read_text())
        read["exit_code_by_key"] = {
            name: codes.get(name, without.get(name, SKIPPED)) for name in read["exit_code_by_key"]
        }
        meta.write_text(json.dumps(read))


def take(copy: Path, area: str, codes: dict[str, int]) -> None:
    """Write exit codes into mutmut's files of results."""
    for meta in metas(copy, area):
        read = json.loads(meta.read_text())
        before = read["exit_code_by_key"]
        after = {name: codes.get(name, code) for name, code in before.items()}
        if after != before:
            meta.write_text(json.dumps({**read, "exit_code_by_key": after}))


def keep(store: Path, copy: Path, area: str, at: Now, killed_by: dict[str, str]) -> None:
    """Store the results that mutmut has of a folder by now; those of other mutants stay."""
    results, states = read(store)
    numbers = {json.dumps(state): number for number, state in enumerate(states)}
    for meta in metas(copy, area):
        for name, code in exit_codes(meta).items():
            if code is not None:
                killer = None if code in {SURVIVED, WITHOUT_TESTS, UNDECIDED} else killed_by.get(name)
                files = at.of_tests(name)
                rests = {file_of(killer): files.get(file_of(killer), "")} if killer else files
                number = numbers.setdefault(json.dumps(rests), len(numbers))
                results[name] = [at.base[name], code, killer, number]
    results = {name: one for name, one in results.items() if name in at.base}
    store.parent.mkdir(parents=True, exist_ok=True)
    whole = store.with_suffix(".part")
    text = {"states": [json.loads(state) for state in numbers], "mutants": results}
    whole.write_text(json.dumps(text))
    os.replace(whole, store)


def tidy(copy: Path, root: Path, folders: Sequence[str]) -> None:
    """Remove from a checkout's copy what the checkout no longer has, and results whose writing was cut off.

    mutmut makes a module's mutants anew where both are missing.
    """
    for base in (copy, copy / "mutants"):
        for path in [path for name in folders for path in (base / name).rglob("*.py")]:
            if not (root / path.relative_to(base)).exists():
                path.unlink()
                path.with_name(f"{path.name}.meta").unlink(missing_ok=True)
    for meta in (copy / "mutants").rglob("*.py.meta"):
        if not exit_codes(meta):
            meta.with_suffix("").unlink(missing_ok=True)
            meta.unlink()

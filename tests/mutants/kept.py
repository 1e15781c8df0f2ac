"""Keep the results of mutants from run to run, as long as a mutant's module and the tests that reach it are the same.

Each folder's results are one file, `fit-search.json`. It holds the key and the exit code of every mutant that was
tested, and the test that killed it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

SKIPPED = 34  # mutmut's code of a mutant that is not to be tested


def keys(copy: Path, area: str, tests: Sequence[str]) -> dict[str, str]:
    """Return the key of every mutant of a folder, by its name.

    A key is a digest of the mutant's module, of the test files that reach its function, and of the files beside these
    that hold no tests. It also covers mutmut's version, which numbers the mutants.
    """
    digest = cache(lambda path: sha256(path.read_bytes()).hexdigest())
    reaching = reached(copy)
    beside = {path for name in tests for path in (copy / name).rglob("*.py") if not path.name.startswith("test_")}
    found = {}
    for meta in metas(copy, area):
        module = copy / meta.relative_to(copy / "mutants").with_suffix("")
        for name in exit_codes(meta):
            by_tests = {copy / test.partition("::")[0] for test in reaching.get(name.rsplit("__mutmut_", 1)[0], [])}
            files = [module, *sorted(beside | by_tests)]
            parts = [version("mutmut"), *(f"{path.relative_to(copy)} {digest(path)}" for path in files)]
            found[name] = sha256("\n".join(parts).encode()).hexdigest()
    return found


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


def known(store: Path, wanted: dict[str, str]) -> dict[str, int]:
    """Return the kept exit codes of the mutants whose keys are still the same."""
    kept = json.loads(store.read_text()) if store.exists() else {}
    return {name: kept[name][1] for name, key in wanted.items() if name in kept and kept[name][0] == key}


def killers(store: Path) -> dict[str, str]:
    """Return the test that killed each mutant, under whatever key: most often it will kill the mutant again."""
    kept = json.loads(store.read_text()) if store.exists() else {}
    return {name: one[2] for name, one in kept.items() if one[2:]}


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


def keep(store: Path, copy: Path, area: str, of: dict[str, str], killed_by: dict[str, str]) -> None:
    """Store the results that mutmut has of a folder by now, under their keys; those of other mutants stay."""
    kept = json.loads(store.read_text()) if store.exists() else {}
    for meta in metas(copy, area):
        kept |= {
            name: [of[name], code, *filter(None, [killed_by.get(name)])]
            for name, code in exit_codes(meta).items()
            if code is not None
        }
    kept = {name: one for name, one in kept.items() if name in of}
    store.parent.mkdir(parents=True, exist_ok=True)
    whole = store.with_suffix(".part")
    whole.write_text(json.dumps(kept, indent=0))
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

"""Keep mutmut's map from functions to the tests that reach them, as far as the files of tests are the same.

To learn the whole map takes all tests: ten minutes for `formats`. mutmut learns the tests that the map lacks.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Sequence
from hashlib import sha256
from pathlib import Path

MAP, STAMP = "mutants/mutmut-stats.json", "mutants/tests.json"  # below a copy: mutmut's map, and the files it rests on


def forget_what_changed(copy: Path, tests: Sequence[str]) -> None:
    """Remove from the map the tests of files that have changed, or that import one that has.

    A changed `conftest.py` holds for all files below its folder. Without a stamp the whole map goes.
    """
    files = sorted({path for name in tests for path in [copy / name, *(copy / name).rglob("*.py")] if path.is_file()})
    texts = {path.relative_to(copy).as_posix(): path.read_text() for path in files}
    seen = {name: sha256(text.encode()).hexdigest() for name, text in texts.items()}
    learned, stamp = copy / MAP, copy / STAMP
    before = json.loads(stamp.read_text()) if stamp.exists() else None
    if before is None:
        learned.unlink(missing_ok=True)
    elif learned.exists() and before != seen:
        changed = resting_on(
            {name for name in before.keys() | seen.keys() if before.get(name) != seen.get(name)}, texts
        )
        known = json.loads(learned.read_text())
        known["tests_by_mangled_function_name"] = {
            function: [test for test in some if test.partition("::")[0] not in changed]
            for function, some in known["tests_by_mangled_function_name"].items()
        }
        known["duration_by_test"] = {
            test: took for test, took in known["duration_by_test"].items() if test.partition("::")[0] not in changed
        }
        learned.write_text(json.dumps(known))
    stamp.parent.mkdir(exist_ok=True)
    stamp.write_text(json.dumps(seen))


def resting_on(changed: Collection[str], texts: dict[str, str]) -> set[str]:
    """Return files with all others that import one of them, directly or through others; texts: by path below a root."""
    found, news = set(changed), set(changed)
    while news:
        folders = tuple(name.removesuffix("conftest.py") for name in news if name.endswith("conftest.py"))
        modules = "|".join(re.escape(name.removesuffix(".py").replace("/", ".")) for name in sorted(news))
        parts = "|".join(
            rf"from {re.escape(folder.replace('/', '.'))} import [^\n]*\b{re.escape(stem)}\b"
            for folder, _, stem in (name.removesuffix(".py").rpartition("/") for name in sorted(news))
        )
        wanted = re.compile(rf"\b(?:{modules})\b|{parts}")
        news = {name for name, text in texts.items() if name.startswith(folders) or wanted.search(text)} - found
        found |= news
    return found

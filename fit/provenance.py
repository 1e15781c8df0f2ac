"""Digest of the source text and the library versions on which results depend, besides takes and options.

The digest covers every module of `fit` and `formats` that affects a result (all but `WITHOUT_PART`), and the versions
of `FITTING_LIBRARIES`. A changed comment there costs the time of a fit. In exchange, no stale fit is ever reused or
continued.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

import fit as fit_package
import formats as formats_package

# Modules that only show or export results, or import takes; every other module of `fit` and `formats` may change
# results.
WITHOUT_PART = (
    "fit/api", "fit/batch", "fit/blind", "fit/export", "fit/report", "fit/cli.py", "fit/folders.py",
    "formats/cli.py", "formats/command.py", "formats/command_groups.py", "formats/help_pages.py", "formats/importers",
    "formats/interrupts.py", "formats/start.py", "formats/telling.py", "formats/terminal.py",
)  # fmt: skip
FITTING_LIBRARIES = ("cmaes", "numpy", "scipy", "taichi")


@cache
def physics_version() -> str:
    """Return the digest of the source text and the libraries that results depend on."""
    whole = hashlib.sha256()
    for package in (fit_package, formats_package):
        top = Path(str(package.__file__)).parent
        for path in sorted(top.rglob("*.py")):
            name = f"{top.name}/{path.relative_to(top).as_posix()}"
            if has_part(name):
                content = path.read_bytes()
                whole.update(f"{name} {len(content)}\n".encode() + content)
    for library in FITTING_LIBRARIES:
        whole.update(f"{library} {_installed(library)}\n".encode())
    return whole.hexdigest()


def has_part(name: str) -> bool:
    """Return whether results may depend on a source file, named from its package on: `fit/recordings/geometry.py`."""
    return "/".join(name.split("/")[:2]) not in WITHOUT_PART


def other_than(kept: object, key: Mapping[str, object]) -> str | None:
    """Return the reason why saved work with the key `kept` cannot be continued; None if it can.

    key: the present key, including its `physics`
    """
    if kept == key:
        return None
    is_same = isinstance(kept, dict) and {**kept, "physics": None} == {**key, "physics": None}
    return "another version of Hangtime or of its libraries" if is_same else "other takes or options"


def _installed(library: str) -> str:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "absent"

"""List the files in a folder and its subfolders, and the subfolders that cannot be read."""

from __future__ import annotations

import os
from pathlib import Path


def files_below(folder: Path, *suffixes: str) -> tuple[list[Path], list[Path]]:
    """Return the sorted paths that end in one of the suffixes, and the subfolders that cannot be listed.

    Links to folders are not followed. A folder that is missing, or vanishes during the search, has no files.

    Raises:
        OSError: the folder itself cannot be listed.
    """
    found: list[Path] = []
    locked: list[Path] = []

    def refuse(error: OSError) -> None:
        if isinstance(error, (FileNotFoundError, NotADirectoryError)):
            return
        if Path(error.filename) == folder:
            raise error
        locked.append(Path(error.filename))

    for place, folders, files in os.walk(folder, onerror=refuse):
        found += [Path(place, name) for name in (*folders, *files) if name.endswith(suffixes)]
    return sorted(found), sorted(locked)

"""Folders for results, refused before the work that would fill them and not after it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fit.errors import FitError


def make_folder(folder: Path, *files: str) -> Path:
    """Make a folder in which `files` are to be written, check that they can be, and return it.

    Raises:
        FitError: the folder cannot be made or written to, or a folder has the name of one of the files.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise FitError(
            f"cannot be used as a folder for results ({error.strerror})", where=folder, advice="choose another one"
        ) from error
    for name in files:
        if (folder / name).is_dir():
            raise FitError("is a folder; a file is to be written there", where=folder / name, advice="move it away")
    return folder

"""Check the place of a picture before the work that it is to show; nothing here loads the solver."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from fit.folders import PARTIAL
from formats.errors import OutputError
from formats.outputs import (
    AS_PAGE,
    AS_PICTURE,
    AS_RESULT,
    check_ending,
    check_folder_name,
    check_place,
    refuse_an_input,
    refuse_to_replace,
)
from formats.unfinished import ANOTHER_NAME

# Files of a results folder, which no picture may replace.
RESULT_FILES = ("fit.json", "diagnosis.json", "report.html", "report.motion.npz", *PARTIAL.values())


def check_results(folder: Path) -> None:
    """Check the name of a folder of results, before anything is read.

    Raises:
        OutputError: it has the ending of a result or page, and is no folder.
    """
    check_folder_name(folder, *(ending for _, *endings in (AS_RESULT, AS_PAGE) for ending in endings))


def may_draw(
    picture: Path,
    *,
    overwrite: bool,
    takes: Sequence[Path] = (),
    folder: Path | None = None,
    others: Sequence[Path] = (),
) -> None:
    """Check that a picture can be drawn, before the work that it is to show.

    - `takes`: archives that the command reads; `folder`: of its results; `others`: further files that it writes

    Raises:
        ModuleNotFoundError: Pillow is not installed.
        OutputError: the name has another ending than a PNG, a file exists and is not to be overwritten, the command
            reads or writes it itself, or its folder does not exist. That of the results is made later.
    """
    import PIL  # noqa: F401

    refuse_an_input(picture, takes)
    where = os.path.realpath(picture)
    if where in {os.path.realpath(folder / name) for name in RESULT_FILES if folder is not None}:
        raise OutputError("is a file of the results, and no picture", where=picture, advice=ANOTHER_NAME)
    if where in map(os.path.realpath, others):
        raise OutputError("is named by two options", where=picture, advice="give each file a name of its own")
    check_ending(picture, *AS_PICTURE)
    refuse_to_replace(picture, overwrite=overwrite)
    if folder is None or os.path.realpath(picture.parent) != os.path.realpath(folder):
        check_place(picture)

"""Files that a command writes: never one in the place of another that nobody named as to be replaced."""

from __future__ import annotations

import os
from pathlib import Path

from capture.errors import OutputError


def refuse_to_replace(path: Path) -> None:
    """Do nothing unless a file of this name is there, or the beginning of one that was never finished.

    Raises:
        OutputError: it is there.
    """
    if path.exists():
        raise OutputError("is already there", where=path, advice="give another name, or --overwrite to replace it")
    partial = path.with_name(path.name + ".partial")
    if partial.exists():
        raise OutputError(
            "is what an interrupted recording left under this name", where=partial,
            advice="look at it with `hangtime takes show`; give another name, or --overwrite to replace it",
        )  # fmt: skip


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        with partial.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        raise OutputError(f"cannot be written ({error.strerror})", where=path, advice="check the folder") from error

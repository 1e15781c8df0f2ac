"""Files that a library writes itself, as bytes, and the system's own cause where it could not write one whole.

Such libraries report a full disk in words of their own, or not at all. So a block is added to what the library left.
The system refuses it for the same reason, and names that.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from formats.errors import OutputError
from formats.system_causes import step_to_write

BLOCK = bytes(1 << 16)  # more than is left in the last block of a full disk (4 KiB, 64 KiB at most: `man 5 ext4`)


def bytes_by_library(write: Callable[[Path], object], name: str, *, least: int = 1) -> bytes:
    """Return the bytes of a file that a library writes into a temporary folder.

    - `write`: gets the path; an error of it says that the file is not whole
    - `name`: of the file
    - `least`: bytes that the whole file has, for a library that says nothing

    Raises:
        OutputError: the system refuses the file.
    """
    try:
        place = tempfile.gettempdir()
    except OSError as error:
        raise OutputError(
            "no folder for temporary files takes one", where="TMPDIR",
            advice="name a folder with room; `ulimit -f` may limit the size of files as well",
        ) from error  # fmt: skip
    try:
        with tempfile.TemporaryDirectory(prefix="hangtime-") as folder:
            path = Path(folder) / name
            try:
                write(path)
            except (OSError, RuntimeError):
                _ask_the_system(path)
                raise
            if not path.exists() or path.stat().st_size < least:
                _ask_the_system(path)
                raise OutputError("the library left it unfinished", where=path, advice="choose another --to")
            return path.read_bytes()
    except OSError as error:
        raise OutputError(
            f"the file that is made there first cannot be written ({error.strerror or error})",
            where=place, advice=f"{step_to_write(error)} (TMPDIR names the folder)",
        ) from error  # fmt: skip


def _ask_the_system(path: Path) -> None:
    """Add a block to a file.

    Raises:
        OSError: the system refuses it, as it refused the library.
    """
    with path.open("ab") as file:
        file.write(BLOCK)

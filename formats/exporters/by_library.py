"""Return a file that a library writes, or the system's reason where the library could not write it whole.

Such libraries report a full disk in their own words, or not at all. So a block is appended to the library's incomplete
file. The system refuses the block for the same reason, and names the reason.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from formats.errors import OutputError
from formats.system_causes import step_to_write

MORE_THAN_A_BLOCK = bytes(
    1 << 16
)  # more than is left in the last block of a full disk (4 KiB, 64 KiB at most: `man 5 ext4`)


def bytes_by_library(write: Callable[[Path], object], name: str) -> bytes:
    """Return the bytes of a file that a library writes into a temporary folder.

    - `write`: writes to the path it is given; an exception means that the file is incomplete
    - `name`: name of the file

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
            if not path.exists() or not path.stat().st_size:
                _ask_the_system(path)
                raise OutputError("the library left it unfinished", where=path, advice="choose another --to")
            return path.read_bytes()
    except OSError as error:
        raise OutputError(
            f"the file that is made there first cannot be written ({error.strerror or error})",
            where=place, advice=f"{step_to_write(error)} (TMPDIR names the folder)",
        ) from error  # fmt: skip


def _ask_the_system(path: Path) -> None:
    """Append a block to a file.

    Raises:
        OSError: the system refuses the block, as it refused the library.
    """
    with path.open("ab") as file:
        file.write(MORE_THAN_A_BLOCK)

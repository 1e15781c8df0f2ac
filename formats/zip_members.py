"""List the members of a zip archive in bounded memory, whatever length the archive states for its own list."""

from __future__ import annotations

import zipfile
from typing import BinaryIO

# bytes of an archive's list of members. Our choice: twice the 4 MB of ten minutes with 30 scans a second, as
# `takes export` writes them. A list of this length takes 0.1 GB in Python's memory.
MOST_LIST = 1 << 23


def members_of(file: BinaryIO) -> list[zipfile.ZipInfo]:
    """Return the members of an archive.

    Raises:
        zipfile.BadZipFile: the file is no such archive, or states a list that is longer than any recording's.
        OSError: it cannot be read. ValueError, NotImplementedError: it is damaged.
    """
    with zipfile.ZipFile(_Bounded(file)) as archive:
        return archive.infolist()


class _Bounded:
    """A file in which no single read is longer than a list of members may be."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell, self.seekable = file.seek, file.tell, file.seekable

    def read(self, count: int = -1) -> bytes:  # a negative count of bytes means all, as in every file of Python
        """Return `count` bytes, or the rest of the file where `count` is negative."""
        content = self._file.read(count if count >= 0 else MOST_LIST + 1) if count <= MOST_LIST else None
        if content is None or len(content) > MOST_LIST:
            raise zipfile.BadZipFile(f"its list of members has more than {MOST_LIST} bytes")
        return content

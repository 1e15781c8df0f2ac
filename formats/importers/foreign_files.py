"""Refuse files that no program for motion capture wrote: what a download, an archive or a spreadsheet leaves.

A file of markers has none of the beginnings below.

Sources:
- the Git LFS specification, "The pointer"
- the HTML standard, "The DOCTYPE"
- PKWARE, APPNOTE.TXT, 4.3.7
- RFC 1952
- the formats of 7-Zip, RAR, xz and bzip2
- Microsoft, "Compound File Binary File Format"
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from formats.errors import TakeError

FIRST_BYTES = 512  # bytes; our choice: white space and a byte order mark may stand before the first word
UNPACK = "unpack it, and give the file in it"
DOWNLOADED = (
    (rb"version https://git-lfs", "is a pointer of Git LFS, and not the file itself", "fetch it with `git lfs pull`"),
    (
        rb"(?:\xef\xbb\xbf)?\s*(?i:<!doctype html|<html)",
        "is a web page",
        "download the file itself; opened in a browser, the page may say why it came instead",
    ),
)  # pattern of the first bytes, what the file is, and what to do
FOREIGN_KINDS = (
    *DOWNLOADED,
    (rb"PK\x03\x04", "is a zip archive or a workbook of Excel", f"{UNPACK}, or save the table as .csv"),
    (rb"\xd0\xcf\x11\xe0", "is a workbook of Excel", "save the table as .csv"),
    (rb"\x1f\x8b", "is compressed by gzip", UNPACK),
    (rb"7z\xbc\xaf|Rar!\x1a|\xfd7zXZ|BZh.1AY&SY", "is a compressed archive", UNPACK),
)  # the same of all kinds


def refuse_foreign(path: Path, kinds: Sequence[tuple[bytes, str, str]] = FOREIGN_KINDS) -> None:
    """Refuse a file whose first bytes show that it is of one of these kinds.

    Raises:
        TakeError: it is such a file.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(FIRST_BYTES)
    for pattern, what, advice in kinds:
        if re.match(pattern, head, re.DOTALL):
            raise TakeError(what, where=path, advice=advice)

"""The next step for each cause for which the operating system refuses a file, for all readers and writers.

The causes are those of `man 3 errno` that a person can change.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}  # a full disk, quota or size limit, which a person may raise meanwhile
ONLY_WRITING = {*FULL, errno.EROFS}  # causes that only writing has
TO_WRITE = {
    errno.ENOSPC: "make room on the disk, or choose another one",
    errno.EDQUOT: "make room in your quota, or choose another disk",
    errno.EFBIG: "raise the limit on the size of files (`ulimit -f`), or choose another disk",
    errno.EROFS: "choose another folder: the disk of this one is read-only",
    errno.EACCES: "choose another folder, or get the permission to write to this one",
    errno.EPERM: "choose another folder, or get the permission to write to this one",
    errno.ENAMETOOLONG: "choose a shorter name: the system allows no longer one",
    errno.EISDIR: "give another name: a folder has this one",
    errno.ENOTDIR: "give another path: a part of this one is a file",
    errno.EEXIST: "give another name: a file, a device, a pipe or a broken link has this one",
    errno.ENOENT: "make its folder first, or give another path",
    errno.ELOOP: "give another path: a link of this one leads to itself",
    errno.EIO: "choose another disk: this one fails",
    errno.EINVAL: "give the name of a file",
}
MOST_OF_A_NAME = 255  # bytes of a file's name: Linux, NAME_MAX of limits.h; macOS and Windows allow as many
TO_READ = {
    errno.EACCES: "get the permission to read it",
    errno.EPERM: "get the permission to read it",
    errno.EISDIR: "give a file: this is a folder",
    errno.ENOTDIR: "check the path: a part of it is a file",
    errno.ELOOP: "check the path: a link of it leads to itself",
    errno.ENAMETOOLONG: "shorten the path: the system does not allow its length",
    errno.EIO: "copy the file from elsewhere: its disk fails",
}


def step_to_write(error: OSError) -> str:
    """Return the next step for a file that cannot be written."""
    return TO_WRITE.get(error.errno or 0, "choose another place")


def step_to_read(error: OSError) -> str:
    """Return the next step for a file that cannot be read; one of a too long name says both lengths."""
    parts = Path(os.fsdecode(error.filename)).parts if isinstance(error.filename, str | bytes | Path) else ()
    longest = max((len(os.fsencode(part)) for part in parts), default=0)
    if error.errno == errno.ENAMETOOLONG and longest > MOST_OF_A_NAME:
        return f"shorten the name: it has {longest} bytes, and the system allows {MOST_OF_A_NAME}"
    return TO_READ.get(error.errno or 0, "check the path")

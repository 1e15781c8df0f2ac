"""Write files whole or not at all: written under another name, synced, renamed."""

from __future__ import annotations

import errno
import os
import stat
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from formats.plain_text import sized

NO_PLACE = "a device, a pipe or a socket is no place for a file"
AT_FDCWD, RENAME_NOREPLACE = -100, 1  # Linux, fcntl.h and fs.h
LARGEST_STATE = 1 << 20  # bytes; our choice: hundreds of times a note, a receipt or a key that a program keeps
MOST_NAME_BYTES = 255  # bytes of a file's name: Linux, limits.h


def write_whole(path: Path, content: bytes | Iterable[bytes], *, may_replace: bool = True) -> None:
    """Write a file in an existing folder; after a failure the former file stays, and nothing else is left.

    The unfinished file has a unique name, so that two processes may write the same file at once.

    - `content`: the bytes, or pieces of them, which need not be in memory at once
    - `may_replace`: whether a file of this name may exist; without it one of two processes is refused

    Raises:
        FileExistsError: it exists and may not be replaced.
        OSError: it cannot be written; names the file.
    """
    try:
        _write_whole(path, content, may_replace)
    except OSError as error:
        error.filename, error.filename2 = str(path), None  # a full disk names none
        raise


def name_of_its_own(path: Path) -> Path:
    """Return a new unique name under which `write_whole` writes a file."""
    return path.with_name(f"{path.name}.{os.urandom(6).hex()}.partial")


def _write_whole(path: Path, content: bytes | Iterable[bytes], may_replace: bool) -> None:
    partial = name_of_its_own(path)
    # Unlike `tempfile`, whose files only their owner can read: the user's umask decides who may read a result.
    handle = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
    try:
        with os.fdopen(handle, "wb") as file:
            file.writelines([content] if isinstance(content, bytes) else content)
            file.flush()
            os.fsync(file.fileno())
        give_name(partial, path, may_replace=may_replace)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def give_name(partial: Path, path: Path, *, may_replace: bool) -> None:
    """Give a complete file its final name.

    may_replace: as in `write_whole`

    Raises:
        FileExistsError: a file of that name exists and may not be replaced.
        OSError: it cannot be renamed, or a device, a pipe or a socket has that name.
    """
    _refuse_device(path)
    if may_replace:
        partial.replace(path)
    else:
        _put_where_none_is(partial, path)


def _put_where_none_is(partial: Path, path: Path) -> None:
    """Give a file its name unless another file has it, tested and named in one step.

    A file system that cannot rename like this gets a hard link, which a crash may leave beside the unfinished name.
    """
    if _rename_where_none_is(partial, path):
        return
    try:
        path.hardlink_to(partial)
    except FileExistsError:
        raise
    except OSError as error:  # of a file system without such links
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from error
        partial.replace(path)
    else:
        partial.unlink()


def _rename_where_none_is(partial: Path, path: Path) -> bool:
    """Rename a file unless another file has the name (`man 2 renameat2`); False where the system cannot do that."""
    import ctypes  # imported here: few commands need it

    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    sys.audit("os.rename", str(partial), str(path), -1, -1)  # as `os.rename` does, whose system call cannot refuse
    if rename(AT_FDCWD, os.fsencode(partial), AT_FDCWD, os.fsencode(path), RENAME_NOREPLACE) == 0:
        return True
    number = ctypes.get_errno()
    if number in (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP):
        return False
    raise OSError(number, os.strerror(number), str(path))


def _refuse_device(path: Path) -> None:
    """Refuse to rename a file over a device, a pipe or a socket, or over a link to one."""
    if is_device(path):
        raise OSError(errno.EINVAL, NO_PLACE)


def is_device(path: Path) -> bool:
    """Return whether a path names a device, a pipe or a socket, which no file may replace.

    Raises:
        OSError: its folder cannot be read.
    """
    kind = kind_of_file(path)
    return bool(kind) and not (stat.S_ISREG(kind) or stat.S_ISDIR(kind))


def is_folder(path: Path) -> bool:
    """Return whether a path names a folder, or a link to one.

    Raises:
        OSError: its folder cannot be read.
    """
    return stat.S_ISDIR(kind_of_file(path))


def is_hidden(path: Path) -> bool:
    """Return whether a path leads into a folder without permission, so that nobody here may see what is there."""
    try:
        path.stat()
    except PermissionError:
        return True
    except OSError:
        return False
    return False


def kind_of_file(path: Path) -> int:
    """Return the mode of a file, or 0 where there is none or a link leads to what nobody here may see.

    Raises:
        OSError: its folder cannot be read.
    """
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return 0
    except OSError as error:
        if error.errno == errno.ELOOP or (error.errno in (errno.EACCES, errno.EPERM) and path.is_symlink()):
            return 0
        raise


def leads_to_itself(path: Path) -> bool:
    """Return whether a link in a path leads back to itself, directly or through others, so that there is no file."""
    try:
        path.stat()
    except OSError as error:
        return error.errno == errno.ELOOP
    return False


def loop_words(path: Path, otherwise: str) -> str:
    """Return the words for a path that leads nowhere: those of a link loop, or else `otherwise`."""
    return "is a link that leads to itself" if leads_to_itself(path) else otherwise


def check_ends(path: Path) -> None:
    """Refuse a pipe, a socket or a device before it is opened, since it may have no end.

    Raises:
        OSError: it is one, or is missing.
    """
    kind = path.stat().st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
        raise OSError(errno.EINVAL, "the path is a pipe or a device, and no file", str(path))


def read_bounded(path: Path, most: int = LARGEST_STATE, *, may_be_pipe: bool = False) -> bytes:
    """Return the bytes of a file, which is refused before it is read if it is larger than `most` bytes.

    may_be_pipe: whether a user names the file, who may give a pipe; at most one byte more than `most` is read from it

    Raises:
        OSError: it is larger, a pipe or a device that it may not be, or cannot be read.
    """
    if not may_be_pipe:
        check_ends(path)
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        raw = file.read(most + 1) if size <= most else b""
    if max(size, len(raw)) > most:  # it may have grown since, or be a pipe, whose size is unknown
        bytes_of_file = sized(size) if size > most else f"more than {sized(most)}"
        what = f"the file has {bytes_of_file}, and one of its kind {sized(most)} at most"
        raise OSError(errno.EINVAL, what, str(path))
    return raw


def make_folders(folder: Path) -> None:
    """Make a folder and its missing parent folders, durably against a power cut.

    Raises:
        OSError: it cannot be made.
    """
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        if leads_to_itself(folder):
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(folder)) from error
        raise
    for made in reversed(missing):
        sync_folder(made.parent)


def make_writable(folder: Path) -> None:
    """Make a folder as `make_folders` does, and check that files can be written to it.

    Raises:
        OSError: it cannot be made or written to.
    """
    make_folders(folder)
    with suppress(OSError, AttributeError):  # a nameless file, if the file system supports it
        os.close(os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600))
        return
    import tempfile  # imported here: it takes 4 MB of the appliance's memory

    with tempfile.TemporaryFile(dir=folder):
        pass


def sync_folder(folder: Path) -> None:
    """Flush a folder's names to the disk, which a file's own fsync does not (`man 2 fsync`).

    For a folder that may be written to but not read, such as a drop box, the whole system is synced (`man 2 sync`).

    Raises:
        OSError: the disk fails.
    """
    try:
        handle = os.open(folder, os.O_RDONLY)
    except PermissionError:
        os.sync()
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def longest_name(folder: Path) -> int:
    """Return the largest number of bytes of a file name in a folder, which need not exist yet."""
    try:
        return os.pathconf(folder, "PC_NAME_MAX")
    except OSError:
        return MOST_NAME_BYTES

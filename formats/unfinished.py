"""Hold a file under an unfinished name, locked by one writer, and rename it once it is complete.

The kernel's lock (`man 2 flock`) ends with the process that holds it, so a crash leaves no lock. The lock belongs to
the open file and not to its name. So a lock counts only while the name still refers to that file.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from formats.errors import OutputError
from formats.whole_files import (
    NO_PLACE,
    give_name,
    is_device,
    is_folder,
    is_hidden,
    kind_of_file,
    longest_name,
    loop_words,
    sync_folder,
)

ANOTHER_NAME, ANOTHER_FOLDER = "give another name", "choose another folder with --out"
READERS_LEAVE = 0.2  # s: a reader holds its lock for microseconds, and a busy machine may stop it in between
# s between two tries for the lock. Our choice: a twentieth of the wait. A half and twice were not tried.
TRY_EVERY = 0.01
TellAside = Callable[[Path, Path], None]  # called with the names of a file that was put aside, before and after


def unfinished_name(path: Path) -> Path:
    """Return the unfinished name of the file that is to become `path`."""
    return path.with_name(path.name + ".partial")


def already_there(path: Path, *, instead: str = ANOTHER_NAME, what: str = "is already there") -> OutputError:
    """Return the error for a name that a file, a link, a folder or a device already has.

    - `instead`: the next step for a user who wants to keep both files
    - `what`: description of an existing file
    """
    if is_folder(path):
        return OutputError("is a folder", where=path, advice=instead)
    if is_device(path):
        return OutputError(f"cannot be written ({NO_PLACE})", where=path, advice=instead)
    if not kind_of_file(path) and not is_hidden(path):
        what = loop_words(path, "is a link that leads to nothing")
    return OutputError(what, where=path, advice=f"{instead}, or --overwrite to replace it")


def not_utf8(path: Path) -> OutputError:
    """Return the error of a file name that is not UTF-8, which no text can store."""
    return OutputError("has a name that is not UTF-8, and is kept by its name", where=path, advice="rename it")


def left_unfinished(partial: Path, *, instead: str = ANOTHER_NAME) -> OutputError:
    """Return the error of a recording or import that would replace one that was never finished."""
    look = "look at it with `hangtime takes show`"
    return OutputError(
        "is what an interrupted recording or import left under this name", where=partial,
        advice=f"{look}; {instead}, or --overwrite to put it aside and begin anew",
    )  # fmt: skip


def _locked_away(partial: Path, instead: str) -> OutputError:
    """Return the error of an unfinished file without read permission, which may belong to a running writer."""
    return OutputError(
        "may not be read and written by you, and may be a recording that is still running", where=partial,
        advice=f"get the permission to read and write it, or {instead}",
    )  # fmt: skip


def is_left_over(path: Path, *, instead: str = ANOTHER_NAME) -> bool:
    """Return whether `--overwrite` would rename an unfinished file out of the way; an empty file is simply reused.

    Raises:
        OutputError: `UnfinishedFile` would refuse it.
        OSError: its folder cannot be read.
    """
    try:
        with _locked(unfinished_name(path), instead, os.O_RDWR) as file:
            return os.fstat(file.fileno()).st_size > 0
    except FileNotFoundError:
        return False


def is_being_written(path: Path) -> bool:
    """Return whether a writer holds this unfinished file at this moment; False where nobody can know."""
    if not (path.name.endswith(".partial") and os.path.isfile(path)):  # to open a pipe would wait for its other end
        return False
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return False
    except BlockingIOError:
        return True
    except OSError:
        return False


def _refuse_what_is_no_file(partial: Path, instead: str) -> None:
    """Refuse an unfinished name that a folder, a pipe or a device has, since it cannot be written or renamed."""
    if os.path.lexists(partial) and not (partial.is_symlink() or partial.is_file()):
        kind = "folder" if partial.is_dir() else "pipe or device"
        raise OutputError(
            f"is a {kind}, and the take is written under this name until it is whole", where=partial,
            advice=f"rename it, or {instead}",
        )  # fmt: skip


class UnfinishedFile:
    """The exclusive writer of the file that is to become `path`, until the file is finished, kept or discarded.

    `file` is empty and open for writing; the caller flushes it.
    """

    def __init__(
        self, path: Path, *, overwrite: bool, instead: str = ANOTHER_NAME, tell_aside: TellAside | None = None
    ) -> None:
        """Create or take over the unfinished file, and lock it.

        - `overwrite`: replace the file of this name; rename an unfinished file out of the way unless it is empty
        - `instead`: the next step for a user who wants to keep both files
        - `tell_aside`: called with the old and the new name of a file that was renamed out of the way

        Raises:
            OutputError: another writer holds the file; it exists and may not be replaced, or is a pipe; or its
                unfinished name is that of a link or of a file without permission.
            OSError: it cannot be written.
        """
        self.path, self.partial, self._may_replace, self._instead = path, unfinished_name(path), overwrite, instead
        self._refuse_device()
        self.file = _locked(self.partial, instead)
        try:
            is_left = os.fstat(self.file.fileno()).st_size > 0
            if not overwrite:
                self._refuse_to_replace(is_left=is_left)
            elif is_left:
                left, aside = self.file, put_aside(self.partial, path)
                if tell_aside is not None:
                    tell_aside(self.partial, aside)
                self.file = _locked(self.partial, instead)
                left.close()
            sync_folder(self.partial.parent)
        except BaseException:
            self._leave()
            raise

    def finish(self) -> None:
        """Give the file its final name; both the file and the name are then on the disk.

        Raises:
            OutputError: a file that may not be replaced, or a pipe, has appeared there; this file can still be kept or
                discarded.
            OSError: the disk is full or fails.
        """
        self.sync()
        self._refuse_device()
        try:
            give_name(self.partial, self.path, may_replace=self._may_replace)
        except FileExistsError as error:  # it appeared since this file was begun
            raise already_there(self.path, instead=self._instead) from error
        self.file.close()
        sync_folder(self.path.parent)

    def sync(self) -> None:
        """Flush the written bytes to the disk."""
        self.file.flush()
        os.fsync(self.file.fileno())

    def keep(self) -> None:
        """Close the file unchanged, under its unfinished name."""
        with contextlib.suppress(OSError):  # buffered bytes are lost where the disk is full
            self.file.close()

    def discard(self) -> None:
        """Remove the file, unless it was released before: then it may be another writer's."""
        if not self.file.closed:
            self.partial.unlink(missing_ok=True)
            self.keep()

    def _leave(self) -> None:
        """Release the existing file; an empty one, which may be new, is removed."""
        if os.fstat(self.file.fileno()).st_size > 0:
            self.keep()
        else:
            self.discard()

    def _refuse_device(self) -> None:
        if is_device(self.path):
            raise already_there(self.path, instead=self._instead)

    def _refuse_to_replace(self, *, is_left: bool) -> None:
        if os.path.lexists(self.path):
            raise already_there(self.path, instead=self._instead)
        if is_left:
            raise left_unfinished(self.partial, instead=self._instead)


def put_aside(partial: Path, path: Path) -> Path:
    """Rename an unfinished file out of the way: to `NAME.left-1.mcap.partial`, or the next free number.

    A long NAME is shortened at its end.

    Raises:
        OSError: it cannot be renamed.
    """
    number = 1
    while os.path.lexists(aside := _aside_name(path, number)):
        number += 1
    partial.rename(aside)
    sync_folder(partial.parent)
    return aside


def _aside_name(path: Path, number: int) -> Path:
    stem, ending = path.stem, f".left-{number}{path.suffix}"
    room = longest_name(path.parent) - len(os.fsencode(unfinished_name(Path(ending)).name))
    while stem and len(os.fsencode(stem)) > room:
        stem = stem[:-1]
    return unfinished_name(path.with_name(stem + ending))


def _locked(partial: Path, instead: str, access: int = os.O_RDWR | os.O_CREAT) -> BinaryIO:
    """Open a file as it is, or make it, and lock it.

    access: flags of `man 2 open`; without `O_CREAT` a file that is not there raises `FileNotFoundError`
    """
    _refuse_what_is_no_file(partial, instead)
    while True:
        try:
            handle = os.open(partial, access | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        except PermissionError as error:
            if os.path.lexists(partial):
                raise _locked_away(partial, instead) from error
            raise
        except OSError as error:
            if error.errno != errno.ELOOP or not partial.is_symlink():  # a link of its folder may lead to itself
                raise
            raise OutputError(
                "is a link to another file, which would be overwritten", where=partial, advice="remove the link"
            ) from error
        file = os.fdopen(handle, "r+b")
        try:
            _lock(file)
            if _leads_to(partial, file):
                return file
            file.close()  # the writer before finished it, or discarded it, between our opening and our lock
        except BlockingIOError as error:
            file.close()
            raise OutputError(
                "another recording or import is writing this", where=partial,
                advice=f"{instead}, or wait until it ends",
            ) from error  # fmt: skip
        except BaseException:
            file.close()
            raise


def _lock(file: BinaryIO) -> None:
    """Lock an open file for one writer; wait for readers that look whether a writer holds it.

    Raises:
        BlockingIOError: another writer holds it.
    """
    until = time.monotonic() + READERS_LEAVE
    while True:
        try:
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > until:
                raise
            time.sleep(TRY_EVERY)


def _leads_to(name: Path, file: BinaryIO) -> bool:
    """Return whether a name refers to an open file."""
    try:
        return os.path.samestat(name.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False

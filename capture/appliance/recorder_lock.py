"""The lock by which one process at a time records into a folder, and the check that the folder stays the same one.

A disk that is unmounted leaves an empty folder at the same path. Takes would be recorded there, hidden by the disk
once it is back, under numbers that the disk's own takes have already.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path

from capture.errors import SpoolError
from formats.whole_files import make_folders

NAME = "recorder.lock"


class RecorderLock:
    """The lock of one folder; nothing is touched before `take`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock: int | None = None
        self._held: int | None = None  # the folder itself: while it is open, no other gets its inode

    def take(self) -> None:
        """Lock the folder, which is made where it is missing; a lock that is held stays.

        Raises:
            SpoolError: another process holds the lock, or the folder is no longer the one that was locked.
            OSError: the folder cannot be written.
        """
        if self._lock is not None:
            self.check_in_place()
            return
        make_folders(self._folder)
        lock = os.open(self._folder / NAME, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._held = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError as error:
            os.close(lock)
            if not isinstance(error, BlockingIOError):
                raise
            raise SpoolError(
                "another process records here", where=self._folder,
                advice="stop it first: `systemctl stop hangtime-capture`",
            ) from error  # fmt: skip
        self._lock = lock

    def check_in_place(self) -> None:
        """Check that the locked folder is still the one at its path; without a lock there is nothing to check.

        Raises:
            SpoolError: the folder is gone or replaced.
            OSError: the disk fails.
        """
        if self._held is None:
            return
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            if os.path.samestat(self._folder.stat(), os.fstat(self._held)):
                return
        raise SpoolError(
            "this is not the folder of takes that the recorder began with", where=self._folder,
            advice="mount its disk again or move it back; if the change is meant, `systemctl restart hangtime-capture`",
        )  # fmt: skip

    def let_go(self) -> None:
        """Let another process record here."""
        for handle in (self._lock, self._held):
            if handle is not None:
                os.close(handle)
        self._lock = self._held = None

"""The classes of all errors that a user of Hangtime can act on.

HangtimeError                 says what, where, and what to do next; the command line exits with its `exit_code`, 2
  +-- DescriptionError        a rig or garment file that is malformed or impossible
  +-- TakeError               a take that is missing, damaged or not a take
  |     +-- ImplausibleError  a number that no cloth, hanger or camera has; also a DescriptionError
  +-- OutputError             a file that cannot be written, or that would replace another
  +-- AddressError            an address that leads to no folder and no bucket
  +-- ResultError             a fit result or diagnosis that does not match its schema
  |     +-- NewerFormatError  one of a newer format, which a newer Hangtime reads
  +-- firmware_host.errors.*  the sensor
  +-- capture.errors.*        tracking and recording
  +-- fit.errors.*            fitting and diagnosis
"""

from __future__ import annotations

import errno
from pathlib import Path

from formats.plain_text import plain, shortened, with_advice
from formats.system_causes import FULL, ONLY_WRITING, step_to_read, step_to_write

WHOLE_STAY = "whole files stay, and `fit`, `diagnose`, `blind` and `batch` go on from them"


class HangtimeError(Exception):
    """An error with one clear sentence: what, where, and what to do next.

    - `where`: the file, option or part; None where `what` names it
    - `words`: the sentence without the place, for a caller that names the place itself
    """

    exit_code = 2

    def __init__(self, what: str, *, where: object, advice: str) -> None:
        self.what, self.where, self.advice = what, where, advice
        place = f"{where if isinstance(where, Path) else shortened(str(where))}: " if where is not None else ""
        self.words = plain(with_advice(what, advice))
        super().__init__(plain(place) + self.words)


class DescriptionError(HangtimeError):
    """A rig or garment description that is missing, malformed or impossible."""


class TakeError(HangtimeError):
    """A take archive that is missing, damaged or not a take archive."""


class TakeBegunError(TakeError):
    """A take archive without a readable frame yet, which a recording or import still writes."""


class ImplausibleError(DescriptionError, TakeError):
    """A number that no cloth, hanger or camera has, and that was probably meant in another unit."""


class OutputError(HangtimeError):
    """A file that cannot be written where it was asked for, or that would replace another."""


class AddressError(HangtimeError):
    """An address of a folder or bucket that cannot be opened."""


class ResultError(HangtimeError):
    """A fit result or diagnosis that does not match its published schema."""


class NewerFormatError(ResultError):
    """A fit result or diagnosis of a newer format than this version reads, which is no damage."""


def of_system(error: OSError) -> HangtimeError | None:
    """Return the user's error for an operating system's error, None where no user can act on it."""
    where = error.filename or "output"  # an error of stdout names no file
    if error.errno in ONLY_WRITING:
        advice = f"{step_to_write(error)}; {WHOLE_STAY}" if error.errno in FULL else step_to_write(error)
        return HangtimeError(f"cannot be written ({error.strerror})", where=where, advice=advice)
    if error.filename is None:
        return None
    return HangtimeError(f"cannot be used ({error.strerror})", where=where, advice=_step_to_use(error))


def _step_to_use(error: OSError) -> str:
    """Return the next step where it is unknown whether a file was read or written."""
    if error.errno in (errno.EACCES, errno.EPERM):
        return "get the permission for it, or choose another place"
    return step_to_read(error)

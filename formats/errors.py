"""Every error that a user of Hangtime can act on.

HangtimeError                 says what, where, and what to do next; the command line exits with its `exit_code`, 2
  +-- DescriptionError        a rig or garment file that does not hold
  +-- TakeError               a take that is missing, damaged or not a take
  |     +-- ImplausibleError  a number that no cloth, hanger or camera has; also a DescriptionError
  +-- OutputError             a file that cannot be written, or that would replace another
  +-- AddressError            an address that leads to no folder and no bucket
  +-- ResultError             a fit result or diagnosis that does not match its schema
  +-- firmware_host.errors.*  the sensor
  +-- capture.errors.*        tracking and recording
  +-- fit.errors.*            fitting and diagnosis
"""

from __future__ import annotations

import errno

from formats.plain_text import plain

UNWRITABLE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES}
MAKE_ROOM = (
    "make room on the disk, or choose another place; whole files stay, and `fit`, `diagnose`, `blind` and `batch` go "
    "on from them"
)


class HangtimeError(Exception):
    """An error with one clear sentence: what, where, and what to do next."""

    exit_code = 2

    def __init__(self, what: str, *, where: object = None, advice: str = "") -> None:
        self.what, self.where, self.advice = what, where, advice
        place = f"{where}: " if where is not None else ""
        if advice and what.endswith("?"):
            advice = f" {advice[0].upper()}{advice[1:]}"
        elif advice:
            advice = f"; {advice}"
        super().__init__(plain(f"{place}{what}{advice}"))


class DescriptionError(HangtimeError):
    """A rig or garment description that is missing, malformed or impossible."""


class TakeError(HangtimeError):
    """A take archive that is missing, damaged or not a take archive."""


class ImplausibleError(DescriptionError, TakeError):
    """A number that no cloth, hanger or camera has, and that was probably meant in another unit."""


class OutputError(HangtimeError):
    """A file that cannot be written where it was asked for, or that would replace another."""


class AddressError(HangtimeError):
    """An address of a folder or bucket that cannot be opened."""


class ResultError(HangtimeError):
    """A fit result or diagnosis that does not match its published schema."""


def of_system(error: OSError) -> HangtimeError | None:
    """Return what to tell of an error of the system; nothing where nobody can act on it."""
    if error.errno not in UNWRITABLE and error.filename is None:
        return None
    what = "cannot be written" if error.errno in UNWRITABLE else "cannot be used"
    where = error.filename or "output"  # what stdout raises names nothing
    advice = MAKE_ROOM if error.errno in UNWRITABLE else "check the path"
    return HangtimeError(f"{what} ({error.strerror})", where=where, advice=advice)

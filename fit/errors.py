"""Errors of fitting and diagnosis.

HangtimeError
  +-- FitError            the request cannot be fitted
        +-- DriveError    a hanger path that no cloth can follow (gaps, jumps)
        +-- BlowUpError   a simulation that left the realm of finite numbers
        +-- BatchError    a folder, bucket or cluster that a batch cannot work with
              +-- UnreachableError   one that cannot be reached, or is full, now and not for ever; exit code 75
"""

from __future__ import annotations

from formats.errors import HangtimeError

INCONCLUSIVE = 4  # exit code of `hangtime diagnose`, which did its work: the takes cannot decide


class FitError(HangtimeError):
    """A fit or diagnosis that cannot be started or finished as asked."""


class DriveError(FitError):
    """A hanger path with gaps or jumps that no simulation can be driven by."""


class BlowUpError(FitError):
    """Every candidate of a batch became infinite or not a number."""


class BatchError(FitError):
    """A folder, bucket or cluster that a batch cannot work with."""


class UnreachableError(BatchError):
    """A bucket or cluster that cannot be reached now, or a disk that is full, and may be otherwise later."""

    exit_code = 75  # EX_TEMPFAIL of sysexits.h: what starts the command may try again

"""Errors of fitting and diagnosis.

HangtimeError
  +-- FitError            the request cannot be fitted
        +-- MismatchError a take that contradicts its garment, its rig or its other clock
        +-- DriveError    a hanger path that no cloth can follow (gaps, jumps)
              +-- ImpossiblePathError   one with jumps, or with exchanged ends
        +-- BlowUpError     a simulation that did not stay finite
        +-- BatchError    a folder, bucket or cluster that a batch cannot work with
              +-- UnreachableError   one that is unreachable or full for a while; exit code 75
"""

from __future__ import annotations

from formats.errors import HangtimeError

INCONCLUSIVE = 4  # exit code of a finished `hangtime diagnose` whose takes cannot decide


class FitError(HangtimeError):
    """A fit or diagnosis that cannot be started or finished as requested."""


class DriveError(FitError):
    """A hanger path with gaps or jumps that no simulation can be driven by."""


class MismatchError(FitError):
    """A take that contradicts its garment, its rig or its other clock, which lost frames do not cause."""


class ImpossiblePathError(DriveError):
    """A hanger path with jumps or exchanged ends, which lost frames do not cause."""


class BlowUpError(FitError):
    """Every candidate of a batch became infinite or not a number."""


class BatchError(FitError):
    """A folder, bucket or cluster that a batch cannot work with."""


class UnreachableError(BatchError):
    """A temporary failure: a bucket or cluster that cannot be reached, or a full disk."""

    exit_code = 75  # EX_TEMPFAIL of sysexits.h: a service manager may try again

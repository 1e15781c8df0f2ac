"""Errors of fitting and diagnosis.

HangtimeError
  +-- FitError            the request cannot be fitted
        +-- DriveError    a hanger path that no cloth can follow (gaps, jumps)
        +-- BlowUpError   a simulation that left the realm of finite numbers
        +-- BatchError    a folder, bucket or cluster that a batch cannot work with
"""

from __future__ import annotations

from formats.errors import HangtimeError


class FitError(HangtimeError):
    """A fit or diagnosis that cannot be started or finished as asked."""


class DriveError(FitError):
    """A hanger path with gaps or jumps that no simulation can be driven by."""


class BlowUpError(FitError):
    """Every candidate of a batch became infinite or not a number."""


class BatchError(FitError):
    """A folder, bucket or cluster that a batch cannot work with."""

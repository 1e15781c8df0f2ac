"""Every error of tracking and recording that a user can act on.

HangtimeError
  +-- CaptureError
        +-- UntrackableError    the rig or garment describes something that this tracker cannot follow
        +-- NoMarkersError      a whole recording in which the hanger was never seen
        +-- HangerGapError      a recording in which the hanger was out of view for too long in between
        +-- UnfitTakeError      a recording to which nothing can be fitted for another reason
        +-- CalibrationError    the rig cannot be measured from what the sensor saw
        +-- ControlError        the daemon cannot be asked, or cannot listen
        |     +-- AnotherDaemonError  another daemon listens already
        +-- SpoolError          the appliance's folder of takes cannot be used as asked
        +-- SyncError           takes cannot be brought to the server as asked
"""

from __future__ import annotations

from formats.errors import HangtimeError


class CaptureError(HangtimeError):
    """An error while a recording is tracked."""


class UntrackableError(CaptureError):
    """A rig or garment description that is in order but that the tracker cannot follow."""


class NoMarkersError(CaptureError):
    """A recording in which the two hanger markers were never seen together."""


class HangerGapError(CaptureError):
    """A recording in which the two hanger markers were out of view for too long between two detections."""


class UnfitTakeError(CaptureError):
    """A recording that was kept although no model can be fitted to it."""


class CalibrationError(CaptureError):
    """A calibration that failed: the recorded frames do not determine the rig."""


class ControlError(CaptureError):
    """A daemon that is not running, refuses this user, does not answer or cannot open its socket."""


class AnotherDaemonError(ControlError):
    """Another daemon that already listens at this daemon's socket."""


class SpoolError(CaptureError):
    """A folder of takes that cannot be used as asked."""


class SyncError(CaptureError):
    """A server, setting or credential with which takes cannot be uploaded."""

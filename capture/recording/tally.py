"""The counts of a recording so far: frames, detections of the hanger and of each point, losses, conditions."""

from __future__ import annotations

import numpy as np

from capture.recording.condition import Condition, ConditionWatch
from capture.recording.frame_reader import Seen


class Tally:
    """Counts the frames of one recording; times start at its first frame."""

    def __init__(self, points: int) -> None:
        self.frames = self.with_hanger = self.dropped = self.frame_gaps = 0
        self.points_seen = np.zeros(points)
        self.conditions = ConditionWatch()
        self.first = self.last = 0.0

    def add(self, seen: Seen) -> Condition | None:
        """Count a frame; return the condition to announce, None if unchanged."""
        self.first = seen.time if self.frames == 0 else self.first
        self.last = seen.time
        self.frames += 1
        self.with_hanger += seen.has_hanger
        self.dropped += seen.dropped
        self.frame_gaps += seen.dropped > 0
        self.points_seen += seen.frame.points_valid
        return self.conditions.add(seen.time - self.first, seen.condition)

    def add_unplaced(self, now: float) -> Condition | None:
        """Count a frame without a valid time, at a time [s] of the sensor's clock."""
        return self.conditions.add(now - self.first, Condition.CLOCK)

    @property
    def seconds(self) -> float:
        """The time from the first frame to the last [s]."""
        return self.last - self.first

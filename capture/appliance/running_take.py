"""The frame loop's side of the take that is being recorded: its counters and its metadata."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from capture.appliance.disk import TakePlan
from capture.appliance.wall_clock import WallTime, boot_id, wall_time
from capture.recording.condition import Condition
from capture.recording.frame_reader import FrameReader, Seen
from capture.recording.tally import Tally
from firmware_host.depth_sensor import SensorFrame
from formats.garment import Garment
from formats.judgement import FEWEST_HANGERS
from formats.rig import Rig


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """The beginning of a take: who started it, when, and the length of its pre-roll [s].

    pressed_s [s]: monotonic
    """

    by: str
    pressed_s: float
    pre_roll_s: float
    wall: WallTime


class TakeInProgress:
    """Counts a take's frames; the disk thread stores the frames themselves."""

    def __init__(self, reader: FrameReader, before: list[Seen], points: int, *, by: str, now: float) -> None:
        """Begin with the pre-roll's frames, the oldest first; now [s], monotonic."""
        self.reader, self.tally = reader, Tally(points)
        span = before[-1].time - before[0].time if before else 0.0
        self.beginning = Beginning(by=by, pressed_s=now, pre_roll_s=span, wall=wall_time(span))
        self.condition = Condition.GOOD
        self.shown: SensorFrame | None = None  # the last frame with both markers
        for seen in before:
            self.count(seen)

    def count(self, seen: Seen, frame: SensorFrame | None = None) -> None:
        """Count a frame; frame: its pictures, None for one of the pre-roll."""
        self.condition = self.tally.add(seen) or self.condition
        if frame is not None and seen.has_hanger:
            self.shown = frame

    def plan(self, rig: Rig, garment: Garment, source: str) -> TakePlan:
        """Return the metadata that is known at the beginning."""
        wall = self.beginning.wall
        notes = {
            "clock_source": wall.source,
            "clock_uncertainty_s": "unknown" if wall.uncertainty_s is None else f"{wall.uncertainty_s:.6f}",
            "boot": boot_id(), "pre_roll_s": f"{self.beginning.pre_roll_s:.3f}", "begun_by": self.beginning.by,
        }  # fmt: skip
        return TakePlan(rig=rig, garment=garment, source=source, created=wall.utc, notes=notes)

    @property
    def is_worth_keeping(self) -> bool:
        """Return whether any frame shows the hanger."""
        return self.tally.with_hanger >= FEWEST_HANGERS

    @property
    def seconds_since_press(self) -> float:
        """Return the recorded time since the press [s], by the frames' timestamps."""
        return self.tally.seconds - self.beginning.pre_roll_s

    def now(self) -> dict[str, Any]:
        """Return the take's entry in `status`."""
        tally = self.tally
        return {
            "seconds": round(tally.seconds, 3), "frames": tally.frames, "dropped": tally.dropped,
            "gaps": tally.frame_gaps, "pre_roll_s": round(self.beginning.pre_roll_s, 3),
            "condition": self.condition.value.words,
        }  # fmt: skip

    def facts(self, ended_by: str) -> dict[str, Any]:
        """Return the metadata stored beside the take; durations follow the frames' timestamps, not the wall clock."""
        tally, wall = self.tally, self.beginning.wall
        return {
            "begun": wall.utc, "boot": boot_id(), "clock_source": wall.source,
            "clock_uncertainty_s": wall.uncertainty_s,
            "begun_by": self.beginning.by, "ended_by": ended_by, "pre_roll_s": round(self.beginning.pre_roll_s, 6),
            "seconds": round(tally.seconds, 6), "frames": tally.frames, "with_hanger": tally.with_hanger,
            "dropped": tally.dropped, "gaps": tally.frame_gaps,
            "conditions": {one.value.words: count for one, count in tally.conditions.frames.items()},
        }  # fmt: skip

"""Report which parts of a take archive exist, are damaged, or are missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Span = tuple[float, float]  # s of the sensor's clock: begin, end
State = Literal["sound", "incomplete", "damaged", "too large"]
TOO_LARGE: Literal["too large"] = "too large"  # blocks of the take need more memory than one file may take
LeftState = Literal["waiting", "unreadable"]


@dataclass(frozen=True, kw_only=True)
class TakeReport:
    """The result of `formats.archive.verify_take`: numbers of existing, damaged and missing parts.

    - `missing_frames`: None where the end of the take is not known
    - `spans`: as `formats.take.Take.missing`, without spans that an earlier file of this take had lost
    - `earlier`: the spans that an earlier file had lost
    - `other_blocks`: blocks of another take in the same file, whose header is there too
    - `other_takes`: number of these takes
    - `trailing_bytes`: bytes behind the end of the archive, which belong to something else or repeat a part
    - `unread_blocks`: blocks that need more memory than a file of this size may take; nothing shows that they are
      damaged
    - `doubts`: sentences about contradictions in the header and the end message
    - `earlier_doubts`: the same of an earlier file of this take or of its import, from the notes; '' without any
    - `file`: path from which the take was read, '' for a take without a file
    - `is_being_written`: a recording or import still wrote the file while it was read
    - `left`: the rig or garment that its import left, as `formats.left_descriptions.left_beside` finds them
    """

    is_complete: bool
    missing_frames: int | None
    earlier_doubts: str
    frames: int = 0
    blocks: int = 0
    scans: int = 0
    damaged_blocks: int = 0
    missing_scans: int = 0
    spans: tuple[Span, ...] = ()
    earlier: tuple[Span, ...] = ()
    trailing_bytes: int = 0
    other_blocks: int = 0
    other_takes: int = 0
    unread_blocks: int = 0
    doubts: tuple[str, ...] = ()
    file: str = ""
    is_being_written: bool = False
    left: Mapping[str, LeftState] = field(default_factory=dict)

    @property
    def is_sound(self) -> bool:
        """True for a finished take without damage, missing parts or trailing bytes."""
        return self.is_complete and not (
            self.is_damaged or self.missing_frames or self.missing_scans or self.unread_blocks
        )

    @property
    def state(self) -> State:
        """The state of the take in one word."""
        if self.unread_blocks and not self.is_damaged:
            return TOO_LARGE
        return "sound" if self.is_sound else "damaged" if self.is_damaged else "incomplete"

    @property
    def is_damaged(self) -> bool:
        """True where blocks are damaged or of another take, bytes follow the end, or there are contradictions."""
        return self.damaged_blocks > 0 or self.trailing_bytes > 0 or self.other_blocks > 0 or bool(self.doubts)

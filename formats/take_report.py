"""Report how much of a take archive is there, damaged and missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Span = tuple[float, float]  # s of the sensor's clock: begin, end
LeftState = Literal["waiting", "unreadable"]


@dataclass(frozen=True, kw_only=True)
class TakeReport:
    """The findings of `formats.archive.verify_take`: numbers of what is there, damaged and missing.

    - `missing_frames`: None where the end of the take is not known
    - `spans`: as `formats.take.Take.missing`, without those that an earlier file of this take had lost
    - `earlier`: those that it had lost
    - `other_blocks`: that belong to another take in the same file, whose header is there too
    - `trailing_bytes`: that follow the end of the archive, and belong to something else or come twice
    - `other_takes`: to which these belong
    - `unread_blocks`: that need more memory than a file of this size may take; nothing says that they are damaged
    - `doubts`: sentences about what its header and its end say and what cannot be
    - `earlier_doubts`: those that its notes keep, of an earlier file of this take or of its import; '' without any
    - `file`: whence it was read, '' of a take that was never in a file
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
    left: Mapping[str, LeftState] = field(default_factory=dict)

    @property
    def is_sound(self) -> bool:
        """True for a finished take without damage or missing parts, behind which nothing follows."""
        return self.is_complete and not (
            self.is_damaged or self.missing_frames or self.missing_scans or self.unread_blocks
        )

    @property
    def is_damaged(self) -> bool:
        """True where a block does not hold or is of another take, something follows the end, or says what cannot be."""
        return self.damaged_blocks > 0 or self.trailing_bytes > 0 or self.other_blocks > 0 or bool(self.doubts)

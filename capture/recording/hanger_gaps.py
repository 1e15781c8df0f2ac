"""How long the hanger was not seen within a take, which counts from the first to the last sight of it."""

from __future__ import annotations

from dataclasses import dataclass

from formats.take import LONGEST_GAP


@dataclass
class HangerGaps:
    """The gaps over `LONGEST_GAP` between sights of the hanger: how many, the longest [s] and when it begins [s].

    Nothing tells where the hanger was meanwhile, and `hangtime fit` refuses the take.
    """

    count: int = 0
    longest: float = 0.0
    begins: float = 0.0
    _last: float | None = None

    def add(self, time: float) -> None:
        """Take in a sight of the hanger at a time [s]."""
        gap = 0.0 if self._last is None else time - self._last
        self.count += gap > LONGEST_GAP
        if gap > max(self.longest, LONGEST_GAP):
            self.longest, self.begins = gap, time - gap
        self._last = time

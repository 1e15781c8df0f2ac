"""The pre-roll: the frames of the last seconds before a press, limited by time since frame rates vary."""

from __future__ import annotations

from collections import deque
from typing import Generic, Protocol, TypeVar


class Timed(Protocol):
    """An item with a time in the take [s], which increases."""

    @property
    def time(self) -> float:
        """The item's time in the take [s]."""


T = TypeVar("T", bound=Timed)


class PreRoll(Generic[T]):
    """Buffers the entries of the last seconds before the newest, and one older entry to cover the full time."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._held: deque[T] = deque()

    def add(self, entry: T) -> None:
        """Add an entry and discard those that are too old."""
        self._held.append(entry)
        while len(self._held) > 1 and entry.time - self._held[1].time >= self._seconds:
            self._held.popleft()

    def take(self) -> list[T]:
        """Remove and return all entries, the oldest first."""
        given = list(self._held)
        self._held.clear()
        return given

    @property
    def span(self) -> float:
        """The seconds from the oldest entry to the newest."""
        return self._held[-1].time - self._held[0].time if self._held else 0.0

    def __len__(self) -> int:
        return len(self._held)

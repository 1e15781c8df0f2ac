"""The stay of takes on the device: the oldest verified one leaves first, an unsynced one never."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol, TypeVar

import msgspec

from capture.appliance.receipts import Receipt

GIBIBYTE = 1 << 30


class Retention(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The share of the disk for takes, and the stay of takes that are safe on the server.

    - `quota_bytes`: takes together may be so large
    - `least_free_bytes`: so much of the file system stays free
    - `days`: a verified take leaves so many days after it was verified, even where there is room; None: it stays
    """

    quota_bytes: int = 8 * GIBIBYTE
    least_free_bytes: int = GIBIBYTE // 2
    days: float | None = 30.0

    def __post_init__(self) -> None:
        for name in ("quota_bytes", "least_free_bytes"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} is negative; give a number of bytes")
        if self.days is not None and not self.days >= 0:
            raise ValueError("days is negative; give a number of days, or leave it out")


@dataclass(frozen=True)
class Room:
    """The outcome of making room.

    - `left`: stems of the takes that left
    - `used`, `free`: bytes of all takes, bytes free on the file system; both afterwards
    - `changed`: stems of those that stay because the disk holds something else than the server verified
    - `is_enough`: whether quota and least free space hold, with what was asked for on top
    """

    left: tuple[str, ...]
    used: int
    free: int
    is_enough: bool
    changed: tuple[str, ...] = ()


class Kept(Protocol):
    """The facts of a take for retention."""

    @property
    def size(self) -> int:
        """The size of the take's archive [bytes]."""
        ...

    @property
    def receipt(self) -> Receipt | None:
        """Return what says that it is on the server."""
        ...


One = TypeVar("One", bound=Kept)


def takes_to_leave(
    takes: Sequence[One], retention: Retention, *, free: int, need: int, now: datetime,
    is_safe: Callable[[One], bool] = lambda take: True,
) -> list[One]:  # fmt: skip
    """Return which takes leave, given in the order of their sequence; never one without a receipt.

    - `free`: bytes free on the file system
    - `need`: bytes that are wanted on top of what is there
    - `is_safe`: asked of each take that would leave, whether it is what its receipt says
    """
    leaving: list[One] = []
    over = sum(take.size for take in takes) + need - retention.quota_bytes
    short = retention.least_free_bytes + need - free
    for take in takes:
        if take.receipt is None:
            continue
        if (max(over, short) > 0 or _is_past(take.receipt, retention.days, now)) and is_safe(take):
            leaving.append(take)
            over -= take.size
            short -= take.size
    return leaving


def _is_past(receipt: Receipt, days: float | None, now: datetime) -> bool:
    if days is None:
        return False
    try:
        return (now - datetime.fromisoformat(receipt.at)).total_seconds() > days * 86_400.0
    except (ValueError, TypeError):  # no date, or one without an offset: nobody knows how old it is
        return False

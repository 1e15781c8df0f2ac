"""Retention: which takes are removed from the device; the oldest verified one goes first, an unsynced one never."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol, TypeVar

import msgspec

from capture.appliance.receipts import Receipt

GIBIBYTE = 1 << 30  # bytes, IEC 80000-13


class Retention(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The limits of disk space for takes, and the time for which verified takes are kept.

    - `quota_bytes`: largest total size of the takes
    - `least_free_bytes`: least free space of the file system
    - `days`: a verified take is removed so many days after its verification, even if there is space; None: never
    """

    quota_bytes: int = 8 * GIBIBYTE  # our choice: half of a card of 16 GB
    least_free_bytes: int = GIBIBYTE // 2  # our choice: room for logs and an update
    days: float | None = 30.0  # our choice: a month, in which a take can be sent again

    def __post_init__(self) -> None:
        for name in ("quota_bytes", "least_free_bytes"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} is negative; give a number of bytes")
        if self.days is not None and not self.days >= 0:
            what = "negative" if self.days < 0 else "no number"
            raise ValueError(f"days is {what}; give a number of days, or inf")


@dataclass(frozen=True)
class Room:
    """The result of freeing disk space.

    - `left`: stems of the takes that were removed
    - `used`, `free`: bytes of all takes, bytes free on the file system; both afterwards
    - `changed`: stems of takes that stay because their content differs from the file that the server verified
    - `is_enough`: whether quota and least free space are met, the requested bytes included
    """

    left: tuple[str, ...]
    used: int
    free: int
    is_enough: bool
    changed: tuple[str, ...] = ()


class Kept(Protocol):
    """The properties of a take that retention needs."""

    @property
    def size(self) -> int:
        """The size of the take's archive [bytes]."""
        ...

    @property
    def receipt(self) -> Receipt | None:
        """Return the take's receipt."""
        ...


One = TypeVar("One", bound=Kept)


def takes_to_leave(
    takes: Sequence[One], retention: Retention, *, free: int, need: int, now: datetime,
    is_safe: Callable[[One], bool] = lambda take: True,
) -> list[One]:  # fmt: skip
    """Return the takes to remove, from takes in order of sequence; never one without a receipt.

    - `free`: bytes free on the file system
    - `need`: bytes that must be free in addition
    - `is_safe`: called for each take to remove; returns whether its content matches its receipt
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

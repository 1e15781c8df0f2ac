"""The appliance's faults: each has one sentence, the next action, and whether it blocks recording."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from capture.appliance.log import LOG
from formats.errors import HangtimeError


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault that is present now.

    name: for programs; sentence, advice: for people
    blocks: whether no take can begin
    since_s [s]: when it began, monotonic
    """

    name: str
    sentence: str
    advice: str
    blocks: bool
    since_s: float


class FaultBook:
    """The present faults: the blocking ones first, otherwise in order of appearance.

    The log gets each fault once when it begins, and a line when it is over.
    """

    def __init__(self) -> None:
        self._faults: dict[str, Fault] = {}

    def set(self, name: str, error: HangtimeError, now: float, *, blocks: bool = False) -> bool:
        """Add a fault; return whether it is new. A fault that is already present keeps its time."""
        before = self._faults.get(name)
        where = f"{error.where}: " if error.where is not None else ""
        self._faults[name] = Fault(
            name=name, sentence=where + error.what, advice=error.advice, blocks=blocks,
            since_s=now if before is None else before.since_s,
        )  # fmt: skip
        if before is None:
            LOG.log(logging.ERROR if blocks else logging.WARNING, "%s", error)
        return before is None

    def clear(self, name: str) -> bool:
        """Remove a fault; return whether it was present."""
        before = self._faults.pop(name, None)
        if before is not None:
            LOG.info("over: %s", before.sentence)
        return before is not None

    @property
    def all(self) -> list[Fault]:
        """The present faults, those that block recording first."""
        return sorted(self._faults.values(), key=lambda fault: not fault.blocks)

    @property
    def blocking(self) -> list[Fault]:
        """The faults that block recording."""
        return [fault for fault in self._faults.values() if fault.blocks]

    def __contains__(self, name: object) -> bool:
        return name in self._faults

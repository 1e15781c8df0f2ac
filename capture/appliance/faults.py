"""The appliance's faults: each one sentence and the next action, and whether nothing can be recorded meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

from formats.errors import HangtimeError


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Something that is wrong now.

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
    """The faults of now, the blocking ones first, else in the order in which they came."""

    def __init__(self) -> None:
        self._faults: dict[str, Fault] = {}

    def set(self, name: str, error: HangtimeError, now: float, *, blocks: bool = False) -> bool:
        """Note a fault; return whether it is new. One that is there already keeps its time and takes the new words."""
        before = self._faults.get(name)
        where = f"{error.where}: " if error.where is not None else ""
        self._faults[name] = Fault(
            name=name, sentence=where + error.what, advice=error.advice, blocks=blocks,
            since_s=now if before is None else before.since_s,
        )  # fmt: skip
        return before is None

    def clear(self, name: str) -> bool:
        """Take a fault away; return whether it was there."""
        return self._faults.pop(name, None) is not None

    @property
    def all(self) -> list[Fault]:
        """The faults that stand now, those that block recording first."""
        return sorted(self._faults.values(), key=lambda fault: not fault.blocks)

    @property
    def blocking(self) -> list[Fault]:
        """Those in spite of which nothing can be recorded."""
        return [fault for fault in self._faults.values() if fault.blocks]

    def __contains__(self, name: object) -> bool:
        return name in self._faults

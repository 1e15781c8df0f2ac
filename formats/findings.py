"""Hold one finding on a take: a fault that a person can mend by recording again."""

from __future__ import annotations

from dataclasses import dataclass

from formats.take import Take

SHORTEST_DIAGNOSED = 2.5  # s: a shorter take is not diagnosed, see the reference of the diagnosis
FEWEST_SEEN = 20  # frames with the hanger, and sights of free points: below, neither splines nor statistics make sense
HARDLY_EVER = 0.1  # of the frames
OF_MARKERS = "markers"  # the note that takes of marker paths have, and no others
HARDLY_MOVED = 0.03  # m that the hanger goes to and fro at most: the synthetic world's gentlest motion goes 0.14 m


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something about a take that a person can mend by recording again.

    name: for programs; is_grave: nothing can be fitted to the take
    """

    name: str
    words: str
    advice: str
    is_grave: bool = False

    def as_fact(self) -> dict[str, str | bool]:
        """Return it for a file of facts."""
        return {"name": self.name, "words": self.words, "advice": self.advice, "is_grave": self.is_grave}


def ends_of(take: Take) -> str:
    """Return the plural of that by which the hanger was followed."""
    return "ends of the held edge" if take.rig.hanger is None else "hanger markers"


def camera_of(take: Take) -> str:
    """Return the word for that which sees the hanger."""
    return "cameras" if take.rig.sensor is None else "sensor"


def means_silhouette(take: Take) -> bool:
    """Return whether marker paths count as points of a silhouette because nobody stated of what kind they are."""
    garment = take.garment
    return OF_MARKERS in take.notes and garment.points_are is None and garment.point_kind == "silhouette"

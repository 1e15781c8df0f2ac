"""One finding on a take: a fault that a new recording can correct."""

from __future__ import annotations

from dataclasses import dataclass

from formats.take import Take

SHORTEST_DIAGNOSED = 2.5  # s: a shorter take, of under five blocks, is not diagnosed: no statistic holds
FEWEST_SEEN = 20  # frames with the hanger, and sights of free points: too few for splines and statistics below
# Of the frames. Our choice: at 30 a second, 1.5 frames in a swing at 2 Hz. Half and double were not tried.
HARDLY_EVER = 0.1
OF_MARKERS = "markers"  # the note that only takes of marker trajectories have
HARDLY_MOVED = 0.03  # m, largest travel of a resting hanger: the synthetic world's gentlest motion travels 0.14 m


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A fault of a take that a new recording can correct.

    name: identifier for programs; is_grave: nothing can be fitted to the take
    """

    name: str
    words: str
    advice: str
    is_grave: bool = False

    def as_fact(self) -> dict[str, str | bool]:
        """Return the finding as plain values for JSON."""
        return {"name": self.name, "words": self.words, "advice": self.advice, "is_grave": self.is_grave}


def ends_of(take: Take) -> str:
    """Return the plural noun for the tracked ends of the hanger."""
    return "ends of the held edge" if take.rig.hanger is None else "hanger markers"


def camera_of(take: Take) -> str:
    """Return the noun for the device that sees the hanger."""
    return "cameras" if take.rig.sensor is None else "sensor"


def means_silhouette(take: Take) -> bool:
    """Return whether markers count as silhouette points because the garment file does not state their kind."""
    garment = take.garment
    return OF_MARKERS in take.notes and garment.points_are is None and garment.point_kind == "silhouette"

"""Choose the tracker of a hanger by its markers."""

from __future__ import annotations

from capture.errors import UntrackableError
from capture.hanger.colour_dots import DotTracker
from capture.hanger.fiducial_tracker import HangerTracker, MarkerTracker, hanger_and_sensor
from formats.arrays import Floats
from formats.rig import Rig


def hanger_tracker(rig: Rig, picks: Floats | None = None, *, is_sparing: bool = False) -> HangerTracker:
    """Return the tracker for a rig's hanger.

    - `picks` [px], (2, 2): its dots in the first frame
    - `is_sparing`: while no marker is in view, search only every second image for small markers

    Raises:
        UntrackableError: the rig lacks a section, or picks are given for a hanger without dots.
    """
    hanger, _ = hanger_and_sensor(rig)
    if hanger.marker == "dot":
        return DotTracker(rig, picks)
    if picks is not None:
        raise UntrackableError(
            "fiducial markers are found automatically",
            where="--pick",
            advice="leave it out, or describe dots in the rig",
        )
    return MarkerTracker(rig, is_sparing=is_sparing)

"""The last check of `hangtime sensor doctor`: are the hanger's two markers visible?"""

from __future__ import annotations

from capture.hanger.colour_dots import DotTracker
from capture.hanger.marker_detection import ids_in
from capture.hanger.seen_otherwise import seen_otherwise
from capture.hanger.seen_sizes import sizes_seen, wrong_size, wrong_unit
from firmware_host.depth_sensor import SensorFrame
from firmware_host.doctor.checks import Check, Examination, Finding, ok, problem, skipped
from formats.arrays import Bytes
from formats.rig import Hanger, Rig

USUAL_DICTIONARY = "DICT_4X4_50"  # of the rig that `hangtime sensor synthesise` writes
USUAL_IDS = (0, 1)  # of the same rig
USUAL_HANGER = Hanger(  # the lengths are of no use here
    dictionary=USUAL_DICTIONARY, ids=USUAL_IDS, marker_size_m=0.06, marker_distance_m=0.3,
    held_m=((-0.2, 0.09, 0.0), (0.2, 0.09, 0.0)),
)  # fmt: skip
# pictures searched for markers of other kinds. Our choice: each takes ten searches, and faults stay
SEARCHED_OTHERWISE = 3
LEAST_SEEN = 0.5  # share of the checked frames; tracking searches finer and bridges gaps


def markers_visible(examination: Examination) -> Finding:
    """Search some frames for both markers."""
    dictionary, ids = USUAL_DICTIONARY, USUAL_IDS
    if examination.rig is not None:
        hanger = examination.rig.hanger
        if hanger is None:
            return problem("the rig has no hanger section", "describe it as in docs/reference/file-formats.md")
        if hanger.marker == "dot":
            return _dots_visible(examination, examination.rig)
        dictionary, ids = hanger.dictionary, hanger.ids
    frames = [] if examination.sample is None else examination.sample.frames
    pictures = [frame.colour for frame in frames if frame.colour is not None]
    if not pictures:
        return skipped("there is no colour picture to look at")
    seen = [ids_in(picture, dictionary) for picture in pictures]
    shares = {number: sum(number in found for found in seen) / len(seen) for number in ids}
    text = f"{dictionary} " + ", ".join(
        f"marker {number} in {100 * share:.0f} %" for number, share in shares.items()
    ) + f" of {len(seen)} frames"  # fmt: skip
    if min(shares.values()) >= LEAST_SEEN:
        wrong = "" if examination.rig is None else _sizes_wrong(frames, examination.rig)
        return problem(f"{text}, of other sizes than the rig's", wrong) if wrong else ok(text)
    others = sorted(set().union(*seen) - set(ids))
    how = "" if others else _seen_otherwise(examination, pictures)
    advice = how or "hang the hanger 1.2 to 2.5 m before the sensor, markers towards it, in even light"
    if others:
        advice = f"markers {others} are there instead: give the rig that describes them with --rig"
    return problem(text, advice)


def _seen_otherwise(examination: Examination, pictures: list[Bytes]) -> str:
    """Return how both markers appear in one of the first pictures, such as mirrored, and the remedy; "" if not."""
    hanger = USUAL_HANGER if examination.rig is None or examination.rig.hanger is None else examination.rig.hanger
    is_turned = examination.sample is not None and examination.sample.info.is_turned
    told = (seen_otherwise(picture, hanger, is_turned=is_turned) for picture in pictures[:SEARCHED_OTHERWISE])
    return next(filter(None, told), "")


def _sizes_wrong(frames: list[SensorFrame], rig: Rig) -> str:
    """Return the rig's value, or the unit of depth, that contradicts the markers in the first frame that shows both."""
    for frame in frames:
        if frame.colour is not None and (unit := wrong_unit(frame.colour, frame.depth, rig)):
            return unit
        seen = None if frame.colour is None else sizes_seen(frame.colour, frame.depth, rig)
        if seen is not None and rig.hanger is not None and rig.sensor is not None:
            return wrong_size(rig.hanger, rig.sensor, seen)
    return ""


def _dots_visible(examination: Examination, rig: Rig) -> Finding:
    frames = [] if examination.sample is None else examination.sample.frames
    if rig.sensor is None:
        return problem("the rig has no sensor section", "describe it as in docs/reference/file-formats.md")
    size = rig.sensor.height, rig.sensor.width
    sights = [
        DotTracker(rig).track(frame.colour, frame.depth, frame.time_s)
        for frame in frames
        if frame.colour is not None and frame.depth.shape == size
    ]
    if not sights:
        return skipped("there is no colour picture of the rig's size to look at")
    share = sum(sight.is_found for sight in sights) / len(sights)
    text = f"both dots in {100 * share:.0f} % of {len(sights)} frames"
    if share >= LEAST_SEEN:
        return ok(text)
    advice = "hang it 1.2 to 2.5 m before the sensor in even light; name dot_colours in the rig, or record with --pick"
    return problem(text, advice)


CHECK = Check(name="markers", look=markers_visible, needs=("streams",), is_for_recordings=True)

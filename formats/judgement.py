"""Judge a finished or imported take: can a fitter use it? A recording can still be repeated then.

Every finding is a sentence and a next action. A grave one says that nothing can be fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formats.arrays import Booleans, Floats
from formats.garment import Garment
from formats.hanger import held_ends
from formats.missing import origin_of
from formats.plain_text import counted
from formats.take import LONGEST_GAP, Take
from formats.two_clocks import shows_hanger, shows_points

SHORTEST_DIAGNOSED = 2.5  # s: a shorter take is not diagnosed, see the reference of the diagnosis
FEWEST_HANGERS = 10  # frames with both markers; fewer are no recording of a hanger
HARDLY_EVER = 0.1  # of the frames
HARDLY_MOVED = 0.03  # m that the hanger goes to and fro at most: the synthetic world's gentlest motion goes 0.14 m
DISTANCE_OFF = 0.03  # of the markers' distance: an uncalibrated sensor's depth is off by 1 to 2 %
SMALLER, LARGER = 0.85, 1.10  # of a distance on the flat garment; the synthetic skirt's are 0.96 to 1.01 at rest
RIGHT_MOST = 95  # percentile of a distance over the take: cloth folds, which shortens it, and never stretches by 10 %
HANGS_WITHIN = 15.0  # degrees between gravity and the mean hang: the synthetic motions have below 1
MOST_NAMES = 5  # of points in one sentence
ENOUGH = 10  # frames that both points of a distance must be seen in


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


def judge(take: Take) -> tuple[Finding, ...]:
    """Return what a fitter would find wrong with a take, the grave findings first; nothing where all is well."""
    if len(take.time) < FEWEST_HANGERS:
        return (_too_short(f"the take has {counted(len(take.time), 'frame')}", is_grave=True),)
    has_hanger = np.asarray(np.isfinite(take.markers).all((1, 2)))
    frames = int(shows_hanger(take).sum())
    if has_hanger.sum() < max(FEWEST_HANGERS, HARDLY_EVER * frames):
        return (
            Finding(
                name="hanger_hardly_seen", is_grave=True,
                words=f"both {_ends(take)} were seen together in {has_hanger.sum()} of {counted(frames, 'frame')}",
                advice=f"turn both {_ends(take)} to the {_camera(take)} and record again",
            ),
        )  # fmt: skip
    found = [*_hanger_gaps(take, has_hanger), *_length(take, has_hanger), *_markers(take, has_hanger)]
    found += [*_motion(take, has_hanger), *_points(take), *_size(take), *_hang(take, has_hanger)]
    return tuple(sorted(found, key=lambda one: not one.is_grave))


def _ends(take: Take) -> str:
    """Return the plural of that by which the hanger was followed."""
    return "ends of the held edge" if take.rig.hanger is None else "hanger markers"


def _camera(take: Take) -> str:
    return "cameras" if take.rig.sensor is None else "sensor"


def _hanger_gaps(take: Take, has_hanger: Booleans) -> list[Finding]:
    times = take.time[has_hanger]
    steps = np.diff(times)
    if not len(steps) or steps.max() <= LONGEST_GAP:
        return []
    begins, count = times[int(np.argmax(steps))] - origin_of(take), int((steps > LONGEST_GAP).sum())
    others = f", in all {count} times for over {LONGEST_GAP:g} s" if count > 1 else ""
    spell = f"for {steps.max():.1f} s from {begins:.1f} s on{others}"
    return [
        Finding(
            name="hanger_lost", is_grave=True, words=f"the two {_ends(take)} were not seen together {spell}",
            advice=f"record again with both {_ends(take)} in view from beginning to end",
        )
    ]  # fmt: skip


def _length(take: Take, has_hanger: Booleans) -> list[Finding]:
    of_both = [take.time[shows(take)] for shows in (shows_points, shows_hanger)]
    seconds, seen = min(map(_span, of_both)), _span(take.time[has_hanger])
    if min(seconds, seen) >= SHORTEST_DIAGNOSED:
        return []
    if seconds < SHORTEST_DIAGNOSED:
        return [_too_short(f"the take lasts {_below(seconds)} s, and none below {SHORTEST_DIAGNOSED:g} s is diagnosed")]
    over = f"the two {_ends(take)} were seen together over {_below(seen)} s"
    return [_too_short(f"{over}, and no motion below {SHORTEST_DIAGNOSED:g} s is diagnosed")]


def _span(times: Floats) -> float:
    """Return the time from the first to the last [s]."""
    return float(np.ptp(times)) if len(times) else 0.0


def _below(seconds: float) -> str:
    """Word a time so that it stays below the shortest one."""
    text = f"{seconds:.1f}"
    return text if float(text) < SHORTEST_DIAGNOSED else f"{np.floor(100 * seconds) / 100:.2f}"


def _too_short(words: str, *, is_grave: bool = False) -> Finding:
    advice = "swing for five seconds or more, then hold still until the cloth hangs"
    return Finding(name="too_short", words=words, advice=advice, is_grave=is_grave)


def _markers(take: Take, has_hanger: Booleans) -> list[Finding]:
    if take.rig.hanger is None:
        return []
    apart = take.markers[has_hanger, 1] - take.markers[has_hanger, 0]
    found = []
    if np.median(apart[:, 0]) < 0:
        found.append(
            Finding(
                name="markers_swapped", is_grave=True,
                words="the hanger's first marker is on the right as the sensor sees it, not on the left",
                advice="turn the hanger's front to the sensor, or exchange the two markers' numbers in the rig",
            )
        )  # fmt: skip
    told, measured = take.rig.hanger.marker_distance_m, float(np.median(np.linalg.norm(apart, axis=1)))
    if abs(measured / told - 1) > DISTANCE_OFF:
        found.append(
            Finding(
                name="markers_wrong_distance",
                words=f"the markers are {1e3 * measured:.0f} mm apart as the sensor sees them, "
                f"{1e3 * told:.0f} mm as the rig says",
                advice="measure marker_distance_m again, centre to centre, or run `hangtime calibrate`",
            )
        )
    return found


def _motion(take: Take, has_hanger: Booleans) -> list[Finding]:
    low, high = np.percentile(take.markers[has_hanger], [1, 99], axis=0)  # noise of single frames is no motion
    reach = float(np.linalg.norm(high - low, axis=1).max())  # of either end: a twist leaves the middle where it is
    if reach >= HARDLY_MOVED:
        return []
    return [
        Finding(
            name="hardly_moved",
            words=f"the hanger moved by {1e3 * reach:.0f} mm at most, which tells next to nothing of the cloth",
            advice="swing it to and fro by the width of a hand or more",
        )
    ]  # fmt: skip


def _points(take: Take) -> list[Finding]:
    names = take.garment.point_names
    never = [name for name, valid in zip(names, np.asarray(take.points_valid.any(0)), strict=True) if not valid]
    if not never:
        return []
    if set(names) - set(_held_points(take)) <= set(never):
        which = "of the garment" if len(never) == len(names) else "below the held edge"
        return [
            Finding(
                name="garment_never_seen", words=f"no point {which} was ever seen", is_grave=True,
                advice="let it hang free below the hanger, 8 cm or more before any wall",
            )
        ]  # fmt: skip
    advice = "bring the whole garment into view, with nothing before it"
    if take.rig.hanger is not None and set(_held_points(take)) <= set(never):
        (left, *_), (right, *_) = take.rig.hanger.held_m
        advice = f"measure hanger.held_m again: it says that the held edge is {100 * (right - left):.0f} cm wide"
    return [
        Finding(
            name="points_never_seen",
            words=f"{_names(never)} {'was' if len(never) == 1 else 'were'} never seen", advice=advice,
        )
    ]  # fmt: skip


def _names(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more


def _held_points(take: Take) -> list[str]:
    """Return the names of the points at the ends of the held edge; both or none."""
    ends = take.garment.outline_m[:2]
    names = [
        point.name
        for end in ends
        for point in take.garment.points
        if np.linalg.norm(np.subtract(point.at_m, end)) < 1e-6
    ]
    return names if len(names) == len(ends) else ["none"]


def _hang(take: Take, has_hanger: Booleans) -> list[Finding]:
    """Compare gravity with the mean direction from the held edge to the points: swings to both sides cancel."""
    if take.rig.hanger is None or take.rig.sensor is None:
        return []
    flat = np.array([point.at_m for point in take.garment.points])
    free = flat[:, 1] < min(corner[1] for corner in take.garment.outline_m[:2]) - 0.1  # m: held points hang nowhere
    shown = has_hanger & np.asarray(take.points_valid[:, free].all(1)) if free.any() else has_hanger & False
    if shown.sum() < ENOUGH:
        return []
    held = held_ends(take.markers[shown], take.rig).mean(1)
    hang = (take.points[shown][:, free].mean(1) - held).mean(0)
    gravity = np.array(take.rig.gravity)
    angle = float(
        np.degrees(np.arccos(np.clip(hang @ gravity / np.linalg.norm(hang) / np.linalg.norm(gravity), -1, 1)))
    )
    if angle <= HANGS_WITHIN:
        return []
    down = ", ".join(f"{round(part, 2) + 0.0:.2f}" for part in hang / np.linalg.norm(hang))
    return [
        Finding(
            name="gravity_off", words=f"the garment hangs {angle:.0f} degrees off the rig's gravity, along [{down}]",
            advice="measure gravity with `hangtime calibrate`; x is to the right, y down, z away from the sensor",
        )
    ]  # fmt: skip


def _size(take: Take) -> list[Finding]:
    """Compare the largest distances between points with those on the flat garment.

    Cloth that hangs is nearly as long as on the table, and in a swing it is never longer by much.
    """
    flat = np.array([point.at_m for point in take.garment.points])
    worst: tuple[float, float, str, str] | None = None
    for first, second in _pairs(flat, take.garment):
        both = take.points_valid[:, first] & take.points_valid[:, second]
        if both.sum() < ENOUGH:
            continue
        apart = np.linalg.norm(take.points[both, first] - take.points[both, second], axis=1)
        told, seen = float(np.linalg.norm(flat[first] - flat[second])), float(np.percentile(apart, RIGHT_MOST))
        if worst is None or abs(seen / told - 1) > abs(worst[0] / worst[1] - 1):
            worst = seen, told, take.garment.point_names[first], take.garment.point_names[second]
    if worst is None or SMALLER <= worst[0] / worst[1] <= LARGER:
        return []
    seen, told, one, other = worst
    size = "smaller" if seen < told else "larger"
    return [
        Finding(
            name=f"garment_{size}",
            words=f"the garment is {size} than described: {one} and {other} are at most {100 * seen:.0f} cm apart, "
            f"{100 * told:.0f} cm in its file",
            advice="measure it again, or choose the file of the garment that hangs there",
        )
    ]


def _pairs(flat: Floats, garment: Garment) -> list[tuple[int, int]]:
    """Return the pairs of points that are neighbours along the outline: straight cloth lies between them.

    Between two held corners it may sag.
    """
    outline = garment.outline_m
    corners = [int(np.argmin(np.linalg.norm(flat - corner, axis=1))) for corner in outline]
    if any(np.linalg.norm(flat[at] - corner) >= 1e-6 for at, corner in zip(corners, outline, strict=True)):
        return []
    pairs = list(zip(corners, corners[1:] + corners[:1], strict=True))
    return pairs[1:] if garment.held == "corners" else pairs

"""Judge whether a recorded or imported take can be fitted, while the recording can still be repeated.

Every finding is a sentence and a next action. A grave finding means that nothing can be fitted.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Booleans, Floats
from formats.findings import (
    FEWEST_SEEN,
    HARDLY_EVER,
    HARDLY_MOVED,
    SHORTEST_DIAGNOSED,
    Finding,
    camera_of,
    ends_of,
)
from formats.held_row import held_row_findings
from formats.impossible_points import impossible_findings, without_impossible
from formats.judged_cloth import cloth_findings
from formats.missing import origin_of
from formats.plain_text import counted
from formats.rig_bodies import body_findings
from formats.sights import (
    SETTLING,
    Sights,
    exchanged,
    first_jump,
    fitted_sights,
    reach,
    shown_halves,
    sights_of,
    too_few_halves,
)
from formats.take import LONGEST_GAP, Take
from formats.two_clocks import shows_hanger, shows_points

# Frames with both markers; a recording with fewer is not kept; our choice: a third of a second at 30 a second.
FEWEST_HANGERS = 10
FEW_SIGHTS = 2 * FEWEST_SEEN  # of points: without the impossible ones, these may be too few for a fit
SWAPPED = "markers_swapped"  # the finding that invalidates the findings on the garment
DISTANCE_OFF = 0.03  # of the markers' distance: an uncalibrated sensor's depth is off by 1 to 2 %


def judge(take: Take) -> tuple[Finding, ...]:
    """Return the faults that prevent or weaken a fit of a take, the grave ones first; none for a good take."""
    if len(take.time) < FEWEST_HANGERS:
        return (_too_short(_few_frames(take), is_grave=True),)
    sights = sights_of(take)
    seen, frames = int(sights.held.sum()), int(shows_hanger(take).sum())
    found = _hardly_seen(take, seen, frames)
    if found and seen < FEWEST_SEEN:
        return tuple(found)
    markers = _markers(take, sights.held)
    is_swapped = any(one.name == SWAPPED for one in markers)
    found += [*_hanger_gaps(take, sights), *_length(take, sights, with_cloth=not is_swapped), *markers]
    found += [*_path(take, sights.held), *_motion(take, sights.held)]
    if not is_swapped:  # else garment and held edge were sought on the wrong side of the bar
        found += [*body_findings(take, sights), *_cloth(take, sights)]
        found += [*held_row_findings(take, sights), *impossible_findings(take, sights)]
    # A longer take would have the other grave faults as well.
    return tuple(sorted(found, key=lambda one: (not one.is_grave, one.is_grave and one.name == "too_short")))


def _few_frames(take: Take) -> str:
    return f"the take has {counted(len(take.time), 'frame')}, and a fit needs {FEWEST_SEEN}"


def _cloth(take: Take, sights: Sights) -> list[Finding]:
    """Judge the garment; without impossible sightings, which take long to find, where they decide what a fit does."""
    found = cloth_findings(take, sights)
    if fitted_sights(take, sights) < FEW_SIGHTS or any(one.name == "point_far_off" for one in found):
        possible = without_impossible(take, sights)
        return found if possible is take else cloth_findings(possible, sights)
    return found


def _hardly_seen(take: Take, seen: int, frames: int) -> list[Finding]:
    """Report a hanger that was seen in few of the frames in which it could be seen."""
    if seen >= max(FEWEST_HANGERS, HARDLY_EVER * frames):
        return []
    words = f"both {ends_of(take)} were seen together in {seen} of {counted(frames, 'frame')}"
    advice = f"turn both {ends_of(take)} to the {camera_of(take)} and record again"
    return [Finding(name="hanger_hardly_seen", words=words, advice=advice, is_grave=seen < FEWEST_SEEN)]


def _hanger_gaps(take: Take, sights: Sights) -> list[Finding]:
    times = take.time[sights.held]
    steps = np.diff(times)
    if not len(steps) or steps.max() <= LONGEST_GAP:
        return []
    begins, count = times[int(np.argmax(steps))] - origin_of(take), int((steps > LONGEST_GAP).sum())
    others = f", in all {count} times for over {LONGEST_GAP:g} s" if count > 1 else ""
    words = f"the two {ends_of(take)} were not seen together for {steps.max():.1f} s from {begins:.1f} s on{others}"
    is_grave = fitted_sights(take, sights) < FEWEST_SEEN <= int(take.points_valid[:, sights.free].sum())
    if not is_grave:
        lack = _lack_of_halves(take, sights)
        words += f"; a fit leaves out that time and {SETTLING:g} s after it" + f"; {lack}" * bool(lack)
        is_grave = bool(lack)
    advice = f"record again with both {ends_of(take)} in view from beginning to end"
    return [Finding(name="hanger_lost", is_grave=is_grave, words=words, advice=advice)]


def _length(take: Take, sights: Sights, *, with_cloth: bool) -> list[Finding]:
    of_both = [take.time[shows(take)] for shows in (shows_points, shows_hanger)]
    seconds, seen = min(map(_span, of_both)), _span(take.time[sights.held])
    cloth = take.time[sights.within & sights.cloth]
    together = _span(cloth) if with_cloth and len(cloth) >= FEWEST_SEEN else np.inf  # else other findings tell that
    count = int(sights.held.sum())
    if count < FEWEST_SEEN:
        words = f"the two {ends_of(take)} were seen together in {count} frames, and a fit needs {FEWEST_SEEN}"
        return [_too_short(_few_frames(take) if len(take.time) < FEWEST_SEEN else words, is_grave=True)]
    lack = _lack_of_halves(take, sights)
    if lack and np.diff(take.time[sights.held]).max() <= LONGEST_GAP:  # else the gaps are the cause
        return [_too_short(f"the take is too short: {lack}", is_grave=True)]
    if min(seconds, seen, together) >= SHORTEST_DIAGNOSED:
        return []
    if seconds < SHORTEST_DIAGNOSED:
        return [_too_short(f"the take lasts {_below(seconds)} s, and none below {SHORTEST_DIAGNOSED:g} s is diagnosed")]
    none = f"and no motion below {SHORTEST_DIAGNOSED:g} s is diagnosed"
    if seen < SHORTEST_DIAGNOSED:
        over = f"the two {ends_of(take)} were seen together over {_below(seen)} s"
        return [_too_short(f"{over}, {none}")]
    return [_too_short(f"garment and hanger were seen together over {_below(together)} s, {none}")]


def _lack_of_halves(take: Take, sights: Sights) -> str:
    """Return why the motion is too short for a fit, '' if it is not, or if other findings tell the cause."""
    if take.missing or fitted_sights(take, sights) < FEWEST_SEEN:
        return ""
    return too_few_halves(shown_halves(take, sights))


def _span(times: Floats) -> float:
    """Return the time from the first to the last time [s]."""
    return float(np.ptp(times)) if len(times) else 0.0


def _below(seconds: float) -> str:
    """Format a duration so that rounding never lifts it to the shortest one."""
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
                name=SWAPPED, is_grave=True,
                words="the hanger's first marker is on the right as the sensor sees it, not on the left",
                advice="turn the hanger's front to the sensor, or exchange the two markers' numbers in the rig",
            )
        )  # fmt: skip
    stated, measured = take.rig.hanger.marker_distance_m, float(np.median(np.linalg.norm(apart, axis=1)))
    if abs(measured / stated - 1) > DISTANCE_OFF:
        found.append(
            Finding(
                name="markers_wrong_distance",
                words=f"the markers are {1e3 * measured:.0f} mm apart as the sensor sees them, "
                f"{1e3 * stated:.0f} mm as the rig says",
                advice="measure marker_distance_m again, centre to centre, or run `hangtime calibrate`",
            )
        )
    return found


def _path(take: Take, has_hanger: Booleans) -> list[Finding]:
    """Report held ends that are exchanged in some frames, and other jumps."""
    time, ends = take.time[has_hanger], take.held[has_hanger]
    found, swapped = [], exchanged(time, ends)
    if swapped.any():
        begins = float(time[int(np.argmax(swapped))]) - origin_of(take)
        frames = f"{swapped.sum()} of {counted(len(time), 'frame')}"
        found.append(
            Finding(
                name="ends_exchanged", is_grave=True,
                words=f"left and right {_end(take)} are exchanged in {frames}, first at {begins:.2f} s",
                advice="check which is which there, then correct the labels or record again",
            )
        )  # fmt: skip
    jump = first_jump(time, np.where(swapped[:, None, None], ends[:, ::-1], ends))
    if jump is not None:
        found.append(
            Finding(
                name="hanger_jumps", is_grave=True,
                words=f"the hanger jumps at {time[jump] - origin_of(take):.2f} s, as no hand moves it",
                advice=f"check the {ends_of(take)} there, then record again",
            )
        )  # fmt: skip
    return found


def _end(take: Take) -> str:
    return "end of the held edge" if take.rig.hanger is None else "hanger marker"


def _motion(take: Take, has_hanger: Booleans) -> list[Finding]:
    moved = reach(take.markers[has_hanger])
    if moved >= HARDLY_MOVED:
        return []
    return [
        Finding(
            name="hardly_moved",
            words=f"the hanger moved by {1e3 * moved:.0f} mm at most, which shows next to nothing of the cloth",
            advice="swing it to and fro by the width of a hand or more",
        )
    ]  # fmt: skip

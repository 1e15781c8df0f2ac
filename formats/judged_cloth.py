"""Judge the garment of a take: seen together with the hanger, in motion, and consistent with its description."""

from __future__ import annotations

import numpy as np

from formats.arrays import Booleans, Floats
from formats.findings import FEWEST_SEEN, HARDLY_EVER, HARDLY_MOVED, SHORTEST_DIAGNOSED, Finding, means_silhouette
from formats.garment import Garment
from formats.hanger import held_ends
from formats.missing import origin_of
from formats.nature import NORMAL_90
from formats.plain_text import counted, first_few
from formats.sights import SAME_PLACE, Sights, away_from_held, fitted_sights, longest_without_cloth, standing
from formats.take import Take
from formats.two_clocks import shows_points

SHORTEST_EDGE = 0.25  # of the flat held edge: held ends closer than that mean a wrong unit, not slack
MOST_STRETCHED = 1.25  # of a flat distance, more than apparel stretches under its own weight
MEASURED_APART = 0.06  # m more: held ends and points are measured by different means, 26 mm apart on real takes
# Of a distance on the flat garment; the synthetic skirt's are 0.96 to 1.01 at rest. Our choice: folds shorten a
# distance by more than cloth stretches. Half and double of either difference from 1 were not tried.
SMALLER, LARGER = 0.85, 1.10
RIGHT_MOST = 95  # percentile of a distance over the take: folds shorten it, and cloth never stretches by 10 %
HANGS_WITHIN = 15.0  # degrees between gravity and the mean hang: below 1 in the synthetic motions
MOST_NAMES = 5  # of points in one sentence; our choice: more would hide the sentence's advice
ENOUGH = 10  # frames that both points of a distance must be seen in; our choice: half and double were not tried


def cloth_findings(take: Take, sights: Sights) -> list[Finding]:
    """Return the findings on the garment of a take in which the hanger was seen."""
    found = [*_points(take, sights), *_cloth(take, sights), *_standing(take, sights)]
    return [*found, *_far_off(take, sights), *_size(take), *_hang(take, sights.held), *_kind(take)]


def _kind(take: Take) -> list[Finding]:
    if not means_silhouette(take):
        return []
    return [
        Finding(
            name="points_of_no_kind",
            words="its points count as silhouette points, as its garment file states no points_are",
            advice='in format = "hangtime-garment/2" state points_are = "material" for markers, and import again',
        )
    ]


def _points(take: Take, sights: Sights) -> list[Finding]:
    names = take.garment.point_names
    never = [name for name, valid in zip(names, np.asarray(take.points_valid.any(0)), strict=True) if not valid]
    if not never:
        return []
    if not sights.cloth.any():
        which = "of the garment" if len(never) == len(names) else "below the held edge"
        return [
            Finding(
                name="garment_never_seen", words=f"no point {which} was ever seen",
                is_grave=fitted_sights(take, sights) < FEWEST_SEEN,
                advice=_held_above(take) or "let it hang free below the hanger, 8 cm or more before any wall",
            )
        ]  # fmt: skip
    advice = "bring the whole garment into view, with nothing before it"
    if take.rig.hanger is not None and set(_held_points(take)) <= set(never):
        (left, *_), (right, *_) = take.rig.hanger.held_m
        advice = f"measure hanger.held_m again: by its ends the held edge is {100 * (right - left):.0f} cm wide"
        advice = _held_above(take) or advice
    return [
        Finding(
            name="points_never_seen",
            words=f"{_names(never)} {'was' if len(never) == 1 else 'were'} never seen", advice=advice,
        )
    ]  # fmt: skip


def _held_above(take: Take) -> str:
    """Return what to correct in a rig whose held ends are above its markers, where a cloth below is not looked for."""
    if take.rig.hanger is None:
        return ""
    highest = max(end[1] for end in take.rig.hanger.held_m)
    if highest >= 0:
        return ""
    return (
        f"the rig's hanger.held_m puts the held edge {-1e3 * highest:.0f} mm above the markers, as y points down; "
        "drop the minus signs if it hangs below"
    )


def _names(names: list[str]) -> str:
    return first_few(names, most=MOST_NAMES)


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


def _cloth(take: Take, sights: Sights) -> list[Finding]:
    """Report how rarely the garment was seen while the hanger's path is known, and the longest time without it."""
    if not sights.cloth.any():  # `_points` reports it
        return []
    seen, frames = sights.is_known & sights.cloth, int(shows_points(take).sum())
    is_grave = fitted_sights(take, sights) < FEWEST_SEEN
    if is_grave or seen.sum() < HARDLY_EVER * frames:
        words = f"points below the held edge were seen in {seen.sum()} of {counted(frames, 'frame')}"
        if sights.cloth.sum() > seen.sum():
            words = (
                f"points below the held edge were seen in {sights.cloth.sum()} of {counted(frames, 'frame')}, and in "
            )
            words += f"{seen.sum()} of them while the hanger's path is known"
        advice = "bring garment and hanger into view together, from beginning to end, and record again"
        return [Finding(name="garment_hardly_seen", words=words, advice=advice, is_grave=is_grave)]
    found, names = [], take.garment.point_names
    begin, end = longest_without_cloth(take, sights)
    if end - begin > SHORTEST_DIAGNOSED:
        lost = f"no point below the held edge was seen for {end - begin:.1f} s from {begin - origin_of(take):.1f} s on"
        advice = "record again with the whole garment in view from beginning to end"
        found.append(Finding(name="garment_lost", words=lost, advice=advice))
    counts = take.points_valid[sights.is_known].sum(0)
    rare = np.flatnonzero((counts < HARDLY_EVER * sights.is_known.sum()) & take.points_valid.any(0))
    if len(rare):
        most = f"{counts[rare].max()} of {counted(int(sights.is_known.sum()), 'frame')}"
        words = f"{_names([names[k] for k in rare])} {'was' if len(rare) == 1 else 'were'} seen in {most}"
        words += " at most" * (len(rare) > 1)
        advice = "bring the whole garment into view, with nothing before it"
        found.append(Finding(name="points_hardly_seen", words=words, advice=advice))
    return found


def _standing(take: Take, sights: Sights) -> list[Finding]:
    """Report points that kept their position exactly while the hanger moved, as a failing tracker repeats it."""
    found = standing(take, sights, HARDLY_MOVED)
    if not found:
        return []
    _, begin, end = max(found, key=lambda spell: spell[2] - spell[1])
    which = [take.garment.point_names[point] for point, *_ in found]
    kept = "its exact position" if len(which) == 1 else "their exact positions"
    words = f"{_names(which)} kept {kept} while the hanger moved, "
    words += f"for {end - begin:.1f} s from {begin - origin_of(take):.1f} s on" + " at most" * (len(which) > 1)
    advice = "the tracker repeated an old position: leave those positions out, or record again"
    return [Finding(name="points_stand", words=words, advice=advice)]


def _far_off(take: Take, sights: Sights) -> list[Finding]:
    """Compare each point's distance from the held ends with the distance on the flat garment, as a fit does."""
    outline = np.asarray(take.garment.outline_m, float)
    ends, edge = take.held[sights.held], float(np.linalg.norm(outline[1] - outline[0]))
    apart = float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))
    if not SHORTEST_EDGE * edge <= apart <= MOST_STRETCHED * edge + MEASURED_APART:
        words = f"the held ends are {1e3 * apart:.0f} mm apart, the garment's held edge is {1e3 * edge:.0f} mm long"
        advice = "check the garment's outline, which points are its held ends, and their unit"
        return [Finding(name="held_ends_apart", words=words, advice=advice, is_grave=True)]
    away = away_from_held(take, sights)
    flat = np.array([[np.linalg.norm(np.subtract(p.at_m, end)) for end in outline[:2]] for p in take.garment.points])
    beyond = np.nan_to_num(away - MOST_STRETCHED * flat - MEASURED_APART, nan=-1.0)
    point, end = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    if beyond[point, end] <= 0:
        return []
    words = f"{take.garment.point_names[point]} is {1e3 * away[point, end]:.0f} mm from the {('left', 'right')[end]} "
    words += f"held end in the median, {1e3 * flat[point, end]:.0f} mm on the flat garment"
    advice = "check the points' names, which held end is the left one, and that points and hanger are of one recording"
    if take.rig.hanger is not None:
        advice = "fix the markers in line with the held edge and measure hanger.held_m again; check the garment's file"
    return [Finding(name="point_far_off", words=words, advice=advice, is_grave=True)]


def _size(take: Take) -> list[Finding]:
    """Compare the largest distances between points with those on the flat garment.

    Hanging cloth is nearly as long as on the table, and in a swing it is hardly longer. Where only the width is too
    small, the held edge folds, and the cloth below it may fold too.
    """
    sizes = [_apart(take, pair) for pair in _pairs(take.garment)]
    sides = [one for one in (*sizes[1:2], *sizes[-1:]) if one]
    edge = float(np.linalg.norm(np.subtract(take.garment.outline_m[0], take.garment.outline_m[1])))
    width = min([_held_width(take), *(one[0] for one in sizes[:1] if one)])
    is_narrow = width < SMALLER * edge and all(seen >= SMALLER * flat for seen, flat, *_ in sides)
    if is_narrow and take.garment.held == "edge":
        return [_folded(width, edge)]
    compared = [one for one in (sizes if take.garment.held == "edge" else sizes[1:]) if one]
    compared = sides if is_narrow else compared  # two corners may be held near each other: the whole width folds
    if not compared:
        return []
    seen, flat, first, second = max(compared, key=lambda size: abs(size[0] / size[1] - 1))
    if SMALLER <= seen / flat <= LARGER:
        return []
    size = "smaller" if seen < flat else "larger"
    return [
        Finding(
            name=f"garment_{size}",
            words=f"the garment is {size} than described: {first} and {second} are at most {100 * seen:.0f} cm apart, "
            f"{100 * flat:.0f} cm in its file",
            advice="measure it again, or choose the file of the garment that hangs there",
        )
    ]


def _folded(width: float, edge: float) -> Finding:
    return Finding(
        name="held_edge_folds",
        words=f"the held edge folds or sags: its ends are at most {100 * width:.0f} cm apart, {100 * edge:.0f} cm in "
        "the garment's file",
        advice='hold the edge taut, or give held = "corners" where two corners alone are held',
    )


def _held_width(take: Take) -> float:
    ends = take.held[np.isfinite(take.held).all((1, 2))]
    return float(np.percentile(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), RIGHT_MOST))


def _apart(take: Take, pair: tuple[int, int]) -> tuple[float, float, str, str] | None:
    """Return two points' largest distance and flat distance [m], and their names; None if never seen together."""
    first, second = (take.garment.points[k] for k in pair)
    both = take.points_valid[:, pair].all(1)
    if both.sum() < ENOUGH:
        return None
    ways = take.points[both, pair[0]] - take.points[both, pair[1]]
    apart = np.linalg.norm(ways, axis=1)
    flat = float(np.linalg.norm(np.subtract(first.at_m, second.at_m)))
    seen = float(np.percentile(apart, RIGHT_MOST))
    if seen > flat:
        seen = max(flat, _without_noise(ways, take.points_sd[both][:, pair]))
    return seen, flat, first.name, second.name


def _without_noise(ways: Floats, deviations: Floats) -> float:
    """Return the largest distance of two points [m], corrected for the noise that their standard deviations state.

    - `ways` [m], (frames, 3): vectors from one point to the other; `deviations` [m], (frames, 2, 3)

    Noise of deviation s along the vector lifts the percentile 95 of a constant length d to d + 1.645 s. It does not
    change the median, so a length that is too large in the median is no noise. Noise of variance v across the vector
    makes d the root of d^2 + v in the mean square. So the length is

        root of  max(median, percentile 95 - 1.645 s)^2 - v
    """
    variances = np.square(np.where(np.isfinite(deviations), deviations, 0.0)).sum(1)
    apart = np.linalg.norm(ways, axis=1)
    along = float((variances * (ways / np.maximum(apart, SAME_PLACE)[:, None]) ** 2).sum(1).mean())
    across = float(variances.sum(1).mean()) - along
    most = max(np.median(apart), np.percentile(apart, RIGHT_MOST) - NORMAL_90 * np.sqrt(along))
    return float(np.sqrt(max(most**2 - across, 0.0)))


def _pairs(garment: Garment) -> list[tuple[int, int]]:
    """Return the pairs of neighbouring points along the outline, the held ends first; none if a corner is not tracked.

    The cloth between them is straight. Only between two held corners may it sag.
    """
    flat = np.array([point.at_m for point in garment.points])
    corners = [int(np.argmin(np.linalg.norm(flat - corner, axis=1))) for corner in garment.outline_m]
    if any(np.linalg.norm(flat[at] - corner) >= 1e-6 for at, corner in zip(corners, garment.outline_m, strict=True)):
        return []
    return list(zip(corners, corners[1:] + corners[:1], strict=True))


def _hang(take: Take, has_hanger: Booleans) -> list[Finding]:
    """Compare gravity with the mean direction from the held edge to the points, in which opposite swings cancel."""
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

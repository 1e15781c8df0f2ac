"""Find points where their cloth cannot be: a marker that jumps, or two markers with exchanged labels.

Cloth hardly stretches. So two points are at most as far apart as along the flat cloth. The bound adds allowances for
stretch, glue and noise of deviation s per axis:

    |x_i - x_j| <= 1.25 d_ij + 5 mm + 6 sqrt(s_i^2 + s_j^2)

In a frame that breaks this rule, one point is left out: the point with the largest excess over d_ij, summed over all
others. This repeats until the rule holds. Of two points alone, both are left out. Exchanged markers, a grid's pitch h
apart, are 2 h from their outer neighbours. The rule finds them for s below (0.75 h - 5 mm) / 8.5.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.figures import beside
from formats.findings import Finding
from formats.judged_cloth import MOST_STRETCHED
from formats.sights import Sights, spread
from formats.take import Take

# m, distances of both markers' centres from their points on the cloth. Our choice: on a grid of 20 mm the rule above
# finds exchanged markers with noise below 1.2 mm. At half the limit is 1.5 mm, at twice 0.6 mm.
GLUE = 5e-3
# Of both points' noise. Our choice: normal noise exceeds it once in 10^9 distances, and half once in 740. At twice, the
# limit of noise above is half as high.
DEVIATIONS = 6.0
# pairs of points computed at once, over several frames. Our choice: bounds memory to 8 MB an array, and the result is
# the same.
PAIRS_AT_ONCE = 1 << 20
# Of a take's sightings; more mean another marker set. Our choice: 1 of 20 markers for the whole take. Half and double
# were not tried.
MOST_LEFT_OUT = 0.05
PAIRS_LOOKED_AT = 1 << 20  # pairs sampled by a judgement, in frames spread over the take: 0.2 s of computing at most
BEYOND_REACH = "are further from the others than the cloth reaches"
CHECK_MARKERS = "check the markers' names and the tracker"


def find_impossible(points: Floats, seen: Booleans, sd: Floats, places: Floats) -> Booleans:
    """Return which sightings are too far from others in the same frame, (frames, points).

    points and their standard deviations sd [m], (frames, points, 3); seen, (frames, points); places: positions on the
    flat cloth [m], (points, 2)
    """
    flat = np.linalg.norm(places[:, None] - places, axis=2)
    found = np.zeros(seen.shape, bool)
    each = max(PAIRS_AT_ONCE // flat.size, 1)
    for begin in range(0, len(points), each):
        some = begin + _suspected(points[begin : begin + each], flat)
        at, noise = points[some], np.sqrt(np.mean(sd[some] ** 2, axis=2))
        apart = np.linalg.norm(at[:, :, None] - at[:, None], axis=3)
        too_far = apart > MOST_STRETCHED * flat + GLUE + DEVIATIONS * np.hypot(noise[:, :, None], noise[:, None])
        too_far &= seen[some, :, None] & seen[some, None]
        for k in np.flatnonzero(too_far.any((1, 2))):
            beyond = np.where(seen[some[k]] & seen[some[k], :, None], apart[k] - flat, 0.0)
            found[some[k]] = _left_out(too_far[k], np.maximum(beyond, 0.0))
    return found


def _suspected(points: Floats, flat: Floats) -> Integers:
    """Return the frames that could break the rule without noise, found quickly by a matrix product."""
    square = (points**2).sum(2)
    apart = square[:, :, None] + square[:, None] - 2 * np.matmul(points, points.transpose(0, 2, 1))
    return np.flatnonzero((apart > (MOST_STRETCHED * flat + GLUE) ** 2).any((1, 2)))


def _left_out(too_far: Booleans, beyond: Floats) -> Booleans:
    """Return which points of a frame are left out, (points,), one after the other, until no pair breaks the rule.

    - `too_far`: pairs that break the rule, (points, points); emptied
    - `beyond` [m], (points, points): excess of each distance over the distance along the cloth; emptied
    """
    found = np.zeros(len(too_far), bool)
    while too_far.any():
        whole = np.where(too_far.any(1), beyond.sum(1), 0.0)
        worst = whole == whole.max()
        found |= worst
        for of_pairs in (too_far, beyond):
            of_pairs[worst], of_pairs[:, worst] = 0, 0
    return found


def without_impossible(take: Take, sights: Sights) -> Take:
    """Return a take without the sightings that a fit leaves out, or the same take where there are none."""
    frames, places = np.flatnonzero(sights.within), np.array([point.at_m for point in take.garment.points])
    seen = take.points_valid[frames]
    impossible = find_impossible(take.points[frames], seen, take.points_sd[frames], places)
    if not 0 < impossible.sum() <= MOST_LEFT_OUT * seen.sum():
        return take
    valid = take.points_valid.copy()
    valid[frames] &= ~impossible
    return replace(take, points_valid=valid)


def impossible_findings(take: Take, sights: Sights) -> list[Finding]:
    """Return a finding where a take has more impossible sightings than a fit leaves out, else none."""
    frames, places = np.flatnonzero(sights.within), np.array([point.at_m for point in take.garment.points])
    frames = spread(frames, max(PAIRS_LOOKED_AT // len(places) ** 2, 1))
    seen = take.points_valid[frames]
    impossible = find_impossible(take.points[frames], seen, take.points_sd[frames], places)
    share = float(impossible.sum() / max(seen.sum(), 1))
    if share <= MOST_LEFT_OUT:
        return []
    words = f"{100 * share:.2g} % of the sightings of points {BEYOND_REACH}"
    return [Finding(name="points_impossible", words=words, advice=CHECK_MARKERS)]


def describe_impossible(share: float) -> str:
    """Return the meaning of a share of impossible sightings in words, and the next step."""
    if share == 0.0:
        return "No point is further from the others than the cloth reaches."
    seen, most = beside(100 * share, 100 * MOST_LEFT_OUT)
    is_few = share <= MOST_LEFT_OUT
    found = (
        f"{f'{100 * share:.2g}' if is_few else seen} % of a take's sightings of points {BEYOND_REACH}: markers that "
    )
    found += "jump or are taken for each other."
    if is_few:
        return f"{found} These positions are left out."
    return f"{found} At most {most} % may be: {CHECK_MARKERS}."

"""Classify tracked points as material or sliding, from the common change of lengths between neighbours.

Cloth hardly stretches along its threads. Neighbouring material points keep their distance, except across folds, which
shorten some pairs and not others. A grid that is laid evenly over a silhouette stretches and shrinks as a whole with
the visible cloth. With the pairs p of neighbours down the cloth, or along the held edge,

    c(t) = median_p |x_p1 - x_p2| / d_p,   change^2 = (1.4826 MAD_t c)^2 - noise^2,   noise^2 = 3.14 s^2 / (d^2 P)

change is the larger of the two directions; noise is the deviation of the median of P pairs with s of white noise.
Markers on simulated swatches, twelve blind cases and three fabrics of motion capture, change by 0.1 to 0.9 %.
Re-gridded silhouettes of sixteen real takes (github Alados5/tfm_matlab) change by 2.2 to 6.5 %. A change between these
ranges is inconclusive. Source: the variance of a median of normal numbers, pi / 2 of the mean's; M. G. Kendall & A.
Stuart, "The Advanced Theory of Statistics" 1 (1977), section 10.10.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from fit.recordings.recording import Recording
from formats.arrays import Booleans, Floats, Integers
from formats.findings import FEWEST_SEEN
from formats.garment import Garment
from formats.plain_text import shortened

LEAST_SLIDING = 0.016  # of the flat length; silhouettes change by 0.022 and more
STAYS = 0.010  # of the flat length; material points change by 0.009 at most
FEWEST_PAIRS = 12  # pairs in a direction: fewer may fold together
NEIGHBOUR_SHARE = 0.25  # of the cloth's extent: largest distance of neighbours, as longer pairs fold
ALONG_COSINE = 0.94  # cosine of 20 degrees: largest angle between a pair and its direction


def neighbours(places: Floats, axis: int) -> tuple[Integers, Floats]:
    """Return neighbours along an axis of the flat cloth, (pairs, 2) as numbers, and their distances [m], (pairs,)."""
    extent = float(np.ptp(places, axis=0).max())
    pairs: list[tuple[int, int]] = []
    for k, place in enumerate(places):
        way = places - place
        length = np.linalg.norm(way, axis=1)
        ahead = (
            (way[:, axis] > ALONG_COSINE * np.maximum(length, 1e-9))
            & (length > 0)
            & (length < NEIGHBOUR_SHARE * extent)
        )
        if ahead.any():
            pairs.append((k, int(np.where(ahead, length, np.inf).argmin())))
    found = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return found, np.asarray(np.linalg.norm(places[found[:, 1]] - places[found[:, 0]], axis=1))


def common_change(points: Floats, valid: Booleans, places: Floats, sd: float) -> float | None:
    """Return the common relative change of lengths between neighbours; None for too few pairs.

    points [m], (frames, points, 3); valid, (frames, points); places [m], (points, 2); sd [m], per axis
    """
    found = []
    for axis in (0, 1):
        pairs, flat = neighbours(places, axis)
        if len(pairs) < FEWEST_PAIRS:
            continue
        seen = np.asarray(valid[:, pairs].all(2))
        length = np.linalg.norm(points[:, pairs[:, 1]] - points[:, pairs[:, 0]], axis=2) / flat
        length[~seen] = np.nan
        usable = seen.sum(1) >= FEWEST_PAIRS
        if usable.sum() < FEWEST_SEEN:
            continue
        together = np.nanmedian(length[usable], axis=1)
        spread = 1.4826 * float(np.median(np.abs(together - np.median(together))))
        noise = np.pi * sd**2 / (float(np.median(flat)) ** 2 * float(np.median(seen[usable].sum(1))))
        found.append(float(np.sqrt(max(spread**2 - noise, 0.0))))
    return max(found) if found else None


def kind_shown(recording: Recording) -> tuple[str, float] | None:
    """Return the kind that a recording's points show, `material` or `silhouette`, and their common change.

    The result is None if too few points lie near each other, or if the change is inconclusive.
    """
    places = np.array([p.at_m for p in recording.garment.points])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        change = common_change(recording.seen_points, np.asarray(np.isfinite(recording.seen_points).all(2)), places,
                               float(np.sqrt(np.mean(recording.point_sd**2))))  # fmt: skip
    if change is None or STAYS <= change <= LEAST_SLIDING:
        return None
    return ("silhouette" if change > LEAST_SLIDING else "material"), change


def describe_contradiction(garment: Garment, recordings: Sequence[Recording]) -> str:
    """Return a warning that stated material points slide, with advice.

    Return an empty text if the points do not slide, or if the recordings are inconclusive.
    """
    found = _against(garment, recordings)
    if found is None or found[0] != "silhouette":
        return ""
    _, of, change = found
    return (
        f"The garment file {_stated(garment)} material points, but {of} the lengths between neighbours shrink and "
        f"stretch together, by up to {100 * change:.1f} %. A silhouette's points do so, as they slide over the cloth. "
        f"{_advice('silhouette', recordings)}"
    )


def describe_steady(garment: Garment, recordings: Sequence[Recording]) -> str:
    """Return a note that a stated silhouette's points stay on the cloth.

    Return an empty text if the points slide, or if the recordings are inconclusive.

    This is no contradiction: if the camera sees all of the cloth, its grid is the same in every frame. Markers that
    were described as a silhouette behave alike, and the fit loses the information of their lengths.
    """
    found = _against(garment, recordings)
    if found is None or found[0] != "material":
        return ""
    _, of, change = found
    return (
        f"The garment file {_stated(garment)} points of a silhouette, and {of} neighbours keep their distance, to "
        f"{100 * change:.1f} %: nothing slides. If they are markers, the fit could use their lengths too. "
        f"{_advice('material', recordings)}"
    )


def _stated(garment: Garment) -> str:
    return "states" if garment.points_are else "means"


def _advice(kind: str, recordings: Sequence[Recording]) -> str:
    """Return advice on stating a kind of points; a take keeps the description with which it was made."""
    again = "import" if any(r.is_imported for r in recordings) else "record"
    how = " with --garment" if again == "import" else ""
    return (
        f'State points_are = "{kind}" in the garment file and {again} the takes again{how}: a take keeps the '
        "description that it was made with."
    )


def _against(garment: Garment, recordings: Sequence[Recording]) -> tuple[str, str, float] | None:
    """Return the kind that most recordings show in contradiction to the garment file, these takes, and their change."""
    shown = [(r.take_id, *found) for r in recordings if (found := kind_shown(r)) is not None]
    against = [(take, kind, change) for take, kind, change in shown if kind != garment.point_kind]
    if 2 * len(against) <= len(shown):
        return None
    take, kind, change = max(against, key=lambda one: one[2] if one[1] == "silhouette" else -one[2])
    of = f"in {len(against)} of {len(recordings)} takes" if len(recordings) > 1 else f"in the take {shortened(take)}"
    return kind, of, change

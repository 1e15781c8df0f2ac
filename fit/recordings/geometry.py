"""Check a take's geometry before any simulation: no point is farther from the held ends than on the flat cloth.

In a take a point is at most as far from a held end as on the flat cloth, except for stretch and measurement errors. A
larger median over the frames means a wrong unit, garment or naming of points, or exchanged held ends. The check uses
the points as seen, because a move to their material positions would hide their error.
"""

from __future__ import annotations

import numpy as np

from fit.errors import MismatchError
from fit.recordings.recording import Recording
from fit.recordings.timing import why_foreign
from formats.judged_cloth import MEASURED_APART, MOST_STRETCHED, SHORTEST_EDGE


def _refuse_a_foreign_clock(recording: Recording) -> None:
    """Refuse points whose clock is not the hanger's, the likelier cause of a large distance from the held ends.

    Raises:
        MismatchError: the held row does not move as the hanger's path does, at any shift.
    """
    timing = recording.camera.timing
    if timing is not None and not timing.is_of_hanger:
        raise MismatchError(
            f"the points' clock cannot be the hanger's: {why_foreign(timing)}",
            where=recording.take_id, advice="check that path and points are of one take, and which clock each has",
        )  # fmt: skip


def check_geometry(recording: Recording) -> None:
    """Refuse a take whose points cannot belong to its garment.

    Raises:
        MismatchError: held ends or a point further apart than the cloth is long, held ends hardly apart at all, or
            points whose clock is not the hanger's.
    """
    outline = np.asarray(recording.garment.outline_m, float)
    held = recording.held(recording.time).reshape(-1, 2, 3)
    edge = float(np.linalg.norm(outline[1] - outline[0]))
    apart = float(np.median(np.linalg.norm(held[:, 1] - held[:, 0], axis=1)))
    if not SHORTEST_EDGE * edge <= apart <= MOST_STRETCHED * edge + MEASURED_APART:
        raise MismatchError(
            f"the held ends are {1e3 * apart:.0f} mm apart, the garment's held edge is {1e3 * edge:.0f} mm long",
            where=recording.take_id,
            advice="check the garment's outline, the rig's held_m and their unit",
        )
    for k, point in enumerate(recording.garment.points):
        seen = recording.valid[:, k]
        for end in range(2):
            flat = float(np.linalg.norm(np.asarray(point.at_m) - outline[end]))
            away = np.linalg.norm(recording.seen_points[seen, k] - held[seen, end], axis=1)
            if seen.any() and np.median(away) > MOST_STRETCHED * flat + MEASURED_APART:
                _refuse_a_foreign_clock(recording)
                raise MismatchError(
                    f"the point {point.name!r} is {1e3 * np.median(away):.0f} mm from the {('left', 'right')[end]} "
                    f"held end, on the flat garment {1e3 * flat:.0f} mm",
                    where=recording.take_id,
                    advice="check the garment's points, their names and unit, and which held end is the left one",
                )

"""Tell a plausible garment point from a wrong one: cloth does not stretch and does not leap.

    |p_i - p_j| <= (1 + stretch) |q_i - q_j| + 3 sd        p seen, q on the flat garment
    |p(t) - p'(t)| <= 4 sd + a dt^2 / 2                    p' from the last two sightings at constant velocity

A chord between two points can never be longer than on the flat cloth; it can be shorter, but a side less than
`SHORTEST_SIDE` of its length is folded and its silhouette corner is not the garment's corner.
Points that fail are marked as not seen; nothing is put in their place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STRETCH = 0.04  # strain of a skirt's fabric under its own weight and a hand's swing, and the rig's tolerance
SHORTEST_SIDE = 0.6  # of a side's length when flat: a circular arc through 190 degrees still has 0.6
HARDEST_WHIP = 60.0  # m/s^2, a free corner turning round at the end of a hard swing
LONGEST_MEMORY = 0.2  # s, after this a point may have gone anywhere


def fits_flat_garment(corners: Floats, sd: Floats, flat: Floats) -> NDArray[np.bool_]:
    """Return which of four corners have plausible distances to the others.

    corners [m], (4, 3), NaN where not seen, in order around the garment; sd [m], (4,), of the worst axis;
    flat [m], (4, 2): the same corners on the flat garment.
    """
    chord = np.linalg.norm(corners[:, None] - corners[None], axis=-1)
    rest = np.linalg.norm(flat[:, None] - flat[None], axis=-1)
    slack = 3.0 * np.hypot(sd[:, None], sd[None])
    seen = np.isfinite(chord)
    too_long = seen & (chord > (1.0 + STRETCH) * rest + slack)
    beside = np.abs(np.subtract.outer(np.arange(4), np.arange(4))) % 2 == 1
    too_short = seen & beside & (chord + slack < SHORTEST_SIDE * rest)
    plausible = np.isfinite(corners[:, 0])
    wrong = too_long | too_short
    while wrong[np.ix_(plausible, plausible)].any():
        faults = np.where(plausible, (wrong & plausible[None]).sum(1), 0)
        plausible &= faults < faults.max()  # ties: a wrong distance does not say which end is wrong
    return plausible


class MotionGate:
    """Remembers where the points went and refuses leaps."""

    def __init__(self, points: int) -> None:
        self._place = np.full((points, 3), np.nan)
        self._velocity = np.zeros((points, 3))
        self._time = np.full(points, -np.inf)

    def admit(self, places: Floats, sd: Floats, time: float) -> NDArray[np.bool_]:
        """Return which points came from where they were last seen, and remember those.

        places [m], (points, 3), NaN where not seen; sd [m], (points, 3); time [s], increasing.
        """
        gone = time - self._time
        fresh = gone > LONGEST_MEMORY
        dt = np.where(fresh, 0.0, gone)
        predicted = self._place + self._velocity * dt[:, None]
        leap = np.linalg.norm(places - predicted, axis=1)
        allowed = 4.0 * np.linalg.norm(sd, axis=1) + 0.5 * HARDEST_WHIP * dt**2
        admitted = np.isfinite(places[:, 0]) & (fresh | (leap <= allowed))
        moved = admitted & ~fresh & (dt > 0)
        with np.errstate(invalid="ignore", divide="ignore"):
            velocity = (places - self._place) / dt[:, None]
        self._velocity = np.where(moved[:, None], velocity, np.where(admitted[:, None], 0.0, self._velocity))
        self._place = np.where(admitted[:, None], places, self._place)
        self._time = np.where(admitted, time, self._time)
        return np.asarray(admitted)

"""Tell a plausible garment point from a wrong one: cloth does not leap.

    |p(t) - p'(t)| <= 4 sd + a dt^2 / 2                    p' from the last two sightings at constant velocity

Points that fail are marked as not seen; nothing is put in their place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

HARDEST_WHIP = 60.0  # m/s^2, a free corner turning round at the end of a hard swing
LONGEST_MEMORY = 0.2  # s, after this a point may have gone anywhere


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

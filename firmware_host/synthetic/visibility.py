"""The true visibility of a tracked point's neighbourhood to the depth camera: visible, hidden or ambiguous.

A point has no extent; a camera shows the cloth around the point. The ray of the centre of pixel q meets the point
X(q) of the flat garment, and X_p is the tracked point. The flag lit(q) is true if the projector also reaches X(q). A
structured-light camera has no depth in the projector's shadow.

    near(q) = 1 where |X(q) - X_p| < r and lit(q), else 0
    share   = z^2 / (f^2 A_p) #{q : (G near)(q) >= 1/2}        G: normal of the camera's lateral noise, 0.8 px

The cloth's area within r of the point is A_p. So share is about 1 for unhidden cloth that faces the camera, and
cos(theta) for cloth rotated by theta. A pixel counts if it shows this cloth in at least half of its noisy samples. A
strip one pixel wide does not count (0.499), one of two pixels does (0.73).

    hidden      no pixel at all is near
    visible     the camera's ray meets the point, and share >= 1/4
    ambiguous   all others: seen through a gap, at an edge or edge-on. Neither answer of a tracker counts as an error.

With r = 20 mm, the quarter disc of a right-angled corner that faces the camera has 17 pixels at 2.5 m. A plane needs 12
pixels; half of this radius would give 4. Share 1/4 is a turn of 75 degrees. The noise of these cameras is known up to
60 degrees. `benchmarks/tracking.py` prints the effect of other choices.

Sources: C. V. Nguyen, S. Izadi, D. Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking"
(3DIMPVT 2012), section 3 (lateral noise, angles).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_host.synthetic.depth_noise import LATERAL_PX, in_shadow
from firmware_host.synthetic.render import Renderer
from firmware_host.synthetic.scene import CAMERA
from firmware_host.synthetic.surroundings import Panel
from formats.arrays import Booleans, Floats, Integers

NEIGHBOURHOOD = 0.020  # m along the cloth, derived above: at half, a facing corner has 4 of the 12 pixels at 2.5 m
# Of what the neighbourhood would show if it faced the camera. Our choice: a turn by 75 degrees (decision 12). The limit
# is 83 degrees at half, and 60 at twice.
CLEAR_SHARE = 0.25
NOISE_MARGIN = 4  # px, five deviations of the lateral noise
_STEPS = np.arange(-NOISE_MARGIN, NOISE_MARGIN + 1)  # px from the pixel itself
# The kernel G of the module's equation, along one axis.
_WEIGHTS = np.exp(-0.5 * (_STEPS / LATERAL_PX) ** 2) / np.exp(-0.5 * (_STEPS / LATERAL_PX) ** 2).sum()


@dataclass(frozen=True)
class PointSight:
    """The true visibility of tracked points, (points,) each or (frames, points).

    - `in_view`: the camera's ray meets the point
    - `pixels`: number of pixels that show its neighbourhood
    - `share`: see above
    """

    in_view: Booleans
    pixels: Integers
    share: Floats

    @property
    def hidden(self) -> Booleans:
        """Return whether no pixel shows the neighbourhood."""
        return np.asarray(self.pixels == 0)

    @property
    def visible(self) -> Booleans:
        """Return whether the point and enough of its neighbourhood are in view."""
        return self.visible_from(CLEAR_SHARE)

    def visible_from(self, share: float) -> Booleans:
        """Return which points would be visible with another threshold of the share."""
        return self.in_view & (self.share >= share) & ~self.hidden


def point_sight(
    nodes: Floats, points: Floats, flat: Floats, in_view: Booleans, renderer: Renderer,
    in_front: tuple[Panel, ...] = (),
) -> PointSight:  # fmt: skip
    """Return the visibility of points in one pose of the cloth.

    - `nodes`, `in_front`: see `Renderer.cloth`
    - `points` [m], (points, 3), sensor frame
    - `flat` [m], (points, 2): their positions on the flat garment
    - `in_view`, (points,): which of them the camera's ray meets.
    """
    depth, places = renderer.shown(nodes, in_front)
    places[in_shadow(depth, CAMERA)] = np.nan
    pixels, share = np.zeros(len(points), np.int64), np.zeros(len(points))
    for k, place in enumerate(flat):
        is_near = ((places - place) ** 2).sum(-1) < NEIGHBOURHOOD**2
        pixels[k] = np.count_nonzero(is_near)
        if pixels[k]:
            facing = renderer.area_near(place, NEIGHBOURHOOD) * CAMERA.fx * CAMERA.fy / points[k, 2] ** 2
            share[k] = np.count_nonzero(_as_noise_shows(is_near) >= 0.5) / facing
    return PointSight(in_view, pixels, share)


def _as_noise_shows(is_near: Booleans) -> Floats:
    """Return the share of noisy samples in which each pixel shows one of the marked pixels."""
    rows, columns = np.nonzero(is_near)
    part = is_near[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    seen = np.pad(part.astype(float), NOISE_MARGIN)
    for axis in (0, 1):
        seen = np.apply_along_axis(np.convolve, axis, seen, _WEIGHTS, mode="same")
    return seen

"""Occlusion of a tracked corner: by an object in front, by the border of the image, or by a fold.

In front    around a point at the edge, `NEARER_PIXELS` or more outside the garment are nearer than it by a jump, and by
            more than the cloth that is missing there, because missing cloth may be folded forwards. The edge then
            belongs to another object, behind which the garment continues.
Outside     the point lies at the border of the image.
Folded      cloth hardly stretches, so two corners are as far apart along the seen surface as on the flat garment,

                deficit_ij = (1 - tolerance) D_ij - d_ij        [m], of `capture.garment.flat_garment` and
                `capture.garment.geodesic`

            A deficit means that cloth is missing between the two. The corner with the largest sum is dropped, and the
            others are tested again. `capture.garment.folding` decides whether a dropped corner is hidden: it may also
            be in view at another point than the outline's corner.
"""

from __future__ import annotations

import numpy as np

from capture.garment.silhouette import Silhouette, square_around
from formats.arrays import Booleans, Floats

# px: wider than the missing pixels beside a near thing (43 px m (1 / 1.25 m - 1 / 1.6 m) = 8 px). On nine scenes at
# 1.6 m (`benchmarks/tracking.py --set development-11`) 91 % of the hidden corners are found. Half finds 65 %. Double
# finds 92 %, and 96 % of those called hidden are hidden, in place of 97.
LOOK_AROUND = 12
# px of the 25 x 25 around the point; our choice: 3 % of them, more than single wrong pixels. On the same scenes half
# finds 91 %, of which 96 % are hidden. Double finds 81 %, of which 98 % are hidden.
NEARER_PIXELS = 20
# px; our choice: nearly four deviations of the lateral noise of 0.8 px. A third and double change no figure of the
# scenes that `SHORT_MORE` names.
OCCLUSION_BORDER = 3
# of the longest distance on the flat garment, missing at a corner beside a nearer thing. On the same scenes half finds
# 93 % of the hidden corners, of which 95 % are hidden. Double finds 76 %, of which 97 % are hidden.
COVERED = 0.025
# of the distance on the flat garment: geodesics of the seen surface scatter by 1.5 %. On the same scenes half finds as
# many hidden corners, and double 88 %.
SHORT_WAY = 0.025
# m, the corners' own errors. On the same scenes half finds as many hidden corners, and double 87 %.
SHORT_MORE = 0.008
# of the distance on the flat garment: a longer way goes around a fold or over another thing. On the same scenes half
# puts the corners' 95 % at 11.0 mm in place of 9.9. Double finds 88 % of the hidden corners in place of 91.
LONG_WAY = 0.10


def is_behind_something(silhouette: Silhouette, pixel: Floats, z: float, jump: float) -> bool:
    """Return whether pixels beside a pixel, off the garment, are nearer than `z` [m] by more than a jump [m]."""
    around = square_around(silhouette, pixel, LOOK_AROUND)
    raw = silhouette.raw[around]
    nearer = (raw > 0) & (raw < 1e3 * (z - jump)) & (silhouette.mask[around] == 0)
    return int(np.count_nonzero(nearer)) >= NEARER_PIXELS


def is_at_border(pixel: Floats, shape: tuple[int, ...]) -> bool:
    """Return whether a pixel lies at the border of an image (height, width)."""
    return not (
        OCCLUSION_BORDER <= pixel[0] <= shape[1] - 1 - OCCLUSION_BORDER
        and OCCLUSION_BORDER <= pixel[1] <= shape[0] - 1 - OCCLUSION_BORDER
    )


def folded_away(seen: Floats, flat: Floats, trusted: Booleans) -> tuple[Booleans, Booleans]:
    """Return which corners lack cloth, as a fold causes, and which are misplaced, (k,) each.

    - `seen`, `flat` [m], (k, k): distances along the cloth, NaN where a corner was not found, infinite where no way
      leads
    - `trusted`: corners confirmed by other evidence, so that deviations are attributed to the others
    """
    deficit = np.where(np.isfinite(seen), (1.0 - SHORT_WAY) * flat - SHORT_MORE - seen, 0.0)
    excess = np.where(np.isnan(seen), 0.0, seen - (1.0 + LONG_WAY) * flat - SHORT_MORE)
    folded = _blamed(np.maximum(deficit, 0.0), trusted)
    wrong = _blamed(np.minimum(np.maximum(excess, 0.0), 1.0), trusted | folded)
    return folded, wrong & ~folded


def _blamed(amount: Floats, trusted: Booleans) -> Booleans:
    """Return the fewest corners that explain all deviations between pairs, found worst first, without trusted ones."""
    left = amount.copy()
    blamed = np.zeros(len(left), bool)
    while True:
        score = np.where(trusted | blamed, -1.0, left.sum(1))
        worst = int(score.argmax())
        if score[worst] <= 0.0:
            return blamed
        blamed[worst] = True
        left[worst] = left[:, worst] = 0.0

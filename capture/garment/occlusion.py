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

Where not all corners are found, the ends of the held edge without a corner are compared as well. The markers show
them, so they are never blamed. Without them, nothing would test a lower corner that is found alone. One corner of the
picture could then have two names. The held corner would be 40 mm from its end, and the lower one 0.4 m from its own
place. Of such a distance only a deficit counts, and only beyond the gap beside the end,

                deficit_ei = (1 - tolerance) D_ei - d_ei - gap    [m], from the end e to the corner i

because an isometry keeps the lengths of paths, so no path in the cloth is shorter than D_ei. Source: M. P. do Carmo,
"Differential geometry of curves and surfaces" (1976), section 4-2. The cloth beside such an end is out of view. A way
begins with a straight step across it, and cloth that is folded there is missing. A way may also be too long there.
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
# m, of a way from a held end, across cloth out of view: the longest first step of `capture.garment.geodesic`, 2.5 steps
# of 28 mm. At 4006 positions of nine recordings of the sets `development` and `development-2` of
# `benchmarks/stated_noise.py`, ways lack up to 10 mm beyond the tolerance. Half and double blame no corner there.
END_GAP = 0.07
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


def with_ends(
    seen: Floats, flat: Floats, trusted: Booleans, to_ends: Floats, flat_to_ends: Floats
) -> tuple[Floats, Floats, Booleans]:
    """Return the arguments of `folded_away`, (k + m,), with m held ends after the k corners: see the module.

    to_ends, flat_to_ends [m], (m, k): distances from the ends to the corners
    """
    ends, corners = flat_to_ends.shape
    whole, whole_flat = np.full((2, corners + ends, corners + ends), np.nan)
    whole[:corners, :corners], whole_flat[:corners, :corners] = seen, flat
    short = np.where(np.isfinite(to_ends), np.minimum(to_ends + END_GAP, flat_to_ends), np.nan)
    whole[corners:, :corners], whole[:corners, corners:] = short, short.T
    whole_flat[corners:, :corners], whole_flat[:corners, corners:] = flat_to_ends, flat_to_ends.T
    return whole, whole_flat, np.append(trusted, np.ones(ends, bool))


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

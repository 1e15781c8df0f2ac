"""Weigh the evidence that markers have exchanged their labels, by how smoothly the paths go on with and without it.

`path_roughness` states the roughness `c` of four positions, and how many times larger it is behind a gap, `g`.
An exchange is weighed over the three positions before it and the three behind it, and the rows of four that reach
across. `Q` is the mean of these rows, once under the labels as given and once under the exchanged ones:

    Q = mean c^2 / (noise^2 + (s^2 - noise^2) max(1, g)^2)

`s` is what the marker's rows have elsewhere, and the longer steps of every second position tell the noise in it.

Rows are rougher than usual where cloth folds or is flicked, often for many markers at once. So `s` is unknown up to a
factor, and a position has the distribution of Student's t. The logarithm of the likelihoods' ratio is, for `n` rows:

    E = (NU + 3 n) / 2  ln((NU + Q given / a) / (NU + Q exchanged / a))

`a` is 1 in quiet moments. It grows with the roughness of the other markers, and with the largest `Q exchanged`. Each
label of an exchange must show it by itself: an exchange has the smallest `E` of its labels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formats.arrays import Booleans, Floats, Indices, Integers, Singles
from formats.importers.path_roughness import POSITIONS_BESIDE, weights_of

LED_OVER = 12  # frames to a position that is weighed; our choice: cloth turns within more at 100 frames a second
# Degrees of freedom of Student's t. Our choice: folds and flicks are rougher than normal noise, which has infinity.
NU = 3.0
# Share of the other markers that are as rough or less. Our choice: a flick moves a few rows of a garment at a time.
OF_OTHERS = 0.8
QUIET = 2.5  # times the usual, beyond which no moment is quiet; our choice: that share has 2.0 of normal noise
# Mean square of exchanged rows, in usual ones, beyond which the moment counts as rough: 1.3 for normal noise. Our
# choice: nine planted exchanges in ten have less.
ROUGH = 2.0
ROUGHEST = 300.0  # the same, beyond which paths go on nowhere; our choice: a real recording has up to 24


@dataclass(frozen=True)
class Exchanges:
    """Labels that seem to go on with other paths, one entry each, (labels that do,).

    - `frame`: the first frame that has the exchange
    - `label`, `path`: the label, and the label that the same marker has before this frame
    - `cycle`: number of the exchange, which are numbered from 0
    """

    frame: Integers
    label: Integers
    path: Integers
    cycle: Integers

    @property
    def count(self) -> int:
        """The number of exchanges."""
        return int(self.cycle.max(initial=-1)) + 1

    def least(self, values: Floats) -> Floats:
        """Return the smallest value of each exchange's labels, (exchanges,)."""
        found = np.full(self.count, np.inf)
        np.minimum.at(found, self.cycle, values)
        return found

    def any_of(self, values: Booleans) -> Booleans:
        """Return whether one of each exchange's labels has it, (exchanges,)."""
        return np.bincount(self.cycle, values, self.count) > 0


@dataclass(frozen=True)
class Sights:
    """Where the positions of a stretch of frames were seen.

    - `time` [usual steps], (frames,); `positions` [m], (frames, markers, 3), NaN where not seen
    - `before`: the last frame before each one that shows the marker, (frames + 1, markers), -1 without
    - `behind`: the first frame from each one on that does, (frames + 1, markers), `frames` without
    - `usual`: the usual roughness [m], (frames, markers)
    - `rough`: the roughness of the row that ends in each frame, in usual ones, (frames, markers), NaN without
    - `noise`: the part of the usual roughness that is noise [m], (markers,)
    """

    time: Floats
    positions: Floats
    before: Indices
    behind: Indices
    usual: Singles
    rough: Singles
    noise: Floats

    @classmethod
    def of(cls, time: Floats, positions: Floats, usual: Singles, rough: Singles, noise: Floats) -> Sights:
        """Return the sights of a stretch of frames."""
        frames, markers, _ = positions.shape
        are_seen, at = np.isfinite(positions[..., 0]), np.arange(frames, dtype=np.int32)[:, None]
        before = np.full((frames + 1, markers), -1, np.int32)
        before[1:] = np.maximum.accumulate(np.where(are_seen, at, -1), axis=0)
        behind = np.full((frames + 1, markers), frames, np.int32)
        behind[:frames] = np.minimum.accumulate(np.where(are_seen, at, frames)[::-1], axis=0)[::-1]
        return cls(time, positions, before, behind, usual, rough, noise)

    def are_seen(self) -> Booleans:
        """Return which positions were seen, (frames, markers)."""
        return np.asarray(self.before[1:] == np.arange(len(self.time))[:, None])


def evidence(sights: Sights, found: Exchanges, length: int) -> Floats:
    """Return E of each exchange, (exchanges,), -inf where a label shows none.

    `length`: how many frames have the exchange, 0 where it goes on
    """
    label, path, frame = found.label, found.path, found.frame
    behind = path if length else label
    given, rows_given = _mean_square(sights, (label, label, label), label, frame, length)
    exchanged, rows = _mean_square(sights, (path, label, behind), path, frame, length)
    rows = np.minimum(rows, rows_given)
    most = np.zeros(found.count)
    np.maximum.at(most, found.cycle, exchanged)
    louder = np.maximum(np.maximum(_of_others(sights, found) / QUIET, 1.0) ** 2, (most / ROUGH)[found.cycle])
    with np.errstate(all="ignore"):  # of damaged numbers
        told = (NU + 3 * rows) / 2 * np.log((NU + given / louder) / (NU + exchanged / louder))
    told[(rows == 0) | ~(exchanged < ROUGHEST)] = -np.inf
    if length:  # then a label that is hidden in these frames has no exchange
        told[~sights.are_seen()[frame, label]] = -np.inf
    return found.least(told)


def _mean_square(
    sights: Sights, labels: tuple[Integers, Integers, Integers], path: Integers, frame: Integers, length: int
) -> tuple[Floats, Integers]:
    """Return Q of each label, and the number of rows of four that it is of, both (labels,).

    `labels`: before the exchange, in its frames, and behind these; `path`: whose roughness is usual
    """
    before, within, behind = labels
    frames, usual = len(sights.time), sights.usual[frame, path].astype(float)
    noise = np.minimum(sights.noise[path], usual)
    moved = usual**2 - noise**2
    earlier, later = list[Integers](), list[Integers]()
    at, to = frame, np.minimum(frame + length, frames)
    for _ in range(POSITIONS_BESIDE):
        at = np.where(at >= 0, sights.before[at, before], -1)  # -1 is the last row, and not used
        to = sights.behind[to, behind]
        earlier.append(at)
        later.append(np.where(to < frames, to, -1))
        to = np.minimum(to + 1, frames)
    amid = [np.where(frame + k < frames, frame + k, -1) for k in range(length)]
    places = np.stack([*earlier[::-1], *amid, *later], 1)
    of = np.stack([before] * POSITIONS_BESIDE + [within] * length + [behind] * POSITIONS_BESIDE, 1)
    is_near = (places >= 0) & (np.abs(places - frame[:, None]) <= LED_OVER + length)
    positions, times = np.where(is_near[..., None], sights.positions[places, of], np.nan), sights.time[places]
    total, count = np.zeros(len(frame)), np.zeros(len(frame), int)
    for k in range(places.shape[1] - POSITIONS_BESIDE):
        row = slice(k, k + POSITIONS_BESIDE + 1)
        with np.errstate(all="ignore"):  # of places without a position, and of damaged numbers
            weights, grown = weights_of(times[:, row])
            rough = np.einsum("ep,epd->ed", weights, positions[:, row])
            square = (rough**2).sum(1) / (noise**2 + moved * np.maximum(grown, 1.0) ** 2)
        is_row = ~np.isnan(square)
        total[is_row] += square[is_row]
        count += is_row
    return total / np.maximum(count, 1), count


def _of_others(sights: Sights, found: Exchanges) -> Floats:
    """Return how rough the paths of most other markers are there, in usual ones, (labels,); 0 without any."""
    frames, where = np.unique(found.frame, return_inverse=True)
    rough = np.full((len(frames), sights.rough.shape[1]), -1.0, np.float32)
    for k in range(POSITIONS_BESIDE):
        one = sights.rough[np.minimum(frames + k, len(sights.time) - 1)]
        rough = np.fmax(rough, one)
    rough[where, found.label] = -1.0
    rough.sort(axis=1)
    none = (rough < 0).sum(1)
    place = none + (OF_OTHERS * (rough.shape[1] - none)).astype(int)
    most = rough[np.arange(len(frames)), np.minimum(place, rough.shape[1] - 1)]
    return np.asarray(np.maximum(most, 0.0)[where], float)

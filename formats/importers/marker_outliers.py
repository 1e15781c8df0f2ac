"""Remove isolated outliers of a marker: positions that jump away from its trajectory and back.

Lost bytes and wrong labels cause them. Three straight lines predict a position: between the positions before and after,
through the two before, and through the two after. A position jumps where its distance from each line exceeds the bound
of acceleration and noise:

    |z - line|  >  SMALLEST_JUMP + HARDEST_PULL r / 2 + BENDS q max(1, r / 2 h^2)
    r  =  h1 h2 between two,  h1 (h1 + h2) ahead of two

The path comes back where the neighbours are nearer to each other than the position is to the line between them.

- `h1`, `h2`: the time steps; `h`: the median time step
- `q`: the median distance of the marker's positions from the nearest of their three lines

The first two positions and the last two have only the extrapolation of the next two. The extrapolation adds the noise
of three positions, weighted 1, 2 and 1: sqrt(6) standard deviations. Interpolation adds sqrt(3/2), half as much. So the
bound has twice the noise. The marker's motion elsewhere also limits the bound:

    |z - line|  >  SMALLEST_JUMP + HARDEST_PULL r / 2 + AT_ENDS max(BENDS q, f) max(1, r / 2 h^2)

- `f`: the largest distance of the marker's other positions from such an extrapolation, scaled to r = 2 h^2. A step
  after which the marker stays has a large one

Cloth cannot accelerate so hard. An extrapolation by two frames is 50 mm off under 500 m/s^2 at 100 frames a second.
At 20 frames a second, 20 m/s^2 suffice. Flicked cloth may reach 20 m/s^2, so the bound grows with the time step. The
bound is 65 mm at 100 frames a second. It is 0.43 m at 20, which takes 170 m/s^2, and 6 m at 5. So the rule holds at
every frame rate, but finds fewer outliers at low rates and behind gaps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.importers.number_cells import CELL_SHOWN
from formats.importers.path_outliers import straight_lines
from formats.motion import HARDEST_PULL
from formats.plain_text import MOST_LISTED, first_few

SMALLEST_JUMP = 0.05  # m; our choice: two diameters of a marker; lost bytes leave most positions farther off
AT_ENDS = 2.0  # noise of an extrapolation over noise of an interpolation; also the margin over f
BENDS = 20.0  # times q, which is 0.5 standard deviations of normal noise; 2 of 300 undamaged files had one beyond
FEWEST_POSITIONS = 20  # positions of a marker; our choice: fewer do not show its usual curvature
MOST_JUMPS = 0.05  # of a marker's positions: more jumps have another cause, which other checks report


def remove_jumps(time: Floats, positions: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Mark as not seen the positions that jump away and back; return a warning of them, '' without any.

    - `time` [s], (frames,); `positions` [m], (frames, markers, 3), NaN where not seen
    - `labels`: the markers' names; `where`: returns the name of a frame's line or number in the file
    """
    if len(time) < FEWEST_POSITIONS or not (np.diff(time) > 0).all():
        return ""
    found = list[_Jump]()
    for marker in range(positions.shape[1]):
        jumps = _jumps_of(time, positions[:, marker])
        positions[[jump.frame for jump in jumps], marker] = np.nan
        found += [replace(jump, marker=marker) for jump in jumps]
    if not found:
        return ""
    found.sort(key=lambda jump: (jump.frame, jump.marker))
    named = [f"{labels[jump.marker].strip()[:CELL_SHOWN]}" for jump in found[:MOST_LISTED]]
    if len(found) == 1:
        and_back = " and back" * found[0].comes_back
        return (
            f"{where(found[0].frame)}: {named[0]} jumps {_shown(found[0].off)} m away{and_back}, so it counts as not "
            "seen there"
        )
    each = [f"{name} in {where(jump.frame)} by {_shown(jump.off)} m" for name, jump in zip(named, found, strict=False)]
    return f"{len(found)} positions jump away from their paths and count as not seen: {first_few(each, len(found))}"


def _shown(off: float) -> str:
    return f"{off:.2g}" if off < 10 else f"{off:.0f}"


@dataclass(frozen=True)
class _Jump:
    """An outlier: its frame, its distance [m] from its line, and whether later positions return to the trajectory."""

    frame: int
    off: float
    comes_back: bool
    marker: int = 0


def _jumps_of(time: Floats, path: Floats) -> list[_Jump]:
    """Return the outliers of one marker's trajectory [m], (frames, 3)."""
    seen = np.flatnonzero(np.isfinite(path).all(1))
    instants, positions, step = time[seen], path[seen], float(np.median(np.diff(time)))
    # Most markers never move so far in one frame.
    if len(seen) < FEWEST_POSITIONS or np.abs(np.diff(positions, axis=0)).max() < SMALLEST_JUMP / 2:
        return []
    off, reach = _beside_lines(instants, positions)
    noise = float(np.median(off.min(0)))
    jumps = 2 + np.flatnonzero(_is_beyond(off, reach, noise, step))
    good = np.setdiff1d(np.arange(len(seen)), jumps)
    at = np.searchsorted(good, jumps)  # a good position between outliers may seem to jump as well
    is_amid = (at >= 2) & (at <= len(good) - 2)
    jumps, at = jumps[is_amid], at[is_amid]
    some = np.stack([good[at - 2], good[at - 1], jumps, good[at], good[np.minimum(at + 1, len(good) - 1)]], 1)
    off, reach = _beside_good(instants[some], positions[some])
    across = np.linalg.norm(positions[some[:, 3]] - positions[some[:, 1]], axis=1)
    comes_back = _is_beyond(off, reach, noise, step) & (off[0] > across)
    kept = [_Jump(int(seen[jumps[k]]), float(off[0, k]), comes_back=True) for k in np.flatnonzero(comes_back).tolist()]
    kept += [
        _Jump(int(seen[good[k]]), far, comes_back=False)
        for k, far in _jumps_at_ends(instants[good], positions[good], noise, step)
    ]
    return kept if len(kept) <= max(1, MOST_JUMPS * len(seen)) else []


def _jumps_at_ends(time: Floats, positions: Floats, noise: float, step: float) -> list[tuple[int, float]]:
    """Return which of the first two and the last two positions jump, and their distances [m] from the extrapolation.

    `time` [s], (n,); `positions` [m], (n, 3), without other outliers
    """
    if len(time) < FEWEST_POSITIONS:
        return []
    lead, reach = straight_lines(time, positions)
    ahead = (np.linalg.norm(positions - lead, axis=2) / np.maximum(1.0, reach / (2 * step**2)))[1:]
    elsewhere = float(max(ahead[0, 4:-2].max(), ahead[1, 2:-4].max()))
    bend, found = AT_ENDS * max(BENDS * noise, elsewhere), list[tuple[int, float]]()
    for order in (np.arange(4), len(time) - 1 - np.arange(4)):
        line = order[2:4]
        for k in order[1::-1].tolist():
            if far := _beyond_line(time, positions, np.array([k, *line]), bend, step):
                found.append((k, far))
            else:
                line = np.array([k, line[0]])
    return found


def _beyond_line(time: Floats, positions: Floats, some: Integers, bend: float, step: float) -> float:
    """Return the first position's distance [m] from the line through the other two, 0 within the bound."""
    near, far = np.abs(np.diff(time[some])).tolist()
    reach = near * (near + far)
    lead = positions[some[1]] + (positions[some[1]] - positions[some[2]]) * near / far
    off = float(np.linalg.norm(positions[some[0]] - lead))
    bound = SMALLEST_JUMP + HARDEST_PULL * reach / 2 + bend * max(1.0, reach / (2 * step**2))
    return off if off > bound else 0.0


def _beside_lines(time: Floats, positions: Floats) -> tuple[Floats, Floats]:
    """Return the distances [m] of positions from their three lines, (3, n - 4), and r [s^2] of each line.

    `time` [s], (n,); `positions` [m], (n, 3); the first two and the last two lack lines
    """
    lead, reach = straight_lines(time, positions)
    return np.linalg.norm(positions - lead, axis=2)[:, 2:-2], reach[:, 2:-2]


def _beside_good(time: Floats, positions: Floats) -> tuple[Floats, Floats]:
    """Return the distances [m] of the middle one of five positions from its three lines, (3, n), and r [s^2] of each.

    `time` [s], (n, 5); `positions` [m], (n, 5, 3)
    """
    h, z = np.diff(time, axis=1).T[..., None], positions.transpose(1, 0, 2)
    amid = z[1] + (z[3] - z[1]) * h[1] / (h[1] + h[2])
    lead = np.stack([amid, z[1] + (z[1] - z[0]) / h[0] * h[1], z[3] - (z[4] - z[3]) / h[3] * h[2]])
    reach = np.stack([h[1] * h[2], h[1] * (h[0] + h[1]), h[2] * (h[2] + h[3])])[..., 0]
    return np.linalg.norm(z[2] - lead, axis=2), reach


def _is_beyond(off: Floats, reach: Floats, noise: float, step: float) -> Booleans:
    """Return which positions exceed the bound of acceleration and noise for all three lines."""
    bound = SMALLEST_JUMP + HARDEST_PULL * reach / 2 + BENDS * noise * np.maximum(1.0, reach / (2 * step**2))
    return np.asarray((off > bound).all(0))

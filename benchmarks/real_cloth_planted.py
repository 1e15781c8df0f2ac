"""Plant a camera's faults in real recordings of swung cloth, and count how often the matching figure responds most.

    benchmarks/real_cloth_planted.py FOLDER [TOGETHER]

FOLDER holds the `.npz` recordings (docs/notebook/real-cloth.md). They are read in groups of TOGETHER takes (4 unless
given), as one diagnosis reads them. Four faults are planted in every group:

- stamps 60 ms late
- gravity tilted by 2 degrees across the cloth
- depth 1.5 % too long from the rig's origin
- every border eaten by 10 mm

The findings of a fit's or a diagnosis' camera section (`fit.recordings.camera_findings`) are read before and after. The
change of each figure counts in its typical size, that of the effect of its kind. A fault counts as moved most if its
figure changes most. It counts as named if its figure is named afterwards, with a size nearer to the planted one than
half of it. Nothing is simulated.
"""

from __future__ import annotations

import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from msgspec.structs import replace as changed

from fit.effects import find_effects
from fit.recordings.camera_findings import describe_camera
from fit.recordings.grids import grid_of
from fit.recordings.hanger_path import held_curve
from fit.recordings.recording import Recording, prepare
from fit.recordings.smoothing import best_cut_off
from formats.importers.swung_cloth import import_swung_cloth
from formats.take import Take

LATE, TILT, DEPTH, BORDER = 0.06, np.radians(2.0), 0.015, 0.01  # s, rad, share, m
TYPICAL_OF = {  # unit of a figure: the typical size of an effect
    "latency": "time_offset", "publish_time": "frame_timing", "held_edge": "attachment_offset",
    "eaten_border": "corner_erosion", "eaten_by_pose": "eroded_outline", "depth_scale": "depth_scale",
    "lean": "gravity_tilt",
}  # fmt: skip


def late(take: Take) -> Take:
    """Return the take with later timestamps: the path continues meanwhile."""
    known = take.held_valid.all(1)
    seen, time = take.held.reshape(-1, 6)[known], take.time[known]
    later = held_curve(time, seen, best_cut_off(time, seen))(take.time + LATE).reshape(take.held.shape)
    held = np.where(take.held_valid[..., None], later, take.held)
    return dataclasses.replace(take, held=held, markers=held)


def tilted(take: Take) -> Take:
    """Return the take with the rig's gravity rotated across the cloth, which increases the apparent lean."""
    ends = np.nanmean(np.where(take.held_valid[..., None], take.held, np.nan), axis=0)
    down = np.asarray(take.rig.gravity) / np.linalg.norm(take.rig.gravity)
    out = np.cross(-down, ends[1] - ends[0])
    x, y, z = (np.cos(TILT) * down - np.sin(TILT) * out / np.linalg.norm(out)).tolist()
    return dataclasses.replace(take, rig=changed(take.rig, gravity=(x, y, z)))


def too_deep(take: Take) -> Take:
    """Return the take with points measured too far from the origin."""
    return dataclasses.replace(take, points=(1 + DEPTH) * take.points)


def eaten(take: Take) -> Take:
    """Return the take with its grid resampled bilinearly within an invisible border."""
    grid = grid_of(take.garment)
    assert grid is not None
    rows, columns = grid.at.shape
    laid = take.points[:, grid.at]
    shares = [
        np.linspace(BORDER / size, 1 - BORDER / size, count) * (count - 1)
        for size, count in ((np.ptp(grid.down), rows), (np.ptp(grid.across), columns))
    ]
    for axis, share in enumerate(shares, 1):
        first = np.minimum(share.astype(int), laid.shape[axis] - 2)
        part = (share - first).reshape([-1 if k == axis else 1 for k in range(4)])
        laid = (1 - part) * np.take(laid, first, axis) + part * np.take(laid, first + 1, axis)
    points = np.full(take.points.shape, np.nan)
    points[:, grid.at] = laid
    return dataclasses.replace(take, points=points, points_valid=np.isfinite(points).all(2))


FAULTS: dict[str, tuple[Callable[[Take], Take], str, float]] = {
    "60 ms": (late, "latency", LATE), "2 degrees": (tilted, "lean", TILT),
    "1.5 % of depth": (too_deep, "depth_scale", DEPTH), "10 mm of erosion": (eaten, "eaten_border", BORDER),
}  # fmt: skip


def figures(recordings: Sequence[Recording]) -> dict[str, float]:
    """Return every figure of the takes, whether it is named or not."""
    timings = [r.camera.timing for r in recordings if r.camera.timing is not None]
    edges = [r.camera.edge for r in recordings if r.camera.edge is not None]
    outlines = [r.camera.outline for r in recordings if r.camera.outline is not None]
    leans = [r.camera.lean.angle for r in recordings if r.camera.lean is not None]
    return {
        "latency": float(np.median([t.latency for t in timings])),
        "publish_time": float(np.median([t.share for t in timings])),
        "held_edge": float(np.median([np.hypot(e.down, e.out) for e in edges])),
        "eaten_border": float(np.median([(o.bottom + 2 * o.side) / 3 for o in outlines])),
        "eaten_by_pose": float(np.median([o.by_pose for o in outlines if o.by_pose is not None])),
        "depth_scale": float(np.median([t.scale for t in timings])),
        "lean": float(np.median(leans)),
    }


def main(folder: Path, together: int) -> None:
    """Print the response of the figures to each fault, group by group, and the counts."""
    takes = [import_swung_cloth(path) for path in sorted(folder.glob("*.npz"))]
    groups = [takes[k :: len(takes) // together] for k in range(len(takes) // together)]
    typical = {name: find_effects([effect])[0].typical for name, effect in TYPICAL_OF.items()}
    most, named, whole = dict.fromkeys(FAULTS, 0), dict.fromkeys(FAULTS, 0), 0
    for group in groups:
        whole += 1
        before = figures([prepare(take) for take in group])
        for fault, (plant, name, size) in FAULTS.items():
            recordings = [prepare(plant(take)) for take in group]
            after = figures(recordings)
            moved = {k: (after[k] - before[k]) / typical[k] for k in typical}
            first = max(moved, key=lambda k: abs(moved[k]))
            found = {one.name: one.figure for one in describe_camera(recordings)}
            change = after[name] - before[name]
            most[fault] += first == name
            is_sized = abs(abs(change) - size) < size / 2
            named[fault] += name in found and is_sized
            rest = sorted((k for k in moved if k != name), key=lambda k: -abs(moved[k]))[:2]
            others = ", ".join(f"{k} {moved[k]:+.2f}" for k in rest)
            print(
                f"{' '.join(t.take_id for t in group)}: {fault:17s} {name} {change:+.4g} ({moved[name]:+.2f} typical), "
                f"{'named' if name in found else 'not named'}; others: {others}"
            )
            sys.stdout.flush()
    for fault in FAULTS:
        print(f"{fault:17s} moved most in {most[fault]} of {whole}, named with its size in {named[fault]} of {whole}")
    print(f"moved most in {sum(most.values())} of {whole * len(FAULTS)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 4)

"""Count how often a camera's faults are named on synthetic silhouettes: true and false positives.

    benchmarks/silhouette_rates.py [CLEAN [FAULTY]]

CLEAN recordings (100 unless given) have no fault but noise of 2 mm. Half of them state a silhouette, half state
material points. A clean silhouette keeps its lengths, so that `points_are` is named there, rightly, and does not count.
CLEAN more recordings are seen in five points only, as a sensor tracks a garment.
Each kind of fault is planted in FAULTY recordings (20 unless given). All are made by `hangtime sensor
synthesise-silhouette`'s own code, whose cloth is not the fitter's.

The detectable size is named with a power of 80 %. It lies 3.9 standard deviations of the figure on the clean recordings
beyond the least size that is named. Each kind is planted at twice its detectable size. Kinds that have no size are
planted as they are. A kind counts as found if it is named. The error of its size is a median.
"""

from __future__ import annotations

import os
import sys
import tempfile

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does

import dataclasses
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from msgspec.structs import replace as changed

from firmware_host.synthetic import silhouette
from firmware_host.synthetic.silhouette import CameraFaults, make_silhouette_take
from fit.recordings import camera_findings as said
from fit.recordings.camera_findings import describe_camera
from fit.recordings.recording import Recording, prepare
from formats.fit_records import CameraFinding
from formats.importers.swung_cloth import import_swung_cloth
from formats.take import Take

DETECTION = 3.1 + 0.842  # standard deviations: the level at which a fault is named, 1 in 1000, and power 80 %
NOISE = 0.002  # m, per axis
LEAST_LATE = 0.002  # s
LEAST_SHARE, LEAST_SKEWED = 0.1, 0.02  # of an interval, and of the frames: a smaller size has no effect
Change = Callable[[Take], Take]


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of fault: the finding that names it, the camera's fault and its sign, or the change of the take."""

    label: str
    finding: str
    fault: str = ""
    sign: float = 1.0
    least: float = 0.0
    change: Change | None = None
    figure: Callable[[Recording], float] | None = None


def lost_for_a_while(take: Take) -> Take:
    """Return the take with 1.2 s of the hanger's path missing."""
    middle = float(take.time[-1]) / 2
    lost = np.abs(take.time - middle) < 0.6
    return dataclasses.replace(take, held_valid=take.held_valid & ~lost[:, None])


def of_another_clock(take: Take) -> Take:
    """Return the take with the path on a clock of three quarters of the speed, which no shift explains."""
    flat = take.held.reshape(len(take.time), 6)
    held = np.stack([np.interp(0.75 * take.time, take.time, axis) for axis in flat.T], 1).reshape(take.held.shape)
    return dataclasses.replace(take, held=held, markers=held)


def as_material(take: Take) -> Take:
    """Return the take as if its file stated material points."""
    return dataclasses.replace(take, garment=changed(take.garment, points_are="material"))


def five_points(take: Take) -> Take:
    """Return the take as a sensor tracks a garment: four corners, and the middle of the free edge."""
    places = np.array([point.at_m for point in take.garment.points])
    left, right, bottom, top = *np.sort(places[:, 0])[[0, -1]], *np.sort(places[:, 1])[[0, -1]]
    wanted = np.array([(left, top), (right, top), (left, bottom), ((left + right) / 2, bottom), (right, bottom)])
    kept = np.linalg.norm(places - wanted[:, None], axis=2).argmin(1)
    garment = changed(take.garment, points=tuple(take.garment.points[k] for k in kept))
    return dataclasses.replace(
        take, garment=garment, points=take.points[:, kept], points_valid=take.points_valid[:, kept],
        points_sd=take.points_sd[:, kept],
    )  # fmt: skip


def _timing(read: Callable[[silhouette.CameraFaults], float] | str) -> Callable[[Recording], float]:
    def figure(recording: Recording) -> float:
        timing = recording.camera.timing
        return float(getattr(timing, str(read))) if timing is not None else float("nan")

    return figure


def _outline(name: str) -> Callable[[Recording], float]:
    def figure(recording: Recording) -> float:
        outline = recording.camera.outline
        if outline is None:
            return float("nan")
        return float((outline.bottom + 2 * outline.side) / 3 if name == "border" else outline.by_pose or 0.0)

    return figure


def _edge(recording: Recording) -> float:
    return recording.camera.edge.down if recording.camera.edge is not None else float("nan")


KINDS = (
    Kind("late stamps", "latency", "latency", least=LEAST_LATE, figure=_timing("latency")),
    Kind("early stamps", "latency", "latency", -1.0, LEAST_LATE, figure=_timing("latency")),
    Kind("late stamps, five points", "latency", "latency", least=LEAST_LATE, change=five_points,
         figure=_timing("latency")),
    Kind("publish times", "publish_time", "publish_share", least=LEAST_SHARE, figure=_timing("share")),
    Kind("a shift of each frame", "frame_shifts", "jitter", least=0.01, figure=_timing("deviation")),
    Kind("skewed grids", "skewed_grids", "skewed_share", least=LEAST_SKEWED,
         figure=lambda r: r.camera.skewed / max(r.camera.frames, 1)),
    Kind("an eaten border", "eaten_border", "eroded_border", least=said.LEAST_BORDER, figure=_outline("border")),
    Kind("an outline eaten by pose", "eaten_by_pose", "eaten_by_pose", least=said.LEAST_BY_POSE,
         figure=_outline("pose")),
    Kind("a path below the edge", "held_edge", "path_below", least=said.LEAST_EDGE, figure=_edge),
    Kind("depth too long", "depth_scale", "depth_scale", least=said.LEAST_SCALE, figure=_timing("scale")),
    Kind("a hanger lost for 1.2 s", "hanger_gap", change=lost_for_a_while),
    Kind("a clock that is not the hanger's", "clocks", change=of_another_clock),
    Kind("sliding points stated as material", "points_are", change=as_material),
)  # fmt: skip


def take_with(seed: int, **faults: float) -> Take:
    """Return the imported take of a recording with these faults."""
    with tempfile.TemporaryDirectory() as folder:
        paths = make_silhouette_take(Path(folder), f"take-{seed}", CameraFaults(noise=NOISE, **faults), seed=seed)
        return import_swung_cloth(paths[0])


def named(take: Take) -> tuple[Recording, dict[str, CameraFinding]]:
    """Return the recording and its named findings."""
    recording = prepare(take)
    return recording, {one.name: one for one in describe_camera([recording])}


def main(clean: int, faulty: int) -> None:
    """Print the rates."""
    known = cache(silhouette.swung_cloth)
    silhouette.swung_cloth = lambda seconds, progress=None: known(seconds)  # type: ignore[assignment] # the same cloth
    figures: dict[str, list[float]] = {kind.label: [] for kind in KINDS}
    false: dict[str, int] = {}
    wrong = 0
    for seed in range(clean):
        take = take_with(seed)
        is_material = seed % 2 == 1
        recording, found = named(as_material(take) if is_material else take)
        names = [name for name in found if not (name == "points_are" and not is_material)]
        wrong += bool(names)
        for name in names:
            false[name] = false.get(name, 0) + 1
        for kind in KINDS:
            if kind.figure is not None and not is_material:
                figures[kind.label].append(kind.figure(recording))
    print(f"clean: {wrong} of {clean} recordings have a false name {false or ''}")
    of_five = [named(five_points(take_with(seed)))[1] for seed in range(2000, 2000 + clean)]
    print(
        f"clean, five points: {sum(bool(found) for found in of_five)} of {clean} {sorted(set().union(*of_five)) or ''}"
    )
    print(f"{'kind':36s} {'planted':>10s} {'found':>9s}  {'size, median error':>20s}")
    hits = 0
    for kind in KINDS:
        size = 0.0
        if kind.fault:
            spread = float(np.nanstd(figures[kind.label], ddof=1))
            size = 2 * max(DETECTION * spread, kind.least) * kind.sign
        found_in, errors = 0, []
        for seed in range(1000, 1000 + faulty):
            planted = {kind.fault: size} if kind.fault else {}
            if kind.label.startswith("sliding"):
                planted = {"eaten_by_pose": 0.1}
            take = take_with(seed, **planted)
            recording, found = named(kind.change(take) if kind.change else take)
            found_in += kind.finding in found
            if kind.figure is not None and kind.finding in found:
                sign = -1.0 if kind.fault == "path_below" else 1.0
                errors.append(abs(sign * kind.figure(recording) - size))
        hits += found_in
        error = f"{np.median(errors):.4g}" if errors else ""
        print(f"{kind.label:36s} {size:10.4g} {found_in:4d}/{faulty:<4d}  {error:>20s}")
        sys.stdout.flush()
    print(f"found: {hits} of {faulty * len(KINDS)}")


if __name__ == "__main__":
    main(*[int(value) for value in (sys.argv[1:] + ["100", "20"][len(sys.argv) - 1 :])])

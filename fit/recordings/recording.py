"""A take prepared for simulation: world frame, smooth hanger path, targets for the observer.

World frame: z against gravity, x along the sensor's x as far as level, y = z × x, metres.
The hanger's path is a spline that is smooth in its acceleration, with a cut-off that the take chooses
(`fit.recordings.smoothing`). The observer's targets are cubic smoothing splines with a cut-off at 6 Hz. Both are flat
for hand-made motion, within 0.1 % at 1 Hz. So sensor noise does not become acceleration, and swings keep their size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fit.errors import FitError, MismatchError
from fit.recordings.bodies import Body, capsule, half_space, sphere
from fit.recordings.camera import (
    EVERY_STEP,
    Camera,
    CameraSteps,
    Seen,
    edge_shown,
    examined,
    in_place,
    retimed,
    steadied,
    straightened,
)
from fit.recordings.grids import Grid, grid_of, length_seen
from fit.recordings.hanger_path import check_path, check_sights, gaps_of, held_curve, is_known, led_across
from fit.recordings.held_edge import HeldEdge
from fit.recordings.intact import intact_part
from fit.recordings.smoothing import best_cut_off, smoothing_spline
from formats.arrays import Booleans, Floats
from formats.findings import FEWEST_SEEN
from formats.garment import Garment
from formats.impossible_points import MOST_LEFT_OUT, find_impossible
from formats.missing import origin_of
from formats.rig import Rig, Vector
from formats.rig_bodies import first_entered
from formats.sights import judged_points, on_held_edge
from formats.take import Take
from formats.two_clocks import shows_points

Curve = Callable[[Floats], Floats]

# Observations of a point, below which it has no curve. Our choice: twice the four numbers of a cubic. Half would leave
# no residual to smooth by; double was not tried.
FEWEST_SIGHTINGS = 8
# The constant offset of a tracked point from its material point, per axis [m]. For a marker: glue, and the choice of
# the marker's middle. For a corner in a silhouette: tracking of synthetic swatches (`benchmarks/tracking.py`, "constant
# part").
MARKER_OFFSET, SILHOUETTE_OFFSET = 1e-3, 2e-3
# s from the nearest sighting of a point, up to which its spline is still used. Our choice: it bridges gaps of 0.5 s. A
# swing of 0.10 m at 0.9 Hz, with a tenth of it at 2.2 Hz, is then missed by 17 mm rms. At half 4 mm, at twice 74 mm
# (measured, noise of 2 mm).
LONGEST_BRIDGE = 0.25


@dataclass(frozen=True)
class Windows:
    """Stretches of a recording [s] with free simulation, and the stretches between with the observer's pull."""

    free: float
    caught: float

    def is_free(self, instants: Floats) -> Booleans:
        """Return whether the cloth moves freely at `instants` [s], (n,)."""
        return np.asarray(np.mod(instants, self.free + self.caught) < self.free)


@dataclass(frozen=True, repr=False)
class Recording:
    """One take in the world frame.

    - `time` [s], (frames,)
    - `points` [m], (frames, points, 3), NaN where not valid
    - `point_sd` [m], (points,): per axis, root mean square
    - `held`: maps (n,) instants [s] to (n, 6), left and right end of the held edge [m]
    - `held_seen` [m], (measurements, 6): the measured ends, NaN where not seen
    - `held_time` [s], (measurements,): of the measured ends, on the clock of `time`; None: `time` itself
    - `held_sd` [m]: stated, per axis
    - `held_cut_off` [Hz]: of the path's spline
    - `target_curves`: per point, maps (n,) instants to (n, 6), position [m] and velocity [m/s]
    - `edge_turn`: maps (n,) instants to (n, 2), yaw and roll of the tracked held edge against the path [rad]
    - `turn_rms` [rad], (2,): of both, over the takes that are fitted together (`prepare_together`)
    - `slip_at` [s]: the middle of a possible slip in the clips (`fit.recordings.held_edge`)
    - `judged`, (points,): false for points on a clamped edge or in a clip, which measure the boundary and not the cloth
    - `windows`: the observer's pull acts and residuals count inside these; None: everywhere
    - `held_error` [m]: constant error of the held ends on the hanger, per axis, if the rig states one
    - `offset_sd` [m]: constant offset of a point from its material point, per axis
    - `is_calibrated`: false for a sensor whose rig was never measured (`hangtime calibrate`)
    - `is_imported`: gravity and held edge are as an imported file states them
    - `bodies`: the standing bodies near the cloth, in the world frame
    - `impossible`: share of observed positions that the cloth cannot reach (`formats.impossible_points`)
    - `viewpoint` [m], world frame: the camera, the origin of depth rays
    - `camera`: the camera's faults and their corrections (`fit.recordings.camera`)
    - `raw_points` [m], (frames, points, 3): points before the move to their material positions; None: `points`
    - `begin` [s]: the instant of `time` 0, counted from the take's first frame (`formats.missing`)
    - `gaps` [s]: begin and end of each stretch in which the hanger was lost for too long to know its path
    """

    take_id: str
    garment: Garment
    time: Floats
    points: Floats
    valid: Booleans
    point_sd: Floats
    held_sd: float
    held: Curve
    held_seen: Floats
    held_cut_off: float
    target_curves: tuple[Curve, ...]
    edge_turn: Curve
    turn_rms: Floats
    slip_at: float
    judged: Booleans
    windows: Windows | None = None
    held_error: float = 0.0
    offset_sd: float = MARKER_OFFSET
    is_calibrated: bool = True
    is_imported: bool = False
    impossible: float = 0.0
    bodies: tuple[Body, ...] = ()
    held_time: Floats | None = None
    viewpoint: Vector = (0.0, 0.0, 0.0)
    camera: Camera = field(default_factory=Camera)
    raw_points: Floats | None = None
    gaps: tuple[tuple[float, float], ...] = ()
    begin: float = 0.0

    def __repr__(self) -> str:
        """Return one line: the take's name and the size of its arrays."""
        return f"Recording({self.take_id!r}, {len(self.time)} frames of {len(self.garment.points)} points)"

    @property
    def has_material_points(self) -> bool:
        """Whether a constant offset between points and simulation is a model-form error."""
        return self.garment.point_kind == "material" or self.camera.is_placed

    @property
    def seen_points(self) -> Floats:
        """Points as tracked [m], (frames, points, 3), NaN where not valid, before the move to material positions."""
        return self.points if self.raw_points is None else self.raw_points

    @cached_property
    def grid(self) -> Grid | None:
        """The grid that the points form."""
        return grid_of(self.garment)

    @cached_property
    def grid_length(self) -> Floats:
        """Length of the tracked grid down the cloth [m], (frames,), NaN where unseen or without a grid."""
        if self.grid is None:
            return np.full(len(self.time), np.nan)
        return length_seen(self.seen_points, self.held(self.time), self.grid)

    @property
    def counted(self) -> Booleans:
        """Return the points to compare with the simulation, (frames, points)."""
        seen = self.valid & self.judged
        return seen if self.windows is None else seen & self.windows.is_free(self.time)[:, None]

    @property
    def has_curve(self) -> Booleans:
        """Which points are seen often enough for `target_curves`, (points,)."""
        return np.asarray(self.valid.sum(0) >= FEWEST_SIGHTINGS)

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return float(self.time[-1])

    def targets(self, instants: Floats) -> tuple[Floats, Floats]:
        """Return the observer's targets, (n, points, 6), and trust, (n, points), at `instants` [s]."""
        wanted = np.stack([curve(instants) for curve in self.target_curves], 1)
        trust = np.zeros(wanted.shape[:2])
        for k in np.flatnonzero(self.has_curve):
            seen = self.time[self.valid[:, k]]
            after = np.clip(np.searchsorted(seen, instants), 1, len(seen) - 1)
            distance = np.minimum(np.abs(instants - seen[after - 1]), np.abs(instants - seen[after]))
            trust[:, k] = distance <= LONGEST_BRIDGE
        if self.windows is not None:
            trust[self.windows.is_free(instants)] = 0.0
        return wanted, trust

    def with_points(self, points: Floats) -> Recording:
        """Return the recording with other points, (frames, points, 3), and refitted curves."""
        return replace(self, points=points, target_curves=_target_curves(self.time, points, self.valid), windows=None)

    def with_held(self, held_seen: Floats, held_time: Floats | None = None) -> Recording:
        """Return the recording with other measured ends of the held edge, (n, 6), and a refitted path.

        held_time [s], (n,): their instants; None: those of the recording's own measured ends
        """
        when = self.held_time if held_time is None else held_time
        path = held_curve(self.time if when is None else when, held_seen, self.held_cut_off)
        return replace(self, held_seen=held_seen, held_time=when, held=path)


def world_from_sensor(gravity: tuple[float, float, float]) -> Floats:
    """Return the rotation, (3, 3), from the rig's frame to the world frame."""
    up = -np.asarray(gravity, float)
    up /= np.linalg.norm(up)
    across = np.array([1.0, 0.0, 0.0])
    across -= (across @ up) * up
    if np.linalg.norm(across) < 1e-6:
        across = np.array([0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(up, across), up])


def prepare(take: Take, steps: CameraSteps = EVERY_STEP) -> Recording:
    """Convert a take into a recording for simulation, from the first to the last observation of the hanger.

    Both sides of a gap in the hanger's path are used. The cloth is not judged until the gap no longer affects its
    motion. A take with missing stretches is reduced to its useful part (`fit.recordings.intact`). The camera's faults
    are corrected (`fit.recordings.camera`).

    Raises:
        DriveError: the hanger's path has a jump, or is hardly seen.
        FitError: too few frames or points, or a body of the rig that the held edge passes through.
    """
    origin, whole = origin_of(take), take
    take = intact_part(whole)
    if len(take.time) < FEWEST_SEEN:
        raise FitError(
            f"the take has {len(take.time)} frames, at least {FEWEST_SEEN} are needed",
            where=take.take_id,
            advice="record a longer take",
        )
    rotation = world_from_sensor(take.rig.gravity)
    held_valid = np.asarray(take.held_valid.all(1) & np.isfinite(take.held).all((1, 2)))
    held_seen = np.where(held_valid[:, None], (take.held @ rotation.T).reshape(len(take.time), 6), np.nan)
    check_path(take.take_id, (take.time - origin)[held_valid], held_seen[held_valid], is_whole=False)
    kept = _within_sight(held_valid)
    clock, held_valid, held_seen = take.time[kept] - take.time[kept][0], held_valid[kept], held_seen[kept]
    gaps = gaps_of(clock[held_valid])
    pictures = np.arange(len(take.time))[kept][shows_points(take)[kept]]
    points = take.points[pictures] @ rotation.T
    valid = take.points_valid[pictures] & np.isfinite(take.points[pictures]).all(2)
    places = np.array([p.at_m for p in take.garment.points])
    cannot_be = find_impossible(points, valid, take.points_sd[pictures], places)
    impossible = float(cannot_be.sum() / max(valid.sum(), 1))
    if impossible <= MOST_LEFT_OUT:
        valid &= ~cannot_be
    seen_sd = np.where(valid[..., None], take.points_sd[pictures], np.nan)
    at_pictures = take.time[pictures] - take.time[kept][0]
    valid &= is_known(at_pictures, gaps)[:, None]
    on_edge, judged = on_held_edge(take.garment), judged_points(take.garment)
    with np.errstate(invalid="ignore"):
        point_sd = np.sqrt(np.array([np.nanmean(seen_sd[:, k] ** 2) if np.isfinite(seen_sd[:, k]).any() else 0.0
                                     for k in range(points.shape[1])]))  # fmt: skip
    held_sd = float(np.sqrt(np.mean(take.held_sd[kept][held_valid] ** 2)))
    cut_off = best_cut_off(*led_across(clock[held_valid], held_seen[held_valid]))
    path = held_curve(clock, held_seen, cut_off)
    frames = Seen(at_pictures, np.where(valid[..., None], points, np.nan))
    if steps.stamps and take.rig.hanger is None:  # else points and hanger were seen in the same pictures
        frames = retimed(at_pictures, frames.points, path, take.garment, on_edge)
    if steps.skew:
        frames = straightened(frames, take.garment)
    camera = frames.camera
    if steps.edge and (edge := edge_shown(frames, path, take.garment)) is not None:
        held_seen, camera = edge.of(held_seen), replace(camera, edge=edge)
        path = held_curve(clock, held_seen, cut_off)
    raw_points = frames.points
    if steps.frames and take.rig.hanger is None:  # else the row's error is the hanger's
        frames = steadied(replace(frames, camera=camera), path, take.garment)
        camera = frames.camera
    at_place = in_place(frames, path, take.garment) if steps.places else None
    if at_place is not None:
        camera = examined(replace(frames, camera=camera), path, take.garment)
    first = frames.time[0]
    time, held_time = frames.time - first, clock - first
    gaps = [(begin - first, end - first) for begin, end in gaps]
    seen = frames.points if at_place is None else at_place
    seen = np.where(is_known(time, gaps)[:, None, None], seen, np.nan)
    valid = np.asarray(np.isfinite(seen).all(2))
    sights, left = int(whole.points_valid[:, judged].sum()), int(valid[:, judged].sum())
    check_sights(take.take_id, sights, left, has_gaps=bool(gaps) or take is not whole)
    held = held_curve(held_time, held_seen, cut_off)
    on_row = HeldEdge(time, seen[:, on_edge], places[on_edge, 0], held)
    turn, turn_rms = on_row.turn()
    is_marker = take.rig.sensor is None and take.garment.point_kind == "material"
    return Recording(
        take_id=take.take_id, garment=take.garment, time=time, points=seen,
        valid=valid, point_sd=point_sd, held_sd=held_sd, held=held, held_seen=held_seen, held_cut_off=cut_off,
        target_curves=_target_curves(time, seen, valid), edge_turn=turn, turn_rms=_or_one(turn_rms),
        slip_at=on_row.slip_at(),
        judged=judged, held_error=_held_error(take.rig),
        offset_sd=MARKER_OFFSET if is_marker else SILHOUETTE_OFFSET,
        is_calibrated=take.rig.sensor is None or take.rig.calibration is not None, impossible=impossible,
        is_imported=take.rig.sensor is None and take.rig.calibration is None,
        bodies=_bodies(take, rotation, held_seen[held_valid]), held_time=held_time,
        viewpoint=_world(rotation, take.rig.viewpoint),
        camera=camera,
        raw_points=None if at_place is None else raw_points, gaps=tuple(gaps),
        begin=float(take.time[kept][0] - origin + first),
    )  # fmt: skip


def prepare_together(
    training: Sequence[Take], held_out: Sequence[Take] = ()
) -> tuple[list[Recording], list[Recording]]:
    """Convert fitted and held-out takes into recordings that share the amplitudes of effects.

    Raises:
        DriveError, FitError: as `prepare`.
    """
    train, test = [prepare(t) for t in training], [prepare(t) for t in held_out]
    # Takes without a tracked edge have no rotation, and do not count in the rms of the other takes.
    turns = np.concatenate([np.zeros((0, 2)), *(turn for r in train if (turn := r.edge_turn(r.time)).any())])
    together = _or_one(np.sqrt((turns**2).mean(0)) if len(turns) else np.zeros(2))
    return [replace(r, turn_rms=together) for r in train], [replace(r, turn_rms=together) for r in test]


def _or_one(turn_rms: Floats) -> Floats:
    """Return a divisor for the rotation: 1 if there is none, so that it stays zero."""
    return np.where(turn_rms > 0, turn_rms, 1.0)


def _world(rotation: Floats, place: Vector) -> Vector:
    x, y, z = (rotation @ place).tolist()
    return x, y, z


def _bodies(take: Take, rotation: Floats, ends: Floats) -> tuple[Body, ...]:
    """Return the rig's bodies in the world frame; ends [m], (n, 6), of the held edge, which must stay outside.

    Raises:
        MismatchError: the held edge enters one of them.
    """
    entered = first_entered(take.rig, ends.reshape(-1, 2, 3) @ rotation)
    if entered is not None:
        raise MismatchError(entered.words, where=take.take_id, advice=entered.advice)
    found: list[Body] = []
    for body in take.rig.near:
        at, radius = _world(rotation, body.at_m), body.radius_m or 0.0
        if body.normal is not None:
            found.append(half_space(at, _world(rotation, body.normal)))
        elif body.to_m is not None:
            found.append(capsule(at, _world(rotation, body.to_m), radius))
        else:
            found.append(sphere(at, radius))
    return tuple(found)


def _held_error(rig: Rig) -> float:
    """Return the stated deviation of the held ends on the hanger [m], root mean square per axis; 0 if not stated."""
    stated = rig.calibration.held_sd_m if rig.calibration is not None else None
    return float(np.sqrt(np.mean(np.square(stated)))) if stated is not None else 0.0


def _within_sight(held_valid: Booleans) -> slice:
    """Return the frames from the first to the last observation of the hanger."""
    seen = np.flatnonzero(held_valid)
    return slice(int(seen[0]), int(seen[-1]) + 1)


def _target_curves(time: Floats, points: Floats, valid: Booleans) -> tuple[Curve, ...]:
    """Return the curves of all points; points seen in the same frames share one spline, which is many times cheaper."""
    from scipy.interpolate import BSpline

    curves: list[Curve] = [lambda instants: np.zeros((len(instants), 6))] * points.shape[1]
    patterns: dict[bytes, list[int]] = {}
    for k in np.flatnonzero(valid.sum(0) >= FEWEST_SIGHTINGS).tolist():
        patterns.setdefault(valid[:, k].tobytes(), []).append(k)
    for alike in patterns.values():
        frames = valid[:, alike[0]]
        together = smoothing_spline(time[frames], points[frames][:, alike].reshape(frames.sum(), -1))
        for n, k in enumerate(alike):
            own = np.ascontiguousarray(together.c[:, 3 * n : 3 * n + 3])
            curves[k] = _target_curve(time[frames], BSpline(together.t, own, together.k))
    return tuple(curves)


def _target_curve(seen: Floats, splines: Any) -> Curve:
    slopes = splines.derivative()
    first, last = seen[0], seen[-1]

    def target_at(instants: Floats) -> Floats:
        inside = np.clip(instants, first, last)
        return np.concatenate([splines(inside), slopes(inside)], 1)

    return target_at

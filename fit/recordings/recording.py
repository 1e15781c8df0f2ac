"""A take made ready for simulation: world frame, smooth hanger path, targets for the observer.

World frame: z against gravity, x along the sensor's x as far as level, y = z × x, metres.
The hanger's path is a spline that is smooth in its acceleration, with a cut-off that the take chooses
(`fit.recordings.smoothing`). The observer's targets are cubic smoothing splines with a cut-off at 6 Hz. Both are flat
for hand-made motion, within 0.1 % at 1 Hz. So sensor noise does not become acceleration, and swings keep their size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.errors import DriveError, FitError
from fit.recordings.bodies import Body, capsule, half_space, sphere
from fit.recordings.held_edge import FEWEST_FRAMES, HeldEdge, place_along
from fit.recordings.impossible_points import MOST_LEFT_OUT, find_impossible
from fit.recordings.intact import longest_intact
from fit.recordings.smoothing import best_cut_off, smoothing_spline, steady_spline
from formats.arrays import Booleans, Floats
from formats.garment import Garment
from formats.rig import Rig, Vector
from formats.take import LONGEST_GAP, Take

Curve = Callable[[Floats], Floats]

FASTEST_HANGER = 8.0  # m/s, twice what a hand can do with a hanger
HARDEST_PULL = 150.0  # m/s^2, 15 times gravity
OUTLYING = 10.0  # times what a path's noise is in the median, stated deviations may be too small
ON_EDGE = 0.02  # of the points' height, within which of the held edge, or of a clip, one moves with the hanger
NO_HAND = "no hand moves like that: check the markers' ids and the depth there"
FEWEST_PLACES = 8  # of a point, below which it has no curve
# The constant offset of a tracked point from its material point, per axis [m]. For a marker: glue, and the choice of
# the marker's middle. For a corner in a silhouette: tracking of synthetic swatches (`benchmarks/tracking.py`, "constant
# part").
MARKER_OFFSET, SILHOUETTE_OFFSET = 1e-3, 2e-3
LONGEST_BRIDGE = 0.25  # s without a point over which its spline is still believed


@dataclass(frozen=True)
class Windows:
    """Stretches of a recording [s] that are simulated freely, and those between in which a pull catches the cloth."""

    free: float
    caught: float

    def is_free(self, instants: Floats) -> Booleans:
        """Return whether the cloth moves freely at `instants` [s], (n,)."""
        return np.asarray(np.mod(instants, self.free + self.caught) < self.free)


@dataclass(frozen=True)
class Recording:
    """One take in the world frame.

    - `time` [s], (frames,)
    - `points` [m], (frames, points, 3), NaN where not valid
    - `point_sd` [m], (points,): per axis, root mean square
    - `held`: maps (n,) instants [s] to (n, 6), left and right end of the held edge [m]
    - `held_seen` [m], (frames, 6): the measured ends, NaN where not seen
    - `held_sd` [m]: stated, per axis
    - `held_cut_off` [Hz]: of the path's spline
    - `target_curves`: per point, maps (n,) instants to (n, 6), place [m] and velocity [m/s]
    - `edge_turn`: maps (n,) instants to (n, 2), yaw and roll of the tracked held edge against the path [rad]
    - `turn_rms` [rad], (2,): of both, over the takes that are fitted together (`prepare_together`)
    - `slip_at` [s]: the middle of a possible slip in the clips (`fit.recordings.held_edge`)
    - `judged`, (points,): false for points on a clamped edge or in a clip, which measure the boundary and not the cloth
    - `windows`: the observer's pull acts and residuals count inside these; None: everywhere
    - `held_error` [m]: constant error of the held ends on the hanger, per axis, if the rig states one
    - `offset_sd` [m]: constant offset of a point from its material point, per axis
    - `is_calibrated`: false for a sensor whose rig nobody measured (`hangtime calibrate`)
    - `bodies`: the standing bodies near the cloth, in the world frame
    - `impossible`: share of the points' sightings where the cloth cannot be (`fit.recordings.impossible_points`)
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
    impossible: float = 0.0
    bodies: tuple[Body, ...] = ()

    @property
    def counted(self) -> Booleans:
        """Return the points to compare with the simulation, (frames, points)."""
        seen = self.valid & self.judged
        return seen if self.windows is None else seen & self.windows.is_free(self.time)[:, None]

    @property
    def has_curve(self) -> Booleans:
        """Return the points that are seen often enough for `target_curves`, (points,)."""
        return np.asarray(self.valid.sum(0) >= FEWEST_PLACES)

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
        """Return the same recording with other points, (frames, points, 3), their curves fitted anew."""
        return replace(self, points=points, target_curves=_target_curves(self.time, points, self.valid), windows=None)

    def with_held(self, held_seen: Floats) -> Recording:
        """Return the same recording with other measured ends of the held edge, (frames, 6), their path fitted anew."""
        path = _held_curve(self.time, held_seen, self.held_cut_off)
        return replace(self, held_seen=held_seen, held=path)


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


def prepare(take: Take) -> Recording:
    """Turn a take into a recording that can be simulated, from the first to the last sight of the hanger.

    Of a take with holes only the longest intact stretch is used.

    Raises:
        DriveError: the hanger's path has a gap or a jump, or is hardly seen.
        FitError: too few frames or points, or a body of the rig that the held edge passes through.
    """
    take = longest_intact(take)
    if len(take.time) < FEWEST_FRAMES:
        raise FitError(
            f"the take has {len(take.time)} frames, at least {FEWEST_FRAMES} are needed",
            where=take.take_id,
            advice="record a longer take",
        )
    rotation = world_from_sensor(take.rig.gravity)
    held_valid = np.asarray(take.held_valid.all(1) & np.isfinite(take.held).all((1, 2)))
    held_seen = np.where(held_valid[:, None], (take.held @ rotation.T).reshape(len(take.time), 6), np.nan)
    check_path(take.take_id, (take.time - take.time[0])[held_valid], held_seen[held_valid])
    kept = _within_sight(held_valid)
    time, held_valid, held_seen = take.time[kept] - take.time[kept][0], held_valid[kept], held_seen[kept]
    points = take.points[kept] @ rotation.T
    valid = take.points_valid[kept] & np.isfinite(take.points[kept]).all(2)
    places = np.array([p.at_m for p in take.garment.points])
    cannot_be = find_impossible(points, valid, take.points_sd[kept], places)
    impossible = float(cannot_be.sum() / max(valid.sum(), 1))
    if impossible <= MOST_LEFT_OUT:
        valid &= ~cannot_be
    on_edge = _is_held(take.garment, places)
    judged = ~on_edge if (~on_edge).sum() >= 3 else np.ones(len(places), bool)
    if valid[:, judged].sum() < FEWEST_FRAMES:
        raise FitError(
            "hardly any point of the garment below the held edge was seen",
            where=take.take_id,
            advice="check with `hangtime takes show`, then record again with all of the garment in view",
        )
    seen_sd = np.where(valid[..., None], take.points_sd[kept], np.nan)
    with np.errstate(invalid="ignore"):
        point_sd = np.sqrt(np.array([np.nanmean(seen_sd[:, k] ** 2) if valid[:, k].any() else 0.0
                                     for k in range(points.shape[1])]))  # fmt: skip
    held_sd = float(np.sqrt(np.mean(take.held_sd[kept][held_valid] ** 2)))
    cut_off = best_cut_off(time[held_valid], held_seen[held_valid])
    held = _held_curve(time, held_seen, cut_off)
    seen = np.where(valid[..., None], points, np.nan)
    edge = HeldEdge(time, seen[:, on_edge], places[on_edge, 0], held)
    turn, turn_rms = edge.turn()
    return Recording(
        take_id=take.take_id, garment=take.garment, time=time, points=seen,
        valid=valid, point_sd=point_sd, held_sd=held_sd, held=held, held_seen=held_seen, held_cut_off=cut_off,
        target_curves=_target_curves(time, points, valid), edge_turn=turn, turn_rms=_or_one(turn_rms),
        slip_at=edge.slip_at(),
        judged=judged, held_error=_held_error(take.rig),
        offset_sd=MARKER_OFFSET if take.rig.sensor is None else SILHOUETTE_OFFSET,
        is_calibrated=take.rig.sensor is None or take.rig.calibration is not None, impossible=impossible,
        bodies=_bodies(take, rotation, held_seen[held_valid]),
    )  # fmt: skip


def prepare_together(
    training: Sequence[Take], held_out: Sequence[Take] = ()
) -> tuple[list[Recording], list[Recording]]:
    """Turn the takes that are fitted to and those that are judged on into recordings that can share effects' sizes.

    Raises:
        DriveError, FitError: as `prepare`.
    """
    train, test = [prepare(t) for t in training], [prepare(t) for t in held_out]
    # Takes that do not show their edge do not turn, and have no part in how much the others do.
    turns = np.concatenate([np.zeros((0, 2)), *(turn for r in train if (turn := r.edge_turn(r.time)).any())])
    together = _or_one(np.sqrt((turns**2).mean(0)) if len(turns) else np.zeros(2))
    return [replace(r, turn_rms=together) for r in train], [replace(r, turn_rms=together) for r in test]


def _or_one(turn_rms: Floats) -> Floats:
    """Return a divisor for the turn: 1 for no turn, which then stays zero."""
    return np.where(turn_rms > 0, turn_rms, 1.0)


def _is_held(garment: Garment, places: Floats) -> Booleans:
    """Return the points, at places [m], (points, 2), that move with the hanger: all on a clamped edge, or those at
    clips.
    """
    ends = np.asarray(garment.outline_m[:2], float)
    share, _ = place_along(places, ends)
    share = np.clip(share if garment.held == "edge" else np.round(share), 0.0, 1.0)
    apart = np.linalg.norm(places - ends[0] - share[:, None] * (ends[1] - ends[0]), axis=1)
    return np.asarray(apart < ON_EDGE * float(np.ptp(places[:, 1])))


def _bodies(take: Take, rotation: Floats, ends: Floats) -> tuple[Body, ...]:
    """Return the rig's bodies in the world frame; ends [m], (n, 6), of the held edge, which stays outside of them.

    Raises:
        FitError: the held edge comes into one of them.
    """
    share = np.linspace(0, 1, 11)[:, None]
    edge = ends[:, None, :3] * (1 - share) + ends[:, None, 3:] * share

    def world(place: Vector) -> Vector:
        x, y, z = (rotation @ place).tolist()
        return x, y, z

    found: list[Body] = []
    for number, body in enumerate(take.rig.near, 1):
        at, radius = world(body.at_m), body.radius_m or 0.0
        if body.normal is not None:
            found.append(half_space(at, world(body.normal)))
        elif body.to_m is not None:
            found.append(capsule(at, world(body.to_m), radius))
        else:
            found.append(sphere(at, radius))
        depth = -float(found[-1].distance(edge).min())
        if depth > 0:
            raise FitError(
                f"the held edge comes {1e3 * depth:.0f} mm into the rig's body {number}, a {body.kind}",
                where=take.take_id,
                advice="check where it stands: metres in the sensor frame, a plane's normal towards the cloth",
            )
    return tuple(found)


def _held_error(rig: Rig) -> float:
    """Stated deviation of the held ends on the hanger [m], root mean square per axis; 0 where none is stated."""
    stated = rig.calibration.held_sd_m if rig.calibration is not None else None
    return float(np.sqrt(np.mean(np.square(stated)))) if stated is not None else 0.0


def _within_sight(held_valid: Booleans) -> slice:
    """Frames from the first to the last sight of the hanger: before and after it is fetched and put away."""
    seen = np.flatnonzero(held_valid)
    return slice(int(seen[0]), int(seen[-1]) + 1)


def check_path(name: str, seen: Floats, places: Floats) -> None:
    """Check that the held ends' path can be followed, from when and where they were seen, (n,) [s] and (n, 6) [m].

    Raises:
        DriveError: they were seen in too few frames, are lost for too long, or jump.
    """
    if len(seen) < FEWEST_FRAMES:
        raise DriveError(
            f"the hanger was seen in {len(seen)} frames only",
            where=name,
            advice="keep both markers in view; check with `hangtime takes show`",
        )
    gaps = np.diff(seen)
    if gaps.max() > LONGEST_GAP:
        at = seen[int(np.argmax(gaps))]
        raise DriveError(
            f"the hanger is lost for {gaps.max():.2f} s at {at:.2f} s",
            where=name,
            advice=f"gaps above {LONGEST_GAP} s cannot be bridged; record again with both markers in view",
        )
    speed = np.linalg.norm(np.diff(places.reshape(-1, 2, 3), axis=0), axis=2) / np.diff(seen)[:, None]
    if speed.max() > FASTEST_HANGER:
        at = seen[int(np.argmax(speed.max(1)))]
        raise DriveError(
            f"the hanger jumps at {at:.2f} s ({speed.max():.0f} m/s)",
            where=name,
            advice=NO_HAND,
        )
    pull, most = _accelerations(seen, places.reshape(-1, 2, 3))
    jumps = np.flatnonzero((pull > most).any(1))
    if len(jumps):
        first = int(jumps[0])
        raise DriveError(
            f"the hanger jumps at {seen[1 + first]:.2f} s ({pull[first].max():.0f} m/s2)", where=name, advice=NO_HAND
        )


def _accelerations(seen: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Return how hard both ends are accelerated from frame to frame, and the most that can be, (n - 2, 2) [m/s^2].

    seen [s], (n,); places [m], (n, 2, 3). Noise counts for more between close frames. A second difference of places
    over h1 and h2 seconds has a multiple of their deviation:

        2 / (h1 + h2) sqrt(1/h1^2 + (1/h1 + 1/h2)^2 + 1/h2^2)
    """
    before, after = np.diff(seen)[:-1, None], np.diff(seen)[1:, None]
    slopes = np.diff(places, axis=0) / np.diff(seen)[:, None, None]
    pull = 2 * np.linalg.norm(np.diff(slopes, axis=0), axis=2) / (before + after)
    gain = 2 / (before + after) * np.sqrt(1 / before**2 + (1 / before + 1 / after) ** 2 + 1 / after**2)
    return pull, np.hypot(HARDEST_PULL, OUTLYING * gain * np.median(pull / gain, axis=0))


def _held_curve(time: Floats, held_seen: Floats, cut_off: float) -> Curve:
    valid = np.isfinite(held_seen[:, 0])
    splines = steady_spline(time[valid], held_seen[valid], cut_off)
    first, last = time[valid][0], time[valid][-1]

    def held_at(instants: Floats) -> Floats:
        inside = np.clip(instants, first, last)
        return np.asarray(splines(inside))

    return held_at


def _target_curves(time: Floats, points: Floats, valid: Booleans) -> tuple[Curve, ...]:
    """Curves of all points; those that are seen in the same frames share one spline, which is many times cheaper."""
    from scipy.interpolate import BSpline

    curves: list[Curve] = [lambda instants: np.zeros((len(instants), 6))] * points.shape[1]
    patterns: dict[bytes, list[int]] = {}
    for k in np.flatnonzero(valid.sum(0) >= FEWEST_PLACES).tolist():
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

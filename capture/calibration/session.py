"""Calibrate a rig from a still scene: measure each quantity that is in view, and leave the others unchanged.

    the hanger with its markers     depth scale, depth offset
    two markers on a plumb line     gravity
    a marker in each clip           where the clips hold, in the hanger's frame

The offset comes first, because it locates a plate in depth. The scale follows, then positions divided by the
scale, then gravity. The held ends come last, in a frame that gravity helps to define. Equations:
`capture.calibration.measures`.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from capture.calibration.depth_offset import plate_offset
from capture.calibration.frames import StillFrames, watch
from capture.calibration.measures import (
    Estimate,
    depth_scale,
    gravity_of_plumb_line,
    held_ends_seen,
    mean_offset,
    median_of_frames,
    place_of_frames,
)
from capture.errors import CalibrationError, UntrackableError
from capture.hanger.marker_detection import MarkerDetector, diagonal_crossing
from capture.hanger.marker_plates import PlatePlacer
from capture.hanger.seen_otherwise import seen_otherwise
from firmware_host.depth_sensor import DepthSensor
from formats.arrays import Floats
from formats.descriptions import DEPTH_SCALES
from formats.plausible_rig import DICTIONARIES
from formats.rig import Calibration, Hanger, Rig, Sensor, Vector

SHORTEST_LINE = 0.1  # m between a plumb line's markers: below, gravity is known to two degrees at best
GRAVITY_BY_EYE = np.radians(2.0)  # rad, for a rig whose gravity was never measured
LEFT_MARKER, RIGHT_MARKER, UPPER, LOWER, LEFT_CLIP, RIGHT_CLIP = range(6)  # rows of the arrays of markers


@dataclass(frozen=True, kw_only=True)
class Measured:
    """The result of one calibration; None for a quantity that was not measured.

    - `rig`: the rig with the measured values
    - `frames`: number of still frames used, and of processed frames
    - `gravity`: unit vector, sd [rad]
    - `scale`: measured over true depth
    - `offset` [px], (2,), NaN along an axis that no plate showed
    - `held` [m], (2, 3)
    - `distance_m`: between the hanger's markers as measured
    """

    rig: Rig
    frames: int
    seen: int
    gravity: Estimate | None
    scale: Estimate | None
    offset: Estimate | None
    held: Estimate | None
    distance_m: float


def calibrate(
    sensor: DepthSensor, rig: Rig, *, plumb_ids: tuple[int, int], clip_ids: tuple[int, int], seconds: float,
    accelerometer: Estimate | None = None,
) -> Measured:  # fmt: skip
    """Measure a rig from the next seconds [s] of a sensor, while the scene is still.

    - `plumb_ids`: upper and lower marker of the plumb line
    - `clip_ids`: markers in the left and in the right clip, of the hanger's dictionary and size
    - `accelerometer`: gravity from the sensor's accelerometer, used if no plumb line is in view.

    Raises:
        CalibrationError: no markers, nothing still, a plumb line that is too short, or markers that are not as far
            apart as the rig says.
        UntrackableError: the rig has no hanger or another sensor, or an id is used twice.
    """
    hanger, camera = _described(rig, sensor)
    ids = (*hanger.ids, *plumb_ids, *clip_ids)
    if len(set(ids)) != len(ids):
        raise UntrackableError(
            f"a marker id is used twice among {', '.join(map(str, ids))}", where="--plumb-ids, --clip-ids",
            advice="give six different ones: two each to hanger, plumb line and clips",
        )  # fmt: skip
    count = DICTIONARIES.get(hanger.dictionary, 0)  # 0: the detector refuses the name
    if wrong := [number for number in ids if count and not 0 <= number < count]:
        raise UntrackableError(
            f"there is no marker {wrong[0]} in {hanger.dictionary}", where="--plumb-ids, --clip-ids",
            advice=f"give ids from 0 to {count - 1}",
        )  # fmt: skip
    detector = MarkerDetector(hanger.dictionary, ids)
    still = watch(
        sensor, detector, seconds, lambda colour: seen_otherwise(colour, hanger, is_turned=sensor.info.is_turned)
    )
    before = rig.calibration or Calibration()
    offset = _offset(still, PlatePlacer(camera, hanger.marker_size_m))
    shift = before.depth_offset_px
    if offset is not None:
        known = np.where(np.isfinite(offset.value), offset.value, shift)
        shift = float(known[0]), float(known[1])
    placer = PlatePlacer(camera, hanger.marker_size_m, shift)
    left, right = (_place(still, placer, row) for row in (LEFT_MARKER, RIGHT_MARKER))
    scale, distance = None, float("nan")
    if left is not None and right is not None:
        distance = float(np.linalg.norm(right.value - left.value))
        scale = depth_scale(left, right, hanger.marker_distance_m)
        if not DEPTH_SCALES[0] < float(scale.value) < DEPTH_SCALES[1]:
            raise CalibrationError(
                f"the markers are {1e3 * distance:.0f} mm apart, the rig says {1e3 * hanger.marker_distance_m:.0f}",
                where=rig.name, advice="measure that distance again, and the markers' size",
            )  # fmt: skip
    plumb = _plumb_line(still, placer)
    gravity = plumb or accelerometer
    described = msgspec.structs.replace(rig, sensor=camera)
    if gravity is not None:
        described = msgspec.structs.replace(described, gravity=_vector(gravity.value))
    factor = float(scale.value) if scale is not None else before.depth_scale
    held = _held(still, placer, factor, _gravity_sd(gravity, before), described)
    if held is not None:
        hanger = msgspec.structs.replace(hanger, held_m=(_vector(held.value[0]), _vector(held.value[1])))
    calibration = before
    if gravity is not None:
        calibration = msgspec.structs.replace(
            calibration, gravity_from="plumb line" if plumb else "accelerometer",
            gravity_sd_degrees=_rounded(np.degrees(gravity.sd)),
        )  # fmt: skip
    if scale is not None:
        calibration = msgspec.structs.replace(
            calibration, depth_scale=round(float(scale.value), 5), depth_scale_sd=_rounded(scale.sd)
        )
    if offset is not None and np.isfinite(offset.value).any():
        known_sd = before.depth_offset_sd_px or (np.inf, np.inf)
        right_sd, down_sd = np.where(np.isfinite(offset.value), offset.sd, known_sd).tolist()
        calibration = msgspec.structs.replace(
            calibration, depth_offset_px=(round(shift[0], 3), round(shift[1], 3)),
            depth_offset_sd_px=(_rounded(right_sd), _rounded(down_sd)),
        )  # fmt: skip
    if held is not None:
        calibration = msgspec.structs.replace(calibration, held_sd_m=(_vector(held.sd[0]), _vector(held.sd[1])))
    return Measured(
        rig=msgspec.structs.replace(described, hanger=hanger, calibration=calibration), frames=len(still.depth),
        seen=still.seen, gravity=gravity, scale=scale, offset=offset, held=held, distance_m=distance,
    )  # fmt: skip


def _described(rig: Rig, sensor: DepthSensor) -> tuple[Hanger, Sensor]:
    if rig.hanger is None:
        raise UntrackableError(
            "has no [hanger]", where=rig.name, advice="describe its markers as in docs/reference/file-formats.md"
        )
    if rig.hanger.marker != "fiducial":
        raise UntrackableError(
            "its hanger has dots", where=rig.name, advice="calibrate with a hanger that has fiducial markers"
        )
    info, camera = sensor.info, rig.sensor or sensor.info.intrinsics
    if (info.width, info.height) != (camera.width, camera.height):
        raise UntrackableError(
            f"{info.uri} gives {info.width} x {info.height} pixels, the rig says {camera.width} x {camera.height}",
            where=rig.name, advice="leave [sensor] out of the rig to take over the sensor's own",
        )  # fmt: skip
    return rig.hanger, camera


def _offset(still: StillFrames, placer: PlatePlacer) -> Estimate | None:
    """Return the mean depth offset [px], (2,), of all plates in view, or None."""
    found, depths = [], []
    for row in range(still.corners.shape[1]):
        if not still.sees(row):
            continue
        quads = still.corners[:, row]
        one = median_of_frames(
            np.stack([plate_offset(placer, quad, depth) for quad, depth in zip(quads, still.depth, strict=True)])
        )
        if np.isfinite(one.value).any():
            found.append(one)
            depths.append(float(np.nanmedian([placer.pose_depth(quad) for quad in quads])))
    return mean_offset(found, depths, placer.sensor) if found else None


def _place(still: StillFrames, placer: PlatePlacer, row: int, *, upper_side: bool = False) -> Estimate | None:
    """Return the position of a marker's centre or upper side's middle [m], (3,); None if it is rarely detected."""
    if not still.sees(row):
        return None
    positions = np.full((len(still.depth), 3), np.nan)
    for frame, depth in enumerate(still.depth):
        quad = still.corners[frame, row]
        if np.isfinite(quad).all():
            at = quad[:2].mean(0) if upper_side else diagonal_crossing(quad)
            positions[frame] = placer.place(quad, at, depth)[0]
    if np.count_nonzero(np.isfinite(positions[:, 2])) < len(positions) // 2:
        return None
    return place_of_frames(positions, placer.sensor)


def _plumb_line(still: StillFrames, placer: PlatePlacer) -> Estimate | None:
    upper, lower = (_place(still, placer, row) for row in (UPPER, LOWER))
    if upper is None or lower is None:
        return None
    length = float(np.linalg.norm(lower.value - upper.value))
    if length < SHORTEST_LINE:
        raise CalibrationError(
            f"its markers are only {1e3 * length:.0f} mm apart",
            where="plumb line",
            advice=f"put them at least {1e3 * SHORTEST_LINE:.0f} mm apart; half a metre is good",
        )
    return gravity_of_plumb_line(upper, lower)


def _held(
    still: StillFrames, placer: PlatePlacer, scale: float, gravity_sd: float, rig: Rig
) -> Estimate | None:  # fmt: skip
    rows = ((LEFT_MARKER, False), (RIGHT_MARKER, False), (LEFT_CLIP, True), (RIGHT_CLIP, True))
    places = [_place(still, placer, row, upper_side=upper_side) for row, upper_side in rows]
    true = [Estimate(place.value / scale, place.sd / scale) for place in places if place is not None]
    if len(true) < len(rows):
        return None
    return held_ends_seen(true[0], true[1], true[2:], gravity_sd, rig)


def _gravity_sd(gravity: Estimate | None, before: Calibration) -> float:
    if gravity is not None:
        return float(gravity.sd)
    return GRAVITY_BY_EYE if before.gravity_sd_degrees is None else float(np.radians(before.gravity_sd_degrees))


def _vector(values: Floats) -> Vector:
    x, y, z = (round(float(value), 5) for value in values)
    return x, y, z


def _rounded(value: object) -> float:
    return float(f"{float(np.asarray(value)):.2g}")

"""Synthesise a re-gridded silhouette of swung cloth with a camera's faults, each adjustable and with known truth.

A cloth of 0.3 m is clamped along its top edge and swung through its plane. A camera with uneven frames lays a grid of 8
x 8 points evenly over the visible cloth. The faults are those of public recordings of swung cloth
(github Alados5/tfm_matlab):

- latency: a timestamp is late by a constant
- publish share: it is also late by a share of the excess of the previous frame interval over the usual one
- jitter: each timestamp has an independent normal error of at most half an interval
- path below: the hanger's path lies below the true held edge
- depth scale: distances from a camera 1.5 m in front of the cloth are measured too long by a share
- skew: in a share of the frames the grid is skewed
- eroded border: the left, right and bottom borders are invisible
- eaten by pose: the bottom border is lost, or gained, in proportion to the cloth's lean g:

      length seen = l - border - loss g,   g = mean of (down the cloth) . n,   n = up x bar

The hanger's path is measured separately, on the timestamps' clock. The file is an `.npz` that `hangtime import` reads.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from firmware_host.errors import SensorAddressError
from firmware_host.synthetic.cloth import ClothPhysics, simulate
from firmware_host.synthetic.lengths import LONGEST_RECORDING, SHORTEST_WRITTEN
from firmware_host.synthetic.swatch import TO_SENSOR
from formats.arrays import Booleans, Floats
from formats.garment import Garment, TrackedPoint
from formats.outputs import check_stem, output_folder, refuse_to_replace, write_bytes

SIDE, POINTS_PER_SIDE = 0.3, 8  # m, and points along it, as in the recordings
NODES_ALONG = 9  # of the cloth along its side; our choice: 37.5 mm apart, near the panels' 30 mm
CLOTH_DENSITY = 0.197  # kg/m^2, median of 618 fabrics, ClothDrapeTester (SIGGRAPH Asia 2022)
SILHOUETTE_PHYSICS = ClothPhysics(linear_damping=1.5)
RECORDED_RATE, INTERVAL_SPREAD = 9.0, 0.3  # frames a second, and the spread of their intervals, as in the recordings
AWAY, HERTZ, REST_TIME = 0.1, 0.7, 1.5  # m and Hz of the swing, and s of rest at either end
EYE = np.array([0.0, -1.5, 0.0])  # m, origin of depth; our choice: within the 1.2 to 2.5 m of a recording
# samples a second of the true cloth. Our choice: eleven a frame, so the error of linear interpolation is 121 times
# smaller. Half and double were not tried.
TRUTH_RATE = 100.0


@dataclass(frozen=True, kw_only=True)
class CameraFaults:
    """A camera's faults: latency and jitter of timestamps [s], shares, skew [degrees], offsets, losses and noise [m].

    At 0 the camera is perfect.
    """

    latency: float = 0.0
    publish_share: float = 0.0
    jitter: float = 0.0
    path_below: float = 0.0
    depth_scale: float = 0.0
    skewed_share: float = 0.0
    skew: float = 6.0  # our choice: a clear skew; only a `skewed_share` of the frames has it
    eroded_border: float = 0.0
    eaten_by_pose: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
class Silhouette:
    """A recording and its truth.

    - `stamps` [s], (frames,), and `exposures` [s], (frames,): timestamp and true exposure time of each frame
    - `points` [m], (frames, 64, 3), z up, and `valid`, (frames, 64)
    - `ends` [m], (frames, 2, 3): of the held edge, at the timestamps
    - `places` [m], (frames, 64, 2): each point's position on the flat cloth
    - `lean`, (frames,); `is_skewed`, (frames,)
    """

    stamps: Floats
    exposures: Floats
    points: Floats
    valid: Booleans
    ends: Floats
    places: Floats
    lean: Floats
    is_skewed: Booleans


def held_path(instants: Floats) -> Floats:
    """Return the held edge's ends [m], (n, 2, 3), z up, of a hanger that rests, and then swings until the end."""
    ramp = np.clip((instants - REST_TIME) / 0.6, 0, 1)
    ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    place = np.zeros((len(instants), 2, 3))
    place[:, 0, 0], place[:, 1, 0] = -SIDE / 2, SIDE / 2
    place[:, :, 1] = (AWAY * ramp * np.sin(2 * np.pi * HERTZ * (instants - REST_TIME)))[:, None]
    return place


def swung_cloth(seconds: float, progress: Callable[[float], None] = lambda share: None) -> tuple[Floats, Floats]:
    """Return instants [s], (n,), and the true cloth [m], (n, rows, columns, 3), z up."""
    half = SIDE / 2
    garment = Garment(
        format="hangtime-garment/1", name="silhouette", kind="swatch", mass_kg=CLOTH_DENSITY * SIDE**2, held="edge",
        outline_m=((-half, 0.0), (half, 0.0), (half, -SIDE), (-half, -SIDE)),
        points=(TrackedPoint(name="middle", at_m=(0.0, -half)),),
    )  # fmt: skip
    fine = np.arange(0.0, seconds, 1 / TRUTH_RATE)
    nodes = simulate(
        garment, lambda t: held_path(t) @ TO_SENSOR.T, fine, physics=SILHOUETTE_PHYSICS, effects={},
        rows=NODES_ALONG, columns=NODES_ALONG, progress=progress,
    )  # fmt: skip
    return fine, np.asarray(nodes @ TO_SENSOR)


def seen_silhouette(
    faults: CameraFaults,
    *,
    seconds: float = 12.0,  # s; our choice: as `hangtime sensor synthesise-silhouette` has it
    seed: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> Silhouette:
    """Return a recording of this length [s] with these faults.

    Raises:
        SensorAddressError: an invalid fault or length.
    """
    _check(faults, seconds, seed)
    random = np.random.default_rng([seed, 64])
    fine, nodes = swung_cloth(seconds, progress)
    steps = (1 + INTERVAL_SPREAD * random.standard_normal(int(seconds * RECORDED_RATE)).clip(-2, 2)) / RECORDED_RATE
    stamps = np.cumsum(steps)
    late = np.concatenate([[0.0], np.diff(stamps) - np.median(np.diff(stamps))])
    most = np.median(np.diff(stamps)) / 2
    own = np.clip(faults.jitter * np.random.default_rng([seed, 65]).standard_normal(len(stamps)), -most, most)
    exposures = stamps - faults.latency - faults.publish_share * late - own
    there = (exposures >= 0.0) & (exposures <= fine[-1])
    stamps, exposures = stamps[there], exposures[there]
    is_skewed = random.random(len(exposures)) < faults.skewed_share
    angles = np.radians(faults.skew) * is_skewed * random.choice([-1.0, 1.0], len(exposures))
    return _laid(faults, (fine, nodes), (stamps, exposures), angles, random)


def make_silhouette_take(
    # Seconds; our choice: as above.
    out: Path, name: str, faults: CameraFaults, *, seconds: float = 12.0, seed: int = 1, overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Path]:  # fmt: skip
    """Write NAME.npz and NAME.truth.npz into `out`; return the paths.

    Raises:
        SensorAddressError: an invalid fault or length.
        OutputError: no name that files can have; the folder cannot be made or written to, or a file is there and is not
            to be overwritten.
    """
    _check(faults, seconds, seed)
    check_stem(name)
    paths = [out / f"{name}.npz", out / f"{name}.truth.npz"]
    for path in paths:
        refuse_to_replace(path, overwrite=overwrite)
    with output_folder(out, ".npz"):
        made = seen_silhouette(faults, seconds=seconds, seed=seed, progress=progress)
        _write(paths, faults, made)
    return paths


def _write(paths: list[Path], faults: CameraFaults, made: Silhouette) -> None:
    across, up = np.meshgrid(np.linspace(0, SIDE, POINTS_PER_SIDE), np.linspace(0, SIDE, POINTS_PER_SIDE))
    arrays = {
        "t": made.stamps, "points": made.points, "valid": made.valid, "hanger_corners": made.ends,
        "rest": np.stack([across.ravel(), up.ravel()], 1),
    }  # fmt: skip
    truth = {
        "exposures": made.exposures, "places": made.places, "lean": made.lean, "is_skewed": made.is_skewed,
        **asdict(faults),
    }  # fmt: skip
    for path, content in zip(paths, (arrays, truth), strict=True):
        file = io.BytesIO()
        np.savez(file, **content)
        write_bytes(path, file.getvalue())


def _laid(
    faults: CameraFaults, cloth: tuple[Floats, Floats], times: tuple[Floats, Floats], angles: Floats,
    random: np.random.Generator,
) -> Silhouette:  # fmt: skip
    """Lay the grid over the visible cloth in every frame."""
    stamps, exposures = times
    shapes = _at(*cloth, exposures)
    down = np.diff(shapes, axis=1)
    lean = (down[..., 1] / np.linalg.norm(down, axis=-1)).mean((1, 2))  # up x bar is y: the bar is x
    border = faults.eroded_border
    share = np.linspace(0, 1, POINTS_PER_SIDE)
    points = np.full((len(stamps), POINTS_PER_SIDE * POINTS_PER_SIDE, 3), np.nan)
    places = np.empty((len(stamps), POINTS_PER_SIDE * POINTS_PER_SIDE, 2))
    for frame, shape in enumerate(shapes):
        length = SIDE - border - faults.eaten_by_pose * lean[frame]
        below, right = np.meshgrid(length * share[::-1], border + (SIDE - 2 * border) * share, indexing="ij")
        right = right + np.tan(angles[frame]) * (below - length / 2)
        places[frame] = np.stack([right.ravel(), SIDE - below.ravel()], 1)
        points[frame] = _on(shape, below.ravel() / SIDE, right.ravel() / SIDE)
    points += faults.depth_scale * (points - EYE)
    points += faults.noise * random.standard_normal(points.shape)
    ends = held_path(stamps) - [0.0, 0.0, faults.path_below]
    return Silhouette(stamps, exposures, points, np.isfinite(points).all(2), ends, places, lean, angles != 0.0)


def _at(fine: Floats, nodes: Floats, instants: Floats) -> Floats:
    """Return the cloth at some instants, interpolated linearly between its samples."""
    after = np.clip(np.searchsorted(fine, instants), 1, len(fine) - 1)
    share = ((instants - fine[after - 1]) / (fine[after] - fine[after - 1]))[:, None, None, None]
    return np.asarray(nodes[after - 1] * (1 - share) + nodes[after] * share)


def _on(shape: Floats, down: Floats, across: Floats) -> Floats:
    """Return points of a cloth, (n, 3), at shares of its length and width, (n,), extrapolated beyond its border."""
    rows, columns = shape.shape[:2]
    row = np.clip((down * (rows - 1)).astype(int), 0, rows - 2)
    column = np.clip((across * (columns - 1)).astype(int), 0, columns - 2)
    v, u = (down * (rows - 1) - row)[:, None], (across * (columns - 1) - column)[:, None]
    upper = shape[row, column] * (1 - u) + shape[row, column + 1] * u
    lower = shape[row + 1, column] * (1 - u) + shape[row + 1, column + 1] * u
    return np.asarray(upper * (1 - v) + lower * v)


def _check(faults: CameraFaults, seconds: float, seed: int) -> None:
    limits = {
        "latency": (-0.5, 0.5), "publish_share": (0.0, 1.0), "jitter": (0.0, 0.1),
        "path_below": (-0.05, 0.05), "depth_scale": (-0.1, 0.1), "skewed_share": (0.0, 1.0), "skew": (0.0, 30.0),
        "eroded_border": (0.0, 0.05), "eaten_by_pose": (-0.15, 0.15), "noise": (0.0, 0.02),
    }  # fmt: skip
    for name, (low, high) in limits.items():
        if not low <= getattr(faults, name) <= high:
            raise SensorAddressError(
                f"cannot be {getattr(faults, name):g}", where=option_of(name), advice=f"choose {low:g} to {high:g}"
            )
    if not SHORTEST_WRITTEN <= seconds <= LONGEST_RECORDING:
        raise SensorAddressError(
            f"{seconds:g} s is no length of a recording", where="--seconds",
            advice=f"choose {SHORTEST_WRITTEN:g} to {LONGEST_RECORDING:g} s",
        )  # fmt: skip
    if seed < 0:
        raise SensorAddressError(f"the seed {seed} is below 0", where="--seed", advice="give 0 or more")


def option_of(fault: str) -> str:
    """Return the option of `hangtime sensor synthesise-silhouette` that sets a fault."""
    return {"skewed_share": "--skewed", "eroded_border": "--eroded"}.get(fault, f"--{fault.replace('_', '-')}")

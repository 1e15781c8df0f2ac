"""Measurement faults planted in real takes, which keep their noise, gaps and unmodelled effects.

Interpolating noisy points would change their noise. So most faults are planted in the hanger's path, the clock or the
rig's description. Only faults of the points themselves change the points:

    time_offset        points are tau late: the hanger's path is read at t + tau
    clock_drift        y(s) = x((1 - d) s): frames are stamped s = t / (1 - d), the path is read there
    attachment_offset  the cloth hangs where it did; the path is what markers at - d (hanger's frame) would have shown
    gravity_tilt       the rig's gravity is turned, so that true gravity leans by the planted angles in its world
    depth_scale        y = x (1 + s (1 + (|x| / r - 1) / 2)), r the mean distance; of the points or of everything
    filter_lag         two low-passes (tau / 2 each), exact for points that move straight between frames
    corner_erosion, tracker_smoothing    as in `fit.blind.sensing`, frame by frame

In every take, faulty or not, the frames within MARGIN of its ends are left out. Each case also looks at the scene
through a sensor turned by a few degrees more. So neither length nor gravity reveals the plant. A clock's drift is
visible in the mean time between frames, because this is the fault.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from scipy.interpolate import CubicSpline

from fit.blind.boundary import real_ends
from fit.blind.cases import CREATED, FILES, Kind, drawn_names, rounds, whole_case
from fit.blind.engine import Cloth
from fit.blind.plants import Plant, Planted, choose_plants
from fit.blind.sensing import eroded, smoothing_matrix
from fit.errors import FitError
from formats.archive import read_take, write_take
from formats.arrays import Booleans, Floats
from formats.rig import Rig
from formats.take import Take

TIME_MARGIN = 0.1  # s at both ends of every take: more than any offset in time
# rad, the largest pitch and roll of a case's sensor. Our choice: the pitch is beyond the largest planted tilt of 0.052.
# Half and double were not tried.
TURNS = (0.08, 0.03)
FEWEST_TAKES = len(FILES)


class RealTruth(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Truth of a case of real takes: the plant, the takes, and the case with the same takes untouched."""

    id: str
    kind: Kind
    planted: tuple[Planted, ...]
    takes: tuple[str, ...]
    reference: str
    turn: tuple[float, float]


def real_plants(names: list[str]) -> tuple[Plant, ...]:
    """Return the effects of these names that can be planted in real takes, or all of them without names.

    Raises:
        FitError: a name that cannot be planted.
    """
    return choose_plants(names, PLANTING, "in real takes")


def find_takes(folder: Path) -> dict[str, Path]:
    """Return the takes in a folder by name.

    Raises:
        FitError: there are too few.
    """
    takes = {path.stem: path for path in sorted(folder.glob("*.mcap"))}
    if len(takes) < FEWEST_TAKES:
        raise FitError(
            f"holds {len(takes)} takes, a case needs {FEWEST_TAKES}", where=folder,
            advice="give a folder of takes (.mcap); `hangtime import` makes them of other people's recordings",
        )  # fmt: skip
    return takes


def plan_real(takes: list[str], numbers: dict[Kind, int], plants: tuple[Plant, ...], seed: int) -> list[RealTruth]:
    """Draw all cases in random order: an untouched case draws its takes, and a planted case shares those of one.

    numbers: of singles and nulls

    Raises:
        FitError: planted takes without untouched ones, or kinds that real takes cannot have.
    """
    if numbers["pair"] or numbers["unknown"]:
        raise FitError(
            "only single effects are planted in real takes", where="--real", advice="leave out --pairs and --unknowns"
        )
    if numbers["null"] < 1:
        raise FitError(
            "planted takes are held against untouched ones, and none are asked for",
            where="--nulls",
            advice="give --nulls 1 or more",
        )
    rng = np.random.default_rng([seed, 0])
    total = numbers["null"] + numbers["single"]
    names = drawn_names(rng, total)
    cloth = Cloth(width=0.3, height=0.3)  # only a hem's amplitude would depend on the cloth
    chosen = [tuple(rng.choice(takes, FEWEST_TAKES, replace=False).tolist()) for _ in range(numbers["null"])]
    truths = [
        RealTruth(id=names[k], kind="null", planted=(), takes=chosen[k], reference=names[k], turn=_turn(rng))
        for k in range(numbers["null"])
    ]
    for k, plant in enumerate(rounds(rng, plants, numbers["single"])):
        source = truths[k % numbers["null"]]
        truths.append(RealTruth(
            id=names[numbers["null"] + k], kind="single", planted=(plant.draw(rng, cloth),), takes=source.takes,
            reference=source.id, turn=_turn(rng),
        ))  # fmt: skip
    return [truths[k] for k in rng.permutation(total)]


def _turn(rng: np.random.Generator) -> tuple[float, float]:
    return float(rng.uniform(-TURNS[0], TURNS[0])), float(rng.uniform(-TURNS[1], TURNS[1]))


def write_real_case(folder: Path, truth: RealTruth, takes: dict[str, Path]) -> list[Path]:
    """Write a case's takes with the planted fault; the folder appears atomically.

    Raises:
        FitError: a take is not there or too short.
        TakeError: a take cannot be read.
    """
    with whole_case(folder) as partial:
        for file, name in zip(FILES, truth.takes, strict=True):
            if name not in takes:
                raise FitError(
                    f"the take {name} is not there any more", where=folder, advice="give the same takes again"
                )
            take = case_take(read_take(takes[name]), truth)
            write_take(partial / file, replace(take, take_id=f"{truth.id}-{file.removesuffix('.mcap')}"))
    return [folder / name for name in FILES]


def case_take(take: Take, truth: RealTruth) -> Take:
    """Return a real take for a case: rotated, with the planted fault, without its ends and its provenance."""
    take = turned_take(take, truth.turn)
    for one in truth.planted:
        take = planted_take(take, one)
    return replace(without_ends(take), created=CREATED, source="", notes={}, scans=())


def turned_take(take: Take, turn: tuple[float, float]) -> Take:
    """Return the take as seen by a sensor that is pitched and rolled [rad] in place, gravity included."""
    (cp, cr), (sp, sr) = np.cos(turn), np.sin(turn)
    rotation = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    return replace(
        take, held=take.held @ rotation.T, markers=take.markers @ rotation.T, points=take.points @ rotation.T,
        rig=_with_gravity(take.rig, rotation @ _unit(take.rig.gravity)),
    )  # fmt: skip


def planted_take(take: Take, planted: Planted) -> Take:
    """Return the take with one fault planted.

    Raises:
        FitError: the fault cannot be planted in a real take.
    """
    change = PLANTING.get(planted.id)
    if change is None:
        raise FitError(
            f"{planted.id} cannot be planted in a real take", where=take.take_id,
            advice=f"plant one of {', '.join(sorted(PLANTING))}",
        )  # fmt: skip
    return change(take, planted)


def without_ends(take: Take) -> Take:
    """Return the take without its first and last MARGIN seconds, from 0 on.

    Raises:
        FitError: nothing is left.
    """
    take = _only(take, (take.time >= take.time[0] + TIME_MARGIN) & (take.time <= take.time[-1] - TIME_MARGIN))
    return replace(take, time=take.time - take.time[0])


def _only(take: Take, kept: Booleans) -> Take:
    if kept.sum() < 2:
        raise FitError("the take is too short to plant anything in it", where=take.take_id, advice="leave it out")
    return replace(take, **{name: value[kept] for name in FRAME_ARRAYS if (value := getattr(take, name)) is not None})


FRAME_ARRAYS = (
    "time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers", "pitch",
    "pitch_sd", "points_hidden", "quality",
)  # fmt: skip


def _time_offset(take: Take, planted: Planted) -> Take:
    return _hanger_read_at(take, take.time + planted.components[""])


def _clock_drift(take: Take, planted: Planted) -> Take:
    stamps = take.time[0] + (take.time - take.time[0]) / (1 - planted.components[""])
    changed = replace(_hanger_read_at(take, stamps), time=stamps)
    return _only(changed, stamps <= take.time[-1])  # beyond the ends the hanger's position is unknown


def _hanger_read_at(take: Take, instants: Floats) -> Take:
    """Return the take with the hanger at other instants [s], one per frame; constant beyond the ends."""
    seen = np.flatnonzero(take.held_valid.all(1))
    if len(seen) < 4:
        raise FitError("the hanger was hardly seen", where=take.take_id, advice="leave the take out")
    inside = np.clip(instants, take.time[seen[0]], take.time[seen[-1]])
    held = CubicSpline(take.time[seen], take.held[seen])(inside)
    return _with_held(take, np.where(take.held_valid[..., None], held, np.nan))


def _with_held(take: Take, held: Floats) -> Take:
    """Markers move along with the held edge."""
    return replace(take, held=held, markers=take.markers + (held - take.held))


def _attachment_offset(take: Take, planted: Planted) -> Take:
    rotation = world_of(take.rig)
    ends = (take.held @ rotation.T).reshape(-1, 6)
    away = {name: -value for name, value in planted.components.items()}
    shown = real_ends(ends, (msgspec.structs.replace(planted, components=away),), 0)
    return _with_held(take, np.asarray(shown.reshape(-1, 2, 3) @ rotation))


def _gravity_tilt(take: Take, planted: Planted) -> Take:
    across, away = np.sin([planted.components["x"], planted.components["y"]])
    said = np.array([-across, -away, -np.sqrt(1 - across**2 - away**2)]) @ world_of(take.rig)
    return replace(take, rig=_with_gravity(take.rig, said))


def _depth_scale(take: Take, planted: Planted) -> Take:
    points_share, scene = planted.components["points"], planted.components["scene"]
    mean = float(np.nanmean(np.linalg.norm(take.points, axis=2)))

    def scaled(places: Floats, share: float) -> Floats:
        far = np.linalg.norm(places, axis=-1, keepdims=True)
        return np.asarray(places * (1 + share * (1 + 0.5 * (far / mean - 1))))

    return replace(_with_held(take, scaled(take.held, scene)), points=scaled(take.points, points_share or scene))


def _filter_lag(take: Take, planted: Planted) -> Take:
    delay = planted.amplitude / 2
    columns = _filled(take)
    for _ in range(2):
        late = columns.copy()
        for k, dt in enumerate(np.diff(take.time), start=1):
            # x moves straight within a frame: y = x - slope T + (y0 - x0 + slope T) e^(-dt / T)
            slope = (columns[k] - columns[k - 1]) / dt * delay
            late[k] = columns[k] - slope + (late[k - 1] - columns[k - 1] + slope) * np.exp(-dt / delay)
        columns = late
    return _with_points(take, columns)


def _corner_erosion(take: Take, planted: Planted) -> Take:
    return _with_points(take, eroded(_filled(take), _flat(take), planted.amplitude))


def _tracker_smoothing(take: Take, planted: Planted) -> Take:
    points, is_seen = _filled(take), take.points_valid.any(0)
    smooth = np.einsum("pq,fqc->fpc", smoothing_matrix(_flat(take)[is_seen]), points[:, is_seen])
    points[:, is_seen] += planted.amplitude * (smooth - points[:, is_seen])
    return _with_points(take, points)


PLANTING: dict[str, Callable[[Take, Planted], Take]] = {
    "time_offset": _time_offset, "gravity_tilt": _gravity_tilt, "depth_scale": _depth_scale,
    "filter_lag": _filter_lag, "corner_erosion": _corner_erosion, "clock_drift": _clock_drift,
    "tracker_smoothing": _tracker_smoothing, "attachment_offset": _attachment_offset,
}  # fmt: skip


def _flat(take: Take) -> Floats:
    return np.array([point.at_m for point in take.garment.points])


def _filled(take: Take) -> Floats:
    """Return points with linearly interpolated gaps, for filters and neighbours; zero if never seen."""
    points = np.zeros_like(take.points)
    for k in range(points.shape[1]):
        seen = take.points_valid[:, k]
        for c in range(3):
            if seen.any():
                points[:, k, c] = np.interp(take.time, take.time[seen], take.points[seen, k, c])
    return points


def _with_points(take: Take, points: Floats) -> Take:
    """Return a take with other positions of its points; points that were not seen stay unseen."""
    return replace(take, points=np.where(take.points_valid[..., None], points, np.nan))


def world_of(rig: Rig) -> Floats:
    """Return the rotation, (3, 3), from a rig's frame to one with z against gravity and x along its levelled x."""
    up = -_unit(rig.gravity)
    across = np.array([1.0, 0.0, 0.0]) - up[0] * up
    across = across / np.linalg.norm(across)
    return np.stack([across, np.cross(up, across), up])


def _unit(gravity: tuple[float, float, float]) -> Floats:
    down = np.asarray(gravity, float)
    return np.asarray(down / np.linalg.norm(down))


def _with_gravity(rig: Rig, down: Floats) -> Rig:
    return msgspec.structs.replace(rig, gravity=(float(down[0]), float(down[1]), float(down[2])))

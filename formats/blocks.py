"""Convert frames to the integer columns of blocks, and back. See `formats/SPEC.md`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.arrays import Booleans, Floats, Integers
from formats.errors import TakeError
from formats.integers import decode_tables, encode_tables
from formats.table_memory import NUMBERS_AT_ONCE

MOST_ROWS = 4096  # frames of a block: a second of the fastest cameras
TICKS = 10**6  # a second
LATEST = 10**16  # ticks, three centuries: up to there, sums of seconds resolve microseconds
PLACE_STEPS = np.array([1e-4, 2e-5, 1e-6])  # m: a block uses the coarsest step below a tenth of each deviation
FARTHEST_PLACE = 1000.0  # m: no sensor sees so far, and the finest step reaches twice as far
ANGLE_STEP = 1e-4  # rad: a hundredth of a depth sensor's resolution
MOST_TURN = 1000.0  # rad; our choice: 159 turns, far beyond any rig's; it detects damage only
QUALITY_STEPS, NO_QUALITY = 254, 255  # of a byte, `formats/SPEC.md`
UNKNOWN_SD, EXACT, BOUNDLESS, FIRST_SD = 0, 1, 2, 3  # deviations that are NaN, 0, infinite, and `SMALLEST_SD`
SMALLEST_SD, LARGEST_SD = 1e-9, 1e9  # m or rad; our choice: beyond any sensor and any motion
SD_STEPS = 32  # codes an octave: a deviation is stored to 1.1 %

Columns = dict[str, NDArray[Any]]
STORED = ("time", "markers", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state",
           "points_hidden", "quality", "pitch", "pitch_sd")  # fmt: skip
OPTIONAL = ("quality", "pitch", "pitch_sd", "points_hidden")  # of these, None where nothing was measured
REAL, FLAGS = ("fiu", "real numbers"), ("b", "true or false")  # kinds of `np.dtype`
KINDS_OF_COLUMNS = {"held_valid": FLAGS, "points_valid": FLAGS, "points_hidden": FLAGS}  # the others are real


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One frame's measurements in the sensor frame; NaN and False where something was not seen.

    - `time` [s]
    - `markers`, `held` [m], (2, 3); `points` [m], (points, 3)
    - standard deviations per axis [m], in the same shapes
    - `state`: bits of `formats.take.FrameState`
    - `pitch`, `pitch_sd` [rad]: NaN where not seen
    - `points_hidden`, (points,): whether something occludes the point; None where not determined
    - `quality`: 0 to 1
    """

    time: float
    markers: Floats
    held: Floats
    held_valid: Booleans
    held_sd: Floats
    points: Floats
    points_valid: Booleans
    points_sd: Floats
    state: int = 0
    pitch: float = float("nan")
    pitch_sd: float = float("nan")
    points_hidden: Booleans | None = None
    quality: float = float("nan")

    def as_columns(self) -> Columns:
        """Return the frame as columns of one row, by the names of `formats.take.Take`."""
        hidden = np.zeros(len(self.points), bool) if self.points_hidden is None else self.points_hidden
        values = {**{name: getattr(self, name) for name in self.__dataclass_fields__}, "points_hidden": hidden}
        return {name: value[None] for name, value in as_arrays(values, "a frame").items()}


def as_arrays(values: Mapping[str, object], take_id: object) -> Columns:
    """Return values as arrays.

    Raises:
        TakeError: a value is no array of real numbers, or of flags where its name requires them.
    """
    arrays = {}
    for name, value in values.items():
        kinds, words = KINDS_OF_COLUMNS.get(name, REAL)
        try:
            arrays[name] = np.asarray(value)
            kind = arrays[name].dtype
        except (TypeError, ValueError) as error:  # lists of several lengths
            raise TakeError(f"{name} is no array", where=take_id, advice=f"give an array of {words}") from error
        if kind.kind not in kinds:
            raise TakeError(f"{name} is an array of {kind}, not of {words}", where=take_id, advice=f"give {words}")
        if kinds == REAL[0] and name != "state" and (kind.itemsize < 4 or kind.kind in "iu" or name == "time"):
            arrays[name] = arrays[name].astype(np.float64, copy=False)  # products of short numbers would wrap
    return arrays


def columns_of(take: Mapping[str, object], where: object) -> Columns:
    """Return the arrays of a take that an archive stores, with NaN and False in place of those without measurements.

    take: its fields by name

    Raises:
        TakeError: an array is lacking, or `as_arrays` refuses it.
    """
    columns = as_arrays({name: take[name] for name in STORED if take[name] is not None}, where)
    if lacking := [name for name in STORED if name not in {*columns, *OPTIONAL}]:
        raise TakeError(f"{lacking[0]} is None", where=where, advice="give an array")
    absent = dict.fromkeys(OPTIONAL[:3], np.full(columns["time"].shape, np.nan))
    return {**absent, "points_hidden": np.zeros(columns["points_valid"].shape, bool), **columns}


def check_columns(columns: Columns, *, points: int, take_id: str, first: int, after: float) -> None:
    """Refuse a block that an archive cannot store unchanged.

    first: frame number of the first row; after [s]: time of the row before

    Raises:
        TakeError: time does not increase or lies centuries away, a valid value is not finite, a number is out of range,
            or a shape is wrong; names the frame. Or a column has another type of values; names the column.
    """
    time = as_arrays(columns, take_id)["time"]
    if time.ndim != 1:
        raise TakeError(f"time has shape {time.shape}", where=take_id, advice="give one time a frame")

    def refuse(row: int, what: str, advice: str) -> None:
        raise TakeError(what, where=f"{take_id}, frame {first + row}", advice=advice)

    shapes = {
        "markers": (2, 3), "held": (2, 3), "held_valid": (2,), "held_sd": (2, 3), "points": (points, 3),
        "points_valid": (points,), "points_sd": (points, 3), "points_hidden": (points,), "state": (), "pitch": (),
        "pitch_sd": (), "quality": (),
    }  # fmt: skip
    for name, shape in shapes.items():
        if columns[name].shape[:1] != time.shape:
            refuse(0, f"{name} has shape {columns[name].shape} for {len(time)} frames", "give one row a frame")
        if columns[name].shape[1:] != shape:
            refuse(0, f"{name} have shape {columns[name].shape[1:]}, not {shape}", "give one row a frame in that shape")
    before = np.concatenate([[after], time[:-1]])
    if len(wrong := np.flatnonzero(~(time > before))):
        row = int(wrong[0])
        refuse(
            row,
            f"time goes from {before[row]:.6f} s to {time[row]:.6f} s",
            "frames must come in the order of their time stamps",
        )
    if len(wrong := np.flatnonzero(~(np.abs(time) <= LATEST / TICKS))):
        refuse(int(wrong[0]), f"the time {time[wrong[0]]:g} s lies centuries away", "give it in seconds")
    same_tick = np.rint(time * TICKS) <= np.rint(before * TICKS)
    if same_tick.any():
        row = int(np.argmax(same_tick))
        refuse(row, f"time goes from {before[row]:.9f} s by less than a microsecond", "leave out one of the two frames")
    for name, thing in (("points", "point"), ("held", "held end"), ("markers", "marker")):
        values = columns[name]
        finite = np.asarray(np.isfinite(values).all(2))
        valid = columns[f"{name}_valid"] if name != "markers" else finite
        if (bad := valid & ~finite).any():
            row, place = (int(at[0]) for at in np.nonzero(bad))
            refuse(row, f"{thing} {place} is marked valid but is not a number", "mark it invalid, or give its place")
        if name == "markers" and (endless := np.isinf(values).any(2)).any():
            row, place = (int(at[0]) for at in np.nonzero(endless))
            refuse(row, f"{thing} {place} is infinite", "give NaN where it was not seen")
        far = valid & (np.abs(np.where(finite[..., None], values, 0.0)).max(2, initial=0.0) > FARTHEST_PLACE)
        if far.any():
            row, place = (int(at[0]) for at in np.nonzero(far))
            distance = np.abs(values[row, place]).max()
            refuse(row, f"{thing} {place} lies {distance:g} m away", f"give metres, at most {FARTHEST_PLACE:g}")
    for name in ("points_sd", "held_sd", "pitch_sd"):
        sd = columns[name].reshape(len(time), -1)
        cannot_be = (sd < 0) | ((sd > 0) & (sd < SMALLEST_SD)) | (np.isfinite(sd) & (sd > LARGEST_SD))
        if cannot_be.any():
            row, place = (int(at[0]) for at in np.nonzero(cannot_be))
            refuse(
                row,
                f"{name} has a standard deviation of {sd[row, place]:g}",
                f"give 0, or {SMALLEST_SD:g} to {LARGEST_SD:g}",
            )
    for name, least, most in (("quality", 0.0, 1.0), ("pitch", -MOST_TURN, MOST_TURN), ("state", 0, 65535)):
        outside = (columns[name] < least) | (columns[name] > most)
        if outside.any():
            row = int(np.argmax(outside))
            refuse(row, f"{name} is {columns[name][row]:g}, not between {least:g} and {most:g}", "give one of these")
    if (broken := columns["state"] != np.rint(columns["state"])).any():
        row = int(np.argmax(broken))
        refuse(row, f"state is {columns['state'][row]:g}, no whole number", "give one between 0 and 65535")


def most_rows(points: int) -> int:
    """Return the largest number of frames of a block, such that readers can decode several blocks together."""
    return max(min(MOST_ROWS, NUMBERS_AT_ONCE // sum(widths(points).values())), 1)


def cut_into_blocks(time: Floats, seconds: float, most: int = MOST_ROWS) -> Integers:
    """Return the number of frames of each block: a block ends with the frame that reaches `seconds`, or before a gap.

    most: largest number of frames in a block
    """
    rows, start = [], 0
    while start < len(time):
        end = int(np.searchsorted(time, time[start] + seconds)) + 1
        end = min(end, len(time), start + most)
        if end - start > 1 and time[end - 1] - time[start] >= 2 * seconds:
            end -= 1
        rows.append(end - start)
        start = end
    return np.array(rows, np.int64)


def encode_blocks(columns: Columns, rows: Integers, first: int) -> list[dict[str, Any]]:
    """Return checked columns as the contents of `/block` messages; the first one begins with frame number `first`."""
    starts = np.cumsum(rows) - rows
    steps = np.stack(
        [_steps(columns[f"{name}_sd"], columns[f"{name}_valid"], starts) for name in ("held", "points")], 1
    )
    ticks = np.rint(columns["time"] * TICKS).astype(np.int64)
    held_step, points_step = PLACE_STEPS[np.repeat(steps, rows, axis=0)].T
    held = _quantised(columns["held"], columns["held_valid"], held_step)
    markers_valid = np.asarray(np.isfinite(columns["markers"]).all(2))
    markers = _quantised(columns["markers"], markers_valid, held_step)
    pitch_valid = np.isfinite(columns["pitch"])
    quality = np.rint(np.nan_to_num(columns["quality"]) * QUALITY_STEPS)
    parts = {
        "time": ticks - np.repeat(ticks[starts], rows),
        "state": columns["state"],
        "quality": np.where(np.isfinite(columns["quality"]), quality, NO_QUALITY),
        "pitch": _filled(np.rint(np.nan_to_num(columns["pitch"]) / ANGLE_STEP)[:, None], pitch_valid[:, None]),
        "pitch_sd": _sd_codes(columns["pitch_sd"], pitch_valid),
        "pitch_valid": pitch_valid,
        "held": held,
        "markers": markers - held,
        "held_sd": _sd_codes(columns["held_sd"], columns["held_valid"]),
        "points": _quantised(columns["points"], columns["points_valid"], points_step),
        "points_sd": _sd_codes(columns["points_sd"], columns["points_valid"]),
        "held_valid": columns["held_valid"],
        "markers_valid": markers_valid,
        "points_valid": columns["points_valid"],
        "points_hidden": columns["points_hidden"],
    }
    table = np.concatenate(
        [np.asarray(parts[name]).reshape(len(ticks), -1) for name in LAYOUT], axis=1, dtype=np.int64, casting="unsafe"
    )
    return [
        {"first": first + int(start), "frames": int(count), "start": int(ticks[start]), "steps": step.tolist(),
         "table": coded}
        for start, count, step, coded in zip(starts, rows, steps, encode_tables(table, rows), strict=True)
    ]  # fmt: skip


LAYOUT = (
    "time", "state", "quality", "pitch", "pitch_sd", "pitch_valid", "held", "markers", "held_sd", "points", "points_sd",
    "held_valid", "markers_valid", "points_valid", "points_hidden",
)  # fmt: skip


def widths(points: int) -> dict[str, int]:
    """Return the number of table columns of each quantity, in the order of the table."""
    of_points = {"points": 3 * points, "points_sd": 3 * points, "points_valid": points, "points_hidden": points}
    of_ends = {"held": 6, "markers": 6, "held_sd": 6, "held_valid": 2, "markers_valid": 2}
    return {name: of_points.get(name, of_ends.get(name, 1)) for name in LAYOUT}


def _steps(sd: Floats, valid: Booleans, starts: Integers) -> Integers:
    """Return the index of each block's step, the coarsest that is at most a tenth of every valid deviation."""
    sd = np.where(valid[..., None] & (sd >= 0), sd, np.inf).reshape(len(sd), -1)
    least = np.minimum.reduceat(sd.min(1, initial=np.inf), starts)
    return np.select(
        [least >= 10 * step * (1 - 1e-9) for step in PLACE_STEPS], range(len(PLACE_STEPS)), len(PLACE_STEPS) - 1
    )


def _quantised(values: Floats, valid: Booleans, step: Floats) -> Integers:
    """Return positions in whole steps, (rows, 3 positions); an invalid position repeats the one before."""
    flat = np.where(valid[..., None], values, 0.0).reshape(len(values), -1)
    whole = np.rint(flat / step[:, None])
    if (np.abs(whole * step[:, None] - flat) > 0.5 * step[:, None] * (1 + 1e-6)).any():
        raise TakeError(
            "a place would be stored off by more than half a step", where=None, advice="this is a fault of Hangtime"
        )
    return _filled(whole, np.repeat(valid, 3, axis=1)).astype(np.int64)


def _filled(values: NDArray[Any], valid: Booleans) -> NDArray[Any]:
    """Return values, (rows, columns), with each invalid value replaced by the last valid one, or else the first."""
    if valid.all():
        return values
    rows = np.maximum.accumulate(np.where(valid, np.arange(len(values))[:, None], -1), axis=0)
    rows = np.where(rows < 0, valid.argmax(0), rows)
    return np.take_along_axis(values, rows, axis=0)


def _sd_codes(sd: Floats, valid: Booleans) -> NDArray[Any]:
    """Return codes of the deviations' logarithms, (rows, columns); an invalid position repeats the code before."""
    flat = np.asarray(sd, float).reshape(len(sd), -1)
    usual = np.clip(np.where(flat > 0, flat, SMALLEST_SD), SMALLEST_SD, LARGEST_SD)
    codes = np.rint(SD_STEPS * np.log2(usual / SMALLEST_SD)) + FIRST_SD
    codes[np.isnan(flat)], codes[flat == 0], codes[np.isinf(flat)] = UNKNOWN_SD, EXACT, BOUNDLESS
    counts = np.repeat(valid.reshape(len(sd), -1), flat.shape[1] // valid.reshape(len(sd), -1).shape[1], axis=1)
    return _filled(codes, counts)


def _sds(codes: Integers) -> Floats:
    return _SDS[np.clip(codes, 0, len(_SDS) - 1)]


_SDS = np.array(
    [np.nan, 0.0, np.inf]
    + [SMALLEST_SD * 2 ** (n / SD_STEPS) for n in range(round(SD_STEPS * np.log2(LARGEST_SD / SMALLEST_SD)) + 1)]
)


def decode_blocks(blocks: Sequence[dict[str, Any]], points: int) -> tuple[Columns, Booleans]:
    """Return the columns of `/block` messages by the names of `formats.take.Take`, and which blocks are sound.

    Each block's `first`, `frames`, `start` and `steps` must be whole numbers; `formats.take_reader` checks them. A
    malformed block is left out.
    """
    rows = np.array([block["frames"] for block in blocks], np.int64)
    width = widths(points)
    table, sound = decode_tables([block["table"] for block in blocks], rows, sum(width.values()))
    rows = rows[sound]
    kept = [block for block, good in zip(blocks, sound, strict=True) if good]
    edges = np.cumsum([0, *width.values()])
    parts = {name: table[:, a:b] for name, a, b in zip(width, edges[:-1], edges[1:], strict=True)}
    steps = PLACE_STEPS[np.array([block["steps"] for block in kept], np.int64).reshape(-1, 2)]
    held_step, points_step = (column[:, None, None] for column in np.repeat(steps, rows, axis=0).T)
    start = np.repeat(np.array([block["start"] for block in kept], np.int64), rows)
    count = len(table)
    columns: Columns = {
        "time": (start + parts["time"][:, 0]) / TICKS,
        "state": parts["state"][:, 0].astype(np.uint16),
        "quality": np.where(parts["quality"] == NO_QUALITY, np.nan, parts["quality"] / QUALITY_STEPS)[:, 0],
        "pitch": parts["pitch"][:, 0] * ANGLE_STEP,
        "pitch_sd": _sds(parts["pitch_sd"])[:, 0],
        "held": parts["held"].reshape(count, 2, 3) * held_step,
        "markers": (parts["held"] + parts["markers"]).reshape(count, 2, 3) * held_step,
        "points": parts["points"].reshape(count, points, 3) * points_step,
        "held_sd": _sds(parts["held_sd"]).reshape(count, 2, 3),
        "points_sd": _sds(parts["points_sd"]).reshape(count, points, 3),
        **{name: parts[name] != 0 for name in ("held_valid", "points_valid", "points_hidden")},
    }
    columns["held"][~columns["held_valid"]] = np.nan
    columns["points"][~columns["points_valid"]] = np.nan
    columns["markers"][parts["markers_valid"] == 0] = np.nan
    unseen = parts["pitch_valid"][:, 0] == 0
    columns["pitch"][unseen] = columns["pitch_sd"][unseen] = np.nan
    return columns, sound

"""Locate the gap: split the held-out residual by region of the cloth, phase of the motion, frequency and direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.observer.residuals import Observer
from fit.recordings.camera import STILL_SPEED
from formats.arrays import Floats, Integers
from formats.diagnosis_records import VertexResidual, Where, WhereBin

# s of hanger at rest, after which the motion counts as ring-down; our choice: a hand that turns round rests for less.
# Half and double were not tried.
RING_DOWN = 0.3
# Hz; our choice: an octave about the first swing of 0.45 m of cloth, 0.9 Hz (`fit.cloth.support`), and what is beside
# it.
BANDS = ((0.0, 0.3), (0.3, 0.7), (0.7, 1.5), (1.5, 3.0), (3.0, np.inf))
DIRECTION_NAMES = ("sideways (x)", "to and from the sensor (y)", "vertical (z)")


def find_where(observer: Observer, residual: Floats) -> Where:
    """Split the squared error of a residual, (numbers,), in four ways; the shares of each split sum to one."""
    layout = observer.layout
    point, axis_of, take = (layout.moving(a) for a in (layout.point, layout.axis, layout.take))
    squared = (1e3 * layout.metres(residual)) ** 2  # mm^2 per axis
    garment = observer.recordings[0].garment
    points = len(garment.points)
    by_point = _means(squared, point, points)
    places = np.array([p.at_m for p in garment.points])
    down = (places[:, 1].max() - places[:, 1]) / max(np.ptp(places[:, 1]), 1e-9)
    across = (places[:, 0] - places[:, 0].min()) / max(np.ptp(places[:, 0]), 1e-9)
    region = np.where(down < 1 / 3, "top", np.where(down > 2 / 3, "bottom", "middle")).astype(object)
    side = np.where(across < 1 / 3, " left", np.where(across > 2 / 3, " right", " centre")).astype(object)
    names = np.asarray(region + side)
    seen = np.bincount(point, minlength=points) > 0  # points on the held edge are not judged
    space = [
        _bin(str(n), squared[np.isin(point, np.flatnonzero(names == n))], squared) for n in dict.fromkeys(names[seen])
    ]
    phases = np.concatenate(
        [_phases(r)[layout.moving(layout.frame)[take == k]] for k, r in enumerate(observer.recordings)]
    )
    time = [_bin(str(n), squared[phases == n], squared) for n in sorted(set(phases))]
    most = max(float(squared.sum()), 1e-12)
    term = [_part(name, float(squared[axis_of == a].sum()) / most, squared) for a, name in enumerate(DIRECTION_NAMES)]
    return Where(
        space=sorted(space, key=lambda b: -b.value_mm),
        vertices=[
            VertexResidual(at_m=p.at_m, value_mm=float(np.sqrt(3 * by_point[k])))
            for k, p in enumerate(garment.points)
            if seen[k]
        ],
        time=time,
        frequency=_frequencies(observer, residual),
        term=term,
    )


def _means(values: Floats, index: Integers, count: int) -> Floats:
    total = np.bincount(index, values, minlength=count)
    return np.asarray(total / np.maximum(np.bincount(index, minlength=count), 1))


def _bin(name: str, part: Floats, whole: Floats) -> WhereBin:
    """Return some of the points or frames: their own root mean square distance, and their share of the square."""
    return WhereBin(
        name=name, value_mm=float(np.sqrt(3 * part.mean())), share=float(part.sum() / max(whole.sum(), 1e-12))
    )


def _part(name: str, share: float, whole: Floats) -> WhereBin:
    """Return a component of the distance at all points and frames: squares of components sum to the whole's square.

    whole: squared error of every number [mm^2]
    """
    return WhereBin(name=name, value_mm=float(np.sqrt(3 * whole.mean() * share)), share=share)


def _phases(recording) -> NDArray[np.str_]:  # type: ignore[no-untyped-def]
    """Return the name of the motion's phase in every frame, (frames,)."""
    time = recording.time
    middle = recording.held(time).reshape(-1, 2, 3).mean(1)
    speed = np.linalg.norm(np.gradient(middle, time, axis=0), axis=1)
    is_still = speed < STILL_SPEED
    has_moved = np.maximum.accumulate(np.where(is_still, -np.inf, time))
    ringing = is_still & (time - has_moved > RING_DOWN) & np.isfinite(has_moved)
    faster = np.gradient(speed, time) > 0
    names = np.where(faster, "hanger speeding up", "hanger slowing down")
    names = np.where(is_still, "hanger at rest before the swing", names)
    names = np.where(is_still & np.isfinite(has_moved), "hanger turning or just stopped", names)
    return np.where(ringing, "ring-down, hanger at rest", names)


def _frequencies(observer: Observer, residual: Floats) -> list[WhereBin]:
    """Split the variance over frequency bands; missing points count as zero residual."""
    layout = observer.layout
    metres = layout.metres(residual)
    take, frame, point, axis = (layout.moving(a) for a in (layout.take, layout.frame, layout.point, layout.axis))
    power = np.zeros(len(BANDS))
    for number, recording in enumerate(observer.recordings):
        mine = take == number
        grid = np.zeros((len(recording.time), len(recording.garment.points), 3))
        grid[frame[mine], point[mine], axis[mine]] = 1e3 * metres[mine]
        rate = (len(recording.time) - 1) / recording.duration
        spectrum = (np.abs(np.fft.rfft(grid, axis=0)) ** 2).sum((1, 2))
        spectrum[1 : (len(recording.time) + 1) // 2] *= 2  # all but the mean and, of an even number, the highest
        hertz = np.fft.rfftfreq(len(recording.time), 1 / rate)
        for k, (low, high) in enumerate(BANDS):
            power[k] += spectrum[(hertz >= low) & (hertz < high)].sum() / len(recording.time)
    total = max(power.sum(), 1e-12)
    squared = (1e3 * metres) ** 2
    return [_part(_band(low, high), float(p / total), squared) for (low, high), p in zip(BANDS, power, strict=True)]


def _band(low: float, high: float) -> str:
    return f"{low:g} to {high:g} Hz" if np.isfinite(high) else f"above {low:g} Hz"

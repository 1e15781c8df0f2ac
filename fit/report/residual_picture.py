"""Draw the residuals of a simulation: arrows from simulated to tracked points, and their size over time.

The PNG picture has four rows. The first three show six instants of the take, in the hanger's frame:

- front: along the bar and down, as one looks at the cloth
- side: out of the hanger's plane and down, as one looks along the bar
- in plane: the errors along the cloth only, at the points' positions on the flat cloth

The fourth row shows the root mean square over the points of each frame, across the bar, down and out of the cloth.
A curve breaks where no free point is seen. Arrows have their true length: their scale is that of the view. A line above
each row names its axes, and a bar of 100 mm shows its scale.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fit.recordings.hanger_path import hanger_axes
from fit.recordings.recording import Recording
from fit.report.charts import axis_top
from fit.report.plot import WIDTH
from formats.arrays import Booleans, Floats
from formats.figures import round_step
from formats.outputs import write_bytes
from formats.plain_text import in_one_line
from formats.take_picture import stretches

INSTANTS = 6  # pictures side by side; our choice: each stays 150 px wide
# px. Our choice: six pictures fit the width, and labels the margin; with less, labels would cross the cloth.
ROW_HEIGHT, CHART, MARGIN = 210, 190, 44
ROW_HEADING, RESIDUAL_LETTERS = 24, 14  # px, of the line above a row, and of its letters; our choice: legible
BAR_OF_SCALE = 0.1  # m; our choice: 20 to 60 px of a garment 1 to 0.3 m wide
FRAME, GREY, LINK_COLOUR, SIMULATED, SEEN = "#cccccc", "#eeeeee", "#d62728", "#1f77b4", "#111111"
DIRECTIONS = (("along the bar", "#2ca02c"), ("down the cloth", "#1f77b4"), ("out of the cloth", "#d62728"))


@dataclass(frozen=True)
class Views:
    """Errors of one take, in the hanger's frame.

    - `simulated`, `seen` [m], (frames, points, 3): along the bar, down, out; NaN where not judged
    - `along` [m], (frames, points, 3): errors along the bar, down the cloth and out of it
    """

    time: Floats
    simulated: Floats
    seen: Floats
    along: Floats
    counted: Booleans

    @property
    def parts_mm(self) -> Floats:
        """Return the root mean square of each error component per frame [mm], (frames, 3), NaN if nothing is judged."""
        squares, count = np.nansum(self.along**2, axis=1), self.counted.sum(1)[:, None]
        return np.asarray(np.where(count > 0, 1e3 * np.sqrt(squares / np.maximum(count, 1)), np.nan))


def views_of(recording: Recording, simulated: Floats) -> Views:
    """Return the errors of a simulation, (frames, points, 3) [m], in the hanger's frame."""
    ends = recording.held(recording.time)
    axes, middle = hanger_axes(ends), ends.reshape(-1, 2, 3).mean(1)[:, None]
    counted = recording.counted
    seen = np.where(counted[..., None], recording.points, np.nan)
    local = [np.einsum("fij,fpi->fpj", axes, track - middle) for track in (simulated, seen)]
    error = local[1] - local[0]
    down = _tangents(local[0])
    out = np.cross(np.broadcast_to([1.0, 0.0, 0.0], down.shape), down)
    along = np.stack([error[..., 0], (error * down).sum(-1), (error * out).sum(-1)], -1)
    return Views(recording.time, local[0], local[1], along, counted)


def draw_residuals(
    recording: Recording, simulated: Floats, path: Path, title: str = "", *, overwrite: bool = False
) -> None:  # fmt: skip
    """Draw the residuals of a simulation, (frames, points, 3) [m], of a recording, as a PNG picture.

    Raises:
        ModuleNotFoundError: Pillow is not installed.
        OutputError: the file is there and is not to be overwritten, or cannot be written.
    """
    from PIL import Image, ImageDraw, ImageFont

    views = views_of(recording, simulated)
    picture = Image.new("RGB", (WIDTH, MARGIN + 3 * (ROW_HEADING + ROW_HEIGHT) + ROW_HEADING + CHART + MARGIN), "white")
    pen = ImageDraw.Draw(picture)
    pen.font = ImageFont.load_default(RESIDUAL_LETTERS)
    total = float(np.sqrt(np.nanmean((views.along[views.counted] ** 2).sum(-1)))) if views.counted.any() else 0.0
    said = f"{title or recording.take_id}: {1e3 * total:.1f} mm, root mean square distance of the free points"
    pen.text((MARGIN, 12), _plain(said), fill="black")
    pen.text((WIDTH - 320, 12), "blue: simulated, black: tracked, red: residual", fill="black")
    frames = _instants(views)
    width = (WIDTH - MARGIN) // INSTANTS
    tops = [MARGIN + ROW_HEADING + k * (ROW_HEADING + ROW_HEIGHT) for k in range(4)]
    scale = _draw_row(pen, views, frames, (0, 1), tops[0], width, "front")
    _head(pen, tops[0], "Front: across, along the bar; upright, down from the bar", scale)
    scale = _draw_row(pen, views, frames, (2, 1), tops[1], width, "side")
    _head(pen, tops[1], "Side: across, out of the hanger's plane; upright, down from the bar", scale)
    places = np.array([point.at_m for point in recording.garment.points])
    flat = np.stack([places[:, 0], places[:, 1].max() - places[:, 1]], 1)
    scale = _draw_flat(pen, views, frames, flat, tops[2], width)
    _head(pen, tops[2], "In plane: the flat cloth, with the residuals along the bar and down the cloth alone", scale)
    _head(pen, tops[3], "Root mean square residual of the free points, mm, by direction")
    _draw_chart(pen, views, tops[3])
    stream = io.BytesIO()
    picture.save(stream, "PNG", optimize=True)
    write_bytes(path, stream.getvalue(), overwrite=overwrite)


def _tangents(local: Floats) -> Floats:
    """Return unit vectors from the bar to each simulated point, perpendicular to the bar, (frames, points, 3)."""
    down = local * [0.0, 1.0, 1.0]
    length = np.linalg.norm(down, axis=2, keepdims=True)
    straight = np.broadcast_to([0.0, 1.0, 0.0], down.shape)
    return np.where(length > 1e-3, down / np.maximum(length, 1e-9), straight)


def _instants(views: Views) -> list[int]:
    """Return evenly spaced frames of the take, each replaced by the nearby frame with most seen points."""
    count = views.counted.sum(1)
    parts = np.array_split(np.arange(len(count)), INSTANTS)
    return [int(part[int(np.argmax(count[part]))]) for part in parts if len(part)]


def _draw_row(
    pen: Any, views: Views, frames: list[int], axes: tuple[int, int], top: int, width: int, name: str
) -> float:  # fmt: skip
    """Draw a row of views, and return its scale [px/m]."""
    both = np.concatenate([views.simulated[frames].reshape(-1, 3), views.seen[frames].reshape(-1, 3)])[:, axes]
    low, high = np.nanmin(both, axis=0), np.nanmax(both, axis=0)
    scale = min((width - 20) / max(high[0] - low[0], 1e-3), (ROW_HEIGHT - 40) / max(high[1] - low[1], 1e-3))
    for k, frame in enumerate(frames):
        left = MARGIN + k * width
        _frame(pen, left, top, width, f"{name}, {views.time[frame]:.1f} s")
        origin = np.array([left + width / 2, top + 24]) - scale * np.array([(low[0] + high[0]) / 2, low[1]])
        at = origin + scale * views.simulated[frame][:, axes]
        to = origin + scale * views.seen[frame][:, axes]
        for p in range(len(at)):
            _dot(pen, at[p], SIMULATED)
            if views.counted[frame, p]:
                _arrow(pen, at[p], to[p])
    return float(scale)


def _draw_flat(pen: Any, views: Views, frames: list[int], flat: Floats, top: int, width: int) -> float:
    """Draw the flat cloth of each frame, and return the scale [px/m]."""
    size = np.maximum(np.ptp(flat, axis=0), 1e-3)
    scale = min((width - 40) / size[0], (ROW_HEIGHT - 56) / size[1])
    for k, frame in enumerate(frames):
        left = MARGIN + k * width
        _frame(pen, left, top, width, f"in plane, {views.time[frame]:.1f} s")
        middle = (flat[:, 0].min() + flat[:, 0].max()) / 2
        at = np.array([left + width / 2, top + 30]) + scale * (flat - [middle, 0.0])
        to = at + scale * np.nan_to_num(views.along[frame][:, :2])
        for p in range(len(at)):
            _dot(pen, at[p], SIMULATED if views.counted[frame, p] else FRAME)
            if views.counted[frame, p]:
                _arrow(pen, at[p], to[p])
    return float(scale)


def _head(pen: Any, top: int, words: str, scale: float | None = None) -> None:
    """Write a line above a row that begins at `top`; scale [px/m]: draw the bar of the row's scale behind the line."""
    pen.text((MARGIN, top - ROW_HEADING + 4), words, fill="black")
    if scale is not None:
        right, at = WIDTH - 70, top - ROW_HEADING // 2
        pen.line([(right - BAR_OF_SCALE * scale, at), (right, at)], fill="black", width=2)
        pen.text((right + 8, top - ROW_HEADING + 4), f"{1e3 * BAR_OF_SCALE:.0f} mm", fill="black")


def _draw_chart(pen: Any, views: Views, top: int) -> None:
    parts = views.parts_mm
    reach, steps = axis_top(max(float(np.nanmax(parts, initial=0.0)), 1.0))
    left, right, bottom = MARGIN + 24, WIDTH - 180, top + CHART - 24
    span = max(float(views.time[-1] - views.time[0]), 1e-3)
    for k in range(steps + 1):
        y = bottom - k / steps * (bottom - top - 16)
        pen.line([(left, y), (right, y)], fill=FRAME)
        pen.text((4, y - 8), f"{reach * k / steps:g} mm", fill="black")
    second = round_step(span / 6)
    for k in range(int(span / second + 1e-9) + 1):
        pen.text((left + k * second / span * (right - left) - 8, bottom + 6), f"{k * second:g} s", fill="black")
    x = left + (views.time - views.time[0]) / span * (right - left)
    for part, (name, colour) in enumerate(DIRECTIONS):
        heights = bottom - parts[:, part] / reach * (bottom - top - 16)
        seen = np.isfinite(heights)
        for start, stop in stretches(seen):
            pen.line([(float(x[k]), float(heights[k])) for k in range(start, stop)], fill=colour, width=2)
        rms = float(np.sqrt(np.nanmean(parts[:, part] ** 2))) if seen.any() else 0.0
        pen.text((right + 8, top + 16 + 18 * part), f"{name}: {rms:.1f} mm", fill=colour)


def _frame(pen: Any, left: int, top: int, width: int, name: str) -> None:
    pen.rectangle([left, top, left + width - 6, top + ROW_HEIGHT - 6], outline=GREY)
    pen.text((left + 6, top + 4), name, fill="black")


def _dot(pen: Any, at: Floats, colour: str) -> None:
    x, y = float(at[0]), float(at[1])
    pen.ellipse([x - 1.5, y - 1.5, x + 1.5, y + 1.5], fill=colour)


def _arrow(pen: Any, at: Floats, to: Floats) -> None:
    """Draw a line from the simulated point to the tracked one."""
    pen.line([(float(at[0]), float(at[1])), (float(to[0]), float(to[1]))], fill=LINK_COLOUR, width=1)
    _dot(pen, to, SEEN)


def _plain(text: str) -> str:
    return in_one_line(text).encode("ascii", "replace").decode()

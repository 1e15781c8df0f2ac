"""Draw the motion of a take's tracked points, in braille letters for a terminal and as a PNG picture."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.figures import round_step
from formats.motion import axes_of
from formats.outputs import write_bytes
from formats.plain_text import in_one_line
from formats.soft_lines import SoftLines
from formats.take import Take

# size of the plot in braille letters, each of 2 x 4 dots. Our choice: with labels it fits a terminal of 80 columns; a
# wider plot would be wrapped.
LETTERS_ACROSS, LETTERS_DOWN = 64, 8
DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])  # Unicode 15, block "Braille Patterns"
# px. Our choice: 16 to 9, with a margin for labels of 15 px; with less, labels would be cut off.
FIGURE_WIDTH, FIGURE_HEIGHT, FIGURE_MARGIN = 960, 540, 56
INSTANTS_SHOWN = 8  # on an axis of time at most, less the first; our choice: more labels would touch in 64 letters
PICTURE_LETTERS = 14  # px; our choice: legible, and the longest names and steps fit the margins
LINE_COLOURS = (
    "#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#17becf", "#7f7f7f", "#e377c2", "#bcbd22",
    "#000000", "#00441b",
)  # fmt: skip
MOST_DRAWN = len(LINE_COLOURS)  # that are drawn: the held edge and eleven tracked points
# m: least distance from the mean to either end of the axis. Sensors' noise is 3 mm at most (`formats.motion`), and
# three standard deviations of it fit. On a smaller axis the noise of a still take looks like motion.
LEAST_REACH = 0.01


def paths_of(take: Take) -> tuple[str, list[str], Floats]:
    """Return the direction of the largest motion, names, and paths along this direction [m], (frames, paths).

    The paths are those of the held edge's centre and of each tracked point, less their means; NaN where not seen. The
    direction is `sideways`, `face-on` or `up-and-down` (`formats.motion`).
    """
    names = ["held edge", *(name.replace("_", " ") for name in take.garment.point_names)]
    places = np.concatenate([take.held.mean(1, keepdims=True), take.points], axis=1)
    apart = places - _mean(places)
    found = {way: apart @ axis for way, axis in axes_of(take).items()}
    most = max(found, key=lambda way: float(np.nansum(found[way] ** 2)))
    return most, names, found[most]


def _mean(values: Floats) -> Floats:
    """Return the mean over the frames, ignoring NaN, or 0 without any number."""
    seen = np.isfinite(values)
    total = np.where(seen, values, 0.0).sum(0)
    return np.asarray(total / np.maximum(seen.sum(0), 1))


def draw_in_letters(take: Take) -> str:
    """Return a plot of the held edge, dotted, and the lowest point over time, in braille letters.

    A dotted path shows in every other letter.
    """
    way, _, paths = paths_of(take)
    lowest = 1 + int(np.argmin([point.at_m[1] for point in take.garment.points]))
    shown = paths[:, [0, lowest]]
    most = float(np.nanmax(np.abs(shown), initial=0.0))
    reach = max(most, LEAST_REACH)
    span = float(take.time[-1] - take.time[0]) or 1.0
    across = ((take.time - take.time[0]) / span * (2 * LETTERS_ACROSS - 1)).astype(int)
    dots = np.zeros((LETTERS_DOWN, LETTERS_ACROSS), int)
    for path, is_drawn in zip(shown.T, (across // 2 % 2 == 0, True), strict=True):
        seen = np.isfinite(path) & is_drawn
        down = ((1 - path[seen] / reach) / 2 * (4 * LETTERS_DOWN - 1)).round().astype(int)
        column = across[seen]
        np.bitwise_or.at(dots, (down // 4, column // 2), DOTS[down % 4, column % 2])
    lines = ["".join(chr(0x2800 + int(dot)) for dot in row) for row in dots]
    top, bottom = f"{1e3 * reach:+.0f} mm", f"{-1e3 * reach:+.0f} mm"
    middle = LETTERS_DOWN // 2
    labels = [top, *[""] * (middle - 1), "0 mm", *[""] * (LETTERS_DOWN - middle - 2), bottom]
    drawn = [f"{label:>9} {line}" for label, line in zip(labels, lines, strict=True)]
    captions = [
        f"{_motion(way, most)} over {span:.1f} s, from each path's mean",
        "dotted: the held edge; drawn through: the lowest tracked point",
    ]
    return "\n".join([*drawn, *(f"{'':>9} {line}" for line in [_instants(span), *captions])])


def _motion(way: str, most: float) -> str:
    """Return the title of a plot; of paths that do not fill the axis, with their largest distance `most` [m]."""
    return f"motion {way}" if most >= LEAST_REACH else f"at most {1e3 * most:.1f} mm {way}"


def _instants(span: float) -> str:
    """Return the axis of time: a stroke at each round instant, and the instant beside it."""
    second = round_step(span / INSTANTS_SHOWN)
    axis = ""
    for k in range(int(span / second + 1e-9) + 1):
        axis = f"{axis:<{round(k * second / span * (LETTERS_ACROSS - 1))}}|{k * second:g} s"
    return axis


def draw_png(take: Take, path: Path, *, overwrite: bool = False) -> None:
    """Plot the motion of the held edge and of tracked points over time as a PNG picture.

    Of more points than there are colours, those are drawn that lie farthest apart, the corners first.

    Raises:
        ModuleNotFoundError: Pillow is not installed.
        OutputError: the file is there and is not to be overwritten, or cannot be written.
    """
    from PIL import ImageDraw, ImageFont

    way, names, paths = paths_of(take)
    chosen = [0, *(1 + k for k in well_spread(np.array([p.at_m for p in take.garment.points]), MOST_DRAWN - 1))]
    paths = paths[:, chosen]
    most = float(np.nanmax(np.abs(paths), initial=0.0))
    step = round_step(max(most, LEAST_REACH) / 2)
    reach = 2 * step
    span = float(take.time[-1] - take.time[0]) or 1.0
    lines = SoftLines(FIGURE_WIDTH, FIGURE_HEIGHT)
    left, right, top, bottom = FIGURE_MARGIN + 24, FIGURE_WIDTH - 160, FIGURE_MARGIN, FIGURE_HEIGHT - FIGURE_MARGIN
    x = left + (take.time - take.time[0]) / span * (right - left)
    y = (top + bottom) / 2 - paths / reach * (bottom - top) / 2
    levels = [
        ((top + bottom) / 2 - k / 2 * (bottom - top) / 2, f"{1e3 * k * step:+g}" if k else "0") for k in range(-2, 3)
    ]
    second = round_step(span / INSTANTS_SHOWN)
    count = int(span / second + 1e-9) + 1
    times = [(left + k * second / span * (right - left), f"{k * second:g}") for k in range(count)]
    for at, _ in levels:
        lines.draw([(left, round(at)), (right, round(at))], "#dddddd")
    for at in (*(place for place, _ in times), right):
        lines.draw([(round(at), top), (round(at), bottom)], "#dddddd")
    for number in range(len(chosen)):
        for start, stop in stretches(np.isfinite(paths[:, number])):
            lines.draw(list(zip(x[start:stop], y[start:stop, number], strict=True)), LINE_COLOURS[number], 2)
    picture = lines.picture()
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(PICTURE_LETTERS)
    for at, words in levels:
        pen.text((left - 8, at), words, fill="black", anchor="rm", font=font)
    for at, words in times:
        pen.text((at, bottom + 6), words, fill="black", anchor="ma", font=font)
    pen.text((8, top - 26), "distance from the mean, mm", fill="black", font=font)
    pen.text(
        ((left + right) / 2, bottom + 26), "time from the take's first frame, s", fill="black", anchor="ma", font=font
    )
    for number, index in enumerate(chosen):
        name = in_one_line(names[index]).encode("ascii", "replace").decode()[:20]
        pen.text((right + 12, top + 18 * number), name, fill=LINE_COLOURS[number], font=font)
    count = len(take.garment.points)
    shown = f"; {len(chosen) - 1} of {count} points" if len(chosen) - 1 < count else ""
    title = f"{_motion(way, most)}, from each path's mean; {len(take.time)} frames in {span:.1f} s{shown}"
    pen.text((8, 6), title, fill="black", font=font)
    stream = io.BytesIO()
    picture.save(stream, "PNG")
    write_bytes(path, stream.getvalue(), overwrite=overwrite)


def well_spread(places: Floats, count: int) -> list[int]:
    """Return the indices of at most so many places, (n, 2), that lie far apart: corners, then the farthest from all."""
    if len(places) <= count:
        return list(range(len(places)))
    ways = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])  # the lower corners first
    chosen = list(dict.fromkeys(int(np.argmax(places @ way)) for way in ways))[:count]
    while len(chosen) < count:
        apart = np.linalg.norm(places[:, None] - places[chosen], axis=2).min(1)
        chosen.append(int(np.argmax(apart)))
    return sorted(chosen)


def stretches(seen: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Return begin and end of each run of at least two frames with a value: what a line can be drawn through."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1]

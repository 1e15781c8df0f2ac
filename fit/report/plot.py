"""Draw the error over time of every take as one PNG picture."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fit.errors import FitError
from fit.report.charts import axis_top
from fit.report.motion import ReportMotion, rms_of
from formats.arrays import Floats
from formats.figures import round_step
from formats.outputs import write_bytes
from formats.plain_text import in_one_line
from formats.soft_lines import SoftLines
from formats.take_picture import stretches

# px. Our choice: letters of 15 px fit the margins; with less, labels would be cut off or cross the curves.
WIDTH, PANEL_HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 1200, 340, 84, 72, 24, 48
DASH = 8.0  # px, of the fit's curve: a base model that the fit follows shows between two dashes, as in the page
COLOURS = {"before": "#7b8794", "after": "#1f63b5", "base": "#1f63b5", "with_effect": "#0b7d6b", "fit": "#7a3fa8"}


def draw_plot(
    motions: Sequence[ReportMotion], names: Mapping[str, str], path: Path, *, overwrite: bool = False
) -> None:
    """Draw the root mean square distance of the free points over time [mm], a panel for each take.

    names: of the runs, for the legend

    Raises:
        FitError: there is no motion.
        ModuleNotFoundError: Pillow is not installed.
        OutputError: the file is there and is not to be overwritten, or cannot be written.
    """
    from PIL import Image, ImageDraw, ImageFont

    if not motions:
        raise FitError("holds no motion to draw", where=path, advice="fit or diagnose the takes again")
    picture, font = Image.new("RGB", (WIDTH, PANEL_HEIGHT * len(motions)), "white"), ImageFont.load_default(15)
    top, bottom = TOP, PANEL_HEIGHT - BOTTOM
    for number, motion in enumerate(motions):
        lines = SoftLines(WIDTH, PANEL_HEIGHT)
        shown = {run: 1e3 * motion.rms(run) for run in motion.shown}
        most = max((float(np.nanmax(values, initial=0.0)) for values in shown.values()), default=0.0)
        reach, steps = axis_top(most)
        span = float(motion.time[-1] - motion.time[0])
        x = LEFT + (motion.time - motion.time[0]) / span * (WIDTH - LEFT - RIGHT)
        levels = [(round(bottom - k / steps * (bottom - top)), f"{reach * k / steps:g} mm") for k in range(steps + 1)]
        for level, _ in levels:
            lines.draw([(LEFT, level), (WIDTH - RIGHT, level)], "#dddddd")
        for run, values in shown.items():
            y = bottom - values / reach * (bottom - top)
            for start, stop in stretches(np.isfinite(values)):
                for piece in _pieces(x, start, stop) if run == "fit" and len(shown) > 1 else [slice(start, stop)]:
                    lines.draw(list(zip(x[piece], y[piece], strict=True)), COLOURS[run], 3)
        panel = lines.picture()
        pen = ImageDraw.Draw(panel)
        for level, words in levels:
            pen.text((LEFT - 10, level), words, fill="black", anchor="rm", font=font)
        second = round_step(span / 6)
        for k in range(int(span / second + 1e-9) + 1):
            at = LEFT + k * second / span * (WIDTH - LEFT - RIGHT)
            pen.text((at, bottom + 8), f"{k * second:g} s", fill="black", anchor="ma", font=font)
        kind = "held out" if motion.is_held_out else "used to fit"
        title = f"{motion.take_id} ({kind}): root mean square distance of the free points"
        pen.text((LEFT, top - 60), in_one_line(title).encode("ascii", "replace").decode(), fill="black", font=font)
        across = float(LEFT)
        for run in shown:
            whole = rms_of([motion], run)
            words = f"{names[run]}: {1e3 * whole:.1f} mm" if whole is not None else f"{names[run]}: no free point seen"
            words = in_one_line(words)
            pen.text((across, top - 34), words, fill=COLOURS[run], font=font)
            across += pen.textlength(words, font=font) + 28
        picture.paste(panel, (0, PANEL_HEIGHT * number))
    stream = io.BytesIO()
    picture.save(stream, "PNG")
    write_bytes(path, stream.getvalue(), overwrite=overwrite)


def _pieces(x: Floats, start: int, stop: int) -> list[slice]:
    """Return the dashes of a curve from one frame to before another; its frames stand at x [px], (frames,)."""
    long = max(round(DASH / float(x[1] - x[0])), 1)
    return [slice(first, min(first + long + 1, stop)) for first in range(start, stop, 2 * long)]

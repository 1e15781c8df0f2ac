"""Charts of the report: HTML bars and inline SVG, coloured by the page's style sheet, legible at any width.

Lines are SVG stretched to their box with unscaled strokes. All words are HTML outside the SVG, so that they keep their
size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from fit.report.templating import NOTHING, piece
from fit.report.text import NO_BREAK, number, percent, tenths, tenths_interval, words
from formats.arrays import Floats
from formats.diagnosis_records import EffectFinding, Figure, ForceAt, Gap, VertexResidual, WhereBin
from formats.figures import round_step

MOST_LABELS = 12  # vertices that are labelled with their error; more would overlap

Part = tuple[str, float, float]  # of a bar: its kind, where it begins and where it ends

RUN_CLASSES = {
    "before": "is-before", "after": "is-after", "base": "is-after", "with_effect": "is-effect", "fit": "is-fit",
}  # fmt: skip


@dataclass(frozen=True)
class Curve:
    """Curves of an error over time and, if known, of the worst point's error [m], (frames,) each.

    - `name`: of the run, in the legend
    - `whole` [m]: the figure of all frames, and its name; None: the legend shows no figures
    - `worst` [m]: the largest figure in the legend, and its name; None: the largest of the values
    """

    run: str
    values: Floats
    largest: Floats | None = None
    name: str = ""
    whole: tuple[str, float] | None = None
    worst: tuple[str, float] | None = None


def gap_bars(gap: Gap, effect_name: str) -> Markup:
    """Return the gap as bars from the base error down to the noise floor; `effect_name` is what closes it."""
    base, floor = gap.base_mm.value, gap.floor_mm.value
    after = gap.with_effect_mm
    others = [(f"with {effect_name}", after), ("held by its tracked edge", gap.held_by_edge_mm)]
    known = [(name, figure) for name, figure in others if figure is not None]
    figures = [gap.base_mm, gap.floor_mm, *(figure for _, figure in known)]
    reach = max([f.value for f in figures] + [f.interval[1] for f in figures if f.interval] + [1e-9])
    reach = 1.04 * reach if math.isfinite(reach) else 1.0
    low = min(floor, base)
    stays = base if after is None else min(max(after.value, low), base)
    parts = [("floor", 0.0, low), ("rest", low, stays)]
    if after is not None and after.value < base:
        parts.append(("gone", stays, base))
    rows = [_figure_row("base model", gap.base_mm, parts, reach)]
    for name, figure in known:
        kept = min(low, figure.value)
        rows.append(_figure_row(name, figure, [("floor", 0.0, kept), ("rest", kept, figure.value)], reach))
    rows.append(_figure_row("noise floor", gap.floor_mm, [("floor", 0.0, floor)], reach))
    drawn = {kind for row in rows for kind, *_ in row["parts"]}
    legend = [("var(--floor)", "", "the sensor's noise")]
    if "rest" in drawn:
        legend.append(("var(--rest)", "", "unexplained"))
    if "gone" in drawn:
        legend.append(("var(--effect)", "is-striped", f"removed by {effect_name}"))
    return piece("charts.html", "bars", rows, legend, "")


def effect_bars(gap: Gap, effects: Sequence[EffectFinding], named: Sequence[str]) -> Markup:
    """Return bars of the error that each refitted effect alone would leave, one per effect, best first."""
    base, floor = gap.base_mm.value, gap.floor_mm.value
    rows = []
    for effect in effects:
        if effect.closure is None:
            continue
        left = math.sqrt(max(base**2 - effect.closure.value * (base**2 - floor**2), 0.0))
        low, shown = min(floor, base), min(max(left, min(floor, base)), base)
        parts = _parts([("floor", 0.0, low), ("rest", low, shown), ("gone", shown, base)], base)
        detail = f"{percent(effect.closure.value)} closed"
        rows.append(_row(words(effect.id), tenths(left), detail, parts, is_named=effect.id in named))
    legend = [
        ("var(--floor)", "", "the sensor's noise"), ("var(--rest)", "", "left above the noise"),
        ("var(--effect)", "is-striped", "removed by the effect"),
    ]  # fmt: skip
    return piece("charts.html", "bars", rows, legend, "") if rows else NOTHING


def _figure_row(name: str, figure: Figure, parts: Sequence[Part], reach: float) -> dict[str, Any]:
    shown = _parts(parts, reach)
    if figure.interval is not None and all(math.isfinite(end) for end in figure.interval):
        low, high = figure.interval
        shown.append(("whisker", _share(low, reach), _share(high - low, reach)))
    return _row(name, tenths(figure.value), tenths_interval(figure.interval), shown)


def _parts(parts: Sequence[Part], reach: float) -> list[tuple[str, str, str]]:
    """Return kind, left end and width of the parts of a bar with positive width."""
    shown = [(kind, start, end) for kind, start, end in parts if end > start]
    return [(kind, _share(start, reach), _share(end - start, reach)) for kind, start, end in shown]


def _row(
    name: str, value: str, detail: str, parts: Sequence[tuple[str, str, str]], *, is_named: bool = False
) -> dict[str, Any]:
    return {"name": name, "is_named": is_named, "value": value, "detail": detail, "parts": parts}


def where_bars(title: str, bins: Sequence[WhereBin], cloth: Markup = NOTHING) -> Markup:
    """Return one split of the gap: a bar per bin with its root mean square error [mm], and a map of the cloth."""
    if not bins and not cloth:
        return NOTHING
    reach = max([b.value_mm for b in bins if math.isfinite(b.value_mm)] + [1e-9])
    rows = [
        _row(words(b.name), tenths(b.value_mm), percent(b.share), [("plain", "0", _share(b.value_mm, reach))])
        for b in bins
    ]
    return piece("charts.html", "where", title, rows, cloth)


def force_map(places: Sequence[ForceAt], outline: Floats | None = None) -> Markup:
    """Return the garment from the front with the missing force at each point; outline [m], (corners, 2), of it.

    A disc is the force's part along the normal, and a bar across it the part in the plane, to scale.
    """
    if len(places) < 2:
        return NOTHING
    at = np.array([(p.at_m[0], -p.at_m[1]) for p in places])
    most = max([max(p.normal, p.in_plane) for p in places] + [1e-12])
    shape = _shape(at, outline)
    size = float(max(np.ptp(shape, axis=0).max(), 0.05))
    reach = size * min(0.08, 0.55 / math.sqrt(len(places)))
    marks = [
        {
            "x": _fine(x), "y": _fine(y), "radius": _fine(reach * p.normal / most),
            "left": _fine(x - reach * p.in_plane / most), "right": _fine(x + reach * p.in_plane / most),
            "thickness": _fine(reach / 6),
            "title": f"{p.normal:.2f} m/s² along the normal, {p.in_plane:.2f} m/s² in the plane",
        }
        for (x, y), p in zip(at, places, strict=True)
    ]  # fmt: skip
    box = _box(shape.min(axis=0) - 1.6 * reach, np.ptp(shape, axis=0) + 3.2 * reach)
    return piece("charts.html", "force_map", box, _polygon(shape), marks, number(most, 2))


def cloth_map(vertices: Sequence[VertexResidual], outline: Floats | None = None) -> Markup:
    """Return the garment seen from the front, with a spot per vertex, coloured by its error.

    outline [m], (corners, 2): of the garment; without it the points' own hull is drawn
    """
    known = [v for v in vertices if math.isfinite(v.value_mm) and all(math.isfinite(x) for x in v.at_m)]
    if not known:
        return NOTHING
    places = np.array([(v.at_m[0], -v.at_m[-1]) for v in known])
    values = np.array([v.value_mm for v in known])
    low, high = float(values.min()), float(values.max())
    shape = _shape(places, outline)
    size = float(max(np.ptp(shape, axis=0).max(), 0.05))
    spot = size * min(0.06, 0.5 / math.sqrt(len(known)))
    extent = np.ptp(shape, axis=0) + 3 * spot
    spots = [
        {
            "x": _fine(x), "y": _fine(y), "radius": _fine(spot), "title": tenths(v),
            "share": f"{100 * (v - low) / max(high - low, 1e-12):.0f}",
        }
        for (x, y), v in zip(places, values, strict=True)
    ]  # fmt: skip
    labels = []  # above the middle of their spots: the outline runs through that of spots at an edge
    if len(known) <= MOST_LABELS:
        extent[0] += 7 * spot
        labels = [
            {"x": _fine(x + 1.4 * spot), "y": _fine(y - 0.45 * spot), "size": _fine(1.25 * spot), "text": tenths(v)}
            for (x, y), v in zip(places, values, strict=True)
        ]
    box = _box(shape.min(axis=0) - 1.5 * spot, extent)
    return piece("charts.html", "cloth_map", box, _polygon(shape), spots, labels, tenths(low), tenths(high))


def _fine(value: float) -> str:
    return f"{value:.4f}"


def _box(corner: Floats, extent: Floats) -> str:
    return " ".join(_fine(value) for value in (*corner, *extent))


def _shape(places: Floats, outline: Floats | None) -> Floats:
    """Return the corners to draw, y down [m], (corners, 2): the garment's own, or else the hull of its points."""
    return np.array(_hull(places)) if outline is None else np.asarray(outline) * (1.0, -1.0)


def _polygon(corners: Floats) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in corners)


def _hull(places: Floats) -> list[tuple[float, float]]:
    """Convex hull of points in a plane (Andrew 1979, the monotone chain)."""
    ordered = sorted({(float(x), float(y)) for x, y in places})

    def chain(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for x, y in points:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2], kept[-1]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                    break
                kept.pop()
            kept.append((x, y))
        return kept[:-1]

    return chain(ordered) + chain(ordered[::-1])


def error_chart(
    caption: str, time: Floats, curves: Sequence[Curve], *, motion: int | None = None, axis: str = "time, s",
    unit: str = "mm",
) -> Markup:  # fmt: skip
    """Return errors [m], shown in thousandths, over time as a figure; `motion` ties it to a motion of the player."""
    curves = [curve for curve in curves if np.isfinite(curve.values).any()]
    if len(time) < 2 or not curves:
        return NOTHING
    start, end = float(time[0]), float(time[-1])
    drawn = [part for curve in curves for part in (curve.values, curve.largest) if part is not None]
    top, steps = axis_top(1e3 * max(float(np.nanmax(part)) for part in drawn))
    lines, legend = [], []
    for curve in curves:
        style = RUN_CLASSES[curve.run]
        if curve.largest is not None:
            lines.append((f"largest {style}", _path(time, 1e3 * curve.largest, top)))
        lines.append((style, _path(time, 1e3 * curve.values, top)))
        colour = f"var(--{style.removeprefix('is-')})"
        kind_of_line = "is-line is-dotted" if curve.run == "fit" else "is-line"
        if curve.whole is None:
            legend.append((colour, kind_of_line, curve.name))
            continue
        kind, whole = curve.whole[0], 1e3 * curve.whole[1]
        lines.append((f"mean {style}", f"M0 {100 * (1 - whole / top):.2f}H100"))
        largest, worst = curve.worst or ("worst frame", float(np.nanmax(curve.values)))
        said = f"{curve.name}: {kind} {whole:.1f}{NO_BREAK}mm, {largest} {1e3 * worst:.1f}{NO_BREAK}mm"
        legend.append((colour, kind_of_line, said))
    return piece("charts.html", "error_chart", {
        "caption": caption, "legend": legend, "lines": lines, "axis": axis, "unit": unit, "motion": motion,
        "start": _fine(start), "end": _fine(end),
        "spoken": f"{caption} " + "; ".join(text for _, _, text in legend),
        "grid": [f"{100 * k / steps:.2f}" for k in range(steps + 1)],
        "up": [(f"{100 * k / steps:.2f}", number(top * k / steps)) for k in range(steps + 1)],
        "across": [(f"{100 * (t - start) / (end - start):.2f}", f"{t:g}") for t in _ticks(start, end)],
    })  # fmt: skip


def _path(time: Floats, values: Floats, top: float) -> str:
    """SVG path in percent of the plot; a value that is missing breaks the line."""
    across = 100 * (time - time[0]) / (time[-1] - time[0])
    down = 100 * (1 - values / top)
    parts, is_drawing = [], False
    for x, y in zip(across, down, strict=True):
        if math.isfinite(y):
            parts.append(f"{'L' if is_drawing else 'M'}{x:.2f} {y:.2f}")
        is_drawing = math.isfinite(y)
    return "".join(parts)


def axis_top(largest: float) -> tuple[float, int]:
    """Return the top of an axis from zero and its number of steps."""
    if not largest > 0:
        return 1.0, 2
    step = round_step(largest / 4)
    steps = math.ceil(largest / step * (1 - 1e-9))
    return step * steps, steps


def _ticks(start: float, end: float) -> list[float]:
    power = 10.0 ** math.floor(math.log10((end - start) / 5))
    step = next(power * nice for nice in (1, 2, 5, 10) if (end - start) / (power * nice) <= 6)
    first = math.ceil(start / step - 1e-9)
    return [round(k * step, 6) for k in range(first, math.floor(end / step + 1e-9) + 1)]


def _share(value: float, reach: float) -> str:
    share = 100 * value / reach if math.isfinite(value) else 0.0
    return f"{min(100.0, max(0.0, share)):.2f}%"

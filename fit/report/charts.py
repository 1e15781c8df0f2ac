"""Charts of the report: HTML bars and inline SVG, coloured by the page's style sheet, legible at any width.

Lines are SVG stretched to their box with unscaled strokes; all words are HTML beside it, so that they never shrink.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fit.report.text import escaped, number, percent, small, tenths, tenths_interval, words
from formats.arrays import Floats
from formats.results import EffectFinding, Figure, ForceAt, Gap, VertexResidual, WhereBin

MOST_LABELS = 12  # vertices that are labelled with their error; more would overlap

RUN_NAMES = {"before": "before the fit", "after": "after the fit", "with_effect": "with the effect"}
RUN_CLASSES = {"before": "is-before", "after": "is-after", "with_effect": "is-effect"}


@dataclass(frozen=True)
class Curve:
    """Mean and, where known, largest error over time [m], (frames,) each; `name` replaces the figures in the legend."""

    run: str
    mean: Floats
    largest: Floats | None = None
    name: str = ""


def gap_bars(gap: Gap, effect_name: str) -> str:
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
    rows = [_bar_row("base model", gap.base_mm, parts, reach)]
    for name, figure in known:
        kept = min(low, figure.value)
        rows.append(_bar_row(name, figure, [("floor", 0.0, kept), ("rest", kept, figure.value)], reach))
    rows.append(_bar_row("noise floor", gap.floor_mm, [("floor", 0.0, floor)], reach))
    legend = [("var(--floor)", "", "the sensor's noise"), ("var(--rest)", "", "unexplained")]
    if after is not None:
        legend.append(("var(--effect)", "is-striped", f"removed by {effect_name}"))
    return f'<div class="bars">{"".join(rows)}</div>{_legend(legend)}'


def effect_bars(gap: Gap, effects: Sequence[EffectFinding], named: Sequence[str]) -> str:
    """Return what each refitted effect would leave of the base error, alone; one bar per effect, best first."""
    base, floor = gap.base_mm.value, gap.floor_mm.value
    rows = []
    for effect in effects:
        if effect.closure is None:
            continue
        left = math.sqrt(max(base**2 - effect.closure.value * (base**2 - floor**2), 0.0))
        low, shown = min(floor, base), min(max(left, min(floor, base)), base)
        parts = [("floor", 0.0, low), ("rest", low, shown), ("gone", shown, base)]
        name = words(effect.id) + (' <span class="tag">named</span>' if effect.id in named else "")
        bars = "".join(
            f'<i class="{kind}" style="left:{_share(start, base)};width:{_share(end - start, base)}"></i>'
            for kind, start, end in parts
            if end > start
        )
        rows.append(_bar(name, f"{tenths(left)} {small(percent(effect.closure.value) + ' closed')}", bars))
    return f'<div class="bars">{"".join(rows)}</div>' if rows else ""


def force_map(places: Sequence[ForceAt]) -> str:
    """Return the garment from the front with the missing force at each point.

    A disc is its part along the normal, a bar across it the part in the plane, both as large as they are strong.
    """
    if len(places) < 2:
        return ""
    at = np.array([(p.at_m[0], -p.at_m[1]) for p in places])
    most = max([max(p.normal, p.in_plane) for p in places] + [1e-12])
    size = float(max(np.ptp(at, axis=0).max(), 0.05))
    reach = size * min(0.08, 0.55 / math.sqrt(len(places)))
    left, top = at.min(axis=0) - 1.6 * reach
    width, height = np.ptp(at, axis=0) + 3.2 * reach
    marks = "".join(
        f'<circle cx="{x:.4f}" cy="{y:.4f}" r="{reach * p.normal / most:.4f}" class="along-normal">'
        f"<title>{p.normal:.2f} m/s² along the normal, {p.in_plane:.2f} m/s² in the plane</title></circle>"
        f'<line x1="{x - reach * p.in_plane / most:.4f}" x2="{x + reach * p.in_plane / most:.4f}" y1="{y:.4f}" '
        f'y2="{y:.4f}" class="in-plane" stroke-width="{reach / 6:.4f}"/>'
        for (x, y), p in zip(at, places, strict=True)
    )
    outline = " ".join(f"{x:.4f},{y:.4f}" for x, y in _hull(at))
    return (
        f'<svg class="cloth-map" viewBox="{left:.4f} {top:.4f} {width:.4f} {height:.4f}" role="img" '
        f'aria-label="Missing force by place on the cloth"><polygon points="{outline}"/>{marks}</svg>'
        f'<p class="note">Disc: along the normal; bar: in the plane. The largest is {number(most, 2)} m/s².</p>'
    )


def _bar_row(name: str, figure: Figure, parts: Sequence[tuple[str, float, float]], reach: float) -> str:
    bars = "".join(
        f'<i class="{kind}" style="left:{_share(start, reach)};width:{_share(end - start, reach)}"></i>'
        for kind, start, end in parts
        if end > start
    )
    if figure.interval is not None and all(math.isfinite(end) for end in figure.interval):
        low, high = figure.interval
        bars += f'<i class="whisker" style="left:{_share(low, reach)};width:{_share(high - low, reach)}"></i>'
    value = f"{tenths(figure.value)} {small(tenths_interval(figure.interval))}"
    return _bar(escaped(name), value, bars)


def _bar(name: str, value: str, bars: str) -> str:
    value = f'<span class="value">{value}</span>'
    return f'<div><span class="name">{name}</span><span class="track">{bars}</span>{value}</div>'


def where_bars(title: str, bins: Sequence[WhereBin]) -> str:
    """Return one where-map: a bar per bin as long as its root mean square error [mm]."""
    if not bins:
        return ""
    reach = max([b.value_mm for b in bins if math.isfinite(b.value_mm)] + [1e-9])
    rows = "".join(
        _bar(
            words(b.name),
            f"{tenths(b.value_mm)} {small(percent(b.share))}",
            f'<i class="plain" style="left:0;width:{_share(b.value_mm, reach)}"></i>',
        )
        for b in bins
    )
    return f'<div><h3>{escaped(title)}</h3><div class="bars small">{rows}</div></div>'


def cloth_map(vertices: Sequence[VertexResidual]) -> str:
    """Return the garment seen from the front, a spot per vertex coloured by its error."""
    known = [v for v in vertices if math.isfinite(v.value_mm) and all(math.isfinite(x) for x in v.at_m)]
    if not known:
        return ""
    places = np.array([(v.at_m[0], -v.at_m[-1]) for v in known])
    values = np.array([v.value_mm for v in known])
    low, high = float(values.min()), float(values.max())
    size = float(max(np.ptp(places, axis=0).max(), 0.05))
    spot = size * min(0.06, 0.5 / math.sqrt(len(known)))
    left, top = places.min(axis=0) - 1.5 * spot
    width, height = np.ptp(places, axis=0) + 3 * spot
    spots = "".join(
        f'<circle cx="{x:.4f}" cy="{y:.4f}" r="{spot:.4f}" style="fill:color-mix(in oklab, var(--high) '
        f'{100 * (v - low) / max(high - low, 1e-12):.0f}%, var(--low))"><title>{tenths(v)}</title></circle>'
        for (x, y), v in zip(places, values, strict=True)
    )
    outline = " ".join(f"{x:.4f},{y:.4f}" for x, y in _hull(places))
    if len(known) <= MOST_LABELS:
        width += 4 * spot
        spots += "".join(
            f'<text x="{x + 1.4 * spot:.4f}" y="{y + 0.45 * spot:.4f}" font-size="{1.25 * spot:.4f}">{v:.1f}</text>'
            for (x, y), v in zip(places, values, strict=True)
        )
    return (
        f'<svg class="cloth-map" viewBox="{left:.4f} {top:.4f} {width:.4f} {height:.4f}" role="img" '
        f'aria-label="Error by place on the cloth, from {tenths(low)} to {tenths(high)}">'
        f'<polygon points="{outline}"/>{spots}</svg>'
        f'<p class="ramp">{tenths(low)} <i></i> {tenths(high)}</p>'
    )


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
) -> str:  # fmt: skip
    """Return errors [m], shown in thousandths, over time as a figure; `motion` ties it to a motion of the player."""
    curves = [curve for curve in curves if np.isfinite(curve.mean).any()]
    if len(time) < 2 or not curves:
        return ""
    start, end = float(time[0]), float(time[-1])
    drawn = [part for curve in curves for part in (curve.mean, curve.largest) if part is not None]
    top, steps = _nice_top(1e3 * max(float(np.nanmax(part)) for part in drawn))
    lines, legend = [], []
    for curve in curves:
        style = RUN_CLASSES[curve.run]
        if curve.largest is not None:
            lines.append(f'<path class="largest {style}" d="{_path(time, 1e3 * curve.largest, top)}"/>')
        lines.append(f'<path class="{style}" d="{_path(time, 1e3 * curve.mean, top)}"/>')
        colour = f"var(--{style.removeprefix('is-')})"
        if curve.name:
            legend.append((colour, "is-line", curve.name))
            continue
        mean = 1e3 * float(np.nanmean(curve.mean))
        lines.append(f'<path class="mean {style}" d="M0 {100 * (1 - mean / top):.2f}H100"/>')
        worst = 1e3 * float(np.nanmax(curve.mean if curve.largest is None else curve.largest))
        worst_name = "worst frame" if curve.largest is None else "worst point"
        text = f"{RUN_NAMES[curve.run]}: mean {mean:.1f} mm, {worst_name} {worst:.1f} mm"
        legend.append((colour, "is-line", text))
    ticks = "".join(
        f'<span class="tick y" style="bottom:{100 * k / steps:.2f}%">{number(top * k / steps)}</span>'
        for k in range(steps + 1)
    )
    ticks += "".join(
        f'<span class="tick x" style="left:{100 * (t - start) / (end - start):.2f}%">{t:g}</span>'
        for t in _ticks(start, end)
    )
    grid = "".join(
        f'<line class="grid" x1="0" x2="100" y1="{100 * k / steps:.2f}" y2="{100 * k / steps:.2f}"/>'
        for k in range(steps + 1)
    )
    tied = "" if motion is None else f' data-motion="{motion}" data-start="{start:.4f}" data-end="{end:.4f}"'
    cursor = "" if motion is None else '<span class="cursor" hidden></span>'
    spoken = escaped(f"{caption} " + "; ".join(text for _, _, text in legend))
    return (
        f'<figure class="chart"><figcaption>{escaped(caption)}</figcaption>{_legend(legend)}<div class="plot"{tied}>'
        f'<svg viewBox="0 0 100 100" preserveAspectRatio="none" role="img" aria-label="{spoken}">'
        f"{grid}{''.join(lines)}</svg>"
        f'{ticks}<span class="axis y">{escaped(unit)}</span><span class="axis x">{escaped(axis)}</span>{cursor}'
        "</div></figure>"
    )


def _legend(entries: Sequence[tuple[str, str, str]]) -> str:
    items = "".join(
        f'<li class="{kind}" style="--swatch:{colour}">{escaped(text)}</li>' for colour, kind, text in entries
    )
    return f'<ul class="legend">{items}</ul>'


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


def _nice_top(largest: float) -> tuple[float, int]:
    """Top of an axis from zero and its number of steps."""
    if not largest > 0:
        return 1.0, 2
    raw = largest / 4
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * nice for nice in (1, 2, 2.5, 5, 10) if power * nice >= raw * (1 - 1e-9))
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

"""Fit a fabric to 81, 49, 25, 16, 9 and 5 of a swatch's markers, and measure the error on all 81.

The swatch is the motion capture paper's, of a synthetic fabric whose cloth is not the fitter's
(`firmware_host.synthetic.swatch`). It is held along its whole top edge, because one that hangs from two corners chooses
its folds by chance. The method is `si`, fitted by least squares to the motion `swing`. The markers are rows and columns
nearest to even ones; five are the corners and the middle. Error: mean distance of all judged markers
on the motion `other`, which no fit sees. Width: end over beginning of the 90 % interval; "-" where the markers do not
identify the parameter. With --svg the figure is written there. Fits are cached in --folder.

Run: python benchmarks/marker_count.py [--fabric cotton ...] [--seed 0] [--svg FILE] [--folder DIR]
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import sys
import tempfile
from pathlib import Path

from formats.arrays import Floats, Integers

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import msgspec
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from firmware_host.synthetic.cloth import simulate
from firmware_host.synthetic.swatch import SWATCH_FPS, SWATCH_MOTIONS, TO_SENSOR, TRUE_FABRICS, measured
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.export.moving import material_rows
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import find_method
from fit.recordings.recording import prepare
from formats.fit_records import FitResult
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.importers.swatch_mocap import import_marker_take
from formats.results import load_fit_result, save_fit_result
from formats.swatch import SWATCH_SIDE as LENGTH
from formats.swatch import swatch
from formats.take import Take

SWATCH_SIDE = 9  # markers along each side
CELLS, SECONDS = 4, 4.2  # of the other cloth between two markers; as long as the paper's 500 frames
GRIDS = {81: 9, 49: 7, 25: 5, 16: 4, 9: 3, 5: 0}
SPACING = 0.05  # m


def chosen(count: int) -> Integers:
    """Return the indices of the chosen markers among the 81."""
    if count == 5:
        return np.array([0, 8, 40, 72, 80])
    lines = np.unique(np.round(np.linspace(0, SWATCH_SIDE - 1, GRIDS[count])).astype(int))
    return np.asarray((SWATCH_SIDE * lines[:, None] + lines).ravel())


def fewer(take: Take, count: int) -> Take:
    """Return a take with fewer markers."""
    left = chosen(count)
    garment = msgspec.structs.replace(take.garment, points=tuple(take.garment.points[k] for k in left))
    hidden = None if take.points_hidden is None else take.points_hidden[:, left]
    return dataclasses.replace(
        take, garment=garment, points=take.points[:, left], points_valid=take.points_valid[:, left],
        points_sd=take.points_sd[:, left], points_hidden=hidden,
    )  # fmt: skip


def recorded(fabric: str, motion: str, folder: Path) -> Take:
    """Return a take of a swatch that is swung through the cloth and up and down, held along its top edge."""
    true = TRUE_FABRICS[fabric]
    garment = msgspec.structs.replace(swatch(true.density * LENGTH**2, name=fabric), held="edge")
    time = np.arange(round(SECONDS * SWATCH_FPS)) / SWATCH_FPS

    def ends(instants: Floats) -> Floats:
        ramp = np.clip(instants / 0.5, 0.0, 1.0)
        ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
        swung = sum(a * (np.sin(2 * np.pi * f * instants + p) - np.sin(p)) for f, a, p in SWATCH_MOTIONS[motion]) * ramp
        place = np.zeros((len(instants), 2, 3))
        place[:, 0, 0], place[:, 1, 0] = -LENGTH / 2, LENGTH / 2
        place[:, :, 2] = np.asarray(swung)[:, None]
        return place

    count = (SWATCH_SIDE - 1) * CELLS + 1
    nodes = simulate(garment, ends, time, physics=true.physics, effects={}, rows=count, columns=count)
    markers = nodes[:, ::CELLS, ::CELLS].reshape(len(time), -1, 3) @ TO_SENSOR
    seen = measured(markers, np.random.default_rng([1, 81]))
    path = folder / f"{fabric}-{motion}.csv"
    write_marker_csv(path, MarkerTracks(garment.point_names, time, seen))
    return import_marker_take(path, garment)


def error_of(result: FitResult, take: Take) -> float:
    """Return the mean distance [m] of all judged markers of a take from the fit's simulation."""
    recording = prepare(take)
    simulator = Simulator(recording, resolution=Resolution(spacing=SPACING))
    run = simulator.run(material_rows(result, take.garment.areal_density))
    counted = recording.counted
    return float(np.linalg.norm(run.points[0] - recording.points, axis=2)[counted].mean())


def widths(result: FitResult) -> dict[str, float]:
    """Return the end over the beginning of every parameter's interval; NaN where it is not identified."""
    return {
        p.name: p.interval_high / p.interval_low
        if p.is_identified and p.interval_low and p.interval_high is not None else float("nan")
        for p in result.parameters
    }  # fmt: skip


def fitted(fabric: str, folder: Path, seed: int) -> dict[int, tuple[float, float, FitResult]]:
    """Return for each number of markers the error before and after [m] on all markers of the other motion, and the fit.

    Fits in the folder are reused.
    """
    takes = {motion: recorded(fabric, motion, folder) for motion in ("swing", "other")}
    method = find_method("si")
    found = {}
    for count in GRIDS:
        kept = folder / f"{fabric}-{count}-{seed}.json"
        if not kept.exists():
            request = request_of(method, [], iterations=350, seed=seed, spacing=SPACING, search="least-squares")
            save_fit_result(kept, calibrate([fewer(takes["swing"], count)], [], request))
        result = load_fit_result(kept)
        start = msgspec.structs.replace(
            result, parameters=[msgspec.structs.replace(p, fitted=p.initial) for p in result.parameters]
        )
        found[count] = error_of(start, takes["other"]), error_of(result, takes["other"]), result
    return found


def svg(errors: dict[str, list[float]], spread: dict[str, list[float]]) -> str:
    """Return the figure: errors [mm] and, on a log scale, interval widths against the number of markers."""
    counts = list(GRIDS)
    colours = ("#2b6cb0", "#c05621", "#2f855a", "#6b46c1", "#b7791f")
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 760 330" font-family="sans-serif" font-size="12">',
        '<rect width="760" height="330" fill="#fff"/>',
    ]
    panels = (
        (errors, 50, "error on another motion, mm", 0.0, 1.1 * max(max(v) for v in errors.values()), False),
        (spread, 430, "end over beginning of the 90 % interval", 1.0, 100.0, True),
    )
    for lines, left, title, low, high, is_log in panels:

        def at(k: int, value: float, left: int = left, low: float = low, high: float = high, log: bool = is_log) -> str:
            share = np.log(value / low) / np.log(high / low) if log else (value - low) / (high - low)
            return f"{left + 40 + k * 46:.0f},{270 - 210 * min(float(share), 1.0):.1f}"

        parts.append(f'<text x="{left}" y="24" fill="#222">{title}</text>')
        parts.append(f'<path d="M{left + 20},50V270H{left + 290}" fill="none" stroke="#888"/>')
        decade = 10 ** np.floor(np.log10(high))
        step = decade if high > 3 * decade else decade / 4
        for tick in (1, 2, 5, 10, 20, 50, 100) if is_log else np.arange(0, high, step):
            y = at(0, float(tick)).split(",")[1]
            parts.append(f'<text x="{left + 14}" y="{float(y) + 4:.1f}" text-anchor="end" fill="#555">{tick:g}</text>')
        for k, count in enumerate(counts):
            parts.append(f'<text x="{left + 40 + k * 46}" y="288" text-anchor="middle" fill="#555">{count}</text>')
        parts.append(f'<text x="{left + 155}" y="306" text-anchor="middle" fill="#555">markers</text>')
        for number, (name, values) in enumerate(lines.items()):
            colour = colours[number % len(colours)]
            known = [(k, v) for k, v in enumerate(values) if np.isfinite(v)]
            path = " ".join(at(k, v) for k, v in known)
            parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
            parts += [
                f'<circle cx="{x}" cy="{y}" r="3.5" fill="{colour}"/>'
                for x, y in (at(k, v).split(",") for k, v in known)
            ]  # fmt: skip
            parts.append(
                f'<text x="{left + 150}" y="{48 + 16 * number}" fill="{colour}">{name.replace("_", " ")}</text>'
            )
    return "\n".join([*parts, "</svg>"]) + "\n"


def main(arguments: list[str] | None = None) -> None:
    """Print the table, and draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fabric", nargs="+", default=["cotton", "silk"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--svg", type=Path)
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args(arguments)
    errors, spread = {}, {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        for fabric in options.fabric:
            found = fitted(fabric, folder, options.seed)
            names = list(widths(found[81][2]))
            print(f"{fabric:16} {'before':>7} {'error':>7}   " + " ".join(f"{n:>20}" for n in names))
            for count, (before, after, result) in found.items():
                cells = " ".join(f"{w:20.2f}" if np.isfinite(w) else f"{'-':>20}" for w in widths(result).values())
                print(f"{count:8} markers {1e3 * before:7.2f} {1e3 * after:7.2f}   {cells}", flush=True)
            errors[fabric] = [1e3 * after for _, after, _ in found.values()]
            if fabric == options.fabric[0]:
                spread = {n: [widths(r)[n] for _, _, r in found.values()] for n in names}
    if options.svg is not None:
        options.svg.write_text(svg(errors, spread))


if __name__ == "__main__":
    main()

"""Measure the distance of the settled cloth from its true rest at the beginning of a take.

Run: python benchmarks/settling.py [--fabrics 6]. Swatches of 0.30 and 0.45 m have ten nodes a side. Fabrics are drawn
from the `si` method's box without its edges (log-uniform, 0.2 kg/m^2). A swatch is held at the edge, or at two corners
by clips. The clips are as far apart as the cloth is wide, or 15 mm nearer. Five or 81 tracked points have 2 mm of white
noise at 60 frames a second.

The points show a rest of the same fabric or of another fabric, or the same rest displaced by 60 mm at the bottom. The
last stands for a take that begins in motion. Rests come from 30 s of settling from a stirred sheet, without a pull.

Two distances are means over the points [mm]. One is from the first frame to the position after another 30 s, the
remainder of settling. The other is from the first frame to the rest of the points, if the rest is the fabric's own. It
reveals whether the same one of several folds was found. Printed are median, 90th percentile and largest over fabrics,
sizes and points, and the share of rests found to 1 mm.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.cloth.support import SETTLE_TIME
from fit.effects.clip_slack import ClipSlack
from fit.methods.physical_units import SI
from fit.recordings.recording import prepare
from formats.arrays import Floats
from tests.fit.scenes import hung, sheet, take_of

DENSITY = 0.2  # kg/m^2
SIZES = (0.30, 0.45)  # m
SLACK = 0.015  # m
LONG = 30.0  # s, after which every swing and nearly every fold is at rest
TIME = np.arange(25) / 60
NOISE = 0.002  # m
ASIDE = 0.06  # m at the bottom
SHOWN = ("its own rest", "another fabric's rest", "its own rest, swung aside")


@dataclass(frozen=True)
class Scene:
    """A swatch of `size` [m], held at its "edge" or "corners" by clips `slack` [m] nearer; five points, or a grid."""

    size: float
    held: str
    grid: int | None
    slack: float

    def settle(self, row: Floats, shown: Floats | None, seconds: float, start: Floats | None = None) -> Hung:
        """Settle one fabric, (1, parameters), for `seconds`; shown [m], (points, 3): initial positions of the points.

        start [m], (nodes, 3): initial positions of the nodes instead of the default ones.
        """
        garment = sheet(self.size, self.size, held=self.held, grid=self.grid, mass=DENSITY * self.size**2)
        points = hung(garment, TIME)
        if shown is not None:
            points = shown + np.random.default_rng(0).normal(0, NOISE, points.shape)
        recording = prepare(take_of(garment, TIME, np.zeros((len(TIME), 3)), points, sd=NOISE))
        if shown is None:
            recording = replace(recording, valid=np.zeros_like(recording.valid))
        simulator = Simulator(recording, (ClipSlack(),), resolution=Resolution(spacing=self.size / 9))
        support, rest = simulator.support, simulator.mesh.rest

        def begin(ends: Floats) -> Floats:
            if start is not None:
                return np.repeat(start[None], len(ends), 0)
            return support.start(ends) + (stirred(rest) if shown is None else 0.0)

        simulator.support = replace(support, settle_time=seconds, start=begin)
        run = simulator.run(row, np.array([[self.slack]]), shapes=True)
        assert run.shapes is not None
        return Hung(run.points[0, 0], run.shapes[0, 0].astype(float))


@dataclass(frozen=True)
class Hung:
    """Cloth at the first frame: points [m], (points, 3), and nodes [m], (nodes, 3)."""

    points: Floats
    nodes: Floats


def stirred(rest: Floats) -> Floats:
    """Waves out of the flat cloth's plane [m], (nodes, 3), from nothing at the top to 1 cm: no fold is preferred."""
    drop = (rest[:, 1].max() - rest[:, 1]) / np.ptp(rest[:, 1])
    waves = sum(np.sin(8 * k * rest[:, 0] + k * k) * np.sin(3 * k * rest[:, 1] + k) for k in (1, 2, 3))
    return np.outer(0.01 * drop * waves, [0.0, 1.0, 0.0])


def fabrics(count: int, seed: int) -> Floats:
    """Material rows drawn from the middle nine tenths of the box, (count, parameters)."""
    share = 0.05 + 0.9 * np.random.default_rng(seed).random((count, len(SI.minimum)))
    return SI.to_materials(SI.minimum * (SI.maximum / SI.minimum) ** share, DENSITY)


def shown_by(what: str, rests: list[Hung], k: int) -> Floats:
    """Return the initial positions of fabric k's points [m], (points, 3)."""
    places = rests[(k + 1) % len(rests) if what == SHOWN[1] else k].points
    if what == SHOWN[2]:
        drop = (places[:, 2].max() - places[:, 2]) / np.ptp(places[:, 2])
        places = places + np.outer(ASIDE * drop**1.5, [0.0, 1.0, 0.0])
    return places


def apart(a: Floats, b: Floats) -> float:
    """Mean distance [mm] of points, (points, 3) each."""
    return float(1e3 * np.linalg.norm(a - b, axis=1).mean())


def measure(scene: Scene, rows: Floats, seconds: float = SETTLE_TIME) -> dict[str, Floats]:
    """Return distances [mm] for each of `SHOWN`: from the later rest, and from the fabric's rest, (fabrics, 2)."""
    rests = [scene.settle(row[None], None, LONG) for row in rows]
    found = {}
    for what in SHOWN:
        first = [scene.settle(row[None], shown_by(what, rests, k), seconds) for k, row in enumerate(rows)]
        after = [scene.settle(row[None], None, LONG, start=one.nodes) for row, one in zip(rows, first, strict=True)]
        left = [apart(one.points, later.points) for one, later in zip(first, after, strict=True)]
        missed = [apart(one.points, rest.points) for one, rest in zip(first, rests, strict=True)]
        found[what] = np.stack([left, missed], 1)
    return found


def show(title: str, found: Floats) -> None:
    """Print one line of the table; found, (cases, 2)."""
    left, missed = found.T
    print(f"{title:<56} {spread(left)} | {spread(missed)} | {(missed < 1.0).mean():4.0%}", flush=True)


def spread(distances: Floats) -> str:
    """Median, 90th percentile and largest."""
    return " ".join(f"{mm:6.2f}" for mm in np.percentile(distances, [50, 90, 100]))


def main(arguments: list[str] | None = None) -> None:
    """Print a table, one line for each kind of held edge and each kind of initial points."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fabrics", type=int, default=6, help="default %(default)s")
    parser.add_argument("--seed", type=int, default=2, help="default %(default)s")
    parser.add_argument("--seconds", type=float, default=SETTLE_TIME, help="of settling; default %(default)s")
    options = parser.parse_args(arguments)
    if options.fabrics < 2 or options.seconds <= 0:
        parser.error("at least two fabrics and some seconds are needed")
    rows = fabrics(options.fabrics, options.seed)
    print(f"{'mm: median, 90 %, largest':<56} left to do           | from the fabric's rest | found")
    for held in ("edge", "corners"):
        for slack in (0.0, SLACK):
            parts = [measure(Scene(w, held, n, slack), rows, options.seconds) for w in SIZES for n in (None, 9)]
            for what in SHOWN:
                title = f"{held}, {1e3 * slack:.0f} mm slack, showing {what}"
                show(title, np.concatenate([part[what] for part in parts]))


if __name__ == "__main__":
    main()

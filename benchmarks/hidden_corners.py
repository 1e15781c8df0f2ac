"""Fit the coefficients of `capture.garment.folding` to the development sets, with cross-validation over cloths.

Run: python benchmarks/hidden_corners.py [--keep FOLDER] [--sets development development-2 ...]. Half a minute a scene,
6 scenes a set, to draw them; a few seconds a scene once they are kept (50 MB each).

    maximise  sum_n [y_n ln P_n + (1 - y_n) ln(1 - P_n)] - L / 2 sum_k (s_k c_k)^2

by Newton's iteration, s_k the feature's standard deviation. The previous frame's log-odds are also a feature and depend
on the weights. So the weights are fitted `ROUNDS` times, first without this feature. Examples are the corners in doubt
of the hard swings that are clearly hidden (y = 1) or clearly visible (0, `firmware_host.synthetic.visibility`). Scenes
of one cloth at several distances are one motion, so that `DISTANCES` do, and all are left out together. A hidden corner
that is not in doubt counts as missed. Only depth is drawn; the held edge's ends are the true ones with the noise that
tracked ones have.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.tracking_scenes import FIRST, LAST, SEEDS, Scene, scenes
from capture.depth.surface import CorrelationMeter
from capture.garment.folding import TRACES, Belief, Weights
from capture.garment.tracker import SilhouetteTracker
from firmware_host.synthetic.depth_noise import spoil
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.render import View
from firmware_host.synthetic.scene import CAMERA, RIG
from firmware_host.synthetic.visibility import PointSight
from firmware_host.synthetic.world import FIRST_STAMP, World

DEVELOPMENT = tuple(name for name in SEEDS if name.startswith("development"))
HELD_SD = np.array([0.3e-3, 0.3e-3, 1.2e-3])  # m, of a tracked end of the held edge
DISTANCES = (1.6, 2.5)  # m
ROUNDS = 6
PENALTY = 1.0  # L
TARGETS = (0.95, 0.90)  # precision, recall
CORNERS = 4
FEW = 20  # pixels


@dataclass(frozen=True)
class Examples:
    """Corners of one scene: time [s], (n,); features, (n, 4, features), NaN where not in doubt; the truth, (n, 4).

    - `pixels`, (n, 4): number of pixels that show the corner's neighbourhood
    - `reported`, (n, 4): the current tracker's answer, which also considers objects in front and the image's border;
      corners from the top left clockwise
    """

    cloth: str
    time: np.ndarray
    traces: np.ndarray
    hidden: np.ndarray
    visible: np.ndarray
    pixels: np.ndarray
    reported: np.ndarray

    @property
    def asked(self) -> np.ndarray:
        """Return which corners are in doubt, (n, 4)."""
        return np.isfinite(self.traces[..., 0])

    @property
    def learnt(self) -> np.ndarray:
        """Return which corners are in doubt, and clearly hidden or clearly visible, (n, 4)."""
        return self.asked & (self.hidden | self.visible)

    def followed(self, weights: Weights) -> tuple[np.ndarray, np.ndarray]:
        """Return, for given weights, the prior log-odds and the probability of being hidden, (n, 4) each."""
        belief = Belief(self.traces.shape[1], weights)
        pairs = [(belief.before(float(t)), belief.update(found, float(t)))
                 for t, found in zip(self.time, self.traces, strict=True)]  # fmt: skip
        before, probable = zip(*pairs, strict=True)
        return np.array(before), np.array(probable)


def depth_frames(scene: Scene, world: World) -> dict[str, np.ndarray]:
    """Render a scene's depth, the ends of the held edge [m], (n, 2, 3), and each corner's visibility, (n, 5)."""
    renderer = world.renderer()
    noise = np.random.default_rng(scene.seed)
    numbers = np.flatnonzero((world.time >= FIRST) & (world.time < LAST))
    depth, sights = [], []
    for n in numbers.tolist():
        bare, _ = renderer.shown(world.nodes[n], world.in_front[n] if world.in_front else ())
        view = View(bare, np.zeros((*bare.shape, 3)))
        whole = renderer.with_hanger(view, world.hanger.origin[n], world.hanger.rotation[n]).depth
        depth.append(spoil(whole, CAMERA, np.random.default_rng([world.seed, n])))
        sights.append(world.sight(n, renderer))
    return {
        "time": world.time[numbers] + FIRST_STAMP,
        "depth": np.stack(depth),
        "held": world.hanger.held[numbers] + HELD_SD * noise.standard_normal((len(numbers), 2, 3)),
        "in_view": np.stack([sight.in_view for sight in sights]),
        "pixels": np.stack([sight.pixels for sight in sights]),
        "share": np.stack([sight.share for sight in sights]),
    }


def examples(scene: Scene, drawn: dict[str, np.ndarray]) -> Examples:
    """Track a rendered scene and return the features of the corners in doubt."""
    tracker = SilhouetteTracker(GARMENTS[scene.garment](), RIG, CorrelationMeter())
    found, reported = [], []
    for depth, held, time in zip(drawn["depth"], drawn["held"], drawn["time"], strict=True):
        reported.append(tracker.track(depth, held, float(time)).hidden)
        found.append(tracker.traces)
    sight = PointSight(drawn["in_view"], drawn["pixels"], drawn["share"])
    corners = np.s_[:, :CORNERS]
    return Examples(
        f"{scene.garment}-{scene.seed % 1000}", drawn["time"], np.array(found), sight.hidden[corners],
        sight.visible[corners], sight.pixels[corners], np.array(reported)[corners],
    )  # fmt: skip


def all_examples(sets: list[str], keep: Path | None) -> Iterator[Examples]:
    """Yield the hard swings' examples, rendered or from the cache."""
    for chosen in sets:
        for scene, make in scenes(chosen):
            if scene.swing != "hard" or scene.distance not in DISTANCES:
                continue
            path = keep / f"{scene.name}.npz" if keep else None
            if path and path.exists():
                with np.load(path) as kept:
                    drawn = {name: kept[name] for name in kept.files}
            else:
                drawn = depth_frames(scene, make())
                if path:
                    path.parent.mkdir(parents=True, exist_ok=True)
                    np.savez(path, **drawn)
            yield examples(scene, drawn)


def fit(traces: np.ndarray, hidden: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the constant and the coefficients, (features,), of the most probable logistic regression."""
    spread = np.maximum(traces.std(0), 1e-9)
    rows = np.column_stack([np.ones(len(traces)), traces / spread])
    penalty = np.diag([1e-6] + [PENALTY] * len(spread))
    weights = np.zeros(rows.shape[1])
    for _ in range(30):
        p = 1.0 / (1.0 + np.exp(-rows @ weights))
        slope = rows.T @ (hidden - p) - penalty @ weights
        weights = weights + np.linalg.solve((rows * (p * (1.0 - p))[:, None]).T @ rows + penalty, slope)
    return float(weights[0]), weights[1:] / spread


def fit_to(found: list[Examples]) -> Weights:
    """Fit to the corners in doubt that are clearly hidden or clearly visible."""
    seen = np.concatenate([e.traces[e.learnt] for e in found])
    hidden = np.concatenate([e.hidden[e.learnt] for e in found]).astype(float)
    weights = Weights(*fit(seen, hidden), 0.0)
    for _ in range(ROUNDS - 1):
        before = np.concatenate([e.followed(weights)[0][e.learnt] for e in found])
        constant, coefficients = fit(np.column_stack([seen, before]), hidden)
        weights = Weights(constant, coefficients[:-1], float(coefficients[-1]))
    return weights


def left_out(found: list[Examples]) -> list[np.ndarray]:
    """Return the probability of every corner, (n, 4) each, by fits to the other cloths; NaN where not in doubt."""
    others = {cloth: fit_to([e for e in found if e.cloth != cloth]) for cloth in {e.cloth for e in found}}
    return [e.followed(others[e.cloth])[1] for e in found]


def rates(found: list[Examples], probable: list[np.ndarray], threshold: float) -> tuple[float, float]:
    """Return precision and recall at a threshold."""
    right = wrong = hidden = 0
    for e, p in zip(found, probable, strict=True):
        right += np.count_nonzero((p > threshold) & e.hidden)
        wrong += np.count_nonzero((p > threshold) & e.visible)
        hidden += np.count_nonzero(e.hidden)
    return right / max(right + wrong, 1), right / hidden


def print_wrong(found: list[Examples], probable: list[np.ndarray], threshold: float) -> None:
    """Print the false and the missed answers at a threshold, by kind."""
    wrong = few = sleeves = others = unasked = 0
    for e, p in zip(found, probable, strict=True):
        alarms, missed = (p > threshold) & e.visible, e.asked & e.hidden & ~(p > threshold)
        wrong, few = wrong + np.count_nonzero(alarms), few + np.count_nonzero(alarms & (e.pixels <= FEW))
        tips = np.count_nonzero(missed[:, :2]) if e.cloth.startswith("t-shirt") else 0
        sleeves, others = sleeves + tips, others + np.count_nonzero(missed) - tips
        unasked += np.count_nonzero(e.hidden & ~e.asked)
    print(f"wrongly reported as hidden: {wrong}, of these seen through {FEW} pixels or fewer: {few}")
    print(f"hidden, in doubt, not reported: {sleeves} tips of sleeves, {others} others; never in doubt: {unasked}")


def main() -> None:
    """Print coefficients, threshold, and the precision and recall on cloths left out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="cache rendered depth there, 50 MB a scene")
    parser.add_argument("--sets", nargs="+", choices=sorted(SEEDS), default=DEVELOPMENT, help="which seeds")
    chosen = parser.parse_args()
    found = list(all_examples(list(chosen.sets), chosen.keep))
    p = left_out(found)
    grid = np.arange(0.05, 1.0, 0.01)
    shortfall = [max(want - got for want, got in zip(TARGETS, rates(found, p, t), strict=True)) for t in grid]
    hidden, visible = (sum(np.count_nonzero(e.asked & part) for e, part in parts) for parts in
                       ([(e, e.hidden) for e in found], [(e, e.visible) for e in found]))  # fmt: skip
    print(
        f"{len(found)} scenes of {len({e.cloth for e in found})} cloths; in doubt: {hidden} hidden, {visible} visible"
    )
    best = float(grid[int(np.argmin(shortfall))])
    for threshold in (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, best):
        precision, recall = rates(found, p, threshold)
        print(f"threshold {threshold:.2f}: precision {100 * precision:.1f} %, recall {100 * recall:.1f} %")
    print_wrong(found, p, best)
    precision, recall = rates(found, [e.reported.astype(float) for e in found], 0.5)
    print(f"the tracker as it is: precision {100 * precision:.1f} %, recall {100 * recall:.1f} %")
    weights = fit_to(found)
    print(f"{weights.constant:8.2f}  constant")
    for name, value in zip(TRACES, weights.coefficients, strict=True):
        print(f"{value:8.2f}  {name}")
    print(f"{weights.before:8.2f}  what was before")


if __name__ == "__main__":
    main()

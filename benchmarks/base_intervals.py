"""Count how many 90 % intervals of a diagnosis' base fit hold the truth, in cloth whose cost ripples.

    benchmarks/base_intervals.py [--truths 40] [--first 0] [--ripple 0 0.15 0.3 0.6] [--missing 0 2]
    benchmarks/base_intervals.py --of TAKE ... [--seeds 6] [--spacing 0.08]

The first form simulates nothing: each base parameter's logarithm moves a field of its own, as in
`tests/fit/gap/linear_cloth.py`, and waves of it move two more. So the cost has many local minima, as folds make them.
`--ripple` is the size [mm rms] of these fields, and `--missing` of a motion that no parameter makes. Truths are drawn
over the box of parameters. The diagnosis' own base fit fits two takes of each, with noise of 3 mm along an axis. A row
counts intervals by several rules for the ends that count; a further end is predicted from them in each
(`fit.gap.findings.base_parameters`).

The second form has no truth. It fits real or simulated takes with several seeds, and counts the values of one seed that
lie in another seed's interval. Rates are of all parameters, and of those called identified, with 95 % Wilson intervals.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from fit.blind.rates import rate_of
from fit.cloth.model import Resolution
from fit.gap.base_fit import fit_base
from fit.gap.checkpoint import Checkpoint
from fit.gap.closure import block_errors, share_of
from fit.gap.diagnosis import fine_enough
from fit.gap.findings import ONE_END, alike_ends, base_parameters
from fit.gap.fitting import Fitted
from fit.gap.gates import CONVERGED
from fit.methods import SI
from fit.observer import residuals
from fit.observer.residuals import Observer
from fit.recordings.recording import Recording, prepare
from formats.arrays import Floats
from formats.take import Take
from formats.take_reader import read_take
from tests.fit.gap.linear_cloth import EFFECTS, MESH, OF_VECTOR, RATE, LinearCloth, World
from tests.fit.scenes import hung, sheet, swing, take_of

NOISE = 3e-3  # m, of a point along an axis; our choice: a depth sensor's
SECONDS = 3.0  # of a take; our choice: six half-seconds, as short takes have
# m rms of a factor of e in stretch, shear, bending, bending damping and damping. Our choice: from what a take shows
# plainly to what it hardly shows, in the order of the intervals of `hangtime fit`.
SIZES = (1e-3, 1e-3, 0.5e-3, 0.2e-3, 1e-3)
WAVES = 2  # fields that a parameter moves in waves; our choice: two waves together do not repeat within the box
SHORTEST, LONGEST = 0.25, 1.0  # of a wave, in logs: apart as ends of seeds are, 143, 185, 413 and 1000 N/m of stretch
MARGIN = 0.1  # of a parameter's range at each end, without truths; our choice: a value at its bound has no interval
Rule = Callable[[Observer, Fitted, list[Fitted]], list[Fitted]]


def told_apart_by_test(observer: Observer, best: Fitted, fits: list[Fitted]) -> list[Fitted]:
    """Return the best end, and those that agree in cost and that a paired test does not tell from it, as before."""
    errors, most = block_errors(observer, best.residual), (1 + CONVERGED) * best.cost
    near = [one for one in fits if one is not best and one.cost <= most]
    return [best, *(o for o in near if share_of(block_errors(observer, o.residual), errors, 0.0).p_value >= ONE_END)]


RULES: dict[str, Rule] = {
    "best end alone": lambda observer, best, fits: [best],
    "ends not told apart": told_apart_by_test,
    "as the diagnosis": lambda observer, best, fits: alike_ends(observer, best, fits),
    "all ends": lambda observer, best, fits: [best, *(one for one in fits if one is not best)],
}


class Rippled(World):
    """A linear world in which waves of each base parameter's logarithm move further fields, [m rms]."""

    seed, ripple = 0, 0.0

    def columns(self, recording: Recording) -> tuple[Floats, dict[str, Floats]]:
        """Return fields of a factor of e in each base parameter, of its own size, and those of effects."""
        base, made = super().columns(recording)
        scale = np.array(SIZES) / self.parameter
        return base * scale[:, None, None, None], made

    def waves(self, recording: Recording, logs: Floats) -> Floats:
        """Return the motion by waves of parameters' logarithms, (candidates, parameters)."""
        rng = np.random.default_rng(90_000 + self.seed)
        moved = np.zeros((len(logs), *recording.points.shape))
        for k, number in itertools.product(range(len(SIZES)), range(WAVES)):
            length, phase = rng.uniform(SHORTEST, LONGEST), rng.uniform(0, 2 * np.pi)
            field = self.field(recording, 5000 + 10 * k + number, self.ripple)
            moved += np.sin(2 * np.pi * logs[:, k] / length + phase)[:, None, None, None] * field
        return moved


class RippledCloth(LinearCloth):
    """A simulator of one recording in a rippled world."""

    def run(self, materials, amplitudes, **options):  # type: ignore[no-untyped-def]
        """Return the candidates' points, with the waves."""
        found = super().run(materials, amplitudes, **options)
        logs = np.log(materials[:, OF_VECTOR] / SI.initial)
        found.points = found.points + self.world.waves(self.recording, logs)
        return found


def takes_of(world: Rippled, logs: Floats, missing: float) -> list[Take]:
    """Return two takes of a cloth with these base parameters, and with a motion [m rms] that no parameter makes."""
    takes = []
    for n, hz in enumerate((0.7, 1.0)):
        time, garment = np.arange(0, SECONDS, 1 / RATE), sheet(grid=5)
        moved = swing(time, amplitude=0.05, hz=hz, sideways=0.02, stop=SECONDS - 1)
        recording = prepare(take_of(garment, time, moved))
        points = hung(garment, time) + moved[:, None] + np.tensordot(logs, world.columns(recording)[0], 1)
        points = points + world.waves(recording, logs[None])[0] + world.field(recording, 9000 + world.seed, missing)
        points = points + np.random.default_rng(2 * world.seed + n).normal(0, NOISE, points.shape)
        takes.append(take_of(garment, time, moved, points, sd=NOISE, name="ab"[n]))
    return takes


def fitted(takes: list[Take], seed: int, resolution: Resolution) -> tuple[Observer, list[Fitted]]:
    """Return the base fits of takes as a diagnosis makes them, best first, and their observer."""
    observer = Observer([prepare(take) for take in takes], SI, EFFECTS, frequency=0.0, resolution=resolution)
    fits, observer, _ = fit_base(observer, lambda *said: None, Checkpoint(None, {}, lambda: 0), seed)
    return observer, fits


def simulated(first: int, count: int, ripple: float, missing: float) -> str:
    """Return rows of counts of intervals that hold known truths."""
    low, high = np.log(SI.minimum / SI.initial), np.log(SI.maximum / SI.initial)
    residuals.Simulator = RippledCloth  # type: ignore[misc, assignment]
    held: dict[str, list[tuple[bool, bool, float]]] = {name: [] for name in RULES}
    ends, apart = [], []
    for seed in range(first, first + count):
        world = Rippled(mesh=0.0)
        world.seed, world.ripple = seed, 1e-3 * ripple
        LinearCloth.world = world
        share = np.random.default_rng(70_000 + seed).uniform(MARGIN, 1 - MARGIN, len(low))
        truth = SI.initial * np.exp(low + share * (high - low))
        observer, fits = fitted(takes_of(world, np.log(truth / SI.initial), 1e-3 * missing), seed, MESH)
        ends.append(len(fits))
        apart.append(fits[1].cost / fits[0].cost - 1)
        for name, rule in RULES.items():
            for one, value in zip(base_parameters(SI, rule(observer, fits[0], fits)), truth, strict=True):
                is_held = one.interval_low <= value <= one.interval_high  # type: ignore[operator]
                width = float(np.log(one.interval_high / one.interval_low))  # type: ignore[operator]
                held[name].append((is_held, bool(one.is_identified), width))
    said = [
        f"ripple {ripple:g} mm, missing {missing:g} mm: {np.mean(ends):.1f} ends of {count} truths, the second "
        f"{100 * np.median(apart):.2g} % above the best in the median"
    ]
    for name, found in held.items():
        all_of, sure = rate_of(h for h, _, _ in found), rate_of(h for h, is_sure, _ in found if is_sure)
        wide = np.exp(np.median([w for _, _, w in found]))
        said.append(f"  {name:26s} all {all_of}; identified {sure}; end over beginning {wide:.2f}")
    return "\n".join(said)


def seeds_agree(paths: list[Path], seeds: int, spacing: float | None) -> str:
    """Return rows of counts of one seed's values in another seed's intervals."""
    takes = [read_take(path) for path in paths]
    resolution = Resolution(spacing=spacing) if spacing else fine_enough(prepare(takes[0]))
    made = [fitted(takes, seed, resolution) for seed in range(seeds)]
    said = []
    for name, rule in RULES.items():
        found = [base_parameters(SI, rule(observer, fits[0], fits)) for observer, fits in made]
        pairs = [(one, o.fitted) for a, b in itertools.permutations(found, 2) for one, o in zip(a, b, strict=True)]
        held = [(one.interval_low <= value <= one.interval_high, one.is_identified) for one, value in pairs]  # type: ignore[operator]
        sure = rate_of(h for h, is_sure in held if is_sure)
        said.append(f"  {name:26s} all {rate_of(h for h, _ in held)}; identified {sure}")
    costs = " ".join(f"{fits[0].cost:.0f}" for _, fits in made)
    return "\n".join([f"{' '.join(path.stem for path in paths)}, {seeds} seeds, costs {costs}", *said])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truths", type=int, default=40, help="truths a row")
    parser.add_argument("--first", type=int, default=0, help="seed of a row's first truth")
    parser.add_argument("--ripple", type=float, nargs="+", default=[0.0, 0.15, 0.3, 0.6])
    parser.add_argument("--missing", type=float, nargs="+", default=[0.0, 2.0])
    parser.add_argument("--of", type=Path, nargs="+", default=[], metavar="TAKE")
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--spacing", type=float)
    given = parser.parse_args()
    if given.of:
        print(seeds_agree(given.of, given.seeds, given.spacing))
    else:
        for missing, ripple in itertools.product(given.missing, given.ripple):
            print(simulated(given.first, given.truths, ripple, missing), flush=True)

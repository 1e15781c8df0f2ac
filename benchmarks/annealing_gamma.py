"""The distance that annealing reaches as a function of gamma, the one factor that the paper does not give.

Two stand-ins for D [m] have the paper's six parameters and bounds. They have a floor of 0.03 and about 0.13 at the
paper's initial values (its Fig. 6: 0.1276 before, 0.0467 after). `smooth` has bumps a few millimetres high, as of
folding cloth, and its mass is collinear with stiffness and air. `trap` also has a wide second local minimum, 0.05 deep,
on the initial values' side of the box. Run: python benchmarks/annealing_gamma.py [--seeds 10]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from fit.methods import KINECT_SKIRT
from fit.search.annealing import Annealing, AnnealingSettings, SearchBox
from formats.arrays import Floats

GAMMAS = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)  # 1/m
BOX = SearchBox(KINECT_SKIRT.minimum, KINECT_SKIRT.maximum, KINECT_SKIRT.interval)
# Optimal struct, bend, spring, air and velocity as shares of their ranges, and the cost [m] of a whole range.
BEST = np.array([0.75, 0.12, 0.55, 0.25, 0.72])
COST = np.array([0.16, 0.08, 0.08, 0.17, 0.22])
TRAP = np.array([0.25, 0.60, 0.10, 0.75, 0.30])


def smooth(candidates: Floats) -> Floats:
    """Return an artificial objective D [m], (candidates,), of parameters, (candidates, 6)."""
    shares = (candidates - BOX.minimum) / (BOX.maximum - BOX.minimum)
    apart = shares[:, 1:] - BEST
    apart[:, [0, 3]] += 0.03 * (candidates[:, :1] ** 0.5 - 1)  # more stiffness and air compensate more mass
    bowl = np.sqrt(((COST * apart) ** 2).sum(1) + 1e-4) - 1e-2
    bumps = (
        0.004
        * (1 - np.cos(19 * apart[:, 0] + 7 * apart[:, 3]))
        * (0.5 + np.cos(11 * apart[:, 1] + 5 * apart[:, 4]) ** 2)
    )
    return np.asarray(0.03 + bowl + bumps)


def trap(candidates: Floats) -> Floats:
    """Return the smooth stand-in with a second, shallower and wider valley [m], (candidates,)."""
    shares = (candidates - BOX.minimum) / (BOX.maximum - BOX.minimum)
    second = 0.05 + 0.5 * np.sqrt(((COST * (shares[:, 1:] - TRAP)) ** 2).sum(1))
    return np.minimum(smooth(candidates), second)


STAND_INS: dict[str, Callable[[Floats], Floats]] = {"smooth": smooth, "trap": trap}


def anneal(distance: Callable[[Floats], Floats], settings: AnnealingSettings, seed: int, width: int = 16) -> Annealing:
    """Run one whole annealing chain on an artificial objective."""
    chain = Annealing(KINECT_SKIRT.initial, BOX, settings, np.random.default_rng(seed))
    while not chain.is_finished:
        candidates = chain.ask(width)
        chain.tell(candidates, distance(candidates))
    return chain


def row(distance: Callable[[Floats], Floats], settings: AnnealingSettings, seeds: int) -> dict[str, float]:
    """Run all seeds of one setting; distances in mm, acceptance as shares, iterations per batch of 16."""
    chains = [anneal(distance, settings, seed) for seed in range(seeds)]
    best = 1e3 * np.array([chain.best_distance for chain in chains])
    last = 1e3 * np.array([chain.current_distance for chain in chains])
    accepted = np.array([[step.is_accepted for step in chain.steps[1:]] for chain in chains])
    third = accepted.shape[1] // 3
    low, middle, high = np.percentile(best, [25, 50, 75])
    return {
        "best": middle, "low": low, "high": high, "last": float(np.median(last)),
        "first_third": float(accepted[:, :third].mean()), "last_third": float(accepted[:, -third:].mean()),
        "per_batch": float(np.mean([len(c.steps) / np.ceil(c.evaluations / 16) for c in chains])),
    }  # fmt: skip


def main(seeds: int = 10) -> list[dict[str, float]]:
    """Print the table; return its rows."""
    start = ", ".join(f"{name} {1e3 * d(KINECT_SKIRT.initial[None])[0]:.0f} mm" for name, d in STAND_INS.items())
    print(f"D at the paper's initial values: {start}; {seeds} seeds, 350 iterations")
    print(
        f"{'D':7} {'bounds':8} {'gamma':>7}  {'best D, median (quartiles)':26} {'last D':>7}"
        "  accepted: first, last third  iterations/batch"
    )
    rows = []
    for name, distance in STAND_INS.items():
        for beyond in ("reflect", "redraw", "clip"):
            for gamma in GAMMAS:
                found = row(distance, AnnealingSettings(gamma=gamma, beyond_bounds=beyond), seeds)
                rows.append(found)
                quartiles = f"{found['best']:.1f} ({found['low']:.1f} to {found['high']:.1f}) mm"
                print(
                    f"{name:7} {beyond:8} {gamma:7.0e}  {quartiles:26} {found['last']:7.1f}  "
                    f"{found['first_third']:15.0%} {found['last_third']:11.0%} {found['per_batch']:18.1f}"
                )
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    main(parser.parse_args().seeds)

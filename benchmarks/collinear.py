"""Compare the probabilities that a diagnosis gives two nearly collinear effects with how often it is right.

    benchmarks/collinear.py [--takes 24] [--first 0] [--apart 0.03 0.01 0.003] [--law 0 0.1] [--by evidence rules]

Takes are those of a linear cloth (`tests/fit/gap/linear_cloth.py`), so nothing is simulated. Strain stiffening moves
this cloth as air drag does, but for the share `--apart` of a field of its own. One of the two is planted in turn, with
half to twice its typical size and noise of its own. `--law` adds a motion of this share of the effect's own: the error
of its law. A row states, of the likelier one of the two, the mean probability, and how often this one was planted.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from formats.take import Take
from tests.fit.gap.linear_cloth import EFFECTS, World, a_take, diagnosed

DRAG, TWIN = "air_drag", "strain_stiffening"
SMALLEST, LARGEST = 0.5, 2.0  # typical sizes that are planted; our choice: from hardly seen to plain
NUMBER_OF_LAW = 7  # of the field that `a_take` draws for an unknown motion
NOISE = 1e-3  # m, of the takes fitted to; half as much again on the take judged on, as in the tests


class Lawful(World):
    """A linear world whose unknown motion is another one for each seed."""

    seed = 0

    def field(self, recording, number, size):  # type: ignore[no-untyped-def]
        """Return the field of a number, or of the seed where the unknown motion is asked for."""
        return super().field(recording, 9000 + self.seed if number == NUMBER_OF_LAW else number, size)


def takes_of(world: Lawful, effect: str, size: float, law: float) -> tuple[list[Take], list[Take]]:
    """Return two takes to fit to and one to judge on, in which an effect has a size in typical sizes."""
    typical = next(one.typical for one in EFFECTS if one.name == effect)
    planted, unknown, first = {effect: size * typical}, law * size * world.effect, 1000 * world.seed
    fitted = [
        a_take(name, world, planted, seed=first + k, hz=0.7 + 0.3 * k, noise=NOISE, unknown=unknown)
        for k, name in enumerate("ab")
    ]
    return fitted, [a_take("c", world, planted, seed=first + 7, noise=1.5 * NOISE, seconds=3.5, hz=0.85,
                           unknown=unknown)]  # fmt: skip


def measure(first: int, count: int, apart: float, law: float, by: str) -> str:
    """Return a row of counts."""
    stated, right, alone = [], [], 0
    for seed in range(first, first + count):
        planted, other = (DRAG, TWIN)[:: 1 if seed % 2 == 0 else -1]
        world = Lawful(alike={TWIN: DRAG}, apart=apart)
        world.seed = seed
        size = float(np.random.default_rng(500 + seed).uniform(SMALLEST, LARGEST))
        found = diagnosed(*takes_of(world, planted, size, law), world, by=by).diagnosis
        likely = {one.id: one.probability for one in found.effects}
        share = likely[planted] / max(likely[planted] + likely[other], 1e-9)
        stated.append(max(share, 1 - share))
        right.append(share > 0.5)
        alone += found.verdict == "effect" and found.named != [planted]
    return (
        f"apart {apart:g}, law {law:g}, by {by}: stated {np.mean(stated):.0%}, right {np.mean(right):.0%} of {count}; "
        f"the other one named alone {alone} times"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--takes", type=int, default=24, help="diagnoses a row")
    parser.add_argument("--first", type=int, default=0, help="seed of a row's first takes")
    parser.add_argument("--apart", type=float, nargs="+", default=[0.03, 0.01, 0.003])
    parser.add_argument("--law", type=float, nargs="+", default=[0.0, 0.1])
    parser.add_argument("--by", nargs="+", default=["evidence", "rules"])
    given = parser.parse_args()
    for law in given.law:
        for apart in given.apart:
            for by in given.by:
                print(measure(given.first, given.takes, apart, law, by), flush=True)

"""Measure the cost of a diagnosis: simulations a take and time, for three takes of three to four seconds, 9 x 9 points.

The case comes from the blind check's generator, with air drag. All effects of the library are tested, and two more
takes are held out. Simulations on the finer and coarser meshes count like any other.
"""

from __future__ import annotations

import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or results depend on the number of processors

from msgspec.structs import replace

from fit.blind.cases import draw_truth, make_takes
from fit.blind.foreign.engines import OWN_GENERATOR
from fit.gap.diagnosis import diagnose

SIMULATIONS_PER_TAKE = 400
SECONDS = 180


def main(seed: int = 5) -> None:
    """Diagnose one case and print its cost beside the targets."""
    truth = draw_truth("cost", "single", OWN_GENERATOR.plants(["air_drag"]), (seed, 0))
    truth = replace(truth, look=replace(truth.look, grid=9))
    takes = make_takes(truth)
    found = diagnose(
        takes[:3], takes[3:], progress=lambda stage, share: print(f"{100 * share:3.0f} % {stage}")
    ).diagnosis
    print(found.sentence)
    per_take = found.cost.simulations / len(takes)
    print(f"{found.cost.simulations} simulations, {per_take:.0f} a take (target {SIMULATIONS_PER_TAKE})")
    print(f"{found.cost.seconds:.0f} s (target {SECONDS} on two cores)")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

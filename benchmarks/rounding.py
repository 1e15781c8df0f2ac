"""Count how often a fit ends inside the intervals of twins, whose starts differ by a rounding error.

    benchmarks/rounding.py [--sets 3] [--truths 5] [--jitters 3] [--spacing 0.1] [--air-drag 1.2] [--takes FOLDER]
    benchmarks/rounding.py --seeds --fit-drag [...]
    benchmarks/rounding.py --seeds --fit-drag --of demo/gentle.mcap demo/mixed.mcap --jitters 8

A set is two takes of the demo's synthetic skirt in air, 4 s each, with hands, noise and motions of its own. The fits
have no drag, so a model-form error is left; with `--fit-drag` they have it. A truth is a case of
`benchmarks/search.py`: our own solver, known parameters, noise alone. Each is fitted once a jitter
(`HANGTIME_JITTER`), and fits that differ in the jitter alone are twins. With `--seeds` twins differ in the search's
seed instead. With `--of` these takes are fitted, in place of sets and truths. Per kind are printed

    held      twins' values inside the 90 % interval: of all parameters, of those called identified
    changes   pairs of twins that disagree whether a parameter is identified
    truth     true values inside the interval, where they are known

`--takes` keeps the sets' takes in a folder, and uses those that are there.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.demo_seeds import hangtime
from benchmarks.search import make_case
from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.identification.calibrate import calibrate
from fit.identification.request import Request
from fit.methods import SI
from fit.runtime import JITTER_VARIABLE
from formats.archive import read_take
from formats.arrays import Booleans, Floats
from formats.fit_records import FitResult
from formats.take import Take

MOTIONS = (("mixed", "twist"), ("hard", "mixed"), ("twist", "gentle"), ("swing", "gentle"))
SECONDS = 4  # of a take
SETS_FROM = 50  # below are those that the rules were chosen on
TRUTHS_FROM = 100  # as in `benchmarks/search.py`


def recorded(folder: Path, number: int) -> list[Take]:
    """Return the takes of a set; record those that the folder lacks."""
    place = folder / str(number)
    place.mkdir(parents=True, exist_ok=True)
    found = []
    for k, motion in enumerate(MOTIONS[number % len(MOTIONS)]):
        archive = place / f"{motion}.mcap"
        if not archive.exists():
            hangtime(place, "sensor", "synthesise", motion, "--name", motion, "--motion", motion, "--effect",
                     "air_drag", "--seconds", SECONDS, "--seed", 10 * number + k)  # fmt: skip
            hangtime(place, "record", "--sensor", f"{motion}/{motion}.oni", "--rig", f"{motion}/rig.toml", "--garment",
                     f"{motion}/garment.toml", "--out", archive)  # fmt: skip
        found.append(read_take(archive))
    return found


def twins(takes: list[Take], request: Request, count: int, *, by_seed: bool) -> list[FitResult]:
    """Return fits that differ by a rounding error of the start, or in the search's seed."""
    if by_seed:
        return [calibrate(takes, [], replace(request, seed=seed)) for seed in range(count)]
    found = []
    for jitter in range(count):
        os.environ[JITTER_VARIABLE] = str(jitter)
        found.append(calibrate(takes, [], request))
    del os.environ[JITTER_VARIABLE]
    return found


class Count:
    """The counts of one kind of takes."""

    def __init__(self) -> None:
        self.held: list[Floats] = []
        self.identified: list[Booleans] = []
        self.truth: list[Floats] = []
        self.changes: list[Floats] = []

    def add(self, fits: list[FitResult], truth: Floats | None = None) -> None:
        """Count one set of twins, and print them."""
        values = np.array([[p.fitted for p in fit.parameters] for fit in fits])
        low = np.array([[p.interval_low for p in fit.parameters] for fit in fits], dtype=float)
        high = np.array([[p.interval_high for p in fit.parameters] for fit in fits], dtype=float)
        identified = np.array([[bool(p.is_identified) for p in fit.parameters] for fit in fits])
        for one in range(len(fits)):
            others = np.arange(len(fits)) != one
            self.held += list((low[one] <= values[others]) & (values[others] <= high[one]))
            self.identified += [identified[one]] * (len(fits) - 1)
            self.changes += list(identified[others] != identified[one])
        if truth is not None:
            self.truth.append(np.where(identified, (low <= truth) & (truth <= high), np.nan))
        for k, p in enumerate(fits[0].parameters):
            spans = (f"{v:.3g} [{a:.3g}, {b:.3g}]{'' if t else ' -'}" for v, a, b, t in
                     zip(values[:, k], low[:, k], high[:, k], identified[:, k], strict=True))  # fmt: skip
            print(f"  {p.name:22} {'   '.join(spans)}")

    def show(self, name: str) -> None:
        """Print the counts."""
        held, identified, changes = np.array(self.held), np.array(self.identified), np.array(self.changes)
        if not held.size:
            return
        print(
            f"{name}: held {held.mean():.1%} of all, "
            f"{held[identified].mean():.1%} of the {identified.sum()} identified ones"
        )
        print(
            f"{name}: {identified.mean():.0%} are called identified; {changes.mean():.1%} of the pairs disagree on it"
        )
        if self.truth:
            inside = np.concatenate(self.truth)
            print(f"{name}: truth held by {np.nanmean(inside):.1%} of the {np.isfinite(inside).sum()} identified ones")


def main(
    sets: int, truths: int, jitters: int, spacing: float, air_drag: float, folder: Path, given: list[Path], *,
    by_seed: bool, fits_drag: bool,
) -> None:  # fmt: skip
    """Fit all twins and print what was counted."""
    skirts, known, begun = Count(), Count(), time.process_time()
    request = Request(
        method=SI, effects=find_effects(["air_drag"]) if fits_drag else (), search="least-squares",
        resolution=Resolution(spacing=spacing),
    )  # fmt: skip
    if given:
        sets, truths = 0, 0
        print(" and ".join(path.name for path in given), flush=True)
        skirts.add(twins([read_take(path) for path in given], request, jitters, by_seed=by_seed))
    for number in range(SETS_FROM, SETS_FROM + sets):
        print(f"set {number}: {' and '.join(MOTIONS[number % len(MOTIONS)])}", flush=True)
        skirts.add(twins(recorded(folder, number), request, jitters, by_seed=by_seed))
    for number in range(TRUTHS_FROM, TRUTHS_FROM + truths):
        case = make_case(number, spacing, air_drag)
        print(f"truth {number}: {', '.join(f'{value:.3g}' for value in case.truth)}", flush=True)
        known.add(twins(case.takes, case.request(search="least-squares"), jitters, by_seed=by_seed), case.truth)
    skirts.show(f"skirts in air, fitted {'with' if fits_drag else 'without'} drag")
    known.show("known truths")
    print(f"{time.process_time() - begun:.0f} s of the processor")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=3)
    parser.add_argument("--truths", type=int, default=5)
    parser.add_argument("--jitters", type=int, default=3)
    parser.add_argument("--spacing", type=float, default=0.1, help="mesh of all fits [m]")
    parser.add_argument("--air-drag", type=float, default=1.2, help="drag coefficient of the truths, fitted too")
    parser.add_argument("--seeds", action="store_true", help="twins differ in the search's seed")
    parser.add_argument("--fit-drag", action="store_true", help="fit the skirts' drag, too")
    parser.add_argument("--of", type=Path, nargs="+", default=[], metavar="TAKE", help="fit these takes")
    parser.add_argument("--takes", type=Path, help="folder of the sets' takes")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as kept:
        main(
            given.sets, given.truths, given.jitters, given.spacing, given.air_drag, given.takes or Path(kept),
            given.of, by_seed=given.seeds, fits_drag=given.fit_drag,
        )  # fmt: skip

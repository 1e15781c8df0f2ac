"""Compare manual and optimised parameters of the motion capture method on four synthetic fabrics.

Errors are of the fitted takes and of another motion.

The cloth of the recordings is not the fitter's (`firmware_host.synthetic.cloth`), the start is `fit.methods.fabrics`.
Cotton is the fabric that choices were made on; read the other three. Run: python benchmarks/mocap_swatch.py [--fabric
silk ...] [--air-drag 1.2] [--method mocap-swatch] [--effect air_drag ...] [--search annealing] [--spacing 0.0208]
[--length-unit 1.0] [--iterations 350] [--seed 0] [--training swing slow]
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import fit.methods.swatch_error
from firmware_host.synthetic.swatch import SWATCH_MOTIONS, make_swatch_take
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import find_method
from fit.methods.fabrics import find_fabric
from fit.methods.mocap_swatch import NODE_SPACING
from formats.descriptions import load_garment
from formats.fit_records import FitResult
from formats.importers.swatch_mocap import import_marker_take

FABRICS = ("cotton", "silk", "denim", "polyester-rayon")
HELD_OUT = "other"


def fit_one(
    fabric: str, folder: Path, *, method: str, spacing: float, iterations: int, seed: int, air_drag: float,
    training: Sequence[str], length_unit: float = 1.0, effects: Sequence[str] = (), search: str = "annealing",
) -> FitResult:  # fmt: skip
    """Make the takes of one fabric and fit all but the last, which is of the motion HELD_OUT."""
    takes = []
    for motion in (*training, HELD_OUT):
        csv, _, garment = make_swatch_take(folder, fabric=fabric, motion=motion, air_drag=air_drag)
        takes.append(import_marker_take(csv, load_garment(garment)))
    chosen = find_method(method)
    chosen = chosen.starting_from(find_fabric(fabric).start, fabric)
    # In units of L metres E is x/L, v/L, kappa L; after division by 1/L only the curvature's factor changes.
    fit.methods.swatch_error.GAMMA = 2.0 * length_unit**2
    chosen = dataclasses.replace(chosen, gamma=chosen.gamma if length_unit == 1.0 else 1e5)
    request = request_of(chosen, list(effects), iterations=iterations, seed=seed, spacing=spacing, search=search)
    return calibrate(takes[:-1], takes[-1:], request)


def main(arguments: list[str] | None = None) -> list[FitResult]:
    """Print the table; return its results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fabric", nargs="+", default=list(FABRICS), choices=FABRICS)
    parser.add_argument("--method", default="mocap-swatch")
    parser.add_argument("--effect", nargs="+", default=[])
    parser.add_argument("--search", default="annealing")
    parser.add_argument("--spacing", type=float, default=NODE_SPACING)
    parser.add_argument("--length-unit", type=float, default=1.0)
    parser.add_argument("--air-drag", type=float, default=0.0)
    parser.add_argument("--iterations", type=int, default=350)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--training", nargs="+", default=["swing"], choices=sorted(set(SWATCH_MOTIONS) - {HELD_OUT}))
    chosen = parser.parse_args(arguments)
    print(
        f"{' with '.join([chosen.method, *chosen.effect])}, {chosen.search}, mesh {1e3 * chosen.spacing:.1f} mm, "
        f"recorded with a drag of {chosen.air_drag:g}, seed {chosen.seed}, "
        f"fitted to {' and '.join(chosen.training)}; mm"
    )
    print(
        f"{'fabric':16} {'objective':>16} {'training mean':>15} {'maximum':>15} {'held-out mean':>15} {'maximum':>15}"
    )
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for fabric in chosen.fabric:
            found = fit_one(
                fabric, Path(folder), method=chosen.method, spacing=chosen.spacing, iterations=chosen.iterations,
                seed=chosen.seed, air_drag=chosen.air_drag, length_unit=chosen.length_unit,
                effects=chosen.effect, search=chosen.search, training=chosen.training,
            )  # fmt: skip
            results.append(found)
            error, whole = found.error, found.objective
            pairs = [(error.train_before, error.train_after), (error.held_out_before, error.held_out_after)]
            cells = [
                f"{1e3 * getattr(before, part):6.1f} > {1e3 * getattr(after, part):6.1f}"
                for before, after in pairs
                if before is not None and after is not None
                for part in ("mean_m", "max_m")
            ]
            both = f"{whole.before:7.3f} > {whole.after:6.3f}" if whole is not None else ""
            print(f"{fabric:16} {both:>16} " + " ".join(cells), flush=True)
            listed = "; ".join(
                f"{c.name} {c.fitted:.3g}{'' if c.is_identified else ' (not identified)'}" for c in found.combinations
            )
            print(f"{'':16} {found.simulations} simulations; {listed}", flush=True)
    return results


if __name__ == "__main__":
    main()

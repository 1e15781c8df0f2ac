"""Compare fits to the outline alone with fits to points: fits to one take, errors on all markers of another motion.

The takes are those of `benchmarks/marker_count.py`: a synthetic swatch held along its top edge, whose cloth is not the
fitter's. `si` by least squares and by CMA-ES uses all markers. `si-outline` by CMA-ES uses the edge of the cloth as
seen from the front, without material points. Each parameter stands beside the truth.

Run: python benchmarks/outline.py [--fabric cotton ...] [--iterations 350] [--seed 0] [--folder DIR]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.marker_count import SPACING, error_of, recorded
from firmware_host.synthetic.swatch import TRUE_FABRICS
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import find_method
from formats.fit_records import FitResult

FITS = (("si", "least-squares"), ("si", "cma-es"), ("si-outline", "cma-es"))


def fitted(fabric: str, folder: Path, *, iterations: int, seed: int) -> list[tuple[str, float, FitResult]]:
    """Return name, error [m] on the other motion, and result of every fit."""
    takes = {motion: recorded(fabric, motion, folder) for motion in ("swing", "other")}
    found = []
    for method, search in FITS:
        request = request_of(
            find_method(method), [], iterations=iterations, seed=seed, spacing=SPACING, search=search
        )  # fmt: skip
        result = calibrate([takes["swing"]], [], request)
        found.append((f"{method}, {search}", error_of(result, takes["other"]), result))
    return found


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fabric", nargs="+", default=["cotton"])
    parser.add_argument("--iterations", type=int, default=350)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        for fabric in options.fabric:
            true = TRUE_FABRICS[fabric].physics
            print(
                f"{fabric}: true stretch {true.stretch_stiffness:g}, shear {true.shear_stiffness:g}, bending "
                f"{true.bending_stiffness:g}, damping {true.linear_damping:g}"
            )
            for name, error, result in fitted(fabric, folder, iterations=options.iterations, seed=options.seed):
                values = ", ".join(f"{p.name} {p.fitted:.3g}" for p in result.parameters)
                print(f"{name:24} {1e3 * error:6.2f} mm, {result.simulations} simulations; {values}", flush=True)


if __name__ == "__main__":
    main()

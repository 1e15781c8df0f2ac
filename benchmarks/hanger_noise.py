"""Measure the error of simulated cloth from noise on the hanger's path, before and after smoothing.

Run: python benchmarks/hanger_noise.py [CASES]. Cases of the blind generator without any effect are each made twice from
the same seed, with and without noise. The tool's cloth has the generator's stiffnesses. The true path drives the cloth,
then the noisy path. The noisy path is smoothed by a cubic spline with its cut-off at 6 Hz, and by the path's own spline
(`fit.recordings.smoothing`).

The script prints the points' error, root mean square over the training takes [mm], beside the deviation of the markers'
white noise. The remaining error lies below the cut-off, where hands move too.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import msgspec
import numpy as np

from formats.arrays import Floats

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.refits import true_vector
from fit.blind.cases import Truth, draw_truth, make_takes
from fit.blind.sensing import HELD_SHARE
from fit.gap.diagnosis import fine_enough
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import Recording, prepare
from fit.recordings.smoothing import smoothing_spline

SEED = 77
TRAINING = 3  # takes of a case


def cubic(recording: Recording) -> Recording:
    """Return the same recording with a path smoothed by a cubic spline at 6 Hz."""
    spline = smoothing_spline(recording.time, recording.held_seen)
    return dataclasses.replace(recording, held=lambda t: np.asarray(spline(np.clip(t, 0.0, recording.time[-1]))))


def moved(recordings: list[Recording], truth: Truth) -> list[Floats]:
    """Return the simulated points for every recording's path, each (frames, points, 3) [m]."""
    vector = true_vector(truth)
    observer = Observer(recordings, SI, (), frequency=0.0, resolution=fine_enough(recordings[0]))
    return [points[0] for points in observer.trajectories(vector[None], observer.off[None])]


def off_by(number: int) -> tuple[float, float, float]:
    """Return the markers' deviation, and the cloth's error with the cubic and with the path's own spline [mm]."""
    truth = draw_truth(f"n{number}", "null", (), (SEED, number))
    still = msgspec.structs.replace(truth, look=msgspec.structs.replace(truth.look, noise=1e-6))
    noisy, clean = ([prepare(take) for take in make_takes(t)[:TRAINING]] for t in (truth, still))
    true = moved(clean, truth)

    def off(recordings: list[Recording]) -> float:
        apart = zip(moved(recordings, truth), true, recordings, strict=True)
        squared = [((a - b)[:, r.judged] ** 2).sum(-1).mean() for a, b, r in apart]
        return 1e3 * float(np.sqrt(np.mean(squared)))

    return 1e3 * HELD_SHARE * truth.look.noise, off([cubic(r) for r in noisy]), off(noisy)


def main() -> None:
    """Print the table."""
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    print("markers' noise   cubic at 6 Hz   the path's own spline")
    rows = []
    for number in range(cases):
        rows.append(off_by(number))
        print("{:11.2f} mm {:12.2f} mm {:20.2f} mm".format(*rows[-1]), flush=True)
    ratios = np.array([after / before for _, before, after in rows])
    low, middle, high = np.percentile(ratios, [25, 50, 75])
    print(f"off by {middle:.2f} of what it was (quartiles {low:.2f} to {high:.2f})")


if __name__ == "__main__":
    main()

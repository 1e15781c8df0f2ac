"""Server side of `fit.foreign.process`: answer jobs until the input ends. Standard library and NumPy only."""

import contextlib
import os
import sys

import numpy as np


def answer_jobs(version, simulate):
    """Call simulate(job) -> arrays, both dicts by name, for every job file that the standard input names."""
    # Simulators write to the standard output at will: keep it for the answers alone.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    answers.write(f"ready {version}\n")
    answers.flush()
    for line in sys.stdin:
        name = line.strip()
        with np.load(name) as loaded:
            job = {key: loaded[key] for key in loaded.files}
        with contextlib.redirect_stdout(sys.stderr):
            found = simulate(job)
        result = name.replace(".npz", ".answer.npz")
        np.savez(result, **found)
        answers.write(result + "\n")
        answers.flush()

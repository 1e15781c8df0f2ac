"""Three takes for the tests of Python's calls, and the command in a process of its own."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from formats.archive import write_take
from tests.fit.scenes import material, sheet, simulate_take, swing


def written_takes(folder):
    """Make a folder with three takes of a swatch: face-on, faster, and with a sideways swing; return its path."""
    folder.mkdir()
    time, garment = np.arange(0, 2.6, 1 / 30), sheet()
    for name, hz, sideways in (("gentle", 0.7, 0.0), ("mixed", 0.9, 0.02), ("swing", 0.8, 0.05)):
        path = swing(time, amplitude=0.06, hz=hz, sideways=sideways)
        row = material(garment, velocity_damping=3.0)
        write_take(folder / f"{name}.mcap", simulate_take(garment, time, path, row, noise=0.002, seed=5, name=name))
    return folder


def command(*words, folder, end=0):
    done = subprocess.run(
        [sys.executable, "-m", "hangtime", *map(str, words)], capture_output=True, text=True, cwd=folder, check=False
    )
    assert done.returncode == end, done.stderr
    return done.stdout

"""Count how often the demo's diagnosis names its air drag, over recordings and seeds of the diagnosis.

    benchmarks/demo_seeds.py [RECORDINGS [SEEDS]]

RECORDINGS times (5 unless given) the demo's three motions are recorded anew, as `scripts/demo` does, with other hands
and noise. Each is diagnosed SEEDS times (10 unless given) by `hangtime diagnose --seed`. A row has the verdict, the
named effects, the drag with its 90 % interval, and the closure; 1.2 is planted. Verdicts are right where air drag is
named. They are overconfident where another effect is named without "may" or "probably".

The planted coefficient falls with the angle of attack, and the fitter's does not. So the equivalent constant
coefficient on the recorded cloth is printed first. Over faces of area A with speeds v_n along their normals it is

    c = sum(A v_n^4 C(a)) / sum(A v_n^4)
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from formats.arrays import Floats

PLANTED = 1.2
MOTIONS = ("mixed", "gentle", "swing")


def hangtime(folder: Path, *words: object) -> None:
    """Run one command in a folder; exit code 4 means that the takes cannot decide."""
    command = [sys.executable, "-m", "hangtime", *map(str, words)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 4):
        raise SystemExit(done.stderr)


def record(folder: Path, number: int) -> None:
    """Record the demo's takes with new hand motions and noise."""
    for place, motion in enumerate(MOTIONS):
        seed = 1000 * number + place
        hangtime(folder, "sensor", "synthesise", motion, "--name", motion, "--motion", motion, "--effect", "air_drag",
                 "--seconds", 6, "--seed", seed)  # fmt: skip
        hangtime(folder, "record", "--sensor", f"{motion}/{motion}.oni", "--rig", f"{motion}/rig.toml", "--garment",
                 f"{motion}/garment.toml", "--out", f"{motion}.mcap")  # fmt: skip


def equivalent_drag(grids: list[tuple[Floats, Floats]]) -> float:
    """Return the constant drag coefficient whose force is nearest to the planted one's.

    grids: times [s], (frames,), and the cloth [m], (frames, rows, columns, 3), of each motion
    """
    pushed = weight = 0.0
    for time, grid in grids:
        nodes = np.gradient(grid, time, axis=0)
        speed = 0.25 * (nodes[:, 1:, 1:] + nodes[:, :-1, :-1] + nodes[:, 1:, :-1] + nodes[:, :-1, 1:])
        normal = np.cross(grid[:, 1:, 1:] - grid[:, :-1, :-1], grid[:, 1:, :-1] - grid[:, :-1, 1:])
        doubled = np.linalg.norm(normal, axis=-1)
        along = np.abs((speed * normal).sum(-1)) / doubled
        sine = np.minimum(along / (np.linalg.norm(speed, axis=-1) + 1e-12), 1.0)
        shares = doubled * along**4
        pushed += float((shares * PLANTED * (0.05 + 0.95 * sine**1.5)).sum())
        weight += float(shares.sum())
    return pushed / weight


def verdict_of(found: dict) -> tuple[str, str]:
    """Return `right`, `silent` or `wrong` of a diagnosis, and its row."""
    named = found["named"]
    drag = next((e for e in found["effects"] if e["id"] == "air_drag"), {})
    span, closure = drag.get("amplitude_interval"), drag.get("closure")
    row = f"{found['verdict']:12s} {', '.join(named) or '-':24s}"
    if span:
        row += f" drag {drag['amplitude']:.2f} [{span[0]:.2f} to {span[1]:.2f}]"
    if closure:
        row += f" closes {100 * closure['value']:.0f} %"
    if "air_drag" in named:
        return "right", row
    is_sure = found["verdict"] in ("effect", "several") and " may " not in found["sentence"]
    return ("wrong" if is_sure and "probably" not in found["sentence"] else "silent"), row


def main(recordings: int, seeds: int) -> None:
    """Print the rows and the counts."""
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as kept:
        for number in range(1, recordings + 1):
            folder = Path(kept) / str(number)
            folder.mkdir()
            record(folder, number)
            truths = [np.load(folder / motion / f"{motion}.truth.npz") for motion in MOTIONS]
            c = equivalent_drag([(truth["time"], truth["grid"]) for truth in truths])
            print(f"recording {number}: the planted drag of {PLANTED:g} pushes like a constant {c:.2f}", flush=True)
            for seed in range(seeds):
                hangtime(folder, "diagnose", "mixed.mcap", "gentle.mcap", "--held-out", "swing.mcap", "--out", seed,
                         "--seed", seed)  # fmt: skip
                kind, row = verdict_of(json.loads((folder / f"{seed}/diagnosis.json").read_text()))
                counts[kind] += 1
                print(f"recording {number}, seed {seed}: {kind:6s} {row}", flush=True)
    total = sum(counts.values())
    print(f"right in {counts['right']} of {total}; overconfident in {counts['wrong']}; silent in {counts['silent']}")


if __name__ == "__main__":
    main(*[int(value) for value in (sys.argv[1:] + ["5", "10"][len(sys.argv) - 1 :])])

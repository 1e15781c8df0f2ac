"""Compare the simulation kernel's speed with the same method in C, `scalar/rollout.c`, on one thread.

Run: python benchmarks/scalar.py [--seconds 8] [--rounds 15]. The scene is that of `speed.py`: a sheet of 0.4 m x 0.45
m, 8 s of swing, a mesh of 50 mm. The candidates are as many as the kernel has lanes. The machine's gcc compiles the C
each time, with -O3 -march=native -ffast-math and with further flags. The C uses the same arrays as
`fit.cloth.launch`; its lanes are gcc's vectors. The variants run in turn in every round, so that other work of the
machine affects all alike. The script prints medians and quartiles over the rounds, of ratios within a round. Calls are
one call of the C against one of the kernel. Whole runs are `Simulator.run`, which also packs the arrays and unpacks the
results.

Both settle. The kernel also computes a pull in the first fifth of settling, which the C leaves out. The pull is zero
here since no point is seen, and costs the kernel less than 1 %. The kernel keeps the rounding error of each step, which
costs a few per cent. In the C, -ffast-math would remove this sum. Without gcc nothing is measured.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from formats.arrays import Floats, Singles

sys.path.insert(0, str(Path(__file__).parents[1]))

from fit import runtime
from fit.cloth import bundles, launch, lines, rollout
from fit.cloth.bundles import Kind
from fit.cloth.lines import IN_LINES
from fit.cloth.simulator import Simulator
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, material, sheet, swing, take_of

SOURCE = Path(__file__).parent / "scalar" / "rollout.c"
LANES = max(runtime.lane_widths())  # 16 on Intel's processors with AVX-512, for which the targets are, else 8
GIVEN = ("-O3", "-march=native", "-ffast-math")  # the flags that the targets name
WIDE, EAGER, UNROLLED = "-mprefer-vector-width=512", "-fvect-cost-model=unlimited", "-funroll-loops"
APART = "-ffp-contract=off"  # products are not fused with sums, as in the kernel
FURTHER = ((), (UNROLLED,), (WIDE,), (EAGER,), (EAGER, UNROLLED), (APART,))  # may help the C, or explain its speed
ALWAYS = ("-std=gnu11", "-fPIC")
TARGETS = (
    (f"one of {LANES} in the kernel's lanes, times as fast as scalar C", 6.0),
    (f"one of {LANES} in the kernel's lanes, share of the speed of C with the same lanes", 0.5),
    ("one alone, share of the speed of scalar C", 0.8),
)

# Fields of `struct task`, in its order. Arrays are the kernel's, by its own names for them.
IN_LANES = (
    "x", "v", "ahead", "f", "slopes", "slopes_ahead", "strains", "shear_strains", "stress",
    "seen", "path", "material", "inverse_mass",
)  # fmt: skip
UNITS = ("unit_slopes", "values", "curvatures")  # of fit.cloth.lines
OF_THE_CLOTH = (
    "fibre_at", "fibre_weights", "fibre_area", "shear_across", "shear_down", "shear_area", "between",
    "bend_nodes", "bend_weights", "bend_kind", "twist_scales", *UNITS, "held", "shares",
    "point_first", "point_nodes", "point_weights", "frame_step", "frame_lag",
)  # fmt: skip
TIMES_THREE = ("fibre_at", "shear_across", "shear_down", "bend_nodes", "held", "point_nodes")
COUNTS = (
    "nodes", "fibres", "fibres_across", "shears", "few_bends", "many_bends", "twists", "held_nodes", "handles",
    "points", "point_kinds", "frames", "settle_steps",
)  # fmt: skip
MANY = 7  # nodes of a bend between two elements


class Task(ctypes.Structure):
    """`struct task` of rollout.c."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in IN_LANES + OF_THE_CLOTH),
        *((name, ctypes.c_int) for name in COUNTS),
        ("time_step", ctypes.c_float),
        ("settle_damping", ctypes.c_float),
    )


@dataclass(frozen=True, eq=False)
class Call:
    """One call of the kernel: its compile-time options, and its arguments by name."""

    kernel: Callable[..., None]
    made_with: Kind
    arguments: dict[str, Any]
    start: Singles

    def run(self) -> None:
        """Run the kernel once more from the start."""
        self.begin()
        with runtime.vectors_kept():
            self.kernel(**self.arguments)

    def begin(self) -> None:
        """Reset the nodes to their initial positions, at rest, and clear the recorded points."""
        for name in ("x", "ahead"):
            self.arguments[name][...] = self.start[: len(self.arguments[name])]
        for name in ("v", "f"):
            self.arguments[name][...] = 0
        self.arguments["seen"][...] = np.nan

    def lane(self, number: int) -> Call:
        """Return the same call for one candidate, for C only: arrays of one lane."""
        own = {name: np.ascontiguousarray(self.arguments[name][..., number : number + 1]) for name in IN_LANES}
        start = np.ascontiguousarray(self.start[..., number : number + 1])
        return replace(self, arguments={**self.arguments, **own}, start=start)

    @property
    def seen(self) -> Singles:
        """Return a copy of the recorded points [m], (frames, points, 3, lanes)."""
        return self.arguments["seen"][0].copy()


class InC:
    """A call of the kernel made in C, on the same arrays."""

    def __init__(self, call: Call, library: ctypes.CDLL) -> None:
        """Prepare a call; refuse features that rollout.c lacks.

        Raises:
            ValueError: a call of more than one group, with effects, or with other stencils.
        """
        given, made = call.arguments, call.made_with
        unknown = (
            len(given["time_step"]) != 1 or made.face_forces or made.with_bends or made.with_added_mass
            or made.with_viscosity
            or given["gain"] or made.fibre_nodes != (IN_LINES, IN_LINES) or not made.handles
            or not set(made.bend_lengths) <= {IN_LINES, MANY} or not made.with_twist
        )  # fmt: skip
        if unknown:
            raise ValueError("rollout.c knows one group of plain, held panels whose threads run along the mesh")
        self.call, self._function = call, library.rollout
        # The kernel refers to node i as 3 i, the index of its first vector.
        changed = {**given, **{name: given[name] // 3 for name in TIMES_THREE}}
        changed |= {name: np.array(getattr(lines, name.upper()), np.float32) for name in UNITS}
        arrays = {name: changed[name] for name in IN_LANES + OF_THE_CLOTH}
        for name, array in arrays.items():
            if not array.flags.c_contiguous or array.dtype not in (np.float32, np.int32):
                raise ValueError(f"{name} is not a contiguous array of single numbers")
        bends = dict(zip(made.bend_lengths, given["bend_counts"].tolist(), strict=True))
        counts = {
            "nodes": len(given["inverse_mass"]), "fibres_across": given["fibres_across"],
            "fibres": len(given["fibre_area"]),
            "shears": len(given["shear_area"]), "few_bends": bends.get(IN_LINES, 0), "many_bends": bends.get(MANY, 0),
            "twists": len(given["twist_root"]), "held_nodes": len(given["held"]), "handles": made.handles,
            "points": given["pull"].shape[1], "point_kinds": given["point_weights"].shape[1],
            "frames": int(given["counts"][0, bundles.COUNTS.frames]),
            "settle_steps": int(given["counts"][0, bundles.COUNTS.settle_steps]),
        }  # fmt: skip
        self._kept = arrays  # the task holds addresses only
        self._task = Task(
            **{name: array.ctypes.data for name, array in arrays.items()}, **counts,
            time_step=given["time_step"][0], settle_damping=given["settle_damping"],
        )  # fmt: skip

    def run(self) -> None:
        """Run it from the start."""
        self.call.begin()
        self._function(ctypes.byref(self._task))


@contextlib.contextmanager
def heard() -> Iterator[list[Call]]:
    """Record every call of the kernel inside this context, with copies of its arrays.

    A simulation runs as one call here. Elsewhere it is cut into pieces of about a second, so that Ctrl-C gets through.
    """
    calls: list[Call] = []
    make = rollout.make_rollout

    def make_heard(kind: Kind) -> Callable[..., None]:
        kernel = make(kind)

        def hear(**arguments: Any) -> None:
            calls.append(Call(kernel, kind, arguments, arguments["x"].copy()))
            kernel(**arguments)

        return hear

    whole = patch.object(launch, "pieces_for", lambda steps, numbers: 1)
    with patch.object(rollout, "make_rollout", make_heard), whole:
        yield calls


def only_call(run: Callable[[], object]) -> Call:
    """Return the call of the kernel that a run makes; it must be one."""
    with heard() as calls:
        run()
    (call,) = calls
    return call


def find_compiler() -> str | None:
    """Return the path of gcc, or None."""
    return shutil.which("gcc")


def build(compiler: str, folder: Path, lanes: int, further: tuple[str, ...] = ()) -> ctypes.CDLL:
    """Compile rollout.c for this many lanes.

    It is linked without -ffast-math, which would have the loader round tiny numbers to zero in the whole process.
    """
    handle, name = tempfile.mkstemp(".so", dir=folder)
    os.close(handle)
    compiled = Path(name).with_suffix(".o")
    words = [compiler, *ALWAYS, *GIVEN, *further, f"-DLANES={lanes}", "-c", str(SOURCE), "-o", str(compiled)]
    subprocess.run(words, check=True)
    subprocess.run([compiler, "-shared", str(compiled), "-o", name], check=True)
    library = ctypes.CDLL(name)
    library.rollout.argtypes, library.rollout.restype = (ctypes.POINTER(Task),), None
    return library


def scene(seconds: float) -> tuple[Simulator, Floats]:
    """Return LANES candidates of a swung sheet without valid points, so that no pull acts while it settles."""
    garment = sheet()
    instants = np.arange(0, seconds, 1 / 30)
    recording = prepare(take_of(garment, instants, swing(instants), hung(garment, instants)))
    recording = replace(recording, valid=np.zeros_like(recording.valid))
    spread = zip(np.linspace(1.0, 4.0, LANES), np.geomspace(1e-5, 4e-5, LANES), strict=True)
    rows = [material(garment, velocity_damping=c, bending_stiffness=b) for c, b in spread]
    return Simulator(recording), np.concatenate(rows)


@dataclass(frozen=True)
class Cost:
    """Processor time [s] of one candidate in every round, (rounds,).

    - `scalar`, `lanes`: of C, (flags, rounds) in the order of `FURTHER`
    - `narrow`: of C with the kernel's number of lanes for a single candidate
    - `kernel`: of its calls
    - `whole`: of `Simulator.run`
    """

    scalar: Floats
    lanes: Floats
    narrow: Floats
    kernel: Floats
    kernel_alone: Floats
    whole: Floats
    whole_alone: Floats


def distance(way: InC, expected: Singles) -> float:
    """Largest difference of a coordinate [m] between what C and, in the first of its lanes, the kernel saw."""
    way.run()
    seen = way.call.seen
    return float(np.abs(seen - expected[..., : seen.shape[-1]]).max())


def in_turns(runs: Sequence[Callable[[], object]], rounds: int) -> Floats:
    """Processor time [s] of each run in each round, (runs, rounds), after a round that warms them up."""
    spent = np.zeros((rounds + 1, len(runs)))
    for turn in spent:
        for k, run in enumerate(runs):
            start = time.process_time()
            run()
            turn[k] = time.process_time() - start
    return np.asarray(spent[1:].T)


def measure(compiler: str, seconds: float, rounds: int) -> tuple[Cost, float]:
    """Return the cost of each variant, and the largest difference of a coordinate [m] between any C and the kernel."""
    with patch.dict(os.environ, HANGTIME_THREADS="1"), tempfile.TemporaryDirectory() as folder:
        simulator, rows = scene(seconds)
        many, alone = only_call(lambda: simulator.run(rows)), only_call(lambda: simulator.run(rows[:1]))
        expected, expected_alone = many.seen, alone.seen
        scalar = [InC(many.lane(0), build(compiler, Path(folder), 1, flags)) for flags in FURTHER]
        lanes = [InC(many, build(compiler, Path(folder), LANES, flags)) for flags in FURTHER]
        narrow = InC(alone, build(compiler, Path(folder), alone.made_with.lanes))
        furthest = max(distance(way, expected) for way in scalar + lanes)
        furthest = max(furthest, distance(narrow, expected_alone))
        ways = [way.run for way in (*scalar, *lanes, narrow, many, alone)]
        spent = in_turns([*ways, lambda: simulator.run(rows), lambda: simulator.run(rows[:1])], rounds)
    of_scalar, of_lanes, rest = np.split(spent, [len(FURTHER), 2 * len(FURTHER)])
    of_narrow, kernel, kernel_alone, run, run_alone = rest
    return Cost(of_scalar, of_lanes / LANES, of_narrow, kernel / LANES, kernel_alone, run / LANES, run_alone), furthest


def quickest(by_flags: Floats) -> Floats:
    """The row, (rounds,), with the least median."""
    return np.asarray(by_flags[np.median(by_flags, axis=1).argmin()])


def ratios(cost: Cost, scalar: Floats, lanes: Floats) -> list[tuple[Floats, Floats]]:
    """The three ratios of `TARGETS` in every round, (rounds,) each: of calls, and of whole runs."""
    return [
        (scalar / cost.kernel, scalar / cost.whole),
        (lanes / cost.kernel, lanes / cost.whole),
        (scalar / cost.kernel_alone, scalar / cost.whole_alone),
    ]


def show(cost: Cost, furthest: float) -> None:
    """Print the cost of each variant, and the ratios beside their targets."""
    rows = {
        **{" ".join(("scalar C", *flags)): row for flags, row in zip(FURTHER, cost.scalar, strict=True)},
        **{" ".join((f"C, {LANES} lanes", *flags)): row for flags, row in zip(FURTHER, cost.lanes, strict=True)},
        "C, one in the kernel's lanes for one": cost.narrow,
        f"kernel, {LANES} lanes": cost.kernel, "kernel, one alone": cost.kernel_alone,
        f"whole run of {LANES}": cost.whole, "whole run of one": cost.whole_alone,
    }  # fmt: skip
    for name, row in rows.items():
        low, middle, high = 1e3 * np.percentile(row, [25, 50, 75])
        print(f"{name:<56} {middle:8.2f} ms a candidate ({low:.2f} to {high:.2f})")
    print(f"largest difference of a coordinate between any C and the kernel: {1e3 * furthest:.3f} mm")
    against = {
        f"C with {' '.join(GIVEN)}": (cost.scalar[0], cost.lanes[0]),
        "C with the fastest of the further flags": (quickest(cost.scalar), quickest(cost.lanes)),
    }
    for name, ways in against.items():
        print(f"against {name}:")
        for (what, target), (calls, whole) in zip(TARGETS, ratios(cost, *ways), strict=True):
            low, middle, high = np.percentile(calls, [25, 50, 75])
            verdict = "" if middle >= target else ", missed"
            print(
                f"  {what}: {middle:.2f} ({low:.2f} to {high:.2f}; target {target:g}{verdict}); "
                f"whole runs {np.median(whole):.2f}"
            )


def main(arguments: list[str] | None = None) -> None:
    """Print the cost of each variant, and the ratios beside their targets."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=8.0, help="of swing; default %(default)s")
    parser.add_argument("--rounds", type=int, default=15, help="default %(default)s")
    options = parser.parse_args(arguments)
    if options.seconds < 1 or options.rounds < 1:
        parser.error("at least one second and one round are needed")
    compiler = find_compiler()
    if compiler is None:
        print("There is no gcc on this machine, so there is no C to compare with; install it and run this again.")
        return
    show(*measure(compiler, options.seconds, options.rounds))


if __name__ == "__main__":
    main()

"""Measure the cost of a simulated candidate alone, in a batch and with several takes, and the cost of effects.

Run: python benchmarks/speed.py. A sheet of 0.4 m x 0.45 m is clamped and swung for 8 s, with a mesh of 50 mm. Figures
are medians of five. One candidate alone over one of the batch is measured in one run. Viscous cloth is 16 candidates'
processor time over that without viscosity, in turns, and the same for Kelvin-Voigt cloth, whose steps are far shorter.
Few candidates of several takes are simulated one take after the other, and all in one call, whose lanes the takes
share.

Then the script prints the shortening of the step by effects, at their typical and their largest size. Last comes the
time of the published annealing on a take of 20 s, as one chain and as four, with the result's intervals.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.clamps import steps_of
from formats.arrays import Floats

sys.path.insert(0, str(Path(__file__).parents[1]))

from fit.cloth import material as mat
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator, run_together
from fit.effects import find_effects
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import KINECT_SKIRT
from fit.recordings.recording import Recording, prepare
from tests.fit.scenes import hung, material, sheet, simulate_take, swing, take_of

REPEATS = 5
VISCOSITIES = (1e-3, 3e-3)  # s: the effect's typical size, and its largest


def scene() -> tuple[Simulator, Floats]:
    """A swung sheet and one candidate."""
    garment = sheet()
    instants = np.arange(0, 8, 1 / 30)
    recording = prepare(take_of(garment, instants, swing(instants), hung(garment, instants)))
    return Simulator(recording), material(garment, velocity_damping=2.0)


def by_count(simulator: Simulator, row: Floats) -> None:
    """Print seconds per candidate for some numbers of them."""
    costs = {}
    for count in (1, 8, 16, 64):
        rows = np.repeat(row, count, axis=0)
        simulator.run(rows)
        spent = []
        for _ in range(REPEATS):
            start = time.perf_counter()
            simulator.run(rows)
            spent.append(time.perf_counter() - start)
        costs[count] = float(np.median(spent)) / count
        print(f"{count:>3} candidates: {1e3 * costs[count]:7.1f} ms each   {costs[1] / costs[count]:5.1f} x one alone")


def by_company(counts: tuple[int, ...] = (1, 4, 8)) -> None:
    """Print the cost of few candidates of three takes, take by take against all in one call.

    The takes have other motions, lengths and clocks; a quarter of the candidates are stiffer and take shorter steps.
    """
    garment, simulators = sheet(), []
    for seconds, rate, reach in ((4.0, 30, 0.1), (3.6, 30, 0.14), (3.2, 45, 0.08)):
        instants = np.arange(0, seconds, 1 / rate)
        take = take_of(garment, instants, swing(instants, amplitude=reach), hung(garment, instants))
        simulators.append(Simulator(prepare(take)))
    for count in counts:
        rows = np.repeat(material(garment, velocity_damping=2.0), count, axis=0)
        rows[: count // 4, mat.STRETCH] *= 4
        spent = np.zeros((REPEATS + 1, 2))
        for turn in spent:
            start = time.process_time()
            for alone in simulators:
                alone.run(rows)
            middle = time.process_time()
            run_together(simulators, [rows] * 3, [None] * 3)
            turn[:] = middle - start, time.process_time() - middle
        alone_s, together_s = spent[1:].min(0)  # other work on the machine only adds time
        ratio = float(alone_s / together_s)
        print(f"3 takes, {count} candidates of each: one take after the other {ratio:.2f} x the cost of together")


def by_viscosity(simulator: Simulator, row: Floats) -> None:
    """Print the relative cost of viscous cloth, by the effect's model and by Kelvin-Voigt's."""
    ways = [(mat.VISCOSITY, "stretch viscosity"), (mat.MEMBRANE_TIME, "the same as Kelvin-Voigt")]
    for column, name in ways:
        for viscosity in VISCOSITIES:
            rows = [np.repeat(row, 16, axis=0) for _ in range(2)]
            rows[1][:, column] += viscosity
            spent = np.zeros((REPEATS + 1, 2))
            for turn in spent:
                for k in range(2):
                    start = time.process_time()
                    simulator.run(rows[k])
                    turn[k] = time.process_time() - start
            cost = float(np.median(spent[1:, 1] / spent[1:, 0]))
            steps = np.divide(*(steps_of(simulator, chosen)[0] for chosen in rows))
            print(f"{name} of {1e3 * viscosity:g} ms: {cost:5.2f} x the cost of none, {steps:.2f} x as many steps")


def by_effect(recording: Recording) -> None:
    """Print the factor in steps for effects that make the cloth stiffer or more damped."""
    for spacing in (0.05, 0.033):
        simulator = Simulator(recording, resolution=Resolution(spacing=spacing))
        for stretch, bending in ((300.0, 1.4e-5), (1000.0, 1.4e-5), (100.0, 1e-6)):
            row = material(
                recording.garment, stretch_stiffness=stretch, shear_stiffness=stretch / 10, bending_stiffness=bending
            )
            plain = steps_of(simulator, row)[0]
            found = []
            for effect in find_effects(["stretch_viscosity", "bending_viscosity", "strain_stiffening"]):
                for amplitude in (effect.typical, effect.high):
                    changed = effect.material(row[0], np.array([amplitude]))[None]
                    found.append(
                        f"{effect.title} {amplitude:g} {effect.unit} {plain / steps_of(simulator, changed)[0]:.1f} x"
                    )
            print(f"{1e3 * spacing:g} mm, {stretch:g} N/m, {bending:g} N m: {'; '.join(found)}")


def by_annealing(seconds: float = 20.0, iterations: int = 350) -> None:
    """Print the time of the published annealing on a long take with five points, as one chain and as several."""
    garment = sheet()
    instants = np.arange(0, seconds, 1 / 30)
    row = material(garment, velocity_damping=2.0)
    take = simulate_take(garment, instants, swing(instants, stop=0.8 * seconds), row, noise=0.002)
    for search in ("annealing", "restarts"):
        request = request_of(
            KINECT_SKIRT, [], iterations=iterations, seed=0, spacing=Resolution().spacing, search=search
        )
        started = time.perf_counter()
        found = calibrate([take], [], request)
        print(
            f"{iterations} iterations of {search} on a take of {seconds:g} s: {time.perf_counter() - started:.0f} s, "
            f"{found.simulations} simulations"
        )


def main() -> None:
    """Print the tables."""
    simulator, row = scene()
    by_count(simulator, row)
    by_company()
    by_viscosity(simulator, row)
    print("Times as many steps as without:")
    by_effect(simulator.recording)
    by_annealing()


if __name__ == "__main__":
    main()

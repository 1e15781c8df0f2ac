"""Test exports: a strip in other simulators against closed forms, and the cost of animations of sewn garments.

    python benchmarks/export.py [--film SECONDS] [--walk SECONDS] [--only strips|film|walk]

A strip of 6 cm x 50 cm and 100 N/m hangs and swings in each simulator whose Python is set: HANGTIME_NEWTON_PYTHON,
HANGTIME_MUJOCO_PYTHON. A strip of 3 cm x 10 cm and 3.2 mN m, clamped at its end, sags there.

The film is of a skirt with front and back, 0.4 m x 0.5 m, that hangs from its top edge. The skirt moves in four ways at
once. Seconds of the film, of the clock and of the processor are printed. Then a figure walks in a plain skirt
and in a plain T-shirt. Crossings, the distance from the body and the largest stretch are printed besides.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from fit.blind.foreign.engines import find_generator
from fit.export.animation import Scene, animate
from fit.export.fabric import fabric_of
from fit.export.presets import mujoco_flex, newton_preset
from fit.export.sheet import Sheet, strip
from fit.export.usd_physics import usd_physics
from fit.export.worn import WORN_GARMENTS, FigureOrder
from tests.fit.export.exported import a_fit
from tests.fit.export.test_in_other_engines import (
    CELL,
    CLAMPED,
    HERTZ,
    LENGTH,
    RIGID,
    SAG,
    SPACING,
    STRETCH,
    answer,
)
from tests.fit.scenes import hung, sheet, take_of


def strips() -> None:
    """Print stretch and frequency of a hanging strip in each simulator."""
    print(f"right: {1e3 * STRETCH:.3f} mm, {HERTZ:.4f} Hz")
    asked = in_each_simulator(
        "strip", SPACING, ("SolverStyle3D", "SolverSemiImplicit"), strip(0.06, LENGTH, SPACING), {}
    )
    for title, found in asked:
        print(f"{title} {found['version']}: {1e3 * found['stretch']:.3f} mm, {found['hertz']:.4f} Hz")


def sags() -> None:
    """Print the sag of a clamped strip in each simulator."""
    print(f"right: {1e3 * SAG:.3f} mm")
    solvers, cloth = ("SolverStyle3D", "SolverVBD", "SolverSemiImplicit"), strip(0.03, CLAMPED + CELL, CELL)
    for title, found in in_each_simulator("cantilever", CELL, solvers, cloth, {"bending_stiffness": RIGID}, str(CELL)):
        print(f"{title} {found['version']}: {1e3 * found['sag']:.3f} mm")


def in_each_simulator(
    trial: str, spacing: float, solvers: Sequence[str], cloth: Sheet, values: dict[str, float], *words: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of each simulator whose Python is set, and the result of a trial of an exported strip in it.

    - `trial`: of the scripts newton_TRIAL.py and mujoco_TRIAL.py beside the tests
    - `values`: parameters of the fit that replace the defaults
    - `words`: further arguments of MuJoCo's script
    """
    result = a_fit(values={"velocity_damping": 0.02} | values)
    fabric, simulators = fabric_of(result), {name: find_generator(name).foreign for name in ("mujoco", "newton")}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "strip.json").write_bytes(newton_preset(result, fabric, spacing))
        (folder / "strip.xml").write_bytes(mujoco_flex(result, fabric, cloth))
        runs = [("MuJoCo flex", "mujoco", [folder / "strip.xml", *words])]
        if simulators["newton"].is_installed():
            (folder / "strip.usda").write_bytes(usd_physics(result, fabric, cloth, 5e-4))
            runs += [(f"Newton {s}", "newton", [folder / "strip.usda", folder / "strip.json", s]) for s in solvers]
        for title, simulator, further in runs:
            foreign = simulators[simulator]
            if foreign.is_installed():
                yield title, answer(foreign, f"{simulator}_{trial}.py", *further)
            else:
                print(f"{title}: {foreign.variable} names no Python that has it")


def film(seconds: float) -> None:
    """Print the cost of an animation of a sewn skirt."""
    skirt = msgspec.structs.replace(
        sheet(width=0.4, height=0.5, mass=0.08), format="hangtime-garment/2", seams=((1, 2), (3, 0))
    )
    instants = np.arange(0, 1, 1 / 30)
    take = take_of(skirt, instants, np.zeros((len(instants), 3)), hung(skirt, instants))
    scene = Scene(result=a_fit(effects={"air_drag": 1.0}), take=take, motion="mixed", seconds=seconds, spacing=0.03)
    with tempfile.TemporaryDirectory() as name:
        begun, spent = time.perf_counter(), time.process_time()
        path = animate(scene, Path(name) / "skirt.mp4").path
        wall, processor = time.perf_counter() - begun, time.process_time() - spent
        print(f"film of {seconds:g} s: {wall:.0f} s, {processor:.0f} s of the processor, {path.stat().st_size} bytes")


def walks(seconds: float) -> None:
    """Print the results and the cost of animations in which a figure walks in a skirt and in a T-shirt."""
    for garment in WORN_GARMENTS:
        scene = Scene(result=a_fit(effects={"air_drag": 1.0}), seconds=seconds, figure=FigureOrder(wear=garment))
        with tempfile.TemporaryDirectory() as name:
            begun, spent = time.perf_counter(), time.process_time()
            done = animate(scene, Path(name) / "walk.mp4")
            wall, processor = time.perf_counter() - begun, time.process_time() - spent
        print(f"a walk of {seconds:g} s in a {garment}: {wall:.0f} s, {processor:.0f} s of the processor")
        print("".join(f"  {remark}\n" for remark in done.remarks), end="")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--film", type=float, default=10.0)
    parser.add_argument("--walk", type=float, default=10.0)
    parser.add_argument("--only", choices=("strips", "film", "walk"))
    chosen = parser.parse_args()
    if chosen.only in (None, "strips"):
        strips()
        sags()
    if chosen.only in (None, "film"):
        film(chosen.film)
    if chosen.only in (None, "walk"):
        walks(chosen.walk)

"""Simulation of the fitted cloth under a take's hanger, with the nodes of every frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.cloth.effect import Effect, parameter_names
from fit.cloth.launch import Progress
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.effects import find_effects
from fit.engines import OWN_ENGINE
from fit.errors import BlowUpError, FitError
from fit.export.solids import Solids
from fit.methods import find_method
from fit.recordings.recording import Recording, prepare
from fit.virtual_tests.fitted_rows import effects_of
from formats.arrays import Floats, Integers, Singles
from formats.fit_records import FitResult
from formats.take import Take

(CONTACT,) = find_effects(["self_contact"])
SIMULATED_OF_MESH = 0.9  # of the time of a moving mesh; our choice: approximate share of its simulation
MOST_UNEVEN = 0.02  # of the mean frame interval: deviation up to which a clock counts as even


@dataclass(frozen=True)
class Moving:
    """Cloth in motion, world frame: z up.

    - `name`: of the take
    - `time` [s], (frames,), from 0
    - `places` [m], (frames, nodes, 3)
    - `triangles`, (n, 3), anticlockwise as seen from the front
    - `rest` [m], (nodes, 2), on the flat cloth
    - `points` [m], (frames, points, 3), as a tracker would report them, with their names
    - `held` [m], (frames, 2, 3): ends of the held edge
    - `figure`: the figure that wears the cloth, if any
    - `remarks`: sentences on the simulation
    """

    name: str
    time: Floats
    places: Singles
    triangles: Integers
    rest: Floats
    points: Floats
    point_names: tuple[str, ...]
    held: Floats
    figure: Solids | None = None
    remarks: tuple[str, ...] = ()

    @property
    def followed(self) -> Floats:
        """The point that a camera follows [m], (frames, 3): a figure's position on the floor, or the origin."""
        middle = self.held.mean(1) * [1.0, 1.0, 0.0]
        return middle if self.figure is not None else np.zeros_like(middle)

    @property
    def rate(self) -> float:
        """Mean number of frames a second."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    def even(self, rate: float | None = None) -> Moving:
        """Return the motion resampled to an even rate [1/s] by cubic splines in time, unchanged if already even."""
        from scipy.interpolate import CubicSpline

        wanted = self.rate if rate is None else rate
        steps = np.diff(self.time) * wanted
        if np.abs(steps - 1).max() <= MOST_UNEVEN:
            return self
        instants = np.arange(int(np.floor((self.time[-1] - self.time[0]) * wanted + 1e-9)) + 1) / wanted + self.time[0]
        changed = {name: CubicSpline(self.time, getattr(self, name))(instants) for name in ("places", "points", "held")}
        return replace(
            self, time=instants, places=changed["places"].astype(np.float32), points=changed["points"],
            held=changed["held"],
        )  # fmt: skip


def moving_cloth(
    result: FitResult, take: Take, spacing: float | None = None, *, progress: Progress | None = None
) -> Moving:
    """Simulate a take's garment with a fit, driven by the take's hanger, from the settled first shape on.

    progress: receives the finished share

    Raises:
        FitError: the fit is of another engine, or the take cannot be simulated.
        BlowUpError: the simulation did not stay finite.
    """
    return motion_of(result, prepare(take), spacing, progress=progress)


def motion_of(
    result: FitResult, recording: Recording, spacing: float | None = None, *, layers_apart: float = 0.0,
    progress: Progress | None = None,
) -> Moving:  # fmt: skip
    """Simulate a recording with a fit; raises as `moving_cloth` does.

    - layers_apart [m]: distance that contact keeps between layers of the cloth, if the fit has no contact
    - progress: receives the finished share
    """
    check_engine(result)
    method = find_method(result.method)
    effects = known_effects(result)
    if layers_apart > 0 and CONTACT not in effects:
        effects += (CONTACT,)
    resolution = Resolution(spacing=spacing or result.spacing or method.spacing)
    simulator = Simulator(recording, effects, resolution=resolution)
    density = recording.garment.mass_kg / float(simulator.mesh.area)
    known = {CONTACT.name: layers_apart} | result.effects
    amplitudes = np.array([known[name] for effect in effects for name in parameter_names(effect)])
    done = simulator.run(material_rows(result, density), amplitudes[None], shapes=True, progress=progress)
    if done.shapes is None or not np.isfinite(done.points).all():
        raise BlowUpError(
            "the simulation of this take blew up",
            where=recording.take_id,
            advice="use a coarser mesh (a larger spacing)",
        )
    return Moving(
        name=recording.take_id, time=recording.time - recording.time[0], places=done.shapes[0],
        triangles=simulator.mesh.triangles.astype(np.int64), rest=simulator.mesh.rest, points=done.points[0],
        point_names=recording.garment.point_names, held=recording.held(recording.time).reshape(-1, 2, 3),
    )  # fmt: skip


def check_engine(result: FitResult) -> None:
    """Refuse a fit by an engine that stores no shapes.

    Raises:
        FitError: the fit is of another engine.
    """
    if result.engine != OWN_ENGINE:
        raise FitError(
            f"its cloth is {result.engine}'s, which keeps no shapes", where=result.label, advice="fit with --engine own"
        )


def known_effects(result: FitResult) -> tuple[Effect, ...]:
    """Return the effects of a fit.

    Raises:
        FitError: one of them is not in the library.
    """
    effects = effects_of(result)
    if unknown := sorted(result.effects.keys() - {name for e in effects for name in parameter_names(e)}):
        raise FitError(
            f"this version of Hangtime knows no effect {unknown[0]}",
            where=result.label,
            advice="use the version that fitted it",
        )
    return effects


def material_rows(result: FitResult, density: float) -> Floats:
    """Return the fitted material at a density [kg/m^2], (1, parameters).

    Raises:
        FitError: the fit lacks a parameter of its method.
    """
    method = find_method(result.method)
    fitted = {p.name: p.fitted for p in result.parameters}
    if missing := [p.name for p in method.parameters if p.name not in fitted]:
        raise FitError(
            f"lacks {missing[0]}, a parameter of the method {method.name}", where=result.label, advice="fit again"
        )
    return method.to_materials(np.array([[fitted[p.name] for p in method.parameters]]), density)

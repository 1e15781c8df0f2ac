"""The fitted cloth in motion under a take's hanger: the nodes of every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.cloth.effect import parameter_names
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.effects import find_effects
from fit.engines import OWN
from fit.errors import BlowUpError, FitError
from fit.export.fabric import effects_of
from fit.methods import find_method
from fit.recordings.recording import Recording, prepare
from formats.arrays import Floats, Singles
from formats.fit_records import FitResult
from formats.take import Take

(CONTACT,) = find_effects(["self_contact"])
MOST_UNEVEN = 0.02  # of the mean time between two frames, up to which a clock counts as even


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
    """

    name: str
    time: Floats
    places: Singles
    triangles: NDArray[np.int64]
    rest: Floats
    points: Floats
    point_names: tuple[str, ...]
    held: Floats

    @property
    def rate(self) -> float:
        """Return the mean frames a second."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    def even(self, rate: float | None = None) -> Moving:
        """Return the same motion at an even rate [1/s], by cubic splines in time; as it is where it is even already."""
        from scipy.interpolate import CubicSpline

        wanted = self.rate if rate is None else rate
        steps = np.diff(self.time) * wanted
        if np.abs(steps - 1).max() <= MOST_UNEVEN:
            return self
        instants = np.arange(int(np.floor((self.time[-1] - self.time[0]) * wanted + 1e-9)) + 1) / wanted + self.time[0]
        changed = {name: CubicSpline(self.time, getattr(self, name))(instants) for name in ("places", "points", "held")}
        return Moving(
            name=self.name, time=instants, places=changed["places"].astype(np.float32), triangles=self.triangles,
            rest=self.rest, points=changed["points"], point_names=self.point_names, held=changed["held"],
        )  # fmt: skip


def moving_cloth(result: FitResult, take: Take, spacing: float | None = None) -> Moving:
    """Simulate a take's garment with a fit, driven by the take's hanger, from the settled first shape on.

    Raises:
        FitError: the fit is of another engine, or the take cannot be simulated.
        BlowUpError: the simulation did not stay finite.
    """
    return motion_of(result, prepare(take), spacing)


def motion_of(
    result: FitResult, recording: Recording, spacing: float | None = None, *, layers_apart: float = 0.0
) -> Moving:
    """Simulate a recording with a fit; raises as `moving_cloth` does.

    layers_apart [m]: at which contact keeps layers of the cloth apart, where the fit itself knows no contact.
    """
    if result.engine != OWN:
        raise FitError(
            f"the fit is of {result.engine}'s cloth, which keeps no shapes", advice="fit with the engine own"
        )
    method = find_method(result.method)
    effects = effects_of(result)
    if unknown := sorted(result.effects.keys() - {name for e in effects for name in parameter_names(e)}):
        raise FitError(
            f"this version of Hangtime knows no effect {unknown[0]}", advice="use the version that fitted it"
        )
    if layers_apart > 0 and CONTACT not in effects:
        effects += (CONTACT,)
    simulator = Simulator(recording, effects, resolution=Resolution(spacing=spacing or method.spacing))
    fitted = {p.name: p.fitted for p in result.parameters}
    if missing := [p.name for p in method.parameters if p.name not in fitted]:
        raise FitError(f"the fit lacks {missing[0]}, a parameter of the method {method.name}", advice="fit again")
    values = np.array([fitted[p.name] for p in method.parameters])
    density = recording.garment.mass_kg / float(simulator.mesh.area)
    known = {CONTACT.name: layers_apart} | result.effects
    amplitudes = np.array([known[name] for effect in effects for name in parameter_names(effect)])
    done = simulator.run(method.to_materials(values[None], density), amplitudes[None], shapes=True)
    if done.shapes is None or not np.isfinite(done.points).all():
        raise BlowUpError(
            "the simulation of this take blew up", where=recording.take_id, advice="use a coarser mesh (--spacing)"
        )
    return Moving(
        name=recording.take_id, time=recording.time - recording.time[0], places=done.shapes[0],
        triangles=simulator.mesh.triangles.astype(np.int64), rest=simulator.mesh.rest, points=done.points[0],
        point_names=recording.garment.point_names, held=recording.held(recording.time).reshape(-1, 2, 3),
    )  # fmt: skip

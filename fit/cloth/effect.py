"""Base class of all effects: physics or measurement errors that the base model omits and that can be switched on.

An effect has one amplitude, or one per direction (its `components`); all at 0 is exactly off. It acts through hooks,
each with a do-nothing default, so that the step and the observer know no effect by name:

    cloth        `material`, `node_mass`, `rest_curvature`, `friction_moment`, `contact_thickness`
    air          `face_force` (inside the kernel), `added_mass`
    boundary     `drive`: the path of the held ends
    measurement  `drive`, and `observe`: the simulated points as a tracker reports them; `unobserved`: the inverse, for
                 an observer that pulls to the tracked points

A measurement effect acts on the simulated side; noisy data are never transformed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fit.cloth.mesh import ClothMesh
from formats.arrays import Floats

if TYPE_CHECKING:
    from fit.recordings.recording import Recording

Curve = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Effect:
    """One unmodelled effect: name, unit, physical range, typical size and hooks.

    `low`, `high` and `typical` hold for each component. The size of an effect of several components is the length of
    its amplitude vector. `law_spread` is the relative deviation between sound laws of one effect: for example drag that
    varies with the angle, or masses in another place. The spread is 0 if there is only one law. `in_base` names the
    parameter of the base model that is the same physics, if any. An effect that `goes_beyond_base` reaches farther than
    this parameter's range. The diagnosis considers it when the fitted parameter is at its upper bound. `brings` names
    other effects that a sound law of this effect contains, each with its largest size per unit. Only a larger size
    counts as an effect beside this one.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    acts_on: ClassVar[str]  # "cloth", "boundary", "air" or "measurement"
    unit: ClassVar[str]
    low: ClassVar[float]
    high: ClassVar[float]
    typical: ClassVar[float]
    # Share of the size. Our choice: no data; it was the one spread of all laws before effects had spreads of their
    # own. Three deviations, squared, leave 0.06 of a gap, hardly above the least that any law may leave
    # (`fit.observer.edge.LEAST_BY_LAW`). So half changes little there; at twice, 0.23 of a gap may stay unexplained.
    law_spread: ClassVar[float] = 0.08
    probes: ClassVar[tuple[float, ...]] = ()  # further sizes at which the diagnosis tries an effect of one component
    components: ClassVar[tuple[str, ...]] = ("",)
    in_base: ClassVar[str] = ""
    goes_beyond_base: ClassVar[bool] = False
    brings: ClassVar[tuple[tuple[str, float], ...]] = ()
    # Sound solvers differ by as much, so the effect is named with another one only if it passes alone.
    differs_by_solver: ClassVar[bool] = False
    face_force: ClassVar[Callable[..., Any] | None] = None
    bends: ClassVar[bool] = False  # whether `rest_curvature` or `friction_moment` does anything
    adds_mass: ClassVar[bool] = False  # whether `added_mass` does anything
    touches: ClassVar[bool] = False  # whether `contact_thickness` does anything
    no_size: ClassVar[float] = 0.0  # an amplitude without any action except a shorter step, if the effect shortens it

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row (`fit.cloth.material.MATERIAL_NAMES`) with this effect."""
        return row

    def node_mass(self, mass: Floats, mesh: ClothMesh, amplitude: Floats) -> Floats:
        """Return the nodes' masses [kg], (nodes,), with this effect."""
        return mass

    def rest_curvature(self, mesh: ClothMesh, amplitude: Floats) -> Floats | float:
        """Return the rest curvature of each bend [1/m], (bends,), positive towards the outer normal."""
        return 0.0

    def friction_moment(self, amplitude: Floats) -> float:
        """Return the largest frictional moment per width [N]."""
        return 0.0

    def contact_thickness(self, amplitude: Floats) -> float:
        """Return the distance at which layers of the cloth are kept apart [m]."""
        return 0.0

    def added_mass(self, mesh: ClothMesh, amplitude: Floats) -> Floats | float:
        """Return the mass that moves along with each node's normal motion [kg], (nodes,)."""
        return 0.0

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends, (n,) instants [s] -> (n, 6) [m], with this effect."""
        return path

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the simulated points as the tracker reports them [m], (frames, points, 3)."""
        return points

    def unobserved(self, targets: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return an observer's targets [m, m/s], (samples, points, 6), with the tracker's error removed.

        With a perfect model and no noise the pull to the targets is zero, or nearly so.
        """
        return targets

    def regions(self, amplitude: Floats) -> tuple[str, ...]:
        """Return the regions of the cloth that a local effect of this size acts in, as `fit.gap.where` names them."""
        return ()

    @property
    def is_one_sided(self) -> bool:
        """Return whether physics allows only amplitudes of one sign."""
        return self.low >= 0.0

    @property
    def moves_edge(self) -> bool:
        """Return whether the effect may move the tracked held edge relative to the hanger's markers."""
        return type(self).drive is not Effect.drive or type(self).observe is not Effect.observe

    @property
    def in_kernel(self) -> bool:
        """Return whether the effect needs the kernel with effects; others run in the plain one."""
        return self.face_force is not None or self.bends or self.adds_mass


def size_of(amplitude: Floats) -> float:
    """Return one number for an effect's amplitude: itself, or the length of its vector."""
    return float(amplitude[0]) if len(amplitude) == 1 else float(np.linalg.norm(amplitude))


def columns_of(effects: tuple[Effect, ...]) -> list[slice]:
    """Return which columns of a row of amplitudes belong to each effect."""
    ends = np.cumsum([0, *(len(e.components) for e in effects)])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def parameter_names(effect: Effect) -> tuple[str, ...]:
    """Return the names of the effect's amplitudes in a fit: the effect's name, with a component's name after a dot."""
    return tuple(f"{effect.name}.{component}" if component else effect.name for component in effect.components)


def amplitudes_of(effects: tuple[Effect, ...], **chosen: float | tuple[float, ...]) -> Floats:
    """Return a row of amplitudes, (components,), zero except for the named effects."""
    columns = columns_of(effects)
    row = np.zeros(columns[-1].stop if columns else 0)
    for name, amplitude in chosen.items():
        where = next(c for e, c in zip(effects, columns, strict=True) if e.name == name)
        row[where] = amplitude
    return row

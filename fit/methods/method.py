"""Definition of a method: named parameters, their map to the solver's SI material, and the objective."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from fit.errors import FitError
from fit.methods.distance import Objective, TrajectoryDistance
from fit.recordings.recording import Recording
from formats.arrays import Booleans, Floats


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter: its range, its standard step for annealing, and whether it is searched on a log scale."""

    name: str
    unit: str
    initial: float
    minimum: float
    maximum: float
    interval: float
    is_log: bool = False
    meaning: str = ""


@dataclass(frozen=True, kw_only=True)
class Parameterisation:
    """A named parameter vector, its map to material rows, and the objective of its fit.

    - `to_materials`: maps vectors, (candidates, parameters), and the weighed density [kg/m^2] to rows of
      `fit.cloth.material.MATERIAL_NAMES`
    - `degenerate`: parameters that are not identifiable, only their ratios
    - `gamma`: the annealing's factor per unit of the objective
    - `search`: the one that finds its parameters by default; a published method has the one of its paper
    - `knows_layers`: the method allows for the stiffness of layers sewn together
    """

    name: str
    parameters: tuple[Parameter, ...]
    to_materials: Callable[[Floats, float], Floats]
    not_identified: str
    degenerate: tuple[str, ...] = ()
    objective: Callable[[Recording], Objective] = TrajectoryDistance
    gamma: float = 1e5  # 1/m, see fit.search.annealing
    search: str = "least-squares"
    is_in_metres: bool = True  # whether the objective is a mean distance
    spacing: float = 0.05  # m, of the mesh by default, as `fit.cloth.model.Resolution`
    knows_layers: bool = False

    @property
    def initial(self) -> Floats:
        """Initial values, (parameters,)."""
        return np.array([p.initial for p in self.parameters])

    @property
    def minimum(self) -> Floats:
        """Lower bounds, (parameters,)."""
        return np.array([p.minimum for p in self.parameters])

    @property
    def maximum(self) -> Floats:
        """Upper bounds, (parameters,)."""
        return np.array([p.maximum for p in self.parameters])

    @property
    def interval(self) -> Floats:
        """Standard steps theta_s of the annealing, (parameters,)."""
        return np.array([p.interval for p in self.parameters])

    @property
    def is_log(self) -> Booleans:
        """Return a mark for each parameter with a log scale, (parameters,)."""
        return np.array([p.is_log for p in self.parameters])

    def starting_from(self, values: Mapping[str, float], origin: str) -> Parameterisation:
        """Return the method with other initial values, clipped to the bounds; unknown names are ignored.

        Raises:
            FitError: the method has none of these parameters.
        """
        if not {p.name for p in self.parameters} & set(values):
            raise FitError(
                f"the method {self.name} cannot start from {origin}",
                where=None,
                advice="use --method mocap-swatch, or a start of its own parameters",
            )
        moved = tuple(
            dataclasses.replace(p, initial=min(max(values.get(p.name, p.initial), p.minimum), p.maximum))
            for p in self.parameters
        )
        return dataclasses.replace(self, parameters=moved)

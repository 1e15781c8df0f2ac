"""Map from a fit's parameters to its material: the parameters that determine a quantity, and its interval.

A number q is a function of the fitted parameters p (`fit.methods`, and effects that change the cloth). Its interval
reaches from the least to the largest q over the corners of the box of the parameters' 90 % intervals. Every map is
monotonic in each parameter, so that no corner is missed. If one parameter alone decides q, the interval is that
parameter's. If several do, the interval holds q at least as often.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from fit.cloth import material as mat
from fit.cloth.effect import Effect, parameter_names
from fit.effects import LIBRARY
from fit.errors import FitError
from fit.methods import find_method
from formats.arrays import Floats
from formats.fit_records import FitParameter, FitResult

Read = Callable[[Floats], float]


class FittedRows:
    """Material rows of parameter vectors of a fit; a `Read` returns a quantity of such a row."""

    def __init__(self, result: FitResult) -> None:
        """Prepare the map of a fit by our own solver that holds its material.

        Raises:
            FitError: the method is not known, or the fit lacks parameters of its method or of its effects.
        """
        self._method, self._effects = find_method(result.method), effects_of(result)
        self._names = [p.name for p in result.parameters]
        wanted = [p.name for p in self._method.parameters] + sorted(result.effects)
        if missing := [name for name in wanted if name not in self._names]:
            raise FitError(
                f"lacks {missing[0]}, a parameter of its method {self._method.name} or of its effects",
                where=result.label,
                advice="fit again",
            )
        self.parameters = result.parameters
        self.fitted = np.array([result.material[name] for name in mat.MATERIAL_NAMES])
        self._values = np.array([p.fitted for p in result.parameters])
        self._density = 1.0  # a method that fits the mass multiplies the weighed density by it
        self._density = float(self.fitted[mat.DENSITY] / self.at(self._values)[mat.DENSITY])

    def at(self, vector: Floats) -> Floats:
        """Return the material row of one vector."""
        own = [self._names.index(p.name) for p in self._method.parameters]
        row = self._method.to_materials(vector[None, own], self._density)[0]
        for effect in self._effects:
            amplitude = np.array([vector[self._names.index(name)] for name in parameter_names(effect)])
            if effect.acts_on != "measurement" and amplitude.any():
                row = effect.material(row, amplitude)
        return np.asarray(row)

    def parameters_behind(self, read: Read) -> list[FitParameter]:
        """Return the parameters that a quantity depends on: those whose range changes its value."""
        found = []
        for k, p in enumerate(self.parameters):
            ends = []
            for end in (p.minimum, p.maximum):
                vector = self._values.copy()
                vector[k] = end
                ends.append(float(read(self.at(vector))))
            if not np.isclose(ends[0], ends[1], rtol=1e-9, atol=0.0):
                found.append(p)
        return found

    def ends(self, read: Read, behind: list[FitParameter]) -> tuple[float, float] | None:
        """Return least and largest value over the corners of the parameters' intervals; None without intervals."""
        if not behind or any(p.interval_low is None or p.interval_high is None for p in behind):
            return None
        values = []
        for corner in itertools.product(*((p.interval_low, p.interval_high) for p in behind)):
            vector = self._values.copy()
            for p, end in zip(behind, corner, strict=True):
                vector[self._names.index(p.name)] = end
            values.append(float(read(self.at(vector))))
        return min(values), max(values)


def effects_of(result: FitResult) -> tuple[Effect, ...]:
    """Return the effects of a fit, in the library's order."""
    return tuple(e for e in LIBRARY if set(parameter_names(e)) <= result.effects.keys())

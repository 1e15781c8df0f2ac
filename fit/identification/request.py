"""The settings of a fit: the parameters of a method and of effects, their bounds, and the search."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from fit.cloth.effect import Effect, parameter_names
from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.engines import OWN_ENGINE, find_engine
from fit.errors import FitError, unknown_name
from fit.methods import Parameter, Parameterisation, find_method
from fit.methods.fabrics import find_fabric
from fit.search import PRINTED_ITERATIONS
from fit.search.annealing import AnnealingSettings
from fit.search.choice import ANNEALED, OBSERVED, check_search
from fit.search.least_squares import BoundedSpace

MOST_ITERATIONS = 1_000_000  # days of simulation; their schedule takes a second, and that of 1e9 half an hour
# 1/m. At 1e-3 annealing takes every step that makes D worse by less than 100 m, at 1e12 none by more than 50 nm.
LEAST_GAMMA, MOST_GAMMA = 1e-3, 1e12
SIDE_BY_SIDE = 16  # candidates a batch; our choice: the lanes of a full vector (`fit.cloth.packing.COST`)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Settings of a fit: method, effects, bounds and search."""

    method: Parameterisation
    effects: tuple[Effect, ...] = ()
    search: str = "annealing"
    settings: AnnealingSettings = field(default_factory=AnnealingSettings)
    seed: int = 0
    width: int = SIDE_BY_SIDE
    resolution: Resolution = field(default_factory=Resolution)
    engine: str = OWN_ENGINE  # the simulator, `fit.engines`
    bounds: tuple[tuple[str, float, float], ...] = ()  # name, low, high: within the parameter's own range

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the method's parameters and one for each effect's component, with the request's bounds."""
        narrowed = {name: (low, high) for name, low, high in self.bounds}
        return tuple(
            replace(p, minimum=low, maximum=high, initial=min(max(p.initial, low), high))
            for p in self._all_parameters
            for low, high in [narrowed.get(p.name, (p.minimum, p.maximum))]
        )

    @property
    def space(self) -> BoundedSpace:
        """Return the box of the parameters, and which of them have a log scale."""
        return BoundedSpace(
            minimum=np.array([p.minimum for p in self.parameters]),
            maximum=np.array([p.maximum for p in self.parameters]),
            is_log=np.array([p.is_log for p in self.parameters]),
        )

    @property
    def used_options(self) -> dict[str, str | float]:
        """Return the settings that the search uses, by their options."""
        used: dict[str, str | float] = {}
        if self.search not in OBSERVED:
            used["--iterations"] = self.settings.iterations
        if self.search in ANNEALED:
            used["--gamma"] = self.settings.gamma
        return used

    @property
    def _all_parameters(self) -> tuple[Parameter, ...]:
        extra = tuple(
            Parameter(
                name=name,
                unit=e.unit,
                initial=0.0,
                minimum=e.low,
                maximum=e.high,
                interval=e.typical,
                meaning=e.title,
            )
            for e in self.effects
            for name in parameter_names(e)
        )
        return self.method.parameters + extra


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The options of `hangtime fit` as plain values, which a worker process or a notebook can pass on."""

    method: str = "si"
    effects: tuple[str, ...] = ()
    bounds: tuple[str, ...] = ()  # NAME=LOW:HIGH
    search: str = ""  # the method's own where empty; annealing for another engine's cloth
    iterations: int | None = None  # PRINTED_ITERATIONS where None; a search without a number of them keeps None
    gamma: float | None = None  # the method's own where None
    spacing: float | None = None  # m; the method's own where None
    seed: int = 0
    fabric: str | None = None
    engine: str = OWN_ENGINE

    def __post_init__(self) -> None:
        """Fill in the default search and its iterations, so that plans with the same effect are equal.

        Raises:
            FitError: an unknown method.
        """
        if not self.search:
            chosen = find_method(self.method, "--method").search if self.engine == OWN_ENGINE else "annealing"
            object.__setattr__(self, "search", chosen)
        if self.iterations is None and self.search not in OBSERVED:
            object.__setattr__(self, "iterations", PRINTED_ITERATIONS)

    def request(self) -> Request:
        """Return the request for the fitter.

        Raises:
            FitError: an unknown method, fabric, effect, engine or search, bounds that do not hold, or a setting of the
                search that the search does not use.
        """
        made = self._made()
        for option, why in self._unused().items():  # last, so that a value without a meaning is named as such
            advice = "leave it out, or choose another --search, as annealing"
            raise FitError(f"changes nothing here: {why}", where=option, advice=advice)
        return made

    def without_unused(self, say: Callable[[str], None]) -> Plan:
        """Return the plan without the settings that its search does not use, and say of each that it changes nothing.

        Raises:
            FitError: as `request`, except for settings that are not used.
        """
        self._made()  # a value without a meaning is refused, whether the search uses it or not
        unused = self._unused()
        for option, why in unused.items():
            say(f"{option} changes nothing here: {why}.")
        return replace(
            self, gamma=None if "--gamma" in unused else self.gamma,
            iterations=None if "--iterations" in unused else self.iterations,
        )  # fmt: skip

    def _made(self) -> Request:
        method = find_method(self.method, "--method")
        if self.fabric is not None:
            method = method.starting_from(find_fabric(self.fabric, "--fabric").start, f"the fabric {self.fabric}")
        return request_of(
            method, list(self.effects), seed=self.seed, gamma=self.gamma,
            iterations=PRINTED_ITERATIONS if self.iterations is None else self.iterations,
            spacing=method.spacing if self.spacing is None else self.spacing, bounds=list(self.bounds),
            engine=self.engine, search=self.search,
        )  # fmt: skip

    def _unused(self) -> dict[str, str]:
        """Return the reason for each given option that the plan's search does not use."""
        unused = {}
        if self.gamma is not None and self.search not in ANNEALED:
            unused["--gamma"] = f"{self.search} does not use gamma"
        if self.search in OBSERVED and self.iterations is not None:
            unused["--iterations"] = f"{self.search} has no number of iterations"
        return unused


def request_of(
    method: Parameterisation,
    effects: list[str],
    *,
    iterations: int,
    seed: int,
    spacing: float,
    gamma: float | None = None,
    bounds: list[str] | None = None,
    engine: str = OWN_ENGINE,
    search: str = "annealing",
) -> Request:
    """Check plain values and build a request from them; bounds are given as NAME=LOW:HIGH.

    Raises:
        FitError: an unknown effect, engine or search; an effect that is given twice or is part of the method; a gamma
        or a spacing
            that is not above 0; iterations or a seed that is no count; bounds that are crossed, malformed, given twice,
            of an unknown parameter or beyond its range.
    """
    check_count(iterations, "iterations", least=1, most=MOST_ITERATIONS)
    check_count(seed, "seed", least=0)
    if check_search(search) in OBSERVED and engine != OWN_ENGINE:
        raise FitError(
            f"{search} simulates with our own cloth only, not with {engine}", where="--search",
            advice="choose another search or leave out --engine",
        )  # fmt: skip
    if search == "tempering" and not method.is_in_metres:
        raise FitError(
            f"tempering draws by how likely distances are, which the error of {method.name} is not", where="--search",
            advice="choose another search, or a method that minimises distances: si, kinect-skirt",
        )  # fmt: skip
    settings = AnnealingSettings(gamma=method.gamma if gamma is None else gamma).lasting(iterations)
    request = Request(
        method=method,
        effects=find_effects(effects, "--effect"),
        search=search,
        settings=settings,
        seed=seed,
        resolution=Resolution(spacing=spacing),
        engine=engine,
        width=SIDE_BY_SIDE if engine == OWN_ENGINE else 1,  # speculation pays only where candidates share a batch
    )
    find_engine(engine, "--engine")
    _check_effects(method, request.effects)
    _check_gamma(request.settings.gamma)
    known = {p.name: p for p in request.parameters}
    read = tuple(_read_bounds(text, known) for text in bounds or [])
    names = [name for name, _, _ in read]
    if twice := [name for name in known if names.count(name) > 1]:
        raise FitError(f"{twice[0]} is given twice", where="--bounds", advice="give each parameter's bounds once")
    return replace(request, bounds=read)


def _check_effects(method: Parameterisation, effects: tuple[Effect, ...]) -> None:
    names, own = [e.name for e in effects], {p.name for p in method.parameters}
    for effect in effects:
        if names.count(effect.name) > 1:
            raise FitError(f"{effect.name} is named twice", where="--effect", advice="name every effect once")
        if effect.in_base in own and not effect.goes_beyond_base:
            raise FitError(
                f"the method {method.name} has {effect.in_base} as a parameter already",
                where="--effect",
                advice=f"leave {effect.name} out; --bounds {effect.in_base}=LOW:HIGH narrows it",
            )


def check_count(number: int, name: str, *, least: int, most: int | None = None) -> None:
    """Refuse a number that is no count.

    Raises:
        FitError: it is no whole number, below the least, or above the most.
    """
    is_whole = isinstance(number, int | np.integer) and not isinstance(number, bool)
    if not is_whole or number < least or (most is not None and number > most):
        until = "on" if most is None else f"to {most}"
        raise FitError(f"{name} is {number!r}", where=f"--{name}", advice=f"give a whole number from {least} {until}")


def _check_gamma(gamma: float) -> None:
    if not (math.isfinite(gamma) and gamma > 0.0):
        raise FitError(f"gamma is {gamma:g}", where="--gamma", advice="give a number above 0, for example 1e5")
    if not LEAST_GAMMA <= gamma <= MOST_GAMMA:
        raise FitError(
            f"gamma is {gamma:g}, at which annealing takes every step or none that is worse", where="--gamma",
            advice=f"give {LEAST_GAMMA:g} to {MOST_GAMMA:g}, for example 1e5",
        )  # fmt: skip


def _read_bounds(text: str, known: dict[str, Parameter]) -> tuple[str, float, float]:
    name, _, span = text.partition("=")
    low_text, _, high_text = span.partition(":")
    if name not in known:
        raise unknown_name("parameter", name, known, where="--bounds")
    try:
        low, high = float(low_text), float(high_text)
    except ValueError:
        raise FitError(
            f"{text!r} is not NAME=LOW:HIGH", where="--bounds", advice=f"for example {name}={known[name].minimum:g}:"
            f"{known[name].maximum:g}",
        ) from None  # fmt: skip
    parameter = known[name]
    if math.isnan(low) or math.isnan(high):
        raise FitError(
            f"{text!r} has a bound that is no number", where="--bounds",
            advice=f"for example {name}={parameter.minimum:g}:{parameter.maximum:g}",
        )  # fmt: skip
    if not low < high:
        raise FitError(
            f"the lower bound of {name}, {low:g}, is not below its upper bound, {high:g}",
            where="--bounds",
            advice="give the smaller number first",
        )
    if not (parameter.minimum <= low and high <= parameter.maximum):
        raise FitError(
            f"{low:g} to {high:g} leaves the range of {name}",
            where="--bounds",
            advice=f"stay within {parameter.minimum:g} to {parameter.maximum:g} {parameter.unit}",
        )
    return name, low, high

"""Fit a parameterisation to takes by the printed annealing: freely running simulations, the method's own objective.

Each candidate is simulated from the settled first shape through the whole take without any pull; its distance is the
mean of the method's objective (`fit.objective`: D; `fit.swatch_error`: E) over the takes. The interval of a parameter
is that of the linearised model about the result,

    C = (J'J / s^2 / k + diag(12 / range^2))^-1,

with residuals' deviation s, k numbers per independent block of half a second, and the variance of a flat prior over
the range; a parameter counts as identified when the data shrink its prior deviation by half or more.
"""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit import objective
from fit.cloth.material import NAMES
from fit.cloth.simulator import Resolution
from fit.combinations import describe_combinations
from fit.effects import find_effects
from fit.effects.base import Effect, columns_of
from fit.engines import find_engine
from fit.errors import BlowUpError, FitError
from fit.geometry import check_geometry
from fit.parameterisations import Parameter, Parameterisation
from fit.recording import Recording, prepare
from fit.search.annealing import Annealing, AnnealingSettings, SearchBox
from formats.results import ErrorFigure, FitParameter, FitResult, ObjectiveFigure
from formats.results import FitError as FitErrors
from formats.take import Take

Floats = NDArray[np.float64]
Progress = Callable[[int, int, float], None]

BLOCK = 0.5  # s: distances further apart count as independent
CHECKPOINT_EVERY = 10.0  # s
SIDE_BY_SIDE = 16  # candidates a batch


@dataclass(frozen=True, kw_only=True)
class Request:
    """What to fit and how."""

    method: Parameterisation
    effects: tuple[Effect, ...] = ()
    settings: AnnealingSettings = field(default_factory=AnnealingSettings)
    seed: int = 0
    width: int = SIDE_BY_SIDE
    resolution: Resolution = field(default_factory=Resolution)
    engine: str = "own"  # the simulator, `fit.engines`
    bounds: tuple[tuple[str, float, float], ...] = ()  # name, low, high: narrower than the parameter's own

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The method's parameters and one for each component of each effect, within the request's bounds."""
        narrowed = {name: (low, high) for name, low, high in self.bounds}
        return tuple(
            replace(p, minimum=low, maximum=high, initial=min(max(p.initial, low), high))
            for p in self._all_parameters
            for low, high in [narrowed.get(p.name, (p.minimum, p.maximum))]
        )

    @property
    def _all_parameters(self) -> tuple[Parameter, ...]:
        extra = tuple(
            Parameter(
                name=f"{e.name}.{component}" if component else e.name,
                unit=e.unit,
                initial=0.0,
                minimum=e.low,
                maximum=e.high,
                interval=e.typical,
                meaning=e.title,
            )
            for e in self.effects
            for component in e.components
        )
        return self.method.parameters + extra


class Model:
    """Simulators of some takes for vectors of a request's parameters."""

    def __init__(self, recordings: list[Recording], request: Request) -> None:
        self.recordings, self.request = recordings, request
        for recording in recordings:
            check_geometry(recording)
        self.objectives = [request.method.objective(r) for r in recordings]  # refuses bad takes before simulating
        make = find_engine(request.engine)
        self.engines = [make(r, request.method, request.effects, request.resolution) for r in recordings]

    @property
    def weighed_density(self) -> float:
        """Mean over the takes of the garment's weight per area [kg/m^2]."""
        return float(np.mean([r.garment.areal_density for r in self.recordings]))

    def material(self, vector: Floats) -> dict[str, float]:
        """SI material of one vector, at the mean weighed density, with the effects that change the cloth."""
        count = len(self.request.method.parameters)
        row = self.request.method.to_materials(vector[None, :count], self.weighed_density)[0]
        for effect, columns in zip(self.request.effects, columns_of(self.request.effects), strict=True):
            if vector[count:][columns].any():
                row = effect.material(row, vector[count:][columns])
        return dict(zip(NAMES, row.tolist(), strict=True))

    def points(self, vectors: Floats) -> list[Floats]:
        """Simulated points per take, each (candidates, frames, points, 3) [m]."""
        return [engine.points(vectors) for engine in self.engines]

    def distances(self, vectors: Floats) -> Floats:
        """Mean over the takes of the method's objective, (candidates,); infinite where a simulation blew up."""
        by_take = [objective.total(o, p) for o, p in zip(self.objectives, self.points(vectors), strict=True)]
        return np.asarray(np.mean(by_take, axis=0))

    def objective_figure(self, initial: Floats, fitted: Floats) -> ObjectiveFigure:
        """The objective and its parts before and after."""
        both = self.points(np.stack([initial, fitted]))
        parts = np.mean([o.terms(p) for o, p in zip(self.objectives, both, strict=True)], axis=0)
        first = self.objectives[0]
        return ObjectiveFigure(
            name=first.name, unit=first.unit, before=float(parts[0].sum()), after=float(parts[1].sum()),
            parts={name: (float(parts[0, k]), float(parts[1, k])) for k, name in enumerate(first.parts)},
        )  # fmt: skip

    def error(self, vector: Floats) -> ErrorFigure:
        """Mean distance of the points per frame of all takes, one after the other, for one vector."""
        by_frame, time, start = [], [], 0.0
        for recording, points in zip(self.recordings, self.points(vector[None]), strict=True):
            errors = objective.per_frame(recording.points, points[0])
            seen = np.isfinite(errors)
            by_frame.append(errors[seen])
            time.append(recording.time[seen] + start)
            start = float(time[-1][-1]) + 1.0
        joined = np.concatenate(by_frame)
        return ErrorFigure(
            mean_m=float(joined.mean()), max_m=float(joined.max()), per_frame_m=joined.tolist(),
            time_s=np.concatenate(time).tolist(),
        )  # fmt: skip


def calibrate(
    training: list[Take],
    held_out: list[Take],
    request: Request,
    *,
    checkpoint: Path | None = None,
    progress: Progress = lambda done, total, best: None,
) -> FitResult:
    """Fit the request's parameters to the training takes and report errors before and after.

    With a checkpoint file the search is saved every ten seconds and when interrupted, and goes on from there.

    Raises:
        FitError: no take, or takes that cannot be simulated.
        BlowUpError: the initial parameters cannot be simulated.
    """
    if not training:
        raise FitError("no take was given", advice="name at least one take archive")
    started = clock.monotonic()
    model = Model([prepare(t) for t in training], request)
    judge = Model([prepare(t) for t in held_out], request) if held_out else None
    parameters = request.parameters
    initial = np.array([p.initial for p in parameters])
    box = SearchBox(
        minimum=np.array([p.minimum for p in parameters]),
        maximum=np.array([p.maximum for p in parameters]),
        interval=np.array([p.interval for p in parameters]),
    )
    search = Annealing(initial, box, request.settings, np.random.default_rng(request.seed))
    key = _key(training, request)
    if checkpoint is not None and checkpoint.exists():
        _resume(search, checkpoint, key)
    saved = clock.monotonic()
    try:
        while not search.is_finished:
            candidates = search.ask(request.width)
            distances = model.distances(candidates)
            if not search.is_started and not np.isfinite(distances[0]):
                raise BlowUpError(
                    "the simulation of the initial parameters blew up",
                    where=training[0].take_id,
                    advice="use a coarser mesh (--spacing) or check the garment's weight",
                )
            search.tell(candidates, distances)
            progress(search.iteration, request.settings.iterations, search.best_distance)
            if checkpoint is not None and clock.monotonic() - saved > CHECKPOINT_EVERY:
                _save(search, checkpoint, key)
                saved = clock.monotonic()
    except KeyboardInterrupt:
        if checkpoint is not None:
            _save(search, checkpoint, key)
        raise
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return _result(training, held_out, request, model, judge, search, initial, clock.monotonic() - started)


def _key(training: list[Take], request: Request) -> dict[str, object]:
    return {
        "takes": [t.take_id for t in training], "method": request.method.name, "seed": request.seed,
        "effects": [e.name for e in request.effects], "spacing": request.resolution.spacing,
        "bounds": [list(b) for b in request.bounds], "initial": [p.initial for p in request.parameters],
        "engine": request.engine,
    }  # fmt: skip


def _save(search: Annealing, checkpoint: Path, key: dict[str, object]) -> None:
    partial = checkpoint.with_suffix(".writing")
    partial.write_text(json.dumps({"key": key, "search": search.state()}))
    partial.replace(checkpoint)


def _resume(search: Annealing, checkpoint: Path, key: dict[str, object]) -> None:
    try:
        saved = json.loads(checkpoint.read_text())
        state, saved_key = saved["search"], saved["key"]
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise FitError("the saved search cannot be read", where=checkpoint, advice="delete it to start anew") from error
    if saved_key != key:
        raise FitError(
            "the saved search is of other takes or options",
            where=checkpoint,
            advice="delete it or choose another --out",
        )
    search.restore(state)


def _result(
    training: list[Take], held_out: list[Take], request: Request, model: Model, judge: Model | None,
    search: Annealing, initial: Floats, seconds: float,
) -> FitResult:  # fmt: skip
    best = search.best
    covariance = _covariance(model, best, request.parameters)
    intervals, is_identified = _intervals(covariance, best, request.parameters)
    count, weighed = len(request.method.parameters), model.weighed_density
    reach = np.array([p.maximum - p.minimum for p in request.method.parameters])
    described = [
        FitParameter(
            name=p.name, unit=p.unit, initial=p.initial, fitted=float(best[k]), minimum=p.minimum, maximum=p.maximum,
            interval_low=float(intervals[k, 0]), interval_high=float(intervals[k, 1]),
            is_identified=bool(is_identified[k]) and p.name not in request.method.degenerate, note=p.meaning,
        )
        for k, p in enumerate(request.parameters)
    ]  # fmt: skip
    is_own = request.engine == "own"
    notes = [request.method.not_identified] if request.method.not_identified else []
    notes += [o.remark for o in model.objectives if o.remark]
    if not is_own:
        notes.append(f"Simulated by {request.engine}; its numbers have no SI values, so no combinations are given.")
    unit = {"m": "metre"}.get(model.objectives[0].unit, f"unit of {model.objectives[0].name}")
    notes.append(f"gamma = {request.settings.gamma:g} per {unit} is our choice; the paper gives none.")
    if search.non_finite:
        notes.append(f"{search.non_finite} candidates blew up and were rejected.")
    return FitResult(
        format="hangtime-fit/1",
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        take_ids=[t.take_id for t in training],
        held_out_ids=[t.take_id for t in held_out],
        method=request.method.name,
        search="annealing",
        seed=request.seed,
        parameters=described,
        error=FitErrors(
            train_before=model.error(initial),
            train_after=model.error(best),
            held_out_before=judge.error(initial) if judge else None,
            held_out_after=judge.error(best) if judge else None,
        ),
        effects={
            p.name: float(best[k]) for k, p in enumerate(request.parameters) if k >= len(request.method.parameters)
        },
        history=[float(v) for v in search.best_history],
        simulations=search.evaluations * len(training),
        seconds=seconds,
        notes=notes,
        material=model.material(best) if is_own else {},
        objective=model.objective_figure(initial, best),
        combinations=describe_combinations(
            lambda vectors: request.method.to_materials(vectors, weighed),
            initial[:count], best[:count], reach, covariance[:count, :count],
        ) if is_own else [],
    )  # fmt: skip


def _covariance(model: Model, best: Floats, parameters: tuple[Parameter, ...]) -> Floats:
    """Covariance of the parameters in the linearised model about the best vector, (parameters, parameters)."""
    low, high = np.array([p.minimum for p in parameters]), np.array([p.maximum for p in parameters])
    reach = high - low
    step = np.where(best + 0.02 * reach <= high, 0.02, -0.02) * reach
    candidates = np.concatenate([best[None], best + np.diag(step)])
    stacked = [
        (r.points - p)[:, r.valid].reshape(len(candidates), -1)
        for r, p in zip(model.recordings, model.points(candidates), strict=True)
    ]
    residuals = np.concatenate(stacked, axis=1)
    jacobian = np.nan_to_num((residuals[1:] - residuals[0]) / step[:, None])
    variance = float(np.mean(residuals[0] ** 2))
    blocks = sum(r.duration / BLOCK for r in model.recordings)
    per_block = residuals.shape[1] / blocks
    return np.asarray(np.linalg.inv(jacobian @ jacobian.T / variance / per_block + np.diag(12 / reach**2)))


def _intervals(covariance: Floats, best: Floats, parameters: tuple[Parameter, ...]) -> tuple[Floats, NDArray[np.bool_]]:
    """90 % intervals, (parameters, 2), and whether each parameter is identified."""
    low, high = np.array([p.minimum for p in parameters]), np.array([p.maximum for p in parameters])
    prior = (high - low) / np.sqrt(12)
    deviation = np.sqrt(np.diag(covariance))
    intervals = np.stack([np.maximum(best - 1.645 * deviation, low), np.minimum(best + 1.645 * deviation, high)], 1)
    return intervals, deviation < 0.5 * prior


def request_of(
    method: Parameterisation,
    effects: list[str],
    *,
    iterations: int,
    seed: int,
    spacing: float,
    gamma: float | None = None,
    bounds: list[str] | None = None,
    engine: str = "own",
) -> Request:
    """Gather a request from plain values; bounds as NAME=LOW:HIGH.

    Raises:
        FitError: an unknown effect or engine; bounds that are crossed, malformed, of no parameter or beyond its range.
    """
    settings = AnnealingSettings(iterations=iterations, gamma=method.gamma if gamma is None else gamma)
    request = Request(
        method=method,
        effects=find_effects(effects),
        settings=settings,
        seed=seed,
        resolution=Resolution(spacing=spacing),
        engine=engine,
        width=SIDE_BY_SIDE if engine == "own" else 1,  # speculation pays only where candidates share a batch
    )
    find_engine(engine)
    known = {p.name: p for p in request.parameters}
    return replace(request, bounds=tuple(_read_bounds(text, known) for text in bounds or []))


def _read_bounds(text: str, known: dict[str, Parameter]) -> tuple[str, float, float]:
    name, _, span = text.partition("=")
    low_text, _, high_text = span.partition(":")
    if name not in known:
        raise FitError(
            f"there is no parameter named {name!r}", where="--bounds", advice=f"known parameters: {', '.join(known)}"
        )
    try:
        low, high = float(low_text), float(high_text)
    except ValueError:
        raise FitError(
            f"{text!r} is not NAME=LOW:HIGH", where="--bounds", advice=f"for example {name}={known[name].minimum:g}:"
            f"{known[name].maximum:g}",
        ) from None  # fmt: skip
    parameter = known[name]
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

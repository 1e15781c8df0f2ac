"""Fit the parameters of a method to takes: run the search, then report errors, intervals and combinations.

Searches by distance (`fit.search.choice`) get free rollouts. Each candidate is simulated from the settled first shape
through the whole take without any pull. The candidate's distance is the mean of the method's objective over the takes
(`fit.methods.distance`: D; `fit.methods.swatch_error`: E). Least squares (`fit.identification.observed`) sees the
points' residuals instead. Every search reports errors of free rollouts.

Intervals come from the linearised model about the result (`fit.identification.free_intervals`). Tempering takes its
intervals from its draws.
"""

from __future__ import annotations

import functools
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np

from fit.cloth.effect import columns_of
from fit.cloth.material import MATERIAL_NAMES
from fit.engines import OWN_ENGINE, find_engine
from fit.errors import BlowUpError
from fit.identification.combinations import describe_combinations
from fit.identification.effect_sizes import with_sizes
from fit.identification.free_intervals import blocks_of, free_intervals
from fit.identification.notes_on_values import NEVER_MOVED, note_on_start, notes_on_values
from fit.identification.observed import begin_observed
from fit.identification.request import Request
from fit.identification.saved_search import SavedSearch
from fit.identification.trivial import describe_trivial, trivial_figures
from fit.methods import distance as objective
from fit.provenance import physics_version
from fit.recordings.camera_findings import describe_camera
from fit.recordings.geometry import check_geometry
from fit.recordings.intact import describe_flaws, describe_short, naming_damage
from fit.recordings.ready import Ready, ready
from fit.recordings.recording import Recording
from fit.recordings.selection import content_of_garment
from fit.runtime import one_thread_of_algebra
from fit.search.choice import ANNEALED, OBSERVED, Task, begin, has_short_intervals
from fit.search.intervals import Intervals, check_blocks, draw_intervals
from fit.search.steps import Step
from fit.search.tempering import FEWEST_DRAWS, Tempering
from formats.arrays import Floats
from formats.fault_words import state_of_take
from formats.fit_records import ErrorFigure, FitParameter, FitResult, ObjectiveFigure, held_out_option
from formats.fit_records import FitError as FitErrors
from formats.impossible_points import describe_impossible
from formats.sights import BLOCK_SECONDS
from formats.take import Take

Progress = Callable[[int, int, float], None]

CHECKPOINT_EVERY = 10.0  # s; our choice: a crash loses ten seconds of a search of minutes; no result depends on it
TOO_SHORT = (
    "Warning: this search explores one local minimum. So its 90 % intervals are too short, and parameters that it "
    "calls identified may not be identifiable. Where intervals matter, use --search least-squares."
)
LAYERED = (
    "Sleeves and hems are layers sewn together, stiffer than any fabric; where the simulated ones hang down, "
    "try --method si-sewn."
)


class Model:
    """Simulators of some takes for parameter vectors of a request; is_fitted: whether the fit uses these takes."""

    def __init__(self, recordings: list[Recording], request: Request, *, is_fitted: bool = True) -> None:
        self.recordings, self.request = recordings, request
        for recording in recordings:
            check_geometry(recording)
        # The method's error measure refuses unsuitable takes before anything is simulated.
        self.objectives = [request.method.objective(r) for r in recordings] if is_fitted else []
        make = find_engine(request.engine)
        self.engines = [make(r, request.method, request.effects, request.resolution) for r in recordings]

    @property
    def weighed_density(self) -> float:
        """Return the garment's mass per area [kg/m^2], averaged over the takes."""
        return float(np.mean([r.garment.areal_density for r in self.recordings]))

    def material(self, vector: Floats) -> dict[str, float]:
        """Return the SI material of one parameter vector at the weighed density, effects on the cloth included."""
        return dict(zip(MATERIAL_NAMES, self.material_rows(vector[None])[0].tolist(), strict=True))

    def material_rows(self, vectors: Floats) -> Floats:
        """Return the materials of parameter vectors, (candidates, parameters), as rows in the order of `NAMES`."""
        count = len(self.request.method.parameters)
        rows = self.request.method.to_materials(vectors[:, :count], self.weighed_density).copy()
        for effect, columns in zip(self.request.effects, columns_of(self.request.effects), strict=True):
            if effect.acts_on == "measurement":
                continue  # a clock's rate scales the solver's numbers and is no property of the cloth
            for k, amplitude in enumerate(vectors[:, count:][:, columns]):
                if amplitude.any():
                    rows[k] = effect.material(rows[k], amplitude)
        return rows

    def points(self, vectors: Floats) -> list[Floats]:
        """Simulate the points of each take [m], (candidates, frames, points, 3)."""
        return [engine.points(vectors) for engine in self.engines]

    def distances(self, vectors: Floats) -> Floats:
        """Return the method's objective, averaged over the takes, (candidates,); infinite after a blow-up."""
        return self.distances_of(self.points(vectors))

    def distances_of(self, points: list[Floats]) -> Floats:
        """Return `distances` for points that are simulated already [m], (candidates, frames, points, 3) per take."""
        by_take = [objective.total(o, p) for o, p in zip(self.objectives, points, strict=True)]
        return np.asarray(np.mean(by_take, axis=0))

    @functools.cached_property
    def error_before(self) -> ErrorFigure:
        """Return the mean distance of the points with the initial parameters.

        Raises:
            BlowUpError: a take whose simulation does not stay finite.
        """
        return self.error(np.array([p.initial for p in self.request.parameters]))

    def objective_figure(self, initial: Floats, fitted: Floats) -> ObjectiveFigure:
        """Return the objective and its parts before and after the fit."""
        both = self.points(np.stack([initial, fitted]))
        parts = np.mean([o.terms(p) for o, p in zip(self.objectives, both, strict=True)], axis=0)
        first = self.objectives[0]
        return ObjectiveFigure(
            name=first.name, unit=first.unit, before=float(parts[0].sum()), after=float(parts[1].sum()),
            parts={name: (float(parts[0, k]), float(parts[1, k])) for k, name in enumerate(first.parts)},
        )  # fmt: skip

    def error(self, vector: Floats) -> ErrorFigure:
        """Return the mean distance of the points in each frame of all takes in turn, for one parameter vector.

        Raises:
            BlowUpError: a take whose simulation does not stay finite.
        """
        return self.errors_of([points[0] for points in self.points(vector[None])])[0]

    def errors_of(self, points: list[Floats]) -> tuple[ErrorFigure, list[ErrorFigure]]:
        """Return the mean error over all takes, and each take's, of simulated points [m], (frames, points, 3) per take.

        Raises:
            BlowUpError: a take whose simulation does not stay finite.
        """
        by_take, start = [], 0.0
        for recording, simulated in zip(self.recordings, points, strict=True):
            errors = objective.per_frame(recording.points, simulated)
            seen = np.isfinite(recording.points).all(-1).any(-1)
            if not np.isfinite(errors[seen]).all():
                raise BlowUpError(
                    "the simulation of this take blew up",
                    where=recording.take_id,
                    advice="use a coarser mesh (a larger spacing)",
                )
            by_take.append((errors[seen], recording.time[seen] + start))
            start = float(by_take[-1][1][-1]) + 1.0
        joined = tuple(np.concatenate(part) for part in zip(*by_take, strict=True))
        return _error_figure(*joined), [_error_figure(*one) for one in by_take]


def _error_figure(by_frame: Floats, time: Floats) -> ErrorFigure:
    return ErrorFigure(
        mean_m=float(by_frame.mean()), max_m=float(by_frame.max()), per_frame_m=by_frame.tolist(),
        time_s=time.tolist(),
    )  # fmt: skip


@one_thread_of_algebra()
def calibrate(
    training: list[Take],
    held_out: list[Take],
    request: Request,
    *,
    prepared: Ready | None = None,
    checkpoint: Path | None = None,
    progress: Progress = lambda done, total, best: None,
    begun: Callable[[], None] = lambda: None,
) -> FitResult:
    """Fit the request's parameters to the training takes and report errors before and after.

    - `prepared`: the result of `ready` for these takes, if the caller has it already
    - `begun`: called after all checks of the takes, before the first simulation

    With a checkpoint file the search is saved every ten seconds, when interrupted and at its end. The next call
    continues from this file. Remove the file once the result is kept. Least squares saves every finished batch of
    samples and every descent.

    Raises:
        FitError: no take, takes of different garments, a take that is given twice or cannot be simulated, or a saved
        search that cannot be continued. BlowUpError: a take cannot be simulated with the initial or the fitted
        parameters.
    """
    takes = prepared or ready(training, held_out)
    train, test = takes.training, takes.held_out
    training, held_out = takes.in_order(training, held_out)
    with naming_damage([*training, *held_out]):
        check_blocks(np.concatenate(blocks_of(train)))  # before anything is simulated
        model = Model(train, request)
        saved = SavedSearch(checkpoint, _key(takes.contents, model))
        saved.read()  # one that cannot be continued is refused before anything is simulated
        judge = Model(test, request, is_fitted=False) if test else None
        begun()
        if judge is not None:
            _ = judge.error_before  # a take that blows up is refused before the search
        run = _least_squares if request.search in OBSERVED else _ask_and_tell
        found = run(model, request, saved, progress)
        if request.engine == OWN_ENGINE:
            intervals, more = with_sizes(train, request, found.vector, found.intervals)
            found = replace(found, intervals=intervals, simulations=found.simulations + more)
        result = _result(model, judge, found, contents=takes.contents, seconds=saved.seconds)
    return msgspec.structs.replace(
        result,
        notes=[*result.notes, *describe_short(training), *describe_flaws([*training, *held_out])],
        camera=describe_camera(train + test),
        take_states=[state_of_take(take) for take in (*training, *held_out)],
        options=request.used_options | held_out_option(takes.held_out_contents),
    )


@dataclass(frozen=True)
class _Found:
    """Result of a search; `simulations` counts each take of each candidate."""

    vector: Floats
    intervals: Intervals
    history: list[float]
    simulations: int
    non_finite: int = 0


def _ask_and_tell(model: Model, request: Request, saved: SavedSearch, progress: Progress) -> _Found:
    blocks = sum(r.duration for r in model.recordings) / BLOCK_SECONDS
    initial = np.array([p.initial for p in request.parameters])
    steps = np.array([p.interval for p in request.parameters])
    task = Task(
        initial=initial,
        steps=steps,
        space=request.space,
        settings=request.settings,
        seed=request.seed,
        numbers=blocks,
    )
    search = begin(request.search, task)
    if (state := saved.read()) is not None:
        with saved.continuing():
            search.restore(state)
    last = clock.monotonic()
    try:
        while not search.is_finished:
            candidates = search.ask(request.width)
            distances = model.distances(candidates)
            if not search.is_started and not np.isfinite(distances[0]):
                raise BlowUpError(
                    "the simulation of the initial parameters blew up",
                    where=model.recordings[0].take_id,
                    advice="use a coarser mesh (a larger spacing) or check the garment's weight",
                )
            search.tell(candidates, distances)
            progress(search.iteration, request.settings.iterations, search.best_distance)
            if clock.monotonic() - last > CHECKPOINT_EVERY:
                saved.save(search.state())
                last = clock.monotonic()
    except KeyboardInterrupt:
        saved.save(search.state())
        raise
    saved.save(search.state())  # the following simulations may fail
    if isinstance(search, Tempering) and len(search.draws) >= FEWEST_DRAWS:
        intervals = draw_intervals(request.space, search.draws, search.best)
    else:
        intervals = free_intervals(request.space, model.recordings, model.points, search.best)
    takes, history = len(model.recordings), [float(v) for v in search.best_history]
    return _Found(search.best, intervals, history, search.evaluations * takes, search.non_finite)


def _least_squares(model: Model, request: Request, saved: SavedSearch, progress: Progress) -> _Found:
    """Run least squares; the saved state holds samples, descents and the distance after each simulation."""
    search, settings = begin_observed(request, model.recordings, model.distances_of)
    initial = np.array([p.initial for p in request.parameters])
    steps: list[Step] = []
    if (state := saved.read()) is not None:
        with saved.continuing():
            steps = [Step.from_state(one) for one in state["steps"]]
            history = [float(value) for value in state["history"]]
            extra = int(state["extra"])
    if not steps:
        history, extra = [float(model.distances(initial[None])[0])], 1

    def show(step: Step) -> None:
        nonlocal extra
        steps.append(step)
        distances = list(step.distances)
        if not distances:  # distances of rollouts under a pull are not D
            distances, extra = [float(model.distances(step.vector[None])[0])], extra + 1
        history.extend(float(d) for d in np.minimum.accumulate([history[-1], *distances])[1:])
        saved.save({"steps": [one.state() for one in steps], "history": history, "extra": extra})
        progress(len(steps), settings.steps, history[-1])

    found = search.run(initial, settings, show, tuple(steps))
    simulations = found.simulations + extra * len(model.recordings)
    return _Found(found.vector, found.intervals, history, simulations)


def _key(contents: list[str], model: Model) -> dict[str, object]:
    request = model.request
    return {
        "takes": contents, "method": request.method.name, "seed": request.seed,
        "search": request.search,
        "effects": [e.name for e in request.effects], "spacing": request.resolution.spacing,
        "bounds": [list(b) for b in request.bounds], "initial": [p.initial for p in request.parameters],
        "engine": request.engine, "engine_version": model.engines[0].version, "physics": physics_version(),
    }  # fmt: skip


def _result(model: Model, judge: Model | None, found: _Found, *, contents: list[str], seconds: float) -> FitResult:
    request, best, intervals = model.request, found.vector, found.intervals
    garment = model.recordings[0].garment
    initial = np.array([p.initial for p in request.parameters])
    # Least squares may find that its start is the minimum. Other searches know only that they found nothing better.
    has_moved = request.search in OBSERVED or not np.array_equal(best, initial)
    is_identified = [
        has_moved and bool(intervals.is_identified[k]) and p.name not in request.method.degenerate
        for k, p in enumerate(request.parameters)
    ]
    described = [
        FitParameter(
            name=p.name, unit=p.unit, initial=p.initial, fitted=float(best[k]), minimum=p.minimum, maximum=p.maximum,
            interval_low=float(intervals.ends[k, 0]), interval_high=float(intervals.ends[k, 1]),
            is_identified=is_identified[k], is_at_bound=bool(intervals.is_at_bound[k]), note=p.meaning,
        )
        for k, p in enumerate(request.parameters)
    ]  # fmt: skip
    is_own = request.engine == OWN_ENGINE
    notes = [request.method.not_identified] if request.method.not_identified else []
    notes += [o.remark for o in model.objectives if o.remark]
    if impossible := max(r.impossible for r in [*model.recordings, *(judge.recordings if judge else [])]):
        notes.append(f"Warning: {describe_impossible(impossible)}")
    if garment.kind == "t-shirt" and not request.method.knows_layers:
        notes.append(LAYERED)
    if not is_own:
        notes.append(f"Simulated by {request.engine}; its numbers have no SI values, so no combinations are given.")
    if request.search in ANNEALED:
        unit = {"m": "metre"}.get(model.objectives[0].unit, f"unit of {model.objectives[0].name}")
        notes.append(f"gamma = {request.settings.gamma:g} per {unit} is our choice; the paper gives none.")
    if request.search in OBSERVED and model.objectives[0].name != "D":
        name = model.objectives[0].name
        notes.append(f"{request.search} minimises the points' residuals; {name} is reported, not minimised.")
    if has_short_intervals(request.search, request.settings.iterations):
        notes.append(TOO_SHORT)
    if not has_moved:
        notes.append(NEVER_MOVED.format(search=request.search))
    notes += notes_on_values(described)
    if found.non_finite:
        notes.append(f"{found.non_finite} candidates blew up and were rejected.")
    errors = FitErrors(
        train_before=model.error_before,
        train_after=model.error(best),
        held_out_before=judge.error_before if judge else None,
        held_out_after=judge.error(best) if judge else None,
    )
    if worse := note_on_start(errors, request.search):
        notes.append(worse)
    trivial = trivial_figures(model, judge)
    after = errors.held_out_after or errors.train_after
    notes.append(describe_trivial(after.mean_m, trivial, is_held_out=judge is not None))
    return FitResult(
        format="hangtime-fit/1",
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        take_ids=[r.take_id for r in model.recordings],
        held_out_ids=[r.take_id for r in judge.recordings] if judge else [],
        method=request.method.name,
        engine=request.engine,
        spacing=request.resolution.spacing,
        take_contents=contents,
        search=request.search,
        seed=request.seed,
        parameters=described,
        error=errors,
        trivial=trivial,
        effects={
            p.name: float(best[k]) for k, p in enumerate(request.parameters) if k >= len(request.method.parameters)
        },
        history=found.history,
        simulations=found.simulations,
        seconds=seconds,
        notes=notes,
        material=model.material(best) if is_own else {},
        layers=garment.layers,
        garment=garment.name,
        garment_content=content_of_garment(garment.as_meant),
        objective=model.objective_figure(initial, best),
        combinations=(
            describe_combinations(model.material_rows, request.space, initial, best, intervals) if is_own else []
        ),
    )

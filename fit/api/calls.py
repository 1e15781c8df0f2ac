"""The six calls of the Python interface: load, fit, diagnose, simulate, report, export.

A call that has a command of its name does the work of that command. Both use the same code, defaults and one thread of
linear algebra. So the numbers are the command's to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from fit.api.results import DiagnosisOutcome, FitOutcome, SimulatedTake, Simulation
from fit.errors import FitError
from formats.archive import read_take
from formats.errors import ResultError
from formats.plausible import check_plausible_take
from formats.results import load_diagnosis, load_fit_result
from formats.take import Take

if TYPE_CHECKING:
    from fit.cloth.effect import Effect
    from fit.identification.request import PlanOptions

OneTake = Take | Path | str
Takes = OneTake | Sequence[OneTake]


def load(path: Path | str) -> Take | FitOutcome | DiagnosisOutcome:
    """Return the take of an archive (`.mcap`), or the result that a `fit.json` or `diagnosis.json` holds.

    Raises:
        HangtimeError: the file cannot be read, or is neither.
    """
    path = Path(path)
    if path.suffix != ".json":
        return read_take(path)
    try:
        return FitOutcome(result=load_fit_result(path))
    except ResultError as no_fit:
        try:
            return DiagnosisOutcome(result=load_diagnosis(path))
        except ResultError:
            raise no_fit from None


def fit(
    takes: Takes,
    *,
    held_out: Takes = (),
    held_out_motion: Sequence[str] = (),
    anyway: bool = False,
    checkpoint: Path | str | None = None,
    progress: Callable[[int, int, float], None] = lambda done, total, best: None,
    **options: Unpack[PlanOptions],
) -> FitOutcome:
    """Find the cloth parameters that make the simulation follow the takes, as `hangtime fit` does.

    - `takes`, `held_out`: takes or paths of archives, one or several
    - `held_out_motion`: kinds of motion to judge on, one or several
    - `anyway`: accept sizes, weights and times that no cloth, hanger or camera has
    - `checkpoint`: file from which an interrupted search continues
    - `progress`: called with steps done, steps in all and the least error so far

    The options are those of the command, with the same meanings and defaults (`fit.identification.request.Plan`):
    method, effects, bounds, search, iterations, gamma, spacing, seed, fabric, engine.

    Raises:
        FitError: the request or the takes cannot be fitted.
    """
    from fit.identification.calibrate import calibrate
    from fit.identification.request import plan_of

    training, testing = sorted_out(takes, held_out, held_out_motion, anyway=anyway)
    request = plan_of(options).request()
    result = calibrate(
        training, testing, request, checkpoint=Path(checkpoint) if checkpoint is not None else None, progress=progress
    )
    return FitOutcome(result=result, training=tuple(training), held_out=tuple(testing), request=request)


def diagnose(
    takes: Takes,
    *,
    held_out: Takes = (),
    held_out_motion: Sequence[str] = (),
    model: str | None = None,
    add: Sequence[str] = (),
    without: Sequence[str] = (),
    spacing: float | None = None,
    seed: int = 0,
    anyway: bool = False,
    by: str = "rules",
    checkpoint: Path | str | None = None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> DiagnosisOutcome:
    """Say where the simulation misses and which unmodelled effect causes it, as `hangtime diagnose` does.

    - `takes`, `held_out`, `held_out_motion`, `anyway`: as for `fit`
    - `model`: the base model, by its method's name
    - `add`: effects to refit in any case, without regard to the screening
    - `without`: effects to leave out of the library
    - `spacing`: of the mesh [m]
    - `by`: what decides: `rules` or `evidence`
    - `checkpoint`: a folder in which finished fits are kept.

    Raises:
        FitError: the takes cannot be diagnosed, or there is no such model or effect.
    """
    from fit.cloth.model import Resolution
    from fit.gap.diagnosis import deciding
    from fit.gap.diagnosis import diagnose as find_gap
    from fit.identification.request import each
    from fit.methods import base_model_of, find_method

    training, testing = sorted_out(takes, held_out, held_out_motion, anyway=anyway)
    if not training:
        raise FitError("no take was given", advice="name at least one take archive")
    add, without = each(add), each(without)
    library = library_of(add, without)
    findings = find_gap(
        training, testing,
        effects=library,
        model=find_method(model) if model else base_model_of(training[0].garment),
        added=tuple(add),
        checkpoint=Path(checkpoint) if checkpoint is not None else None,
        resolution=Resolution(spacing=spacing) if spacing is not None else None,
        seed=seed,
        by=deciding(by),
        progress=progress,
    )  # fmt: skip
    return DiagnosisOutcome(
        result=findings.diagnosis, training=tuple(training), held_out=tuple(testing), findings=findings,
        added=tuple(add),
    )  # fmt: skip


def simulate(
    takes: Takes,
    parameters: FitOutcome | Mapping[str, float] | None = None,
    *,
    anyway: bool = False,
    **options: Unpack[PlanOptions],
) -> Simulation:
    """Simulate the cloth of takes from their first shape on, driven by the recorded hanger.

    - `parameters`: a fit, or values by name over the method's initial ones. A fit brings its method, effects, engine
      and values, and its mesh unless it was loaded from a file, which holds no spacing
    - `anyway` and options: as for `fit`; method, effects, spacing, fabric and engine count here

    Raises:
        FitError: unknown names, values outside the ranges, or takes that cannot be simulated.
    """
    import numpy as np

    from fit.identification.calibrate import Model
    from fit.identification.request import plan_of
    from fit.recordings.recording import prepare_together
    from fit.runtime import one_thread_of_algebra

    read, _ = sorted_out(takes, anyway=anyway)
    if not read:
        raise FitError("no take was given", where="simulate", advice="name at least one take archive")
    own = parameters.request if isinstance(parameters, FitOutcome) else None
    if isinstance(parameters, FitOutcome) and own is None:
        options = {**parameters.options, **options}
    request = own if own is not None and not options else plan_of(options).request()
    given = parameters.values if isinstance(parameters, FitOutcome) else dict(parameters or {})
    if unknown := sorted(given.keys() - {p.name for p in request.parameters}):
        raise FitError(
            f"there is no parameter named {unknown[0]!r}", where="simulate",
            advice=f"known parameters: {', '.join(p.name for p in request.parameters)}",
        )  # fmt: skip
    values = {p.name: float(given.get(p.name, p.initial)) for p in request.parameters}
    for p in request.parameters:
        if not p.minimum <= values[p.name] <= p.maximum:
            raise FitError(
                f"{p.name} = {values[p.name]:g} is outside its range", where="simulate",
                advice=f"stay within {p.minimum:g} to {p.maximum:g} {p.unit}",
            )  # fmt: skip
    with one_thread_of_algebra():
        recordings, _ = prepare_together(read)
        model = Model(recordings, request, is_fitted=False)
        vector = np.array(list(values.values()))
        points = model.points(vector[None])
        whole, by_take = model.errors_of([p[0] for p in points])
    shown = tuple(
        SimulatedTake(
            take_id=r.take_id, point_names=tuple(p.name for p in r.garment.points), time=r.time, real=r.points,
            simulated=p[0], valid=r.valid,
        )
        for r, p in zip(recordings, points, strict=True)
    )  # fmt: skip
    return Simulation(takes=shown, values=values, error=whole, by_take=tuple(by_take))


def report(outcome: FitOutcome | DiagnosisOutcome, path: Path | str, *, fit: FitOutcome | None = None) -> Path:
    """Write the report of a fit or a diagnosis as one HTML file, and return its path.

    fit: shown in the report of a diagnosis, where it is of the same takes.

    Raises:
        FitError: the outcome was loaded from a file and holds no takes, or the report cannot be written.
    """
    from fit.report.gather import write_diagnosis_report, write_fit_report
    from fit.runtime import one_thread_of_algebra

    path, training, testing = Path(path), list(outcome.training), list(outcome.held_out)
    with one_thread_of_algebra():
        if isinstance(outcome, FitOutcome) and outcome.request is not None:
            return write_fit_report(path, outcome.result, training, testing, outcome.request)
        if isinstance(outcome, DiagnosisOutcome) and outcome.findings is not None:
            shown = fit.result if fit is not None else None
            return write_diagnosis_report(path, outcome.findings, shown, (training, testing))
    raise FitError(
        "a result that was loaded from a file holds no takes to draw", where=path,
        advice="fit or diagnose the takes again, then write the report",
    )  # fmt: skip


def export(
    outcome: FitOutcome | Path | str,
    to: str,
    path: Path | str,
    *,
    take: OneTake | None = None,
    thickness: float = 1e-3,
    spacing: float | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Write a fit for other programs, as `hangtime export` does, and return the files that were written.

    - `outcome`: a fit, or the path of its `fit.json`
    - `to`: the kind, `fit.export.kinds.EXPORT_KINDS`
    - `take`: gives garment and motion
    - `thickness`: the fabric's [m], which motion does not identify
    - `spacing`: of the mesh [m]

    Raises:
        FitError: an unknown kind, or a fit that holds no such thing.
        OutputError: a file is there already and is not to be overwritten.
    """
    from fit.export.kinds import Order
    from fit.export.kinds import export as write
    from fit.folders import read_fit

    result = outcome.result if isinstance(outcome, FitOutcome) else read_fit(Path(outcome))[0]
    whose = _each(take)[0] if take is not None else None
    order = Order(result=result, take=whose, thickness=thickness, spacing=spacing)
    return write(order, to, Path(path), overwrite=overwrite)


def library_of(add: Sequence[str], without: Sequence[str]) -> tuple[Effect, ...]:
    """Return the effects to look for.

    Raises:
        FitError: an unknown effect, or one that is both added and left out.
    """
    from fit.effects import find_effects, library_without

    find_effects(list(add))
    if both := sorted({*add} & {*without}):
        raise FitError(f"{both[0]} is to be added and left out", where="--without", advice="give one of the two")
    return library_without(list(without))


def sorted_out(
    takes: Takes, held_out: Takes = (), held_out_motion: Sequence[str] = (), *, anyway: bool = False
) -> tuple[list[Take], list[Take]]:
    """Return the takes to fit to and the takes to judge on, read where a path is given.

    anyway: accept implausible takes

    Raises:
        HangtimeError: an archive cannot be read, a take is implausible, or no take moves in a kind to be held out.
    """
    from fit.identification.request import each
    from fit.recordings.selection import split_by_motion

    every, judged = _each(takes), _each(held_out)
    if not anyway:
        for take in every + judged:
            check_plausible_take(take, take.take_id, offers_anyway=True)
    training, moving = split_by_motion(every, each(held_out_motion))
    return training, moving + judged


def _each(takes: Takes) -> list[Take]:
    every = [takes] if isinstance(takes, Take | Path | str) else list(takes)
    return [take if isinstance(take, Take) else read_take(Path(take)) for take in every]

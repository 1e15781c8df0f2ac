"""The six calls of the Python interface: load, fit, diagnose, simulate, report, export.

A call that has a command of its name does the work of that command. Both use the same code, defaults and one thread of
linear algebra. So the numbers are the command's to the last digit.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from fit.api.arguments import (
    OF_THE_FIT,
    PLAN_DEFAULTS,
    PlanOptions,
    arguments_named,
    check_kind,
    check_switches,
    check_text,
    checked,
    names_checked,
    names_of,
    number_of,
    options_shown,
    path_of,
)
from fit.api.results import DiagnosisOutcome, FitOutcome, SimulatedTake, Simulation
from fit.api.takes import OneTake, Takes, library_of, one_take, sorted_out
from fit.api.watched import (
    FitProgress,
    StageProgress,
    check_progress,
    diagnosis_shown,
    ends_in_a_sentence,
    fit_shown,
    one_at_a_time,
)
from fit.errors import FitError, unknown_name
from formats.archive import read_take
from formats.fit_records import FitResult
from formats.outputs import AS_PAGE, check_ending, make_parent, output_folder, refuse_to_replace
from formats.take import Take

if TYPE_CHECKING:
    from fit.identification.request import Request


@names_checked
@arguments_named()
def load(path: Path | str) -> Take | FitOutcome | DiagnosisOutcome:
    """Return the take of an archive (`.mcap`), or the result that a `fit.json` or `diagnosis.json` holds.

    Raises:
        HangtimeError: the file cannot be read, or is neither.
    """
    from fit.identification.read_again import load_either

    path = path_of(path, "path")
    if not _is_json(path):
        return read_take(path)
    result = load_either(path)
    return FitOutcome(result=result) if isinstance(result, FitResult) else DiagnosisOutcome(result=result)


@ends_in_a_sentence
@names_checked
@one_at_a_time
@options_shown(PLAN_DEFAULTS)
@arguments_named()
def fit(
    takes: Takes,
    *,
    held_out: Takes = (),
    held_out_motion: Sequence[str] = (),
    anyway: bool = False,
    checkpoint: Path | str | None = None,
    progress: FitProgress | bool | None = None,
    **options: Unpack[PlanOptions],
) -> FitOutcome:
    """Find the cloth parameters that make the simulation follow the takes, as `hangtime fit` does.

    - `takes`, `held_out`: takes or paths of archives, one or several
    - `held_out_motion`: kinds of motion to judge on, one or several
    - `anyway`: accept sizes, weights, times and jumps that no cloth, hanger or camera has
    - `checkpoint`: file from which an interrupted search continues; its folder is made if absent. Ctrl-C keeps the
      search there; without a file, nothing is kept
    - `progress`: False hides the line of progress, which a terminal or notebook shows. A function receives the steps
      done, the steps in all and the least error so far. It may wait for calls of other threads; this call goes on
      after them. It must not take a lock that a thread holds during its own call: both would wait for ever
    - `method`: the parameters to fit, as `--method`
    - `effects`: names of effects of which the size is fitted too, as `--effect`
    - `bounds`: NAME=LOW:HIGH, one text a parameter
    - `search`, `iterations`, `gamma`, `seed`: of the search; an empty `search` is the method's own, None its default
    - `spacing`: of the mesh [m]; None is the method's own
    - `fabric`: start from the table values of this fabric
    - `engine`: the simulator, `own` or `blender`

    `hangtime fit --help` says more of each.

    Raises:
        FitError: the request or the takes cannot be fitted.
    """
    from fit.identification.calibrate import calibrate
    from fit.identification.request import Plan
    from fit.recordings.ready import ready

    check_progress(progress)
    check_switches(anyway=anyway)
    request = Plan(**checked(options)).request()
    file = path_of(checkpoint, "checkpoint") if checkpoint is not None else None
    mesh = request.resolution.spacing
    training, testing = sorted_out(takes, held_out, held_out_motion, anyway=anyway, spacing=mesh)
    with output_folder(file.parent) if file is not None else contextlib.nullcontext():
        prepared = ready(training, testing)
        with fit_shown(progress, request) as show:
            result = calibrate(training, testing, request, prepared=prepared, checkpoint=file, progress=show)
    return FitOutcome(
        result=result, training=tuple(training), held_out=tuple(testing), request=request, prepared=prepared
    )


@ends_in_a_sentence
@names_checked
@one_at_a_time
@options_shown()
@arguments_named()
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
    progress: StageProgress | bool | None = None,
) -> DiagnosisOutcome:
    """Say where the simulation misses and which unmodelled effect causes it, as `hangtime diagnose` does.

    - `takes`, `held_out`, `held_out_motion`, `anyway`: as for `fit`
    - `model`: the base model, by its method's name
    - `add`: effects to refit in any case, without regard to the screening
    - `without`: effects to leave out of the library
    - `spacing`: of the mesh [m]
    - `by`: what decides: `rules` or `evidence`
    - `checkpoint`: a folder in which finished fits are kept, also at Ctrl-C; the same call continues with them
    - `progress`: as for `fit`; a function receives the stage and its share that is done

    Raises:
        FitError: the takes cannot be diagnosed, or there is no such model or effect.
    """
    from fit.cloth.model import Resolution
    from fit.gap.diagnosis import deciding
    from fit.gap.diagnosis import diagnose as find_gap
    from fit.identification.request import check_count
    from fit.methods import base_model_of, find_base_model

    for name, text in {"model": model, "by": by}.items():
        if text is not None or name == "by":
            check_text(text, name)
    check_progress(progress)
    check_switches(anyway=anyway)
    check_count(seed, "seed", least=0)
    mesh = number_of(spacing, "spacing")
    resolution = Resolution(spacing=mesh) if mesh is not None else None
    folder = path_of(checkpoint, "checkpoint", "the path of a folder") if checkpoint is not None else None
    training, testing = sorted_out(takes, held_out, held_out_motion, anyway=anyway, spacing=mesh)
    if not training:
        raise FitError("no take was given", where=None, advice="name at least one take archive")
    add, without = names_of(add, "add"), names_of(without, "without")
    library = library_of(add, without)
    with diagnosis_shown(progress) as show:
        findings = find_gap(
            training, testing,
            effects=library,
            model=find_base_model(model) if model else base_model_of(training[0].garment),
            added=tuple(add),
            checkpoint=folder,
            resolution=resolution,
            seed=seed,
            by=deciding(by),
            progress=show,
        )  # fmt: skip
    return DiagnosisOutcome(
        result=findings.diagnosis, training=tuple(training), held_out=tuple(testing), findings=findings,
        added=tuple(add),
    )  # fmt: skip


@names_checked
@one_at_a_time
@options_shown(OF_THE_FIT)
@arguments_named()
def simulate(
    takes: Takes,
    parameters: FitOutcome | Mapping[str, float] | None = None,
    *,
    anyway: bool = False,
    **options: Unpack[PlanOptions],
) -> Simulation:
    """Simulate the cloth of takes from their first shape on, driven by the recorded hanger.

    - `parameters`: a fit, or values by name over the method's initial ones. A fit brings its method, effects, engine,
      mesh and values
    - `anyway` and options: as for `fit`. Where `...` stands, the option is that of the given fit, or else the default
      of `fit`. A simulation has no search, and so no option of one

    Raises:
        FitError: unknown names, values outside the ranges, or takes that cannot be simulated.
    """
    import numpy as np

    from fit.identification.calibrate import Model
    from fit.recordings.recording import prepare_together
    from fit.runtime import one_thread_of_algebra

    check_switches(anyway=anyway)
    read, _ = sorted_out(takes, anyway=anyway)
    if not read:
        raise FitError("no take was given", where="simulate", advice="name at least one take archive")
    if parameters is not None and not isinstance(parameters, FitOutcome):
        check_kind(parameters, "parameters", Mapping, "values by name, or a fit, as `fit` and `load` return it")
    request, remarks = _request_of(parameters, options)
    values = _values(parameters.values if isinstance(parameters, FitOutcome) else parameters or {}, request)
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
    fitted = tuple(parameters.result.parameters) if isinstance(parameters, FitOutcome) else ()
    return Simulation(takes=shown, values=values, fitted=fitted, error=whole, by_take=tuple(by_take), remarks=remarks)


@names_checked
@one_at_a_time
@arguments_named()
def report(
    outcome: FitOutcome | DiagnosisOutcome,
    path: Path | str,
    *,
    fit: FitOutcome | None = None,
    overwrite: bool = False,
) -> Path:
    """Write the report of a fit or a diagnosis as one HTML file, and return its path.

    - `fit`: shown in the report of a diagnosis, where it is of the same takes
    - `overwrite`: replace the report and its motion file, where they are there

    Raises:
        FitError: the outcome was loaded from a file and holds no takes, or the fit beside it is of other takes.
        OutputError: the report cannot be written, or its name does not end in .html.
    """
    from fit.report.gather import write_diagnosis_report, write_fit_report
    from fit.report.kept import place_beside
    from fit.runtime import one_thread_of_algebra

    check_switches(overwrite=overwrite)
    check_kind(outcome, "outcome", (FitOutcome, DiagnosisOutcome), "a result of `fit` or `diagnose`")
    path, first = path_of(path, "path"), outcome.training[0] if outcome.training else None
    if fit is not None:
        check_kind(fit, "fit", FitOutcome, "a result of `fit`")
    findings = outcome.findings if isinstance(outcome, DiagnosisOutcome) else None
    if findings is not None and fit is not None and not findings.takes.are_of(fit.result):
        raise FitError("is of other takes", where="fit", advice="fit these takes first, or leave it out")
    if findings is None and (isinstance(outcome, DiagnosisOutcome) or outcome.request is None):
        raise FitError(
            "a result that was loaded from a file holds no takes to draw", where=path,
            advice="`hangtime report DIR` writes the report of a folder of results anew at once; or fit or diagnose "
            "the takes again",
        )  # fmt: skip
    check_ending(path, *AS_PAGE)
    for written in (path, place_beside(path)):
        refuse_to_replace(written, overwrite=overwrite)
    make_parent(path)
    with one_thread_of_algebra():
        if isinstance(outcome, FitOutcome):
            assert outcome.request is not None
            assert outcome.prepared is not None
            return write_fit_report(path, outcome.result, outcome.prepared, outcome.request, first)
        assert findings is not None
        return write_diagnosis_report(path, findings, fit.result if fit is not None else None, first)


@names_checked
@one_at_a_time
@arguments_named()
def export(
    outcome: FitOutcome | Path | str,
    to: str,
    path: Path | str,
    *,
    take: OneTake | None = None,
    thickness: float | None = None,
    spacing: float | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Write a fit for other programs, as `hangtime export` does, and return the files that were written.

    - `outcome`: a fit, or the path of its `fit.json`
    - `to`: the kind, `fit.export.kinds.EXPORT_KINDS`
    - `take`: gives garment and motion
    - `thickness`: the fabric's [m], which motion does not identify; None is 1 mm. Only `usd-physics` holds it
    - `spacing`: of the mesh [m]

    Raises:
        FitError: an unknown kind, a fit that holds no such thing, or an argument that the kind does not use.
        OutputError: a file is there already and is not to be overwritten.
    """
    from fit.export.kinds import EXPORT_KINDS, WITH_THICKNESS, Order
    from fit.export.kinds import export as write
    from fit.export.usd_physics import THICKNESS
    from fit.identification.read_again import read_fit

    check_text(to, "to")
    check_switches(overwrite=overwrite)
    if thickness is not None:
        check_kind(thickness, "thickness", Real, "metres, as in 0.0005")
        if to in EXPORT_KINDS and to not in WITH_THICKNESS:
            advice = "leave it out, or give usd-physics as the kind"
            raise FitError(f"changes nothing here: {to} holds none", where="thickness", advice=advice)
    mesh, file = number_of(spacing, "spacing"), path_of(path, "path")
    result = outcome.result if isinstance(outcome, FitOutcome) else read_fit(path_of(outcome, "outcome"))[0]
    whose = one_take(take, "take") if take is not None else None
    order = Order(
        result=result, take=whose, thickness=THICKNESS if thickness is None else float(thickness), spacing=mesh
    )
    return write(order, to, file, overwrite=overwrite)


def _is_json(path: Path) -> bool:
    """Return whether a file looks like JSON by name or beginning, because results may have any name."""
    if path.suffix == ".json":
        return True
    with contextlib.suppress(OSError):  # the reader reports why the file cannot be read
        if path.is_file():
            with path.open("rb") as file:
                return file.read(64).lstrip().startswith(b"{")
    return False


def _request_of(
    parameters: FitOutcome | Mapping[str, float] | None, options: PlanOptions
) -> tuple[Request, tuple[str, ...]]:
    """Return the request of a simulation, and remarks on assumed settings."""
    from fit.identification.request import Plan

    if not isinstance(parameters, FitOutcome):
        return Plan(**checked(options)).request(), ()
    if parameters.request is not None and not options:
        return parameters.request, ()
    request = Plan(**checked({**parameters.options, **options})).request()
    if parameters.result.spacing is not None or options.get("spacing") is not None:
        return request, ()
    return request, (
        f"The fit's file does not say its mesh spacing. The simulation has the method's own, "
        f"{request.resolution.spacing:g} m.",
    )


def _values(given: Mapping[str, float], request: Request) -> dict[str, float]:
    """Return a value for each parameter, with initial values as defaults.

    Raises:
        FitError: an unknown name, or a value that is no number or outside its range.
    """
    names = [p.name for p in request.parameters]
    if unknown := [name for name in given if name not in names]:
        raise unknown_name("parameter", unknown[0], names, where="parameters")
    values = {}
    for p in request.parameters:
        value = given.get(p.name, p.initial)
        check_kind(value, p.name, Real, f"a number of {p.unit}")
        values[p.name] = float(value)
        if not p.minimum <= values[p.name] <= p.maximum:
            raise FitError(
                f"{p.name} = {values[p.name]:g} is outside its range", where="parameters",
                advice=f"stay within {p.minimum:g} to {p.maximum:g} {p.unit}",
            )  # fmt: skip
    return values

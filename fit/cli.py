"""Run `hangtime fit`, `hangtime fabric` and `hangtime diagnose`; `batch` and `blind` have their own modules."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Annotated

import typer

from fit.api.said import is_diagnosed, model_to_name, next_command, next_step
from fit.batch.cli import add_commands as add_batch_commands
from fit.blind.cli import add_commands as add_blind_commands
from fit.export.cli import add_commands as add_export_commands
from fit.report.cli import add_commands as add_report_commands
from fit.report.cli import fabric_command
from fit.search import PRINTED_ITERATIONS
from formats.anyway import Anyway
from formats.command_groups import FIT
from formats.plain_text import plain
from formats.telling import know, tell
from formats.terminal import ProgressLine, say

Takes = Annotated[
    list[Path], typer.Argument(metavar="TAKE", help="Take archives (.mcap) to fit to.", show_default=False)
]
HeldOut = Annotated[
    list[Path],
    typer.Option("--held-out", metavar="TAKE", help="Judge on this take, which no fit sees. May be repeated."),
]
HeldOutMotion = Annotated[
    list[str],
    typer.Option(
        "--held-out-motion",
        metavar="KIND",
        help="Judge on the takes whose hanger moves this way, instead of fitting to them: sideways, face-on, "
        "up-and-down, twist, mixed or still. `hangtime takes show` names the motion of a take. May be repeated.",
    ),
]
Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results, made if absent.")]
Plot = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE.png", help="Also draw the error over time of every take."),
]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace a picture of this name. Results of other takes, models or effects in DIR get a number anyhow.",
    ),
]
Seed = Annotated[
    int, typer.Option("--seed", min=0, help="Seed of every random number; the same seed gives the same result.")
]


def add_commands(app: typer.Typer) -> None:
    """Add this package's commands to the `hangtime` command."""
    app.command("fit", rich_help_panel=FIT, short_help="Find the cloth parameters that follow the takes.")(fit_command)
    app.command("fabric", rich_help_panel=FIT, short_help="Show a fit as a fabric tester would.")(fabric_command)
    app.command("diagnose", rich_help_panel=FIT, short_help="Say what the simulation lacks, and how sure that is.")(
        diagnose_command
    )
    add_report_commands(app)
    add_export_commands(app)
    add_batch_commands(app)
    add_blind_commands(app)


def fit_command(
    takes: Takes,
    held_out: HeldOut = [],  # noqa: B006  (Typer copies it)
    held_out_motion: HeldOutMotion = [],  # noqa: B006
    method: Annotated[
        str,
        typer.Option(
            "--method",
            help="Parameters to fit. si: physical units, the weight is known. si-sewn: si for garments with sleeves "
            "and hems. si-outline: si, fitted to the outline alone. lean: si without shear and bending damping. "
            "kinect-skirt: the six Blender parameters of the Kinect-skirt paper. mocap-swatch: the five parameters and "
            "the error E of the motion capture paper, for a swatch with a grid of markers. kinect-skirt-weighed, "
            "mocap-swatch-weighed: the same with the weight known.",
        ),
    ] = "si",
    fabric: Annotated[
        str | None,
        typer.Option(
            "--fabric", help="Start from the table values of this fabric: silk, denim, cotton or polyester-rayon."
        ),
    ] = None,
    engine: Annotated[
        str, typer.Option("--engine", help="Simulator: own, or blender (kinect-skirt only; needs the extra `blender`).")
    ] = "own",
    effect: Annotated[
        list[str], typer.Option("--effect", metavar="NAME", help="Also fit the size of this effect. May be repeated.")
    ] = [],  # noqa: B006
    bounds: Annotated[
        list[str],
        typer.Option(
            "--bounds", metavar="NAME=LOW:HIGH", help="Search this parameter within narrower bounds. May be repeated."
        ),
    ] = [],  # noqa: B006
    search: Annotated[
        str,
        typer.Option(
            "--search",
            help="least-squares: the quickest, with the best intervals. annealing: as in the papers, one chain. "
            "restarts: four shorter chains. tempering: parallel tempering, with intervals of the posterior. cma-es: "
            "covariance matrix adaptation. short-windows: least squares on stretches of two seconds.",
            show_default="least-squares; annealing for the methods of the papers",
        ),
    ] = "",
    iterations: Annotated[
        int | None,
        typer.Option(
            "--iterations",
            min=1,
            help="Iterations of annealing and restarts, candidates of tempering and cma-es. The least-squares "
            "searches have none.",
            show_default=str(PRINTED_ITERATIONS),
        ),
    ] = None,
    gamma: Annotated[
        float | None,
        typer.Option(
            "--gamma",
            help="Factor gamma of the annealing's acceptance [1/m].",
            show_default="1e5; mocap-swatch 1e4 per E/N",
        ),
    ] = None,
    out: Out = Path("fitted"),
    spacing: Annotated[
        float | None,
        typer.Option(
            "--spacing",
            metavar="METRES",
            help="Mesh spacing. Half the spacing takes eight times as long.",
            show_default="0.05; mocap-swatch 0.0208",
        ),
    ] = None,
    seed: Seed = 0,
    anyway: Anyway = False,
    plot: Plot = None,
    overwrite: Overwrite = False,
) -> None:
    """Find the cloth parameters that make the simulation follow the takes.

    The cloth is simulated freely from its first shape on, driven by the recorded hanger. The search looks for the
    parameters with the smallest error. The result gives each parameter a 90 % interval. The interval covers the takes'
    noise and the local minima that the search found, but neither missing physics nor the mesh's error. The interval of
    an effect's size (--effect) also covers the error of mesh and solver, and sound laws of the effect. A parameter that
    the takes do not identify has an interval and no value.

    Give takes of one motion at several strengths, and hold the middle strength out to judge on (--held-out, or
    --held-out-motion for takes of another motion). Without a held-out take, the command judges on the takes it fitted
    to, which flatters the result.

    The command writes DIR/fit.json and DIR/report.html. Interrupt it with Ctrl-C at any time: the same command
    continues from there. The least-squares searches continue from their last finished step.

    Example: `hangtime fit gentle.mcap wide.mcap --held-out middle.mcap --out results`
    """
    from fit.api.takes import check_there
    from fit.report.places import check_results, may_draw

    check_results(out)
    if plot is not None:
        may_draw(plot, overwrite=overwrite, takes=[*takes, *held_out], folder=out)
    check_there([*takes, *held_out])  # before the imports below, which take seconds
    from msgspec import to_builtins

    from fit.api.shown import fit_tables
    from fit.api.tables import as_text
    from fit.api.takes import say_takes, sorted_out
    from fit.api.watched import fit_words
    from fit.engines import check_engine
    from fit.folders import alone, make_folder, set_aside_others
    from fit.identification.calibrate import calibrate
    from fit.identification.request import Plan
    from fit.recordings.ready import ready
    from fit.report.again import errors_of_report, plot_of
    from fit.report.gather import write_fit_report
    from fit.report.origin import command_line
    from formats.results import save_fit_result

    request = Plan(
        method=method, effects=tuple(effect), bounds=tuple(bounds), search=search, iterations=iterations, gamma=gamma,
        spacing=spacing, seed=seed, fabric=fabric, engine=engine,
    ).without_unused(say).request()  # fmt: skip
    check_engine(request.engine, request.method, request.effects)
    mesh = request.resolution.spacing
    training, testing = sorted_out(takes, held_out, held_out_motion, anyway=anyway, spacing=mesh)
    prepared = ready(training, testing)
    make_folder(out, "fit.json", "fit.partial.json", "report.html")
    progress = ProgressLine(request.search)
    checkpoint = out / "fit.partial.json"
    is_resumed = checkpoint.exists()

    def show(done: int, total: int, best: float) -> None:
        nonlocal is_resumed
        if is_resumed:
            say(f"Continuing from {done} of {total}.")
            is_resumed = False
        progress.show(done / total, fit_words(request, done, total, best))

    try:
        with alone(out):
            result = calibrate(
                training, testing, request, prepared=prepared, checkpoint=checkpoint, progress=show,
                begun=lambda: say_takes(training, testing, mesh),
            )  # fmt: skip
            progress.end()
            if aside := set_aside_others(out / "fit.json", prepared.are_of, result):
                say(aside)  # before the writing, which may fail
            save_fit_result(out / "fit.json", result)
            report = write_fit_report(out / "report.html", result, prepared, request, training[0], command_line())
            checkpoint.unlink(missing_ok=True)  # after the report, so that the command can continue
    except KeyboardInterrupt:
        progress.end()
        is_kept = checkpoint.exists()
        kept = f"the search is kept in {plain(checkpoint)}. The same command continues."
        say(f"Interrupted; {kept if is_kept else 'nothing is kept.'}")
        raise typer.Exit(130) from None
    if plot is not None:
        plot_of(report, result, None, plot, overwrite=overwrite)
    know(fit=to_builtins(result), file=str(out / "fit.json"), report=str(report))
    tell("\n".join([as_text(fit_tables(result)), *errors_of_report(report, result)]))
    tell(f"Fit result: {plain(out / 'fit.json')}\nReport:     {plain(report)}")
    if plot is not None:
        tell(f"Picture:    {plain(plot)}", plot=str(plot))
    if not effect and not is_diagnosed(out, prepared):
        base = model_to_name(method, training[0].garment)
        command = next_command(takes, held_out, held_out_motion, spacing, out, model=base, anyway=anyway)
        tell(next_step(prepared, command))


def diagnose_command(
    takes: Takes,
    held_out: HeldOut = [],  # noqa: B006
    held_out_motion: HeldOutMotion = [],  # noqa: B006
    fit_file: Annotated[
        Path | None,
        typer.Option(
            "--fit", metavar="FIT.json", help="A fit result to show in the same report.", show_default="DIR/fit.json"
        ),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            help="Base model: si (physical units), si-sewn (si with stiff sleeves and hems), lean (si without shear "
            "and bending viscosity) or kinect-skirt.",
            show_default="si-sewn for T-shirts, else si",
        ),
    ] = None,
    add: Annotated[
        list[str],
        typer.Option("--add", metavar="EFFECT", help="Also refit with this effect, and show it. May be repeated."),
    ] = [],  # noqa: B006
    without: Annotated[
        list[str],
        typer.Option("--without", metavar="EFFECT", help="Leave this effect out of the library. May be repeated."),
    ] = [],  # noqa: B006
    out: Out = Path("diagnosis"),
    spacing: Annotated[
        float | None,
        typer.Option("--spacing", metavar="METRES", help="Mesh spacing.", show_default="a ninth of the smaller side"),
    ] = None,
    seed: Seed = 0,
    anyway: Anyway = False,
    plot: Plot = None,
    by: Annotated[
        str,
        typer.Option(
            "--by",
            metavar="WHAT",
            help="Decision method. rules: rules for held-out takes. evidence: all sets of up to three effects are "
            "weighed together, on the takes fitted to.",
        ),
    ] = "rules",
    arrows: Annotated[
        Path | None,
        typer.Option(
            "--arrows",
            metavar="FILE.png",
            help="Also draw the residuals of the first judged take, as arrows.",
        ),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Say where the simulation misses, which unmodelled effect causes the error, and how far the error would shrink.

    The command fits the base model and every effect of the library to the takes, and judges them on the held-out takes.
    The verdict names an effect with its size, a 90 % interval and a probability. The verdict can also be that
    nothing is missing, that several effects cannot be told apart, or that the takes cannot decide.

    Give takes of one motion at several strengths, and hold the middle strength out to judge on (--held-out, or
    --held-out-motion for takes of another motion).

    The command writes DIR/diagnosis.json and DIR/report.html. Interrupt it with Ctrl-C at any time: the same command
    continues with the finished fits. Exit code 4: the verdict is inconclusive.

    Example: `hangtime diagnose gentle.mcap wide.mcap --held-out middle.mcap --out results`
    """
    from fit.api.takes import check_there
    from fit.report.places import check_results, may_draw

    check_results(out)
    for picture, other in ((plot, arrows), (arrows, plot)):
        if picture is not None:
            others = [other] if other is not None else []
            may_draw(picture, overwrite=overwrite, takes=[*takes, *held_out], folder=out, others=others)
    check_there([*takes, *held_out])  # before the imports below, which take seconds
    from msgspec import to_builtins

    from fit.api.shown import diagnosis_tables
    from fit.api.tables import as_text
    from fit.api.takes import library_of, say_takes, sorted_out
    from fit.cloth.effect import parameter_names
    from fit.cloth.model import Resolution
    from fit.effects import find_effects
    from fit.errors import INCONCLUSIVE, FitError
    from fit.folders import alone, make_folder, set_aside_others
    from fit.gap.diagnosis import deciding, diagnose
    from fit.gap.gates import data_gates
    from fit.identification.read_again import load_fit
    from fit.methods import base_model_of, find_base_model
    from fit.recordings.ready import ready
    from fit.report.again import plot_of
    from fit.report.gather import draw_left, write_diagnosis_report
    from fit.report.origin import command_line
    from formats.results import save_diagnosis

    training, testing = sorted_out(takes, held_out, held_out_motion, anyway=anyway, spacing=spacing)
    base = find_base_model(model) if model else base_model_of(training[0].garment)
    library = library_of(add, without)
    decided = deciding(by)
    resolution = Resolution(spacing=spacing) if spacing is not None else None
    fitted = load_fit(fit_file) if fit_file else None
    prepared = ready(training, testing)
    if fitted is not None and not prepared.are_of(fitted):
        raise FitError("the fit is of other takes", where=fit_file, advice="fit these takes first, or leave out --fit")
    if fitted is None and os.path.exists(out / "fit.json"):  # `Path.exists` refuses long names
        beside = load_fit(out / "fit.json")
        fitted = beside if prepared.are_of(beside) else None
    struck = {name for effect in find_effects(without) for name in parameter_names(effect)}
    if fitted is not None and (kept := struck & fitted.effects.keys()):
        raise FitError(
            f"the fit keeps {min(kept)} in its model, which the library is to lack", where="--without",
            advice="leave out --without, or diagnose into another --out",
        )  # fmt: skip
    for gate in data_gates(prepared.training, prepared.held_out):
        if not gate.passed:  # the verdict reports this too, but only after all simulations
            say(f"No effect will be named: {gate.sentence[0].lower()}{gate.sentence[1:]}")
    make_folder(out, "diagnosis.json", "report.html")
    progress = ProgressLine("diagnosis")

    def begun() -> None:
        say_takes(training, testing, spacing)
        if finished := len(list((out / "diagnosis.partial").glob("*.npz"))):
            say(f"Continuing with {finished} finished fits.")

    try:
        with alone(out):
            findings = diagnose(
                training, testing, effects=library, model=base, added=tuple(add), checkpoint=out / "diagnosis.partial",
                resolution=resolution, seed=seed, prepared=prepared, by=decided, begun=begun,
                progress=lambda stage, share: progress.show(share, stage),
            )  # fmt: skip
            progress.end()
            if aside := set_aside_others(out / "diagnosis.json", prepared.are_of, findings.diagnosis):
                say(aside)
            save_diagnosis(out / "diagnosis.json", findings.diagnosis)
            report = write_diagnosis_report(out / "report.html", findings, fitted, training[0], command_line())
            if arrows is not None:
                draw_left(arrows, findings, overwrite=overwrite)
            # Only after the report, which may fail too.
            shutil.rmtree(out / "diagnosis.partial", ignore_errors=True)
    except KeyboardInterrupt:
        progress.end()
        say(f"Interrupted; finished fits are kept in {plain(out / 'diagnosis.partial')}. The same command continues.")
        raise typer.Exit(130) from None
    if plot is not None:
        plot_of(report, fitted, findings.diagnosis, plot, overwrite=overwrite)
    know(diagnosis=to_builtins(findings.diagnosis), file=str(out / "diagnosis.json"), report=str(report))
    tell(as_text(diagnosis_tables(findings.diagnosis, tuple(add))))
    tell(f"Diagnosis: {plain(out / 'diagnosis.json')}\nReport:    {plain(report)}")
    for name, picture in {"plot": plot, "arrows": arrows}.items():
        if picture is not None:
            tell(f"Picture:   {plain(picture)}", **{name: str(picture)})
    if findings.diagnosis.verdict == "inconclusive":
        raise typer.Exit(INCONCLUSIVE)

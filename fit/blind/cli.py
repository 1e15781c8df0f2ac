"""`hangtime blind make|run|score|strike|report`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fit.errors import FitError
from formats.command_groups import CHECK_DIAGNOSIS
from formats.plain_text import plain
from formats.telling import tell
from formats.terminal import ProgressLine, say

if TYPE_CHECKING:
    from fit.blind.cases import Kind
    from fit.blind.rates import Rate
    from fit.blind.real_scoring import RealScore
    from fit.blind.scoring import Score

blind = typer.Typer(
    help="Check the diagnosis on cases whose truth is sealed.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
Set = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the set of cases.", show_default=False)]
Answers = Annotated[Path, typer.Argument(metavar="ANSWERS", help="Folder of the answers.", show_default=False)]
Options = Annotated[
    list[str],
    typer.Option("--option", metavar="WORD", help="An argument for `hangtime diagnose`; may be repeated."),
]
Limit = Annotated[float, typer.Option("--limit", metavar="SECONDS", min=1, help="Time for one case.")]
Again = Annotated[bool, typer.Option("--again", help="Try cases again that ended without a diagnosis.")]
Workers = Annotated[int, typer.Option("--workers", min=1, help="Diagnoses side by side, which share the processors.")]


def add_commands(app: typer.Typer) -> None:
    """Add the group `blind` to the `hangtime` command."""
    app.add_typer(blind, name="blind", rich_help_panel=CHECK_DIAGNOSIS)


@blind.command("make", short_help="Simulate cases with withheld effects and seal their labels.")
def make_command(
    folder: Set,
    cases: Annotated[int, typer.Option("--cases", min=0, help="Cases with one effect of the library.")] = 0,
    nulls: Annotated[int, typer.Option("--nulls", min=0, help="Cases with no effect.")] = 0,
    pairs: Annotated[int, typer.Option("--pairs", min=0, help="Cases with two effects.")] = 0,
    unknowns: Annotated[int, typer.Option("--unknowns", min=0, help="Cases with an effect of no library.")] = 0,
    effect: Annotated[
        list[str], typer.Option("--effect", metavar="NAME", help="Plant only this effect; may be repeated.")
    ] = [],  # noqa: B006  (Typer copies it)
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of every random number.")] = 0,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes that simulate side by side.")] = 1,
    side: Annotated[
        float | None,
        typer.Option(
            "--side", metavar="METRES", help="Side of the generator's mesh.", show_default="0.016, other engines 0.02"
        ),
    ] = None,
    generator: Annotated[
        str, typer.Option("--generator", metavar="NAME", help="Simulator of the cloth: own, mujoco or newton.")
    ] = "own",
    noise: Annotated[
        float | None,
        typer.Option("--noise", metavar="METRES", min=1e-4, max=0.01, help="White noise of every point, per axis.",
                     show_default="0.0005 to 0.003, drawn"),
    ] = None,
    missing: Annotated[
        float | None,
        typer.Option("--missing", metavar="SHARE", min=0.0, max=0.5, help="Share of the frames that a point is not "
                     "seen in.", show_default="0 to 0.1, drawn"),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option("--rate", metavar="HERTZ", min=15.0, max=200.0, help="Frames a second.",
                     show_default="30, 45 or 60, drawn"),
    ] = None,
    real: Annotated[
        Path | None,
        typer.Option(
            "--real", metavar="FOLDER", help="Plant faults of measurement in the takes of this folder instead.",
            show_default=False,
        ),
    ] = None,
) -> None:  # fmt: skip
    """Simulate cases with withheld effects and seal their labels.

    Other engines than the own generator run in a Python of their own and plant less: see
    docs/reference/blind-check.md.
    With --real nothing is simulated: --nulls untouched and --cases planted copies of real takes are made.
    Sets that differ in --noise, --missing or --rate alone hold the same cloths, motions and effects: a ladder.

    Writes DIR/cases, DIR/manifest.json with the hash of every file, and DIR/sealed. Interrupt with Ctrl-C at any time;
    the same command continues from there.
    """
    from fit.blind.foreign.engines import find_generator
    from fit.blind.making import make_real_set, make_set
    from fit.blind.real import real_plants
    from fit.folders import alone, make_folder

    engine = find_generator(generator, "--generator")
    numbers: dict[Kind, int] = {"single": cases, "null": nulls, "pair": pairs, "unknown": unknowns}
    given = {"noise": noise, "away": missing, "rate": rate}
    sensor = {name: value for name, value in given.items() if value is not None}
    if real is not None and (generator != "own" or side is not None or sensor):
        raise FitError(
            "real takes are not simulated",
            where="--real",
            advice="leave out --generator, --side, --noise, --missing and --rate, or --real",
        )
    make_folder(folder, "manifest.json")
    with alone(folder), counting("making", "finished cases are kept") as show:
        if real is not None:
            manifest = make_real_set(folder, real, numbers, real_plants(effect), seed, progress=show)
        else:
            manifest = make_set(
                folder, numbers, engine.plants(effect), seed, workers=workers, side=side, generator=engine,
                sensor=sensor, progress=show,
            )  # fmt: skip
    words = f"{len(manifest.cases)} cases in {folder / 'cases'}; labels sealed as {manifest.sealed}"
    tell(words, cases=len(manifest.cases), sealed=manifest.sealed)


@blind.command("run", short_help="Diagnose every case of a set.")
def run_command(
    folder: Set,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="ANSWERS", help="Folder for the answers.", show_default="DIR/answers"),
    ] = None,
    option: Options = [],  # noqa: B006
    limit: Limit = 3600.0,  # s; our choice: an hour, so that no case holds up a set for longer
    again: Again = False,
    workers: Workers = 1,
    takes: Annotated[
        int | None,
        typer.Option(
            "--takes", min=1, max=3, help="Number of takes of each case to diagnose alone, and to judge on too.",
            show_default="three, and two others to judge on",
        ),
    ] = None,
) -> None:  # fmt: skip
    """Diagnose every case of a set with `hangtime diagnose`.

    Cases that are done are skipped; one that fails counts as inconclusive. Interrupt with Ctrl-C at any time; the same
    command continues from there.
    """
    from fit.blind.running import run_set
    from formats.outputs import check_folder_name

    answers = out or folder / "answers"
    check_folder_name(answers, ".json")
    with counting("diagnosing", "finished answers are kept") as show:
        failed = run_set(
            folder, answers, options=option, again=again, limit=limit, workers=workers, takes=takes, progress=show
        )
    without = f"; {failed} cases ended without a diagnosis" if failed else ""
    tell(f"Answers in {plain(answers)}{without}", answers=str(answers), failed=failed)


@blind.command("score", short_help="Hash the answers, open the seal, print every rate.")
def score_command(
    folder: Set,
    answers: Answers,
    answered: Annotated[
        bool, typer.Option("--answered", help="Count only cases that have an answer, though others have none.")
    ] = False,
    beside: Annotated[
        Path | None,
        typer.Option("--beside", metavar="RIVALS", help="Score these answers too, and print both side by side.",
                     show_default=False),
    ] = None,
) -> None:  # fmt: skip
    """Hash the answers, open the seal, print every rate with its 95 % interval, and record that the seal was opened.

    With --beside the rates of two folders of answers stand side by side: of the rules and of the evidence, for example.
    """
    from fit.blind.real_scoring import RealScore
    from fit.blind.scoring import SCORE, score_set

    score = score_set(folder, answers, some=answered)
    rival = score_set(folder, beside, some=answered) if beside is not None else None
    if isinstance(score, RealScore):
        print_real(score)
        if isinstance(rival, RealScore):
            print_real(rival)
    else:
        tell(f"{len(score.cases)} cases, opening {score.look} of this seal; answers {score.answers}")
        if rival is not None:
            tell(f"beside: {len(rival.cases)} cases, opening {rival.look}; answers {rival.answers}")
        print_score(score, None if isinstance(rival, RealScore) else rival)
    known = {name: json.loads((at / SCORE).read_text()) for name, at in (("score", answers), ("beside", beside)) if at}
    tell(f"Score: {answers / SCORE}", **known)


def print_score(score: Score, beside: Score | None = None) -> None:
    """Print every rate, also by size, and the rivals' rates; beside: score of other answers, in a second column."""
    from fit.blind.page import TARGET_RATES, figure

    bins = [name for name, rates in score.by_size.items() if rates.cases]
    for title, name, asked in TARGET_RATES:
        said = figure(score.overall, name)
        other = f" {figure(beside.overall, name):<32}" if beside else ""
        tell(f"{title:<48} {said:<32}{other}" + (f" asked: {asked}" if asked else ""))
        for size in bins:
            part, other = figure(score.by_size[size], name), figure(beside.by_size[size], name) if beside else "–"
            if (part, other) != ("–", "–"):
                tell(f"    {size + ' x detectable':<44} {part:<32}" + (f" {other}" if beside else ""))
    tell(f"{'baseline: chance':<48} {100 * score.chance:.0f} %")
    print_rates((f"baseline: {name}", rate) for name, rate in score.baselines.items())
    for note in score.notes:
        tell(note)


def print_rates(rates: Iterable[tuple[str, Rate]]) -> None:
    """Print titled rates, one per line."""
    for title, rate in rates:
        tell(f"{title:<48} {rate}")


def print_real(score: RealScore) -> None:
    """Print the effect of planted faults on the diagnosis of real takes, case by case and in sum."""
    tell(f"{len(score.cases)} planted cases, opening {score.look} of this seal; answers {score.answers}")
    for case, said in score.untouched.items():
        tell(f"untouched takes {case}: {said}")
    tell(f"{'planted':<20}{'amplitude':>11}{'x detectable':>14}{'error':>8}  {'moved most':<20}named")
    for one in score.cases:
        ratio = "–" if one.ratio is None else f"{one.ratio:.2g}"
        error = "–" if one.error is None else f"{100 * one.error:.0f} %"
        named = ", ".join(one.named) or f"({one.verdict})"
        tell(f"{one.planted:<20}{one.amplitude:>11.3g}{ratio:>14}{error:>8}  {one.moved_most or '–':<20}{named}")
    print_rates((
        ("the planted effect's group moved most", score.moved_most),
        ("by the right size, within half", score.right_size),
        ("covered by the intervals", score.covered),
        ("newly named", score.newly_named),
    ))  # fmt: skip
    if score.without_answer:
        tell(f"{score.without_answer} cases have no estimate to compare and count in no rate of sizes")


@blind.command("strike", short_help="Diagnose scored cases with a library that lacks the planted effect.")
def strike_command(
    folder: Set,
    answers: Answers,
    out: Annotated[
        Path, typer.Option("--out", metavar="STRUCK", help="Folder for the answers without it.", show_default=False)
    ],
    least: Annotated[
        float,
        typer.Option("--least", metavar="TIMES", min=0.0, help="Smallest amplitude, over the detectable one."),
    ] = 2.0,  # our choice: the least size to which the targets apply
    option: Options = [],  # noqa: B006
    limit: Limit = 3600.0,  # s; our choice: an hour, so that no case holds up a set for longer
    again: Again = False,
    workers: Workers = 1,
) -> None:
    """Diagnose scored cases of one effect again with a library without this effect: is the verdict `unknown` then?

    Finished answers are skipped. Interrupt with Ctrl-C at any time; the same command continues from there.
    """
    from fit.blind.striking import STRUCK, strike_set
    from formats.outputs import check_folder_name

    check_folder_name(out, ".json")
    with counting("diagnosing", "finished answers are kept") as show:
        struck = strike_set(
            folder, answers, out, least=least, options=option, again=again, limit=limit, workers=workers,
            progress=show,
        )  # fmt: skip
    for case in struck.cases:
        said = ", ".join(case.named) or f"({case.verdict})"
        tell(f"{case.planted:<20}{case.ratio:>8.3g} x detectable  {case.said:<9}{said}")
    print_rates((
        ("`unknown`", struck.unknown),
        ("`unknown` where nothing looks like it", struck.unknown_without_twin),
        ("an effect that these takes cannot tell from it", struck.twin_named),
        ("another effect named", struck.other_named),
        ("nothing named, no gap or no data", struck.nothing),
        ("confident and wrong", struck.confident_and_wrong),
    ))  # fmt: skip
    tell(f"Struck: {plain(out / STRUCK)}", struck=json.loads((out / STRUCK).read_text()))


@blind.command("report", short_help="Write the score as one HTML file.")
def report_command(
    folder: Set,
    answers: Answers,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.html", help="Where to write it.")] = Path("blind.html"),
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE.html.")] = False,
) -> None:
    """Write scored answers as one HTML file: rates, confusion, calibration, baselines, every case."""
    from fit.blind.making import read_manifest
    from fit.blind.page import check_page_name, write_page
    from formats.outputs import AS_PAGE, check_ending, refuse_to_replace

    check_ending(out, *AS_PAGE)
    read_manifest(folder)
    check_page_name(out, (folder, answers))
    refuse_to_replace(out, overwrite=overwrite)
    page = write_page(answers, out)
    tell(f"Report: {plain(page)}", report=str(page))


@contextmanager
def counting(title: str, kept: str) -> Iterator[Callable[..., None]]:
    """Context that shows a progress line of cases, and reports the kept part after an interruption."""
    line = CountLine(title)
    try:
        yield line.show
    except KeyboardInterrupt:
        line.end()
        say(f"Interrupted; {kept}. The same command continues.")
        raise typer.Exit(130) from None
    line.end()


class CountLine:
    """Cases on a progress line, with how many of them ended without a diagnosis."""

    def __init__(self, title: str) -> None:
        self._line = ProgressLine(title)

    def show(self, done: int, total: int, failed: int = 0) -> None:
        """Show the number of finished cases, and of those without a diagnosis."""
        without = f", {failed} without a diagnosis" if failed else ""
        self._line.show(done / max(total, 1), f"{done}/{total} cases{without}")

    def end(self) -> None:
        """End the line of progress."""
        self._line.end()

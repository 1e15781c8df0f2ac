"""Run `hangtime batch`."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from fit.errors import BatchError, UnreachableError
from fit.search import PRINTED_ITERATIONS
from formats.anyway import Anyway
from formats.command_groups import FIT
from formats.interrupts import ended_like_ctrl_c
from formats.plain_text import counted, plain
from formats.telling import tell, tell_fault
from formats.terminal import say

if TYPE_CHECKING:
    from fit.batch.ending import Ending
    from fit.batch.morning import Morning
    from fit.batch.runner import Survey
    from fit.batch.store import Store
    from fit.batch.summary import Row

SOME_NOT_FITTED = 3  # exit status: 1 is a crash of Python, 2 wrong options
MOST_HOURS = 8784.0  # h; our choice: a leap year, which says that another unit was meant
MOST_PATIENCE = 10_080.0  # min; our choice: a week, for the same reason
DASHBOARD_PORT = 8787  # dask's own default
NEXT_TRY = 900.0  # s after which the nightly service tries again (RestartSec in systemd/user/hangtime-batch.service)


def add_commands(app: typer.Typer) -> None:
    """Add `hangtime batch` to the command."""
    app.command(
        "batch", rich_help_panel=FIT, short_help="Fit every take of a folder or bucket, over night or on a cluster."
    )(batch_command)


def batch_command(
    url: Annotated[
        str, typer.Argument(metavar="URL", help="Takes: a folder, file:///..., s3://..., gs://... or az://...")
    ],
    out: Annotated[
        str, typer.Option("--out", metavar="URL", help="Folder or bucket for the results. A folder is made if absent.")
    ] = "batch",
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            metavar="ADDRESS|FILE",
            help="Use a running dask cluster: tcp://..., tls://... or its scheduler file.",
            show_default="this machine",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            min=1,
            metavar="N",
            help="Workers on this machine, no more than its processors and its free memory allow.",
            show_default="one a core",
        ),
    ] = None,
    dashboard_port: Annotated[
        int | None,
        typer.Option(
            "--dashboard-port",
            min=0,
            max=65535,
            help="Port of the dashboard on 127.0.0.1; 0 chooses a free one.",
            show_default=str(DASHBOARD_PORT),
        ),
    ] = None,
    patience: Annotated[
        float,
        typer.Option(
            "--patience",
            min=0,
            max=MOST_PATIENCE,
            metavar="MINUTES",
            help="How long to wait for workers, and for an unreachable scheduler or bucket.",
        ),
    ] = 10.0,  # min; our choice: a scheduler restarts sooner
    hours: Annotated[
        float | None,
        typer.Option(
            "--hours",
            min=0,
            max=MOST_HOURS,
            metavar="HOURS",
            help="Stop after this time. The next run continues.",
            show_default="no limit",
        ),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(
            "--until",
            metavar="HH:MM",
            help="Stop at this time of the day by the machine's clock, or after --hours if that is earlier.",
            show_default="no limit",
        ),
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Try failed takes and garments again.")] = False,
    diagnose: Annotated[
        bool,
        typer.Option(
            "--diagnose",
            help="Afterwards diagnose every garment with takes of one motion at three strengths, or of two kinds of "
            "motion, and write one page for the morning.",
        ),
    ] = False,
    method: Annotated[str, typer.Option("--method", help="As for `hangtime fit`, like all below.")] = "si",
    fabric: Annotated[str | None, typer.Option("--fabric", help="Start from this fabric's table values.")] = None,
    effect: Annotated[
        list[str], typer.Option("--effect", metavar="NAME", help="Also fit the size of this effect.")
    ] = [],  # noqa: B006
    bounds: Annotated[list[str], typer.Option("--bounds", metavar="NAME=LOW:HIGH", help="Narrower bounds.")] = [],  # noqa: B006
    search: Annotated[
        str, typer.Option("--search", help="Search for the parameters.", show_default="the method's own")
    ] = "",
    iterations: Annotated[
        int | None,
        typer.Option(
            "--iterations",
            min=1,
            help="Iterations of annealing and restarts, candidates of tempering and cma-es. The least-squares searches "
            "have none.",
            show_default=str(PRINTED_ITERATIONS),
        ),
    ] = None,
    gamma: Annotated[
        float | None,
        typer.Option("--gamma", help="Factor gamma of the acceptance [1/m].", show_default="the method's own"),
    ] = None,
    spacing: Annotated[
        float | None, typer.Option("--spacing", metavar="METRES", help="Mesh spacing.", show_default="the method's own")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of every random number.")] = 0,
    anyway: Anyway = False,
) -> None:
    """Fit every take of a folder or bucket, each on a core of its own.

    Each result is kept at once, whole or not at all, under a key of the take's content, the options and the physics.
    A second run fits only what is new. A worker that dies, a take that cannot be fitted and a scheduler that is lost
    cost time and nothing else. The command writes fits/KEY.json, summary.csv and summary.html.

    With --diagnose it then sorts the takes by garment. Of one motion at three strengths the middle one is judged on.
    Else a garment needs two kinds of motion, and the kind that shows least is judged on. The others are fitted. The
    command writes diagnoses/KEY.json and KEY.html. It ends with morning.html and morning.txt: every take, its fit, the
    verdict, and what needs a person.

    The exit status is 0 when everything is fitted and diagnosed, and 3 when something is not. It is 75 when bucket,
    scheduler or workers cannot be reached: try again later. Within the last quarter of an hour before --until, 3 stands
    for 75.

    Example: `hangtime batch takes --out results --diagnose`
    """
    from fit.batch.cluster import Workers
    from fit.batch.ending import ending_of
    from fit.batch.runner import run, survey
    from fit.batch.store import open_store, try_writing
    from fit.batch.summary import as_facts, lines_of, rows_of, said_once, sentence_of, write_summary
    from fit.folders import make_folder
    from fit.identification.calibrate import TOO_SHORT
    from fit.identification.request import Plan
    from formats.outputs import no_empty_folder
    from formats.terminal import ProgressLine

    plan = Plan(
        method=method, effects=tuple(effect), bounds=tuple(bounds), iterations=iterations, gamma=gamma, search=search,
        spacing=spacing, seed=seed, fabric=fabric,
    ).without_unused(say)  # fmt: skip
    for option, given, its in (("--workers", workers, "workers"), ("--dashboard-port", dashboard_port, "a dashboard")):
        if scheduler is not None and given is not None:
            raise BatchError(
                f"changes nothing here: a running cluster has {its} of its own", where=option,
                advice="leave it out, or leave out --scheduler",
            )  # fmt: skip
    ending = ending_of(hours, until)
    port = DASHBOARD_PORT if dashboard_port is None else dashboard_port
    cluster = Workers(scheduler=scheduler, count=workers, dashboard_port=port, patience=60 * patience)

    def work(found: Survey, what: str) -> bool:
        """Run the waiting jobs; return whether the run was interrupted."""
        progress = ProgressLine("batch")

        def show(done: float, total: int, text: str) -> None:
            failed = sum(o.state in ("failed", "refused") for o in found.outcomes.values())
            progress.show(
                done / total,
                f"{int(done)}/{total} {what}{f', {failed} failed' if failed else ''}{text and f', {text}'}",
            )

        try:
            run(found, cluster, progress=show, say=say, ending=ending)
        except KeyboardInterrupt:
            return True
        finally:
            progress.end()
        return False

    with _none_after(ending), ended_like_ctrl_c():
        takes, results = open_store(url), open_store(out)
        own = results.path("summary.html")
        with no_empty_folder(own.parent) if own is not None else contextlib.nullcontext():
            if own is not None:
                make_folder(own.parent, "summary.csv", own.name)
            found = survey(takes, results, plan, retry_failed=retry_failed, anyway=anyway)
        if own is None:
            try_writing(results)
        say(f"{counted(len(found.keys), 'take')}, {len(found.jobs)} to fit.")
        try:
            is_interrupted = work(found, "takes")
        finally:
            rows = rows_of(found, results)
            write_summary(rows, results, plan)
        morning = None
        if diagnose and not is_interrupted:
            morning, is_interrupted = _diagnose(rows, found, takes, results, seed, retry_failed, anyway, work)
    needs = morning.needs if morning is not None else ()
    for line in lines_of(rows, needs):  # needs are said below
        say(line)
    if any(TOO_SHORT in row.remarks for row in rows if row.state != "known"):
        say(TOO_SHORT)
    place = results.path("summary.html") or f"{results.url}/summary.html"
    shown = str(place)
    tell(f"{sentence_of(rows)}\nSummary: {plain(shown)}", summary=shown, takes=as_facts(rows))
    if morning is not None:
        page = results.path("morning.html") or f"{results.url}/morning.html"
        for line in said_once(morning.left_out):
            say(line)
        for who, what in needs:
            say(f"{plain(who)}: {plain(what)}")
        tell(
            f"{morning.headline}\nMorning page: {plain(page)}",
            morning=str(page),
            headline=morning.headline,
            needs=[{"who": who, "what": what} for who, what in needs],
            left_out=[{"take": take, "why": why} for take, why in morning.left_out],
        )
    if is_interrupted:
        say("Interrupted; the same command continues.")
        raise typer.Exit(130)
    is_done = morning is None or all(finding.state in ("diagnosed", "lacking") for finding in morning.findings)
    if not is_done or any(row.state not in ("fitted", "known") for row in rows):
        page, what = (place, sentence_of(rows)) if morning is None else (page, morning.headline)
        tell_fault(f"{plain(page)}: {what}")
        raise typer.Exit(SOME_NOT_FITTED)


def _diagnose(
    rows: list[Row], found: Survey, takes: Store, results: Store, seed: int, retry_failed: bool, anyway: bool,
    work: Callable[[Survey, str], bool],
) -> tuple[Morning, bool]:  # fmt: skip
    """Diagnose every garment with enough takes; return the morning page, and whether the run was interrupted."""
    from fit.batch.garments import diagnoses_of, is_diagnosed, wardrobes
    from fit.batch.morning import morning_of, write_morning

    every = wardrobes(rows, found, takes, lambda one: is_diagnosed(one, results, seed))
    diagnoses = diagnoses_of(every, takes, results, seed, retry_failed=retry_failed, anyway=anyway)
    say(f"{counted(len(every), 'garment')}, {len(diagnoses.jobs)} to diagnose.")
    try:
        is_interrupted = work(diagnoses, "garments")
    finally:
        morning = morning_of(rows, every, diagnoses, results)
        write_morning(morning, results)
    return morning, is_interrupted


@contextlib.contextmanager
def _none_after(ending: Ending) -> Iterator[None]:
    """Return the exit status without a request for a retry that would start after the batch's end time."""
    try:
        yield
    except UnreachableError as error:
        if ending.is_near(NEXT_TRY):
            error.exit_code = SOME_NOT_FITTED
        raise

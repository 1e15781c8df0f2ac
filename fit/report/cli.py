"""Run `hangtime report` and `hangtime compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from formats.command_groups import FIT
from formats.plain_text import plain
from formats.telling import know, tell
from formats.terminal import say

Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is already there.")]


def add_commands(app: typer.Typer) -> None:
    """Add these commands to the `hangtime` command."""
    app.command("report", rich_help_panel=FIT, short_help="Write the report of a folder of results again.")(
        report_command
    )
    app.command("compare", rich_help_panel=FIT, short_help="Set fits, diagnoses or takes side by side.")(
        compare_command
    )


def report_command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that `fit` or `diagnose` filled.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE.html", help="Where to write it.", show_default="DIR/report.html"),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE.png", help="Also draw the error over time of every take.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write the report of a folder of results again: its fit, its diagnosis, and the motion that was kept.

    Nothing is simulated, and no take is read. DIR/report.html is replaced. Without DIR/report.motion.npz the page has
    neither player nor origin.
    """
    from fit.report.again import write_again
    from fit.report.answer import run_names
    from fit.report.plot import draw_plot
    from formats.outputs import refuse_to_replace

    if plot is not None:
        import PIL  # noqa: F401 - before the page is replaced
    for path in (out, plot):
        if path is not None and not overwrite:
            refuse_to_replace(path)
    report, found, motions = write_again(folder, out)
    if found.left_out:
        say(found.left_out)
    if not motions:
        say("No motion of these results is kept in the folder, so the page has no player.")
    if plot is not None:
        draw_plot(motions, run_names(found.fit, found.diagnosis), plot)
    tell(f"Report: {plain(report)}", report=str(report), takes=[motion.take_id for motion in motions])


def compare_command(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="A B", help="Folders of results, fit.json or diagnosis.json files, or takes (.mcap)."),
    ],
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE.html", help="Also write them as a page.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Set fits, diagnoses or takes side by side.

    Fits are compared by parameter, with 90 % intervals. The last column says whether the intervals have a value in
    common. Of a folder that holds a fit and a diagnosis, the fit is taken.
    """
    from fit.report.compare import compare
    from formats.outputs import refuse_to_replace, write_text
    from formats.rows import aligned

    if out is not None and not overwrite:
        refuse_to_replace(out)
    found = compare(paths)
    for remark in found.remarks:
        say(remark)
    know(kind=found.kind, compared=list(found.records))
    tell("\n".join(aligned([("", *found.heads), *found.rows], ())))
    if out is not None:
        write_text(out, found.page(), overwrite=overwrite)
        tell(f"Page: {plain(out)}", page=str(out))

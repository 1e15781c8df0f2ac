"""Run `hangtime report`, `hangtime compare` and `hangtime fabric`."""

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

    Nothing is simulated, and no take is read. DIR/report.html is replaced, as `fit` and `diagnose` replace it; any
    other file only with --overwrite. Without DIR/report.motion.npz the page has neither player nor origin.

    Example: `hangtime report results --plot error.png`
    """
    from fit.report.again import write_again
    from fit.report.answer import run_names
    from fit.report.places import may_draw
    from fit.report.plot import draw_plot
    from formats.outputs import AS_PAGE, check_place, refuse_to_replace

    if out is not None:
        check_place(out, *AS_PAGE)
        refuse_to_replace(out, overwrite=overwrite)
    if plot is not None:
        may_draw(plot, overwrite=overwrite, folder=folder, others=[out] if out is not None else [])
    report, found, motions = write_again(folder, out)
    if found.left_out:
        say(found.left_out)
    if not motions:
        say("No motion of these results is kept in the folder, so the page has no player.")
    if plot is not None:
        draw_plot(motions, run_names(found.fit, found.diagnosis), plot, overwrite=overwrite)
    tell(f"Report: {plain(report)}", report=str(report), takes=[motion.take_id for motion in motions])
    if plot is not None:
        tell(f"Picture: {plain(plot)}", plot=str(plot))


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
    common. Of a folder that holds a fit and a diagnosis, the fit is taken, unless another folder holds a diagnosis
    alone.

    Example: `hangtime compare results other-results`
    """
    from fit.report.compare import compare
    from formats.outputs import AS_PAGE, check_place, refuse_to_replace, write_text
    from formats.rows import aligned

    if out is not None:
        check_place(out, *AS_PAGE)
        refuse_to_replace(out, overwrite=overwrite)
    found = compare(paths)
    for remark in found.remarks:
        say(remark)
    know(kind=found.kind, compared=list(found.records))
    tell("\n".join(aligned([("", *found.heads), *found.rows], ())))
    if out is not None:
        write_text(out, found.page(), overwrite=overwrite)
        tell(f"Page: {plain(out)}", page=str(out))


def fabric_command(
    fit_file: Annotated[
        Path, typer.Argument(metavar="FIT", help="A result of `hangtime fit`: fit.json, or the folder that holds it.")
    ],
) -> None:
    """Test a fitted fabric virtually: tension, shear and bending in KES units.

    The sheet shows the values beside those of fabrics that were measured elsewhere. A value that the takes do not
    identify gives place to its 90 % interval.

    Example: `hangtime fabric results`
    """
    from dataclasses import asdict

    from fit.identification.read_again import read_fit
    from fit.virtual_tests.sheet import sheet_of, tests_of, unidentified_of

    result = read_fit(fit_file)[0]
    sheet, unidentified = sheet_of(result), unidentified_of(result)
    tell(sheet, material=result.material, tests=asdict(tests_of(result)), not_identified=unidentified)

"""`hangtime record` and `hangtime markers print`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def add_commands(app: typer.Typer) -> None:
    """Add this package's commands to the `hangtime` command."""
    app.command("record", short_help="Track hanger and garment and keep them as a take.")(record_command)
    markers = typer.Typer(no_args_is_help=True, help="The hanger's fiducial markers.")
    markers.command("print", short_help="Write a page of markers to print.")(print_command)
    app.add_typer(markers, name="markers", short_help="The hanger's fiducial markers.")


def print_command(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.svg", help="The page to write.")] = Path("markers.svg"),
    ids: Annotated[str, typer.Option("--ids", metavar="ID,ID", help="Numbers of the markers.")] = "0,1",
    size: Annotated[
        float, typer.Option("--size", metavar="METRES", help="Side, from black edge to black edge.")
    ] = 0.06,
    dictionary: Annotated[str, typer.Option("--dictionary", metavar="NAME", help="OpenCV's name.")] = "DICT_4X4_50",
    rig: Annotated[
        Path | None,
        typer.Option("--rig", metavar="RIG.toml", help="Take dictionary, numbers and size from this rig."),
    ] = None,
) -> None:
    """Write a page of markers, true to scale, with bars to check the print.

    Any browser prints it; choose 100 %, not "fit to page", and measure both bars before cutting.
    """
    from capture.errors import UntrackableError
    from capture.marker_sheet import write_sheet
    from formats.descriptions import load_rig

    try:
        numbers = [int(part) for part in ids.split(",")]
    except ValueError:
        raise UntrackableError(
            f"{ids!r} is no list of numbers", where="--ids", advice="for example --ids 0,1"
        ) from None
    if rig is not None:
        hanger = load_rig(rig).hanger
        if hanger is None:
            raise UntrackableError("the rig has no [hanger]", where=rig, advice="add one, or leave out --rig")
        dictionary, numbers, size = hanger.dictionary, list(hanger.ids), hanger.marker_size_m
    typer.echo(f"{write_sheet(out, dictionary, numbers, size)}: {len(numbers)} markers of {1e3 * size:g} mm")


def record_command(
    sensor: Annotated[
        str, typer.Option("--sensor", metavar="FILE|URI", help="An .oni recording, openni2: or synthetic:MOTION.")
    ],
    rig: Annotated[Path, typer.Option("--rig", metavar="RIG.toml", help="Sensor, gravity and hanger.")],
    garment: Annotated[Path, typer.Option("--garment", metavar="GARMENT.toml", help="Outline, weight and points.")],
    out: Annotated[Path, typer.Option("--out", metavar="TAKE.mcap", help="The take to write.")],
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=1.0, help="Stop after so long.", show_default="the end")
    ] = None,
    scan_rate: Annotated[
        float, typer.Option("--scan-rate", metavar="HZ", min=0.0, max=60.0, help="Surface scans a second; 0 for none.")
    ] = 0.0,
    scan_points: Annotated[
        int, typer.Option("--scan-points", metavar="N", min=3, max=64, help="Scan a grid of N x N, and 8 N around it.")
    ] = 12,
) -> None:
    """Track the hanger and the garment in every frame and keep them as a take.

    Nothing has to be clicked: the two markers are found by themselves. Ctrl-C ends the take cleanly.
    """
    import sys
    from datetime import UTC, datetime

    from capture.recording import ScanPlan, record
    from firmware_host.opening import open_sensor
    from formats.descriptions import load_garment, load_rig

    described_rig, described_garment = load_rig(rig), load_garment(garment)
    scans = ScanPlan(rate=scan_rate, grid=scan_points, contour=8 * scan_points) if scan_rate > 0 else None
    is_terminal = sys.stderr.isatty()

    def show(frames: int, total: int | None, hanger_share: float) -> None:
        if is_terminal and frames % 5 == 0:
            of = f" of {total}" if total else ""
            text = f"\r{frames}{of} frames, hanger seen in {100 * hanger_share:.0f} %"
            print(text, end="", file=sys.stderr, flush=True)

    with open_sensor(sensor) as source:
        report = record(
            source, described_rig, described_garment, out, take_id=out.stem,
            created=datetime.now(UTC).isoformat(timespec="seconds"), seconds=seconds, scans=scans, progress=show,
        )  # fmt: skip
    if is_terminal:
        print(file=sys.stderr)
    points = ", ".join(
        f"{name} {100 * share:.0f} %"
        for name, share in zip(described_garment.point_names, report.point_share, strict=True)
    )
    typer.echo(f"{report.path}: {report.frames} frames{', stopped by hand' if report.is_interrupted else ''}")
    typer.echo(f"hanger seen in {100 * report.with_hanger / max(report.frames, 1):.0f} %; {points}")

"""`hangtime record`, `hangtime calibrate` and `hangtime markers print`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from capture.appliance.cli import add_commands as add_appliance_commands
from capture.sync import cli as sync_cli
from formats.anyway import Anyway
from formats.command_groups import RECORD
from formats.plain_text import counted, plain, with_advice
from formats.telling import know, tell, tell_entry
from formats.terminal import CLEAR_LINE, is_watched, say

NOT_FIRST = (
    "this user may not run before other programs: while they are busy, frames may be lost; "
    "systemd/README.md says how to permit it"
)


def add_commands(app: typer.Typer) -> None:
    """Add this package's commands to the `hangtime` command."""
    add_appliance_commands(app)
    app.command("record", rich_help_panel=RECORD, short_help="Track hanger and garment and keep them as a take.")(
        record_command
    )
    app.command("calibrate", rich_help_panel=RECORD, short_help="Measure gravity, depth and clips of a rig.")(
        calibrate_command
    )
    markers = typer.Typer(no_args_is_help=True, help="The hanger's fiducial markers.")
    markers.command("print", short_help="Write a page of markers to print.")(print_command)
    app.add_typer(markers, name="markers", rich_help_panel=RECORD, short_help="The hanger's fiducial markers.")
    sync_cli.add_commands(app)


def print_command(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.svg", help="The page to write.")] = Path("markers.svg"),
    ids: Annotated[
        str | None,
        typer.Option("--ids", metavar="ID,ID", help="Numbers of the markers.", show_default="the rig's, or 0,1"),
    ] = None,
    size: Annotated[
        float, typer.Option("--size", metavar="METRES", help="Side, from black edge to black edge.")
    ] = 0.06,  # m; our choice: 22 px at 1.6 m and f = 576 px
    dictionary: Annotated[str, typer.Option("--dictionary", metavar="NAME", help="OpenCV's name.")] = "DICT_4X4_50",
    rig: Annotated[
        Path | None,
        typer.Option(
            "--rig", metavar="RIG.toml", help="Take dictionary, size and, without --ids, numbers from this rig."
        ),
    ] = None,
    anyway: Anyway = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the page that --out names.")] = False,
) -> None:
    """Write a page of markers, true to scale, with bars to check the print.

    Any browser prints it; choose 100 %, not "fit to page", and measure both bars before cutting.
    """
    from capture.errors import UntrackableError
    from capture.hanger.marker_sheet import write_sheet
    from formats.descriptions import load_rig
    from formats.outputs import refuse_to_replace
    from formats.plausible_rig import check_plausible_marker

    try:
        numbers = [int(part) for part in (ids or "0,1").split(",")]
    except ValueError:
        raise UntrackableError(
            f"{ids!r} is no list of numbers", where="--ids", advice="give them as in --ids 0,1"
        ) from None
    if rig is not None:
        hanger = load_rig(rig, anyway=anyway).hanger
        if hanger is None:
            raise UntrackableError("the rig has no [hanger]", where=rig, advice="add one, or leave out --rig")
        if hanger.marker == "dot":
            raise UntrackableError("its hanger has dots, not markers", where=rig, advice="leave out --rig")
        dictionary, size = hanger.dictionary, hanger.marker_size_m
        numbers = numbers if ids else list(hanger.ids)
    if size > 0 and not anyway:
        check_plausible_marker(size, "--size", offers_anyway=True)
    refuse_to_replace(out, overwrite=overwrite)
    sheet = write_sheet(out, dictionary, numbers, size)
    words = f"{sheet}: {counted(len(numbers), 'marker')} of {1e3 * size:g} mm"
    tell(words, file=str(sheet), ids=numbers, dictionary=dictionary, size_m=size)


def calibrate_command(
    sensor: Annotated[
        str, typer.Option("--sensor", metavar="FILE|URI", help="An .oni recording, openni2: or synthetic:MOTION.")
    ],
    rig: Annotated[Path, typer.Option("--rig", metavar="RIG.toml", help="The rig, with the values known so far.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="RIG.toml", help="Write the rig with the measured values.")
    ] = None,
    plumb: Annotated[
        str, typer.Option("--plumb-ids", metavar="ID,ID", help="Upper and lower marker of the plumb line.")
    ] = "4,5",
    clips: Annotated[
        str, typer.Option("--clip-ids", metavar="ID,ID", help="Marker in the left and in the right clip.")
    ] = "2,3",
    # Seconds; our choice: 150 frames of a sensor with 30 a second.
    seconds: Annotated[float, typer.Option("--seconds", min=1.0, max=10.0, help="Duration of the measurement.")] = 5.0,
    accelerometer: Annotated[
        bool | None,
        typer.Option(
            "--accelerometer/--no-accelerometer",
            help="Read the connected Kinect's accelerometer.",
            show_default="tried with a live sensor",
        ),
    ] = None,
    anyway: Anyway = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file that --out names.")] = False,
) -> None:
    """Calibrate a rig from a still scene; each value has its standard deviation.

    The hanger gives the depth scale and the offset of depth from colour. A plumb line with two markers gives gravity,
    and so does a sensor's accelerometer. A marker in each clip, its black upper edge where the clip holds, gives the
    ends of the held edge. Other values of the rig stay unchanged. Without --out nothing is written.
    """
    from msgspec import to_builtins

    from capture.calibration.accelerometer import connected_accelerometer
    from capture.calibration.report import lines
    from capture.calibration.session import calibrate
    from capture.errors import CalibrationError
    from firmware_host.errors import FirmwareError
    from firmware_host.opening import open_sensor
    from formats.descriptions import check_rig, dump_description, load_rig
    from formats.outputs import AS_RIG, check_is_no_input, check_place, refuse_to_replace, write_text
    from formats.plausible_rig import check_plausible_rig

    if out is not None:
        check_is_no_input(out, {"--sensor": sensor})  # a rig may be replaced by what was measured of it
        check_place(out, *AS_RIG)
        refuse_to_replace(out, overwrite=overwrite)
    plumb_ids, clip_ids = two_numbers(plumb, "--plumb-ids"), two_numbers(clips, "--clip-ids")
    before = load_rig(rig, anyway=anyway)
    with open_sensor(sensor, anyway=anyway) as source:
        gravity = None
        if accelerometer or (accelerometer is None and source.info.is_live):
            try:
                gravity = connected_accelerometer()
            except (FirmwareError, CalibrationError) as error:
                if accelerometer:
                    raise
                say(f"without the accelerometer: {error}")
        measured = calibrate(
            source, before, plumb_ids=plumb_ids, clip_ids=clip_ids, seconds=seconds, accelerometer=gravity
        )
    for line in lines(measured, before):
        tell(line)
    know(rig=to_builtins(measured.rig), file=str(out) if out is not None else None)
    if out is not None:
        check_rig(measured.rig, out)
        if not anyway:
            check_plausible_rig(measured.rig, out, offers_anyway=True)
        write_text(out, dump_description(measured.rig), overwrite=overwrite)
        tell(f"{out}: written")


def two_numbers(text: str, option: str) -> tuple[int, int]:
    """Return the two whole numbers of an option.

    Raises:
        UntrackableError: the value is not two whole numbers.
    """
    from capture.errors import UntrackableError

    try:
        first, second = (int(part) for part in text.split(","))
    except ValueError:
        raise UntrackableError(f"{text!r} is no pair of numbers", where=option, advice="give two, as in 4,5") from None
    return first, second


def check_take_name(out: Path, inputs: Mapping[str, str | Path]) -> None:
    """Check that a take's name ends in .mcap, that its folder exists, and that it is not an input file.

    Raises:
        OutputError: it is not UTF-8, does not end in .mcap, the ending of takes, its folder is absent, or an input
            would be replaced.
    """
    from formats.errors import OutputError
    from formats.outputs import check_is_no_input, check_name, check_place

    check_name(out)
    if out.suffix != ".mcap":
        raise OutputError("takes are written as MCAP", where=out, advice="give a name that ends in .mcap")
    check_place(out)
    check_is_no_input(out, inputs)


def record_command(
    sensor: Annotated[
        str, typer.Option("--sensor", metavar="FILE|URI", help="An .oni recording, openni2: or synthetic:MOTION.")
    ],
    rig: Annotated[Path, typer.Option("--rig", metavar="RIG.toml", help="Sensor, gravity and hanger.")],
    garment: Annotated[Path, typer.Option("--garment", metavar="GARMENT.toml", help="Outline, weight and points.")],
    out: Annotated[Path, typer.Option("--out", metavar="TAKE.mcap", help="The take to write, *.mcap.")],
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", min=1.0, max=86400.0, help="Stop after this time.", show_default="the end"),
    ] = None,
    pick: Annotated[
        tuple[str, str] | None,
        typer.Option("--pick", metavar="X,Y X,Y", help="Pixels of the left and the right dot in the first picture."),
    ] = None,
    anyway: Anyway = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the take that --out names.")] = False,
    scan_rate: Annotated[
        float, typer.Option("--scan-rate", metavar="HZ", min=0.0, max=60.0, help="Surface scans a second; 0 for none.")
    ] = 0.0,
    scan_points: Annotated[
        int, typer.Option("--scan-points", metavar="N", min=3, max=64, help="Scan a grid of N x N, and 8 N around it.")
    ] = 12,  # our choice: as the appliance's `recording.scan_points`
    lamp: Annotated[
        str | None,
        typer.Option(
            "--lamp",
            metavar="LED",
            help="LED of /sys/class/leds that shows the state of the recording.",
            show_default="no lamp",
        ),
    ] = None,
) -> None:
    """Track the hanger and the garment in every frame and keep them as a take.

    The two markers, fiducials or coloured dots as in the rig, are found automatically. If other objects look like
    dots, --pick gives the position of the right ones. Ctrl-C, SIGTERM and SIGHUP end the take cleanly.

    The lamp is steady without faults. It blinks once a second if tracking fails, and four times a second if the sensor
    fails. With a live sensor the recorder takes real-time priority, if this user may: systemd/README.md.

    Example: `hangtime record --sensor openni2: --rig rig.toml --garment garment.toml --out wide.mcap`
    """
    from contextlib import ExitStack
    from datetime import UTC, datetime

    import numpy as np

    from capture.recording.condition import Condition
    from capture.recording.condition_lamp import show_condition
    from capture.recording.frame_queue import QueuedSensor
    from capture.recording.frame_reader import ScanPlan
    from capture.recording.known_garment import check_known_garment
    from capture.recording.precedence import Precedence
    from capture.recording.session import check_sensor, record
    from capture.recording.stop_signals import stopped_like_ctrl_c
    from firmware_host.errors import LampError
    from firmware_host.lamp import StatusLamp
    from firmware_host.opening import garment_in_view, names_live_sensor, open_sensor
    from formats.descriptions import load_garment, load_rig
    from formats.outputs import refuse_to_replace
    from formats.plausible_rig import check_plausible_hold
    from formats.takes_cli import tell_aside

    check_take_name(out, {"--sensor": sensor, "--rig": rig, "--garment": garment})
    refuse_to_replace(out, overwrite=overwrite)
    described_rig, described_garment = load_rig(rig, anyway=anyway), load_garment(garment, anyway=anyway)
    if not anyway:
        check_plausible_hold(described_rig, described_garment, rig, offers_anyway=True)
        if (in_view := garment_in_view(sensor)) is not None:  # before its cloth is simulated, for up to minutes
            check_known_garment(described_garment, in_view, garment)
    is_terminal = is_watched()
    clear, is_live = CLEAR_LINE if is_terminal else "", True
    whose = "" if is_terminal else f"{plain(out.name)}: "  # a log may hold the lines of several recordings

    def show(frames: int, total: int | None, hanger_share: float) -> None:
        if is_terminal and frames % 5 == 0:
            of = f" of {total}" if total else ""
            say(f"{frames}{of} frames, hanger seen in {100 * hanger_share:.0f} %", begin=clear, end="")

    def announce(time: float, condition: Condition) -> None:
        said = condition.value
        step = said.next_step(is_live=is_live)
        say(f"{whose}{time:6.1f} s  {with_advice(said.words, step)}", begin=clear)
        if lamps:
            try:
                show_condition(lamps[0], condition)
            except LampError as error:
                lamps.clear()
                say(f"{whose}{time:6.1f} s  without the lamp: {error}", begin=clear)

    picks = None if pick is None else np.array([two_numbers(one, "--pick") for one in pick], float)
    scans = ScanPlan(rate=scan_rate, grid=scan_points, contour=8 * scan_points) if scan_rate > 0 else None
    with stopped_like_ctrl_c() as stop:
        with ExitStack() as opened:
            opened.callback(say, "", begin=clear, end="")
            lamps = [] if lamp is None else [opened.enter_context(StatusLamp(lamp))]
            precedence = Precedence()
            if names_live_sensor(sensor):
                opened.enter_context(precedence)
            source = opened.enter_context(open_sensor(sensor, anyway=anyway))
            check_sensor(source.info, described_rig, rig)
            is_live = source.info.is_live
            for note in source.info.notes:
                tell_entry("notes", f"note: {note}", words=note)
            if is_live:
                source = opened.enter_context(QueuedSensor(source))
                precedence.begin_tracking()
                if not precedence.is_granted:
                    say(NOT_FIRST)
            report = record(
                source, described_rig, described_garment, out, take_id=out.stem,
                created=datetime.now(UTC).isoformat(timespec="seconds"), seconds=seconds, progress=show,
                announce=announce, picks=picks, scans=scans, overwrite=overwrite, tell_aside=tell_aside, stop=stop,
            )  # fmt: skip
        points = ", ".join(
            f"{name} {100 * share:.0f} %"
            for name, share in zip(described_garment.point_names, report.point_share, strict=True)
        )
        hanger_share = report.with_hanger / max(report.frames, 1)
        shares = dict(zip(described_garment.point_names, map(float, report.point_share), strict=True))
        tell(
            # Both lines at once: commands side by side may share an output, as in the demo.
            f"{report.path}: {counted(report.frames, 'frame')}{', stopped early' if report.is_interrupted else ''}\n"
            f"hanger seen in {100 * hanger_share:.0f} %; {points}",
            file=str(report.path), frames=report.frames, is_interrupted=report.is_interrupted,
            hanger_share=hanger_share, point_share=shares, conditions={}, findings=[],
        )  # fmt: skip
        for condition, count in sorted(report.conditions.items(), key=lambda item: -item[1]):
            if condition is not Condition.GOOD:
                tell(f"in {counted(count, 'frame')} {condition.value.words}")
        know(conditions={c.value.words: count for c, count in report.conditions.items()})
        for finding in report.findings:
            if not finding.is_grave:
                said = with_advice(finding.words, finding.advice)
                tell_entry("findings", said, words=finding.words, advice=finding.advice)
        complaint = report.failure or report.doubt
        if complaint is not None:
            raise complaint

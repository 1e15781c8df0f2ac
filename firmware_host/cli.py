"""`hangtime sensor`: list, play, three kinds of synthesis, and the commands of `usb_control` and `doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from firmware_host.synthetic.lengths import LONGEST_RECORDING, SHORTEST_WRITTEN
from formats.anyway import Anyway
from formats.command_groups import RECORD
from formats.plain_text import counted, plain
from formats.telling import know, tell
from formats.terminal import ProgressLine

Seconds = Annotated[
    float,
    typer.Option("--seconds", min=SHORTEST_WRITTEN, max=LONGEST_RECORDING, help="Length of the recording."),
]


def add_commands(app: typer.Typer) -> None:
    """Add this package's commands to the `hangtime` command."""
    from firmware_host.doctor.cli import add_commands as add_doctor
    from firmware_host.usb_control.cli import add_commands as add_usb_commands

    sensor = typer.Typer(help="Sensors and sensor recordings.", no_args_is_help=True)
    sensor.command("list", short_help="List the sensors on the USB bus.")(list_sensors)
    sensor.command("play", short_help="Play a recording or sensor to its end.")(play)
    sensor.command("synthesise", short_help="Make a sensor recording without a sensor.")(synthesise)
    sensor.command("synthesise-swatch", short_help="Make motion capture without cameras.")(synthesise_swatch)
    sensor.command("synthesise-silhouette", short_help="Make a silhouette of swung cloth.")(synthesise_silhouette)
    add_usb_commands(sensor)
    add_doctor(sensor)
    app.add_typer(sensor, name="sensor", rich_help_panel=RECORD)


def list_sensors() -> None:
    """List the depth sensors on the USB bus, and those that OpenNI2 sees."""
    from firmware_host import openni2_library
    from firmware_host.usb_control.devices import find_devices
    from firmware_host.usb_control.report import place_lines, tell_sensor

    devices = find_devices()
    for device in devices:
        tell_sensor(device.model.name, place_lines(device))
    uris = openni2_library.live_uris()
    for uri in uris:
        tell(f"OpenNI2 sees {uri}")
    know(openni2=uris)
    if not devices and not uris:
        tell("No depth sensor is connected.")
    elif not uris:
        tell("OpenNI2 sees none of them; `hangtime sensor doctor` says why.")


def play(
    source: Annotated[str, typer.Argument(metavar="FILE|URI", help="An .oni recording, openni2: or synthetic:MOTION.")],
    max_frames: Annotated[int | None, typer.Option("--max-frames", min=1, help="Stop after so many frames.")] = None,
    anyway: Anyway = False,
) -> None:
    """Play a recording or sensor to its end; report frames, rate, resolution, depth coverage and drops."""
    import numpy as np

    from firmware_host.opening import open_sensor

    count = dropped = without_colour = set_back = 0
    coverage: list[float] = []
    first = last = 0.0
    with open_sensor(source, anyway=anyway) as sensor:
        info = sensor.info
        tell(f"{plain(info.name)}: {info.intrinsics.width} x {info.intrinsics.height}, {info.fps:g} frames a second")
        camera = info.intrinsics
        tell(f"for rig.toml: fx = {camera.fx:.1f}, fy = {camera.fy:.1f}, cx = {camera.cx:g}, cy = {camera.cy:g}")
        for note in info.notes:
            tell(f"note: {note}")
        for frame in sensor.frames():
            first = frame.time_s if count == 0 else first
            set_back += count > 0 and frame.time_s < last
            last = frame.time_s
            count += 1
            dropped += frame.dropped_before
            without_colour += frame.colour is None
            coverage.append(float(np.count_nonzero(frame.depth)) / frame.depth.size)
            if count == max_frames:
                break
    if count < 2:
        rate = ""
    elif last > first:
        rate = f" ({(count - 1) / (last - first):.1f} a second)"
    else:
        rate = "" if set_back else " (its clock stands still)"
    back = f"; its clock was set back {counted(set_back, 'time')}" if set_back else ""
    depth = float(np.mean(coverage)) if coverage else 0.0
    tell(
        f"{counted(count, 'frame')} in {max(last - first, 0):.2f} s{rate}, "
        f"{dropped} dropped, {without_colour} without colour; depth in {100 * depth:.0f} % of the pixels{back}",
        name=info.name, width=camera.width, height=camera.height, fx=camera.fx, fy=camera.fy, cx=camera.cx,
        cy=camera.cy, notes=list(info.notes), frames=count, duration_s=max(last - first, 0.0), dropped=dropped,
        without_colour=without_colour, depth_share=depth, clock_set_back=set_back,
    )  # fmt: skip


def synthesise(
    out: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the recording; made if absent.")],
    name: Annotated[str, typer.Option("--name", help="Name of the recording.")] = "swing",
    motion: Annotated[
        str, typer.Option("--motion", help="Motion of the hanger: swing, mixed, gentle, twist or hard.")
    ] = "swing",
    effect: Annotated[
        str,
        typer.Option("--effect", help="Planted effect: none, air_drag, hem or time_offset."),
    ] = "air_drag",
    amplitude: Annotated[
        float | None, typer.Option("--amplitude", help="Size of the effect in its own unit.", show_default="typical")
    ] = None,
    seconds: Seconds = 8.0,  # s; our choice: rest at both ends, and some swings between
    rest: Annotated[
        float, typer.Option("--rest", metavar="SECONDS", min=0.0, help="Seconds at rest before the hand begins.")
    ] = 1.0,  # s; as `firmware_host.synthetic.motion.START`
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of hand jitter and sensor noise.")] = 1,
    garment: Annotated[str, typer.Option("--garment", help="Garment: skirt, swatch or t-shirt.")] = "skirt",
    fabric: Annotated[
        str, typer.Option("--fabric", help="Fabric: plain, or felt, which is far from the starting values of fits.")
    ] = "plain",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing files of these names.")] = False,
) -> None:
    """Make a sensor recording without a sensor: a garment on a swung hanger, seen by a depth camera with real faults.

    Writes DIR/NAME.oni, DIR/NAME.truth.npz, DIR/rig.toml and DIR/garment.toml.
    """
    from firmware_host.synthetic.recording import make_recording

    progress = ProgressLine(name)
    paths = make_recording(
        out, name, motion=motion, effect=effect, amplitude=amplitude, seconds=seconds, seed=seed,
        garment=garment, fabric=fabric, progress=lambda stage, share: progress.show(share, stage),
        overwrite=overwrite, rest=rest,
    )  # fmt: skip
    progress.end()
    tell("\n".join(map(str, paths)), files=list(map(str, paths)))


def synthesise_swatch(
    out: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the recording; made if absent.")],
    fabric: Annotated[str, typer.Option("--fabric", help="Fabric: silk, denim, cotton or polyester-rayon.")] = "cotton",
    motion: Annotated[str, typer.Option("--motion", help="Motion: swing, other or slow.")] = "swing",
    air_drag: Annotated[float, typer.Option("--air-drag", min=0.0, help="Drag coefficient of the still air.")] = 0.0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the markers' noise and gaps.")] = 1,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing files of these names.")] = False,
) -> None:
    """Make motion capture without cameras: a 50 cm swatch with 81 markers, swung by its corners, 500 frames at 120 Hz.

    Writes DIR/FABRIC-MOTION.csv, its truth (.truth.npz) and the garment DIR/FABRIC.toml; `hangtime import` reads them.
    """
    from firmware_host.synthetic.swatch import make_swatch_take

    paths = make_swatch_take(
        out, fabric=fabric, motion=motion, air_drag=air_drag, seed=seed, overwrite=overwrite
    )  # fmt: skip
    tell("\n".join(map(str, paths)), files=list(map(str, paths)))


def synthesise_silhouette(
    out: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the recording; made if absent.")],
    name: Annotated[str, typer.Option("--name", help="Name of the recording.")] = "silhouette",
    latency: Annotated[float, typer.Option("--latency", metavar="SECONDS", help="Latency of every timestamp.")] = 0.0,
    publish_share: Annotated[
        float, typer.Option("--publish-share", help="Latency per excess of the previous frame interval.")
    ] = 0.0,
    jitter: Annotated[
        float, typer.Option("--jitter", metavar="SECONDS", help="Standard deviation of the timestamps' jitter.")
    ] = 0.0,
    path_below: Annotated[
        float, typer.Option("--path-below", metavar="METRES", help="Offset of the hanger's path below the held edge.")
    ] = 0.0,
    depth_scale: Annotated[
        float, typer.Option("--depth-scale", help="Relative error of depth; above 0: too long.")
    ] = 0.0,
    skewed: Annotated[float, typer.Option("--skewed", help="Share of the frames with a skewed grid.")] = 0.0,
    eroded: Annotated[
        float, typer.Option("--eroded", metavar="METRES", help="Width of the cloth's border that the camera misses.")
    ] = 0.0,
    eaten: Annotated[
        float,
        typer.Option(
            "--eaten-by-pose",
            metavar="METRES",
            help="Loss of the bottom border per unit of lean; at 0 the points are material points.",
        ),
    ] = 0.03,  # m; our choice: the typical size of the effect `eroded_outline`
    # Metres; our choice: a depth camera's noise at 1 m (`firmware_host.synthetic.depth_noise`).
    noise: Annotated[float, typer.Option("--noise", metavar="METRES", help="White noise per axis.")] = 0.002,
    seconds: Seconds = 12.0,  # s; our choice: some swings, at 9 frames a second
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of intervals, skew and noise.")] = 1,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing files of these names.")] = False,
) -> None:
    """Make a re-gridded silhouette of swung cloth, with a camera's faults switched on one by one.

    By default its outline depends on the pose, so that the grid slides over the cloth as in real recordings.

    Writes DIR/NAME.npz, which `hangtime import` reads, and its truth DIR/NAME.truth.npz.
    """
    from firmware_host.synthetic.silhouette import CameraFaults, make_silhouette_take

    faults = CameraFaults(
        latency=latency, publish_share=publish_share, jitter=jitter, path_below=path_below, depth_scale=depth_scale,
        skewed_share=skewed, eroded_border=eroded, eaten_by_pose=eaten, noise=noise,
    )  # fmt: skip
    paths = make_silhouette_take(out, name, faults, seconds=seconds, seed=seed, overwrite=overwrite)
    tell("\n".join(map(str, paths)), files=list(map(str, paths)))

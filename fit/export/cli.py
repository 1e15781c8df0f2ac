"""Run `hangtime export` and `hangtime animate`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from formats.command_groups import OUT
from formats.telling import know, tell, tell_entry

FitFile = Annotated[
    Path, typer.Argument(metavar="FIT", help="A result of `hangtime fit`: fit.json, or the folder that holds it.")
]
Spacing = Annotated[
    float | None,
    typer.Option(
        "--spacing", metavar="METRES", help="Mesh spacing.",
        show_default="0.02; with --take, that of the fit",
    ),
]  # fmt: skip
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is already there.")]


class ExportKind(StrEnum):
    """Choices of `hangtime export --to`; `fit.export.kinds.EXPORT_KINDS` implements them."""

    CSV = "csv"
    PARQUET = "parquet"
    TABLE = "table"
    USD_PHYSICS = "usd-physics"
    NEWTON = "newton"
    MUJOCO = "mujoco"
    U3M = "u3m"
    BLENDER = "blender"
    USD = "usd"
    GLTF = "gltf"
    ABC = "abc"
    PC2 = "pc2"


def add_commands(app: typer.Typer) -> None:
    """Add `hangtime export` and `hangtime animate` to the command."""
    app.command("export", rich_help_panel=OUT, short_help="Write a fit for other programs.")(export_command)
    app.command(
        "animate", rich_help_panel=OUT, short_help="Show a fitted garment in motion, as a film or a moving mesh."
    )(animate_command)


def export_command(
    fit_file: FitFile,
    to: Annotated[
        ExportKind,
        typer.Option(
            "--to",
            help="csv, parquet: every number with its interval. table: what to type into CLO, Marvelous Designer and "
            "Browzwear. usd-physics: an OpenUSD deformable. newton: a preset of Newton's cloth solvers. mujoco: a "
            "MuJoCo flex. u3m: U3M 1.1. blender: a script that builds the cloth in Blender, with settings that come "
            "near. usd, gltf, pc2, abc: the garment in motion under the hanger of --take; Blender's Python writes abc.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File to write.", show_default="beside FIT; table: the terminal"),
    ] = None,
    take: Annotated[
        Path | None,
        typer.Option(
            "--take", metavar="TAKE", help="The garment of this take, and its motion, instead of a 0.3 m swatch."
        ),
    ] = None,
    thickness: Annotated[
        float | None,
        typer.Option(
            "--thickness",
            metavar="METRES",
            help="The fabric's thickness, which motion does not identify. In usd-physics, thickness turns weight into "
            "density.",
            show_default="0.001",
        ),
    ] = None,
    spacing: Spacing = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a fit for other programs: its fabric in SI units, with intervals and provenance.

    Every file says which numbers the takes do not identify. A fit of kinect-skirt or mocap-swatch fits the weight, so
    that it has no SI values. It can be written as csv and in motion, and that of kinect-skirt for Blender too.
    Interrupt it with Ctrl-C at any time: nothing is left behind.

    Example: `hangtime export results --to usd-physics`
    """
    from fit.export.about import doubts, remarks_on_take
    from fit.export.kinds import (
        EXPORT_KINDS,
        WITH_THICKNESS,
        Order,
        check_order,
        checked_names,
        contents,
        default_path,
        write_contents,
    )
    from fit.export.usd_physics import THICKNESS
    from fit.identification.read_again import read_fit
    from formats.archive import read_take
    from formats.outputs import check_is_no_input
    from formats.plain_text import plain
    from formats.terminal import ProgressLine, say

    _refuse_unused(
        "--thickness", thickness, f"{to.value} holds none", "--to usd-physics", is_used=to.value in WITH_THICKNESS
    )
    result, file = read_fit(fit_file)
    progress = ProgressLine(f"export to {to.value}")
    begun = []

    def show(share: float, words: str) -> None:
        begun.append(share)
        progress.show(share, words)

    order = Order(
        result=result, take=read_take(take) if take is not None else None,
        thickness=THICKNESS if thickness is None else thickness, spacing=spacing, show=show,
    )  # fmt: skip
    is_shown = to is ExportKind.TABLE and out is None  # the sheet itself tells the doubts
    path = out or default_path(file, to.value)
    names: dict[str, Path] = {}
    if is_shown:
        check_order(order, to.value)
    else:
        check_is_no_input(path, {"FIT": file} | ({"--take": take} if take is not None else {}))
        names = checked_names(order, to.value, path, overwrite=overwrite)
    remarks = [] if is_shown else doubts(result, order.fabric_if_any)
    remarks = list(dict.fromkeys([*remarks, *remarks_on_take(result, order.take)]))
    for remark in remarks:
        say(remark)
    if is_shown:
        sheet = next(iter(EXPORT_KINDS[to.value].make(order).values())).decode()
        tell(sheet.removesuffix("\n"), table=sheet)
        return
    try:
        made = contents(order, to.value, names)
    except KeyboardInterrupt:
        if begun:
            progress.end()
        say("Interrupted; nothing is kept.")
        raise typer.Exit(130) from None
    if begun:  # only a motion takes long
        progress.show(1.0, "done")
        progress.end()
    write_contents(made, overwrite=overwrite)
    know(remarks=remarks)
    for written in made:
        tell_entry("files", plain(written), file=str(written))


def animate_command(
    fit_file: FitFile,
    out: Annotated[
        Path,
        typer.Option("--out", metavar="FILE", help="File to write: .mp4, .webm, .gif, .usdc or .glb."),
    ],
    take: Annotated[
        Path | None,
        typer.Option(
            "--take", metavar="TAKE", help="The garment of this take, and its motion unless --motion gives another."
        ),
    ] = None,
    motion: Annotated[
        str,
        typer.Option(
            "--motion",
            metavar="KIND",
            help="New hanger motion: sideways, face-on, up-and-down, twist or mixed. Without --take, a swatch of "
            "the fabric hangs from its two top corners.",
        ),
    ] = "",
    figure: Annotated[
        str,
        typer.Option(
            "--figure",
            metavar="KIND",
            help="Let a figure wear the skirt or T-shirt of the take, closed front and back: walk.",
        ),
    ] = "",
    wear: Annotated[
        str | None,
        typer.Option(
            "--wear",
            metavar="GARMENT",
            help="Plain garment of the fabric that the figure wears without --take: skirt or t-shirt.",
            show_default="skirt",
        ),
    ] = None,
    bvh: Annotated[
        Path | None,
        typer.Option("--bvh", metavar="FILE", help="The figure moves as this BVH file says, after two seconds' lead."),
    ] = None,
    speed: Annotated[
        float | None, typer.Option("--speed", help="Speed of the computed walk [m/s].", show_default="1.2")
    ] = None,
    height: Annotated[
        float | None, typer.Option("--height", help="Height of the figure [m].", show_default="1.7")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", help="Length of a new motion or of a walk [s].", show_default="6"),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            "--size", metavar="WxH", help="Pixels of a film: even numbers, 64 to 4096.", show_default="960x720"
        ),
    ] = None,
    spacing: Spacing = None,
    overwrite: Overwrite = False,
) -> None:
    """Show a fitted garment in motion: as a film, a GIF, an OpenUSD cache or glTF.

    The cloth moves under the hanger of a take, under a new motion, or on a walking figure. A figure that walks through
    the cloth is refused, with the frame. The film's comment says where the fit comes from
    and which numbers the takes do not identify. Interrupt it with Ctrl-C at any time: nothing is left behind.

    Example: `hangtime animate results --take wide.mcap --out swing.mp4`
    """
    from dataclasses import replace

    from fit.export.animation import Scene, animate, check_film
    from fit.export.video import DEFAULT_SIZE, FILMS
    from fit.export.worn import FigureOrder
    from fit.identification.read_again import read_fit
    from formats.archive import read_take
    from formats.plain_text import plain
    from formats.terminal import ProgressLine, say

    is_worn = bool(figure or bvh)
    _refuse_unused("--wear", wear, "only a figure wears a garment", "--figure walk", is_used=is_worn)
    _refuse_unused("--wear", wear, "the take has a garment", "no --take", is_used=take is None)
    _refuse_unused(
        "--speed", speed, "only a computed walk has a speed", "--figure walk", is_used=is_worn and bvh is None
    )
    _refuse_unused("--height", height, "a figure has a height", "--figure walk", is_used=is_worn)
    _refuse_unused(
        "--seconds", seconds, "a take lasts as long as it does", "--motion or --figure", is_used=is_worn or bool(motion)
    )
    is_film = out.suffix.lower() in FILMS
    _refuse_unused("--size", size, "a mesh has no pixels", "a film to --out", is_used=is_film or not out.suffix)
    pixels = _pixels(size) if size is not None else DEFAULT_SIZE
    check_film(out, pixels, overwrite=overwrite)
    given = {"speed": speed, "height": height}
    order = FigureOrder(
        kind=figure or "walk", wear=wear or "skirt", bvh=bvh, **{k: v for k, v in given.items() if v is not None}
    )
    scene = Scene(
        result=read_fit(fit_file)[0], motion=motion, seconds=6.0 if seconds is None else seconds, spacing=spacing,
        figure=order if is_worn else None,
    )  # fmt: skip
    scene.check(has_take=take is not None)
    if take is not None:
        scene = replace(scene, take=read_take(take))
    progress = ProgressLine("animate")
    try:
        written = animate(scene, out, size=pixels, overwrite=overwrite, show=progress.show)
    except KeyboardInterrupt:
        progress.end()
        say("Interrupted; nothing is kept.")
        raise typer.Exit(130) from None
    progress.end()
    for remark in written.remarks:
        say(remark)
    tell(plain(written.path), file=str(written.path), remarks=list(written.remarks))


def _refuse_unused(option: str, given: object, why: str, with_what: str, *, is_used: bool) -> None:
    """Refuse an option without effect.

    Raises:
        FitError: the option is given and not used.
    """
    from fit.errors import FitError

    if given is not None and not is_used:
        raise FitError(f"changes nothing here: {why}", where=option, advice=f"leave it out, or give {with_what}")


def _pixels(size: str) -> tuple[int, int]:
    """Return width and height of a film [px].

    Raises:
        FitError: it is not WxH.
    """
    from fit.errors import FitError

    try:
        wide, high = (int(part) for part in size.lower().split("x"))
    except ValueError:
        raise FitError(f"{size!r} is not WxH", where="--size", advice="for example 960x720") from None
    return wide, high

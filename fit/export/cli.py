"""Run `hangtime export`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class ExportKind(StrEnum):
    """The command `hangtime export`; `fit.export.kinds.KINDS` does the work."""

    CSV = "csv"
    TABLE = "table"
    USD_PHYSICS = "usd-physics"
    NEWTON = "newton"
    MUJOCO = "mujoco"
    USD = "usd"
    GLTF = "gltf"
    PC2 = "pc2"


def add_commands(app: typer.Typer) -> None:
    """Add `hangtime export` to the command."""
    app.command("export", short_help="Write a fit for other programs.")(export_command)


def export_command(
    fit_file: Annotated[
        Path, typer.Argument(metavar="FIT", help="A result of `hangtime fit`: fit.json, or the folder that holds it.")
    ],
    to: Annotated[
        ExportKind,
        typer.Option(
            "--to",
            help="csv: every number with its interval. table: what to type into CLO, Marvelous Designer and Browzwear. "
            "usd-physics: an OpenUSD deformable. newton: a preset of Newton's cloth solvers. mujoco: a MuJoCo flex. "
            "usd, gltf, pc2: the garment in motion under the hanger of --take.",
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
        float,
        typer.Option(
            "--thickness",
            metavar="METRES",
            help="The fabric's thickness, which no motion tells. It turns weight into density in usd-physics.",
        ),
    ] = 1e-3,
    spacing: Annotated[
        float | None,
        typer.Option(
            "--spacing",
            metavar="METRES",
            help="Mesh spacing.",
            show_default="0.02; with --take, that of the fit's method",
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what is already there.")] = False,
) -> None:
    """Write a fit for other programs: its fabric in SI units, with intervals and where it comes from.

    Every file says which numbers the takes do not identify. A fit of kinect-skirt or mocap-swatch fits the weight, so
    that it has no SI values; it can be written as csv, and in motion.
    """
    from fit.export.kinds import KINDS, Order, default_path, export, read_fit
    from formats.archive import read_take
    from formats.plain_text import plain

    result, file = read_fit(fit_file)
    order = Order(
        result=result, take=read_take(take) if take is not None else None, thickness=thickness, spacing=spacing
    )
    if to is ExportKind.TABLE and out is None:
        made = KINDS[to.value].make(order)
        typer.echo(next(iter(made.values())).decode(), nl=False)
        return
    for written in export(order, to.value, out or default_path(file, to.value), overwrite=overwrite):
        typer.echo(plain(written))

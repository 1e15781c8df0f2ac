"""Registry of the export kinds, each with the function that writes it.

A kind contains the fit alone, its fabric, or its motion under a take's hanger.
"""

from __future__ import annotations

import contextlib
import difflib
import functools
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from fit.cloth.mesh import check_spacing
from fit.errors import FitError, out_of_range, unknown_name
from fit.export import caches, presets, tables
from fit.export.alembic import alembic, check_blender
from fit.export.blender_recipe import blender_script
from fit.export.fabric import Fabric, fabric_of, why_no_fabric
from fit.export.moving import SIMULATED_OF_MESH, Moving, moving_cloth
from fit.export.parquet import parquet
from fit.export.sheet import EXPORTED_SIDE, SWATCH_SPACING, Sheet, check_strip, garment_sheet, strip
from fit.export.u3m import u3m
from fit.export.usd_physics import THICKNESS, usd_physics
from fit.methods import find_method
from formats.fit_records import FitResult
from formats.interrupts import held
from formats.outputs import (
    AS_PARQUET,
    AS_TABLE,
    check_name,
    output_folder,
    refuse_to_replace,
    uncompressed,
    write_bytes,
)
from formats.plain_text import plain
from formats.take import Take

# of letters alike; our choice: .cvs for .csv and .parqet have 0.75 and more, .txt and .dat of every known ending less
MISSPELT = 0.7
Show = Callable[[float, str], None]
# m, from the thinnest foil to quilted wadding. Our choice: outside is a thickness in another unit.
LEAST_THICKNESS, MOST_THICKNESS = 1e-5, 0.02
THICKNESS_UNITS = (("millimetres", 1e-3), ("micrometres", 1e-6))  # m each; no ruler of inches shows a thickness


@dataclass(frozen=True, kw_only=True, eq=False)
class Order:
    """Request of an export; `take` provides garment and motion, for kinds that contain them.

    show: receives the finished share and words, of kinds that contain a motion
    """

    result: FitResult
    take: Take | None = None
    thickness: float = THICKNESS  # m
    spacing: float | None = None  # m
    show: Show = lambda share, text: None

    @property
    def fabric(self) -> Fabric:
        """Return the fabric of the fit, one layer of it.

        Raises:
            FitError: the fit has no fabric.
        """
        return fabric_of(self.result)

    @property
    def fabric_if_any(self) -> Fabric | None:
        """Return the fabric, or None if the fit has none."""
        return None if why_no_fabric(self.result) else self.fabric

    @functools.cached_property
    def moving(self) -> Moving:
        """Return the garment in motion.

        Raises:
            FitError: there is no take, or it cannot be simulated.
        """
        if self.take is None:
            raise FitError(
                "a fit alone holds no motion", where="--take", advice="name a take whose hanger the garment follows"
            )
        self.show(0.0, "simulating")
        moving = moving_cloth(
            self.result, self.take, self.spacing,
            progress=lambda share: self.show(SIMULATED_OF_MESH * share, "simulating"),
        )  # fmt: skip
        self.show(SIMULATED_OF_MESH, "writing")
        return moving

    @property
    def sheet(self) -> Sheet:
        """Return the garment of the take, or a swatch without a take."""
        if self.take is None:
            return strip(EXPORTED_SIDE, EXPORTED_SIDE, self.spacing or SWATCH_SPACING)
        spacing = self.spacing or self.result.spacing or find_method(self.result.method).spacing
        return garment_sheet(self.take.garment, spacing)

    @property
    def grid_spacing(self) -> float:
        """Return the spacing of a swatch's grid [m].

        Raises:
            FitError: no swatch has such a grid.
        """
        spacing = self.spacing or SWATCH_SPACING
        check_strip(EXPORTED_SIDE, EXPORTED_SIDE, spacing)
        return spacing

    @property
    def sheets_fabric(self) -> Fabric:
        """Return the fabric of `sheet`: all layers of a garment as one, as the fit simulated them."""
        return self.fabric if self.take is None else self.fabric.whole


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of export: suffix of its file, function that makes the files, and suffixes of further files.

    - `also`: further endings by which programs take the file for this format
    - `may_lack`: whether programs read the file also if its name has no ending; OpenUSD opens no such file
    - `check`: raises an error where a program or a library that writes the file is missing; asked before any simulation
    """

    suffix: str
    make: Callable[[Order], dict[str, bytes]]
    beside: tuple[str, ...] = ()
    also: tuple[str, ...] = ()
    may_lack: bool = False
    check: Callable[[], None] = lambda: None

    @property
    def endings(self) -> tuple[str, ...]:
        """Return the endings of the file, the usual one first."""
        return (Path(f"fit{self.suffix}").suffix, *self.also)


def _one(
    suffix: str, make: Callable[[Order], bytes], check: Callable[[], None] = lambda: None, also: tuple[str, ...] = (),
    *, may_lack: bool = False,
) -> Kind:  # fmt: skip
    return Kind(suffix=suffix, make=lambda order: {suffix: make(order)}, check=check, also=also, may_lack=may_lack)


def check_libraries(*names: str) -> None:
    """Check that libraries are installed.

    Raises:
        ModuleNotFoundError: one is not.
    """
    for name in names:
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def _csv(order: Order) -> dict[str, bytes]:
    made = {".csv": tables.parameters_csv(order.result, order.fabric_if_any).encode()}
    return made if order.take is None else made | {".motion.csv": caches.motion_csv(order.moving).encode()}


def _parquet(order: Order) -> dict[str, bytes]:
    rows = tables.parameter_rows(order.result, order.fabric_if_any)
    made = {".parquet": parquet(tables.PARAMETER_HEADS, rows, order.result)}
    if order.take is None:
        return made
    motion = caches.motion_rows(order.moving)
    return made | {".motion.parquet": parquet(caches.MOTION_HEADS, motion, order.result)}


def _pc2(order: Order) -> dict[str, bytes]:
    even = order.moving.even()
    return {".pc2": caches.pc2(even), ".obj": caches.obj(order.result, order.fabric_if_any, even)}


_check_usd = functools.partial(check_libraries, "pxr")
_check_parquet = functools.partial(check_libraries, "pyarrow")

WITHOUT_TAKE = {"table", "newton", "u3m"}  # the fabric alone
WITHOUT_MESH = {"table", "u3m"}
MESH_OF_TAKE = {"csv", "parquet"}  # kinds with a mesh if they contain a motion
WITH_THICKNESS = {"usd-physics"}

EXPORT_KINDS: dict[str, Kind] = {
    "csv": Kind(suffix=".csv", make=_csv, beside=(".motion.csv",), also=AS_TABLE[2:], may_lack=True),
    "parquet": Kind(
        suffix=".parquet",
        make=_parquet,
        beside=(".motion.parquet",),
        also=AS_PARQUET[2:],
        check=_check_parquet,
        may_lack=True,
    ),
    "table": _one(".fabric.txt", lambda o: tables.software_table(o.result, o.fabric).encode(), may_lack=True),
    "usd-physics": _one(
        ".physics.usda",
        lambda o: usd_physics(o.result, o.sheets_fabric, o.sheet, o.thickness),
        _check_usd,
        also=(".usd",),
    ),
    "newton": _one(".newton.json", lambda o: presets.newton_preset(o.result, o.fabric, o.grid_spacing), may_lack=True),
    "mujoco": _one(".mujoco.xml", lambda o: presets.mujoco_flex(o.result, o.sheets_fabric, o.sheet), may_lack=True),
    "u3m": _one(".u3m", lambda o: u3m(o.result, o.fabric)),
    "blender": _one(".blender.py", lambda o: blender_script(o.result, o.fabric_if_any, o.sheet), may_lack=True),
    "usd": _one(".usdc", lambda o: caches.usd_cache(o.result, o.fabric_if_any, o.moving), _check_usd, also=(".usd",)),
    "gltf": _one(".glb", lambda o: caches.gltf(o.result, o.fabric_if_any, o.moving)),
    "abc": _one(".abc", lambda o: alembic(o.moving.even()), check_blender),
    "pc2": Kind(suffix=".pc2", make=_pc2, beside=(".obj",)),
}


def export(order: Order, kind: str, path: Path, *, overwrite: bool = False) -> list[Path]:
    """Write a fit as a kind of file; return every written file, the one at `path` first.

    Ctrl-C leaves all of the files or none.

    Raises:
        FitError: an unknown kind, a fit without the content of this kind, or a take that is missing or not of the fit.
        OutputError: a file is there already, or cannot be written.
    """
    made = contents(order, kind, checked_names(order, kind, path, overwrite=overwrite))
    write_contents(made, overwrite=overwrite)
    return list(made)


def write_contents(made: Mapping[Path, bytes], *, overwrite: bool = False) -> None:
    """Write the files of an export, into one folder; an interruption waits until the last is written.

    Raises:
        OutputError: a file is there already, or cannot be written.
    """
    is_main = threading.current_thread() is threading.main_thread()
    with held() if is_main else contextlib.nullcontext(), output_folder(next(iter(made)).parent):
        for file, raw in made.items():
            write_bytes(file, raw, overwrite=overwrite)


def contents(order: Order, kind: str, names: Mapping[str, Path]) -> dict[Path, bytes]:
    """Return every file of an export with its content, the one that was ordered first; nothing is written.

    names: what `checked_names` returned

    Raises:
        FitError: a fit without the content of this kind.
    """
    return {names[suffix]: raw for suffix, raw in EXPORT_KINDS[kind].make(order).items()}


def check_order(order: Order, kind: str) -> None:
    """Refuse an unknown kind, and arguments that are out of range or without effect on an export of this kind.

    Raises:
        FitError: names the argument.
    """
    if kind not in EXPORT_KINDS:
        raise unknown_name("export", kind, EXPORT_KINDS, where="--to")
    if not LEAST_THICKNESS <= order.thickness <= MOST_THICKNESS:
        raise out_of_range(
            order.thickness, LEAST_THICKNESS, MOST_THICKNESS, f"no fabric is {1e3 * order.thickness:g} mm thick",
            where="--thickness", unit="m, as in 0.0005", units=THICKNESS_UNITS,
        )  # fmt: skip
    check_spacing(order.spacing)
    _check_used(order, kind)


def checked_names(order: Order, kind: str, path: Path, *, overwrite: bool = False) -> dict[str, Path]:
    """Return the path of every file of an export by its suffix, checked before any simulation.

    Raises:
        FitError, OutputError: as `export`.
    """
    check_order(order, kind)
    chosen = EXPORT_KINDS[kind]
    check_name(path)
    if not path.name:  # `.` and `/`, which have no ending to look at
        refuse_to_replace(path, overwrite=overwrite)
    beside = chosen.beside if order.take is not None else ()
    if path.suffix in beside:
        raise FitError(
            f"{path.suffix} is the end of the file beside it",
            where=path,
            advice=f"give a name that ends in {chosen.suffix}",
        )
    _check_end(path, kind)
    names = {suffix: path.with_suffix(suffix) for suffix in beside} | {chosen.suffix: path}
    for file in names.values():
        refuse_to_replace(file, overwrite=overwrite)
    chosen.check()
    return names


def _check_end(path: Path, kind: str) -> None:
    """Refuse another ending than those of the kind, or none where programs need one.

    Raises:
        FitError: names the usual ending, or who writes the other.
    """
    given, endings = path.suffix.lower(), EXPORT_KINDS[kind].endings
    if given in endings or (not given and EXPORT_KINDS[kind].may_lack):
        return
    if not given:
        raise FitError(
            "has no ending, by which programs know the format", where=path,
            advice=f"give a name that ends in {endings[0]}",
        )  # fmt: skip
    if difflib.get_close_matches(given, endings, 1, MISSPELT) and not _writers_of(given):
        advice = f"did you mean {plain(path.with_suffix(endings[0]).name)}?"
    else:
        others = "".join(f", or {other}, which writes {given}" for other in _writers_of(given))
        advice = uncompressed(path, endings) or f"give a name that ends in {endings[0]}{others}"
    raise FitError(
        f"--to {kind} writes no {plain(path.suffix)}, and programs go by the end of the name", where=path, advice=advice
    )


def _writers_of(ending: str) -> list[str]:
    """Return the choice of --to whose usual ending this is, or the command that writes films."""
    from fit.export.video import FILMS

    kinds = [f"--to {name}" for name, one in EXPORT_KINDS.items() if one.endings[0] == ending]
    return [*kinds, *["`hangtime animate`"] * (ending in FILMS)]


def _check_used(order: Order, kind: str) -> None:
    """Refuse arguments without effect on an export of this kind.

    Raises:
        FitError: a take or a spacing that is not used.
    """
    if order.take is not None and kind in WITHOUT_TAKE:
        raise FitError(
            f"{kind} holds the fabric alone, and no garment", where="--take",
            advice="leave it out, or choose another --to",
        )  # fmt: skip
    if order.spacing is not None and (kind in WITHOUT_MESH or (kind in MESH_OF_TAKE and order.take is None)):
        raise FitError(f"{kind} holds no mesh here", where="--spacing", advice="leave it out, or choose another --to")


def default_path(fit_file: Path, kind: str) -> Path:
    """Return the default path of an export, beside its fit."""
    return fit_file.with_name(fit_file.stem + EXPORT_KINDS[kind].suffix)

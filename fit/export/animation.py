"""Animation of the fitted cloth, under a take's hanger, a new motion or on a figure, as film, GIF or mesh cache."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fit.cloth.launch import Progress
from fit.cloth.mesh import check_spacing
from fit.errors import FitError, nearest_first
from fit.export import caches
from fit.export.about import doubts, remarks_on_take
from fit.export.fabric import fabric_of, why_no_fabric
from fit.export.kinds import check_libraries
from fit.export.moving import SIMULATED_OF_MESH, Moving, check_engine, motion_of
from fit.export.new_motion import check_motion, hung_swatch, new_motion
from fit.export.sheet import SWATCH_SPACING
from fit.export.video import DEFAULT_SIZE, FILMS, film
from fit.export.worn import FigureOrder, sewn, worn
from fit.figure.wearing import LAYERS_APART
from fit.recordings.recording import prepare
from formats.fit_records import FitResult
from formats.outputs import check_name, output_folder, refuse_to_replace, write_bytes
from formats.take import Take

ANIMATION_SUFFIXES = (*FILMS, ".usdc", ".glb")
LIBRARIES_OF_FILMS = {".mp4": ("PIL", "av"), ".webm": ("PIL", "av"), ".gif": ("PIL",), ".usdc": ("pxr",)}
SMALLEST_SIDE, LARGEST_SIDE = 64, 4096  # px; our choice: an icon, and the width of the largest usual screens

SIMULATED_SHARE = 0.6  # of the time of a film: approximate share of its simulation
Show = Callable[[float, str], None]


@dataclass(frozen=True)
class Animated:
    """The written file, and remarks on the motion."""

    path: Path
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A garment and its motion: the take's own where `motion` is empty; without a take, a swatch of the fabric.

    With a `figure`, the figure wears a skirt or T-shirt: the take's, or a plain one of the fabric.
    """

    result: FitResult
    take: Take | None = None
    motion: str = ""
    seconds: float = 6.0  # of a new motion
    spacing: float | None = None  # m
    figure: FigureOrder | None = None

    def check(self, *, has_take: bool | None = None) -> None:
        """Refuse invalid requests before any simulation; has_take: whether a take will follow later.

        Raises:
            FitError: neither take nor motion, a fit without a fabric and without a take, an unknown motion, or an
            invalid figure.
        """
        check_spacing(self.spacing)
        has_take = self.take is not None if has_take is None else has_take
        if self.figure is not None:
            if self.motion:
                raise FitError("a figure moves by itself", where="--motion", advice="leave out --motion or --figure")
            self.figure.check(self.seconds)
            if self.take is not None:
                sewn(self.take.garment)  # refuses a garment that no figure wears
        elif self.motion:
            check_motion(self.motion, self.seconds)
        elif not has_take:
            raise FitError(
                "a fit alone holds no motion", where="--take",
                advice="name a take, or a --motion for a swatch of the fabric",
            )  # fmt: skip
        check_engine(self.result)
        if not has_take:
            fabric_of(self.result)

    def moving(self, progress: Progress | None = None) -> Moving:
        """Simulate the scene; `progress` receives the finished share.

        Raises:
            FitError: what `check` and, with a figure, `fit.export.worn` refuse.
        """
        self.check()
        if self.figure is not None:
            garment = self.take.garment if self.take is not None else None
            return worn(self.result, garment, self.figure, self.seconds, spacing=self.spacing, progress=progress)
        recording = prepare(self.take) if self.take is not None else hung_swatch(fabric_of(self.result))
        if self.motion:
            recording = new_motion(recording, self.motion, self.seconds)
        spacing = SWATCH_SPACING if self.spacing is None and self.take is None else self.spacing
        apart = LAYERS_APART if recording.garment.seams else 0.0
        return motion_of(self.result, recording, spacing, layers_apart=apart, progress=progress)


def check_film(path: Path, size: tuple[int, int] = DEFAULT_SIZE, *, overwrite: bool = False) -> None:
    """Refuse an output file that cannot be written, before any simulation.

    Raises:
        FitError: an unknown format, or a size that no film has.
        OutputError: the file is there already and is not to be overwritten.
        ModuleNotFoundError: a library that writes it is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in ANIMATION_SUFFIXES:
        raise FitError(
            f"{suffix} is no format for motion" if suffix else "has no ending, which names the format",
            where=path,
            advice=nearest_first(suffix, ANIMATION_SUFFIXES, "give one of"),
        )
    if not all(SMALLEST_SIDE <= n <= LARGEST_SIDE and n % 2 == 0 for n in size):
        raise FitError(
            f"a film cannot have {size[0]} x {size[1]} pixels", where="--size",
            advice=f"give even numbers from {SMALLEST_SIDE} to {LARGEST_SIDE}, as in 960x720",
        )  # fmt: skip
    check_name(path)
    refuse_to_replace(path, overwrite=overwrite)
    check_libraries(*LIBRARIES_OF_FILMS.get(suffix, ()))


def animate(
    scene: Scene, path: Path, *, size: tuple[int, int] = DEFAULT_SIZE, overwrite: bool = False,
    show: Show = lambda share, text: None,
) -> Animated:  # fmt: skip
    """Simulate a scene and write it in the format of the path's suffix, atomically.

    Raises:
        FitError: an unknown format, a size that no film has, or a scene that cannot be simulated.
        OutputError: the file is there already and is not to be overwritten, or cannot be written.
    """
    check_film(path, size, overwrite=overwrite)
    scene.check()
    with output_folder(path.parent):
        return _animated(scene, path, size, show, overwrite=overwrite)


def _animated(scene: Scene, path: Path, size: tuple[int, int], show: Show, *, overwrite: bool) -> Animated:
    suffix = path.suffix.lower()
    is_film = suffix in FILMS
    moving = scene.moving(_part(show, "simulating", 0.0, SIMULATED_SHARE if is_film else SIMULATED_OF_MESH))
    if not is_film:
        show(SIMULATED_OF_MESH, "writing")
    moving = dataclasses.replace(moving, remarks=(*remarks_on_take(scene.result, scene.take), *moving.remarks))
    fabric = None if why_no_fabric(scene.result) else fabric_of(scene.result)
    if suffix == ".usdc":
        raw = caches.usd_cache(scene.result, fabric, moving)
    elif suffix == ".glb":
        raw = caches.gltf(scene.result, fabric, moving)
    else:
        drawn = _part(show, "drawing", SIMULATED_SHARE, 1.0)
        words = " ".join([*caches.words(scene.result, fabric), *moving.remarks])
        raw = film(moving, suffix, words, size, lambda done, total: drawn(done / total))
    write_bytes(path, raw, overwrite=overwrite)
    told = dict.fromkeys([*doubts(scene.result, fabric), *moving.remarks])
    return Animated(path, tuple(told))


def _part(show: Show, doing: str, first: float, last: float) -> Progress:
    """Return a progress display for one part of the whole work."""
    show(first, doing)
    return lambda share: show(first + share * (last - first), doing)

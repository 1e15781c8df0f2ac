"""The fitted cloth seen moving: under a take's hanger or a new motion, as a film, a GIF or a cache."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fit.errors import FitError
from fit.export import caches
from fit.export.fabric import fabric_of, why_no_fabric
from fit.export.moving import Moving, motion_of
from fit.export.new_motion import hung_swatch, new_motion
from fit.export.sheet import SWATCH_SPACING, check_spacing
from fit.export.video import CODECS, DEFAULT_SIZE, film
from fit.recordings.recording import prepare
from formats.fit_records import FitResult
from formats.outputs import check_name, make_output_folder, refuse_to_replace, write_bytes
from formats.take import Take

FILMS = (*CODECS, ".gif")
SUFFIXES = (*FILMS, ".usdc", ".glb")
SMALLEST, LARGEST = 64, 4096  # px
LAYERS_APART = 2e-3  # m, of sewn garments: a thick fabric (KES, at 0.05 kPa: 0.2 to 2 mm)

Show = Callable[[float, str], None]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A garment and its motion: the take's own where `motion` is empty; without a take, a swatch of the fabric."""

    result: FitResult
    take: Take | None = None
    motion: str = ""
    seconds: float = 6.0  # of a new motion
    spacing: float | None = None  # m

    def moving(self) -> Moving:
        """Simulate it.

        Raises:
            FitError: neither take nor motion, a fit without a fabric and without a take, or an unknown motion.
        """
        if self.take is None and not self.motion:
            raise FitError(
                "a fit alone holds no motion", where="--take",
                advice="name a take, or a --motion for a swatch of the fabric",
            )  # fmt: skip
        recording = prepare(self.take) if self.take is not None else hung_swatch(fabric_of(self.result))
        if self.motion:
            recording = new_motion(recording, self.motion, self.seconds)
        spacing = SWATCH_SPACING if self.spacing is None and self.take is None else self.spacing
        apart = LAYERS_APART if recording.garment.seams else 0.0
        return motion_of(self.result, recording, spacing, layers_apart=apart)


def animate(
    scene: Scene, path: Path, *, size: tuple[int, int] = DEFAULT_SIZE, overwrite: bool = False,
    show: Show = lambda share, text: None,
) -> Path:  # fmt: skip
    """Simulate a scene and write it in the format of the path's end, whole or not at all.

    Raises:
        FitError: an unknown format, a size that no film has, or a scene that cannot be simulated.
        OutputError: the file is there already and is not to be overwritten, or cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FitError(
            f"{suffix or 'no ending'} is no format for motion", where=path, advice=f"use {', '.join(SUFFIXES)}"
        )
    if not all(SMALLEST <= n <= LARGEST and n % 2 == 0 for n in size):
        raise FitError(
            f"no film is {size[0]} x {size[1]} pixels large", where="--size",
            advice=f"give even numbers from {SMALLEST} to {LARGEST}, as in 960x720",
        )  # fmt: skip
    check_spacing(scene.spacing)
    check_name(path)
    if not overwrite:
        refuse_to_replace(path)
    make_output_folder(path.parent)
    show(0.0, "simulating")
    moving = scene.moving()
    fabric = None if why_no_fabric(scene.result) else fabric_of(scene.result)
    if suffix == ".usdc":
        raw = caches.usd_cache(scene.result, fabric, moving)
    elif suffix == ".glb":
        raw = caches.gltf(scene.result, fabric, moving)
    else:
        begun = clock.monotonic()

        def drawn(done: int, total: int) -> None:
            left = (clock.monotonic() - begun) / done * (total - done)
            show(done / total, f"picture {done} of {total}, {left:.0f} s left")

        raw = film(moving, suffix, " ".join(caches.words(scene.result, fabric)), size, drawn)
    write_bytes(path, raw)
    return path

"""A swatch with a grid of markers, swung before a motion capture system: noisy marker paths, and the truth.

The set-up is that of "Optimization of Cloth Simulation Parameters by Considering Static and Dynamic Features", section
2. A swatch of 50 cm square with 81 markers is driven at the two top corners and swung back and forth. The system takes
500 frames at 120 frames a second, of four fabrics. The fabrics' true properties are set here and differ from every
table value that a fit may start from. `firmware_host.synthetic.cloth` simulates the cloth, with other equations and
numerics than a fit.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_host.errors import SensorAddressError
from firmware_host.synthetic.cloth import MOST_DRAG, ClothPhysics, simulate
from formats.arrays import Floats
from formats.descriptions import dump_description
from formats.garment import Garment
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.outputs import output_folder, refuse_to_replace, write_bytes, write_text
from formats.swatch import MARKERS, SWATCH_SIDE, swatch

SWATCH_FPS, SWATCH_FRAMES = 120.0, 500  # section 2
# of the cloth's grid between two markers. Our choice: finer than the markers by a whole number. Half and double were
# not tried.
CELLS_BETWEEN_MARKERS = 3
HELD_APART = 0.92  # of the swatch's width, distance of the held corners: fingers do not stretch it
UNEVENNESS = 5e-3  # m: no cloth hangs perfectly flat, and a flat one would never fold
MARKER_NOISE = 2e-4  # m per axis; optical systems have 0.1 to 0.5 mm
LOST_SHARE, LOST_FRAMES = 0.01, 12  # share of a marker's frames, and s of each gap
TO_SENSOR = np.array(
    [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
)  # x right, y into the room, z up -> x, y down, z


@dataclass(frozen=True, kw_only=True)
class TrueFabric:
    """The true properties of a synthetic fabric: density [kg/m^2] and cloth physics."""

    density: float
    physics: ClothPhysics


TRUE_FABRICS = {
    "silk": TrueFabric(
        density=0.075,
        physics=ClothPhysics(stretch_stiffness=130.0, shear_stiffness=16.0, bending_stiffness=5e-6, linear_damping=1.9),
    ),
    "denim": TrueFabric(
        density=0.38,
        physics=ClothPhysics(
            stretch_stiffness=700.0, shear_stiffness=90.0, bending_stiffness=1.3e-4, linear_damping=0.5
        ),
    ),
    "cotton": TrueFabric(
        density=0.14,
        physics=ClothPhysics(
            stretch_stiffness=450.0, shear_stiffness=50.0, bending_stiffness=2.6e-5, linear_damping=1.5
        ),
    ),
    "polyester-rayon": TrueFabric(
        density=0.22,
        physics=ClothPhysics(
            stretch_stiffness=170.0, shear_stiffness=20.0, bending_stiffness=1.6e-5, linear_damping=0.7
        ),
    ),
}
SWATCH_MOTIONS = {  # Hz, m, phase
    "swing": ((0.7, 0.10, 0.0), (1.3, 0.02, 1.0)),
    "other": ((0.5, 0.09, 0.4), (1.0, 0.06, 0.0)),
    "slow": ((0.35, 0.15, 0.0), (1.1, 0.03, 0.6)),
}


def make_swatch_take(
    out: Path, *, fabric: str, motion: str = "swing", air_drag: float = 0.0, seed: int = 1,
    progress: Callable[[float], None] = lambda share: None, overwrite: bool = False,
) -> list[Path]:  # fmt: skip
    """Write FABRIC-MOTION.csv, its .truth.npz and FABRIC.toml into `out`; return the paths.

    Raises:
        SensorAddressError: there is no such fabric or motion, or a number is invalid.
        OutputError: the folder cannot be made or written to, or one of the files is there with something else in it and
            they are not to be overwritten.
    """
    if fabric not in TRUE_FABRICS:
        raise SensorAddressError(
            f"there is no fabric {fabric!r}", where="--fabric", advice=f"choose one of {', '.join(TRUE_FABRICS)}"
        )
    if not 0.0 <= air_drag <= MOST_DRAG:
        raise SensorAddressError(
            f"{air_drag:g} is no drag coefficient", where="--air-drag", advice=f"give 0 to {MOST_DRAG:g}"
        )
    if seed < 0:
        raise SensorAddressError(f"the seed {seed} is below 0", where="--seed", advice="give 0 or more")
    true = TRUE_FABRICS[fabric]
    garment = swatch(round(true.density * SWATCH_SIDE**2, 6), name=fabric)
    stem, described = f"{fabric}-{motion}", dump_description(garment)
    marks, truth, description = paths = [out / f"{stem}.csv", out / f"{stem}.truth.npz", out / f"{fabric}.toml"]
    for path in paths:
        refuse_to_replace(path, described if path == description else None, overwrite=overwrite)
    with output_folder(out, ".csv", ".toml"):
        time = np.arange(SWATCH_FRAMES) / SWATCH_FPS
        nodes = swung_markers(garment, time, motion, true, air_drag=air_drag, progress=progress)
        seen = measured(nodes, np.random.default_rng([seed, 81]))
        tracks = MarkerTracks(garment.point_names, time, seen)
        content = io.BytesIO()
        np.savez(
            content, time=time, markers=nodes, density=true.density, air_drag=air_drag,
            **{name: getattr(true.physics, name) for name in ClothPhysics.__dataclass_fields__},
        )  # fmt: skip
        write_bytes(truth, content.getvalue())
        write_text(description, described)
        write_marker_csv(marks, tracks)
    return paths


def swung_markers(
    garment: Garment, time: Floats, motion: str, true: TrueFabric, *, air_drag: float = 0.0,
    cells: int = CELLS_BETWEEN_MARKERS,
    progress: Callable[[float], None] = lambda share: None,
) -> Floats:  # fmt: skip
    """Return the true marker positions [m], (frames, 81, 3), z up, of a swatch swung back and forth by its corners.

    Raises:
        SensorAddressError: there is no such motion.
    """
    if motion not in SWATCH_MOTIONS:
        raise SensorAddressError(
            f"there is no motion {motion!r}", where="--motion", advice=f"choose one of {', '.join(SWATCH_MOTIONS)}"
        )
    half = 0.5 * HELD_APART * SWATCH_SIDE

    def ends(instants: Floats) -> Floats:
        ramp = np.clip(instants / 0.5, 0.0, 1.0)
        ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
        swung = sum(a * (np.sin(2 * np.pi * f * instants + p) - np.sin(p)) for f, a, p in SWATCH_MOTIONS[motion]) * ramp
        place = np.zeros((len(instants), 2, 3))
        place[:, 0, 0], place[:, 1, 0] = -half, half
        place[:, :, 2] = np.asarray(swung)[:, None]
        return place

    count = (MARKERS - 1) * cells + 1
    down, across = np.linspace(0, 1, count)[:, None], np.linspace(0, 1, count)[None]
    uneven = UNEVENNESS * down * (np.sin(2 * np.pi * across) + np.sin(3 * np.pi * across + 1.0))
    nodes = simulate(
        garment, ends, time, physics=true.physics, effects={"air_drag": air_drag} if air_drag else {}, rows=count,
        columns=count, unevenness=uneven, progress=progress,
    )  # fmt: skip
    return np.asarray(nodes[:, ::cells, ::cells].reshape(len(time), -1, 3) @ TO_SENSOR)


def measured(markers: Floats, generator: np.random.Generator) -> Floats:
    """Return markers, (frames, markers, 3), as a motion capture system measures them: with noise, and NaN in gaps."""
    seen = markers + MARKER_NOISE * generator.standard_normal(markers.shape)
    frames, count = markers.shape[:2]
    begins = generator.random((frames, count)) < LOST_SHARE / LOST_FRAMES
    for frame, marker in np.argwhere(begins):
        seen[frame : frame + LOST_FRAMES, marker] = np.nan
    return np.asarray(seen)

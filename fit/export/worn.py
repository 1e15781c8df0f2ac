"""Simulation of a fitted skirt or T-shirt on a walking figure, with checks for intersections, and a fine mesh.

The cloth is drawn with smaller triangles than its elements, on the elements' cubic surface. Effects on hanger and
measurement are omitted, because there is neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fit.cloth import material as mat
from fit.cloth.contact import divided
from fit.cloth.crossings import crossings
from fit.cloth.effect import parameter_names
from fit.cloth.launch import Progress
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.errors import BlowUpError, FitError, out_of_range
from fit.export.fabric import fabric_of
from fit.export.moving import CONTACT, Moving, check_engine, known_effects, material_rows
from fit.export.new_motion import MOTION_FPS, SHORTEST_MOTION, hung_still
from fit.export.solids import Solids
from fit.figure.bvh import read_bvh
from fit.figure.dressmaking import plain_skirt, sewn_skirt
from fit.figure.gait import ARM_OUT, NORMAL_SPEED, check_speed, walk
from fit.figure.parts import figure_in, figure_in_shirt
from fit.figure.shirt import arms_out, plain_shirt, sewn_shirt
from fit.figure.skeleton import STANDARD_HEIGHT, SkeletonMotion
from fit.figure.wearing import DEEPEST, looked_at, wear
from formats.arrays import Singles
from formats.fit_records import FitResult
from formats.garment import Garment
from formats.meant_units import TIME_UNITS, UNITS

GAITS = ("walk",)
PLAIN_GARMENTS = {"skirt": plain_skirt, "t-shirt": plain_shirt}  # of an areal density
WORN_GARMENTS = tuple(PLAIN_GARMENTS)
GARMENT_NAMES = {"skirt": "skirt", "t-shirt": "T-shirt"}
SPACING = 0.03  # m between nodes: folds of a skirt are several times wider
# m between the vertices of the drawn mesh. Our choice: 7 px of a figure of 1.7 m on 1000 px. Half takes four times the
# triangles; double was not tried.
WORN_SPACING = 0.012
LONGEST_WALK = 20.0  # s: single precision resolves micrometres over the distance of this walk
# m. Our choice: from a toddler to beyond the tallest players; outside is a height in another unit.
SHORTEST_FIGURE, TALLEST_FIGURE = 0.8, 2.3
FEET = ("feet", 0.3048)  # m: NIST Handbook 44, appendix C; a person's height may be known in them
MOST_STRAIN = 0.15  # strain: woven cloth stretches by some percent, on the bias by more
# Share of the cloth, whose largest strain is reported as well. Our choice: it leaves out single corners, and no result
# depends on it.
MOSTLY = 0.99
# s, of a T-shirt's bending. The slanted pieces of its sleeves would need ten times shorter steps for 20 ms.
MOST_BENDING_TIME = 2e-3
SLIDING_SHARED = (mat.DENSITY, mat.STRETCH, mat.SHEAR, mat.BENDING)  # for layers that slide on one another


@dataclass(frozen=True, kw_only=True)
class FigureOrder:
    """Request of a figure: procedural walk or BVH file, and its garment if no take provides one."""

    kind: str = "walk"
    wear: str = "skirt"
    bvh: Path | None = None
    speed: float = NORMAL_SPEED  # m/s
    height: float = STANDARD_HEIGHT  # m

    def check(self, seconds: float) -> None:
        """Refuse invalid requests of a figure.

        Raises:
            FitError: an unknown kind or garment, or a speed, a height or a length that no walk has.
        """
        if self.kind not in GAITS:
            raise FitError(f"no figure moves by {self.kind!r}", where="--figure", advice=f"known: {', '.join(GAITS)}")
        if self.wear not in WORN_GARMENTS:
            raise FitError(
                f"no figure wears {self.wear!r}", where="--wear", advice=f"known: {', '.join(WORN_GARMENTS)}"
            )
        if not SHORTEST_FIGURE <= self.height <= TALLEST_FIGURE:
            raise out_of_range(
                self.height, SHORTEST_FIGURE, TALLEST_FIGURE, f"nobody is {self.height:g} m tall", where="--height",
                unit="m", units=(*UNITS, FEET),
            )  # fmt: skip
        if not SHORTEST_MOTION <= seconds <= LONGEST_WALK:
            raise out_of_range(
                seconds, SHORTEST_MOTION, LONGEST_WALK, f"{seconds:g} s is no length for a figure's walk",
                where="--seconds", unit="s", units=TIME_UNITS,
            )  # fmt: skip
        if self.bvh is None:
            check_speed(self.speed)

    def skeleton(self, seconds: float, arms: float = ARM_OUT) -> SkeletonMotion:
        """Return the figure's joints; arms_out [rad]: initial angle of the arms; raises as `check` and `read_bvh`."""
        self.check(seconds)
        if self.bvh is not None:
            return read_bvh(self.bvh, self.height, seconds, arms)
        return walk(seconds, self.speed, self.height, arms)


def sewn(garment: Garment) -> tuple[Garment, float]:
    """Return a garment for a figure with its back, and each layer's share of the flat sheet's weight and stiffness.

    Raises:
        FitError: no figure can wear it.
    """
    return sewn_shirt(garment) if garment.kind == "t-shirt" else sewn_skirt(garment)


def worn(
    result: FitResult, garment: Garment | None, order: FigureOrder, seconds: float, *, spacing: float | None = None,
    progress: Progress | None = None,
) -> Moving:  # fmt: skip
    """Return a skirt or T-shirt on a walking figure; without a garment, a plain one of the fitted fabric.

    Raises:
        FitError: an invalid garment or motion, or a figure that walks through the cloth. BlowUpError: the simulation
        did not stay finite.
    """
    check_engine(result)
    flat = PLAIN_GARMENTS[order.wear](fabric_of(result)["areal_density"].value) if garment is None else garment
    closed, share = sewn(flat)
    is_shirt = closed.kind == "t-shirt"
    skeleton = order.skeleton(seconds, arms_out(closed)) if is_shirt else order.skeleton(seconds)
    asked, seconds = seconds, min(seconds, np.floor(skeleton.seconds * MOTION_FPS) / MOTION_FPS)
    figure = figure_in_shirt(closed, skeleton) if is_shirt else figure_in(closed, skeleton)
    dressed = wear(hung_still(closed, flat.name), figure, seconds, MOTION_FPS)
    effects = tuple(e for e in known_effects(result) if e.acts_on in ("cloth", "air") and e != CONTACT)
    simulator = Simulator(
        dressed.recording, effects, resolution=Resolution(spacing=spacing or SPACING), support=dressed.support,
        contact=dressed.contact,
    )  # fmt: skip
    row = material_rows(result, closed.mass_kg / float(simulator.mesh.area) / share)
    row[:, SLIDING_SHARED] *= share
    damped = float(row[0, mat.BENDING_TIME])
    if is_shirt:
        row[:, mat.BENDING_TIME] = min(damped, MOST_BENDING_TIME)
    amplitudes = np.array([[result.effects[name] for e in effects for name in parameter_names(e)]])
    done = simulator.run(row, amplitudes, shapes=True, progress=progress)
    if done.shapes is None or not np.isfinite(done.shapes).all():
        raise BlowUpError(
            f"the {GARMENT_NAMES[closed.kind]} on the figure blew up",
            where=flat.name,
            advice="use a coarser mesh (a larger spacing)",
        )
    shapes, time = done.shapes[0], dressed.recording.time
    bodies, motion = figure.only(figure.touching)
    trouble = looked_at(simulator.surface, shapes, time, bodies, motion)
    if (found := trouble.first()) is not None:
        frame, part = found
        raise FitError(
            f"the figure walks through the cloth with its {figure.touching[part].replace('_', ' ')} in frame {frame}, "
            f"at {time[frame]:.2f} s", where=flat.name,
            advice=f"let it move slower, or give a wider {GARMENT_NAMES[closed.kind]}",
        )  # fmt: skip
    crossed = [crossings(simulator.surface, nodes.astype(float)) for nodes in shapes]
    samples, quads = divided(simulator.mesh, WORN_SPACING)
    triangles = np.concatenate([quads[:, [0, 2, 3]], quads[:, [0, 3, 1]]]).astype(np.int64)
    return Moving(
        name=flat.name, time=time, places=np.stack([samples.apply(n.astype(float)).astype(np.float32) for n in shapes]),
        triangles=triangles, rest=samples.apply(simulator.mesh.rest), points=done.points[0],
        point_names=closed.point_names, held=dressed.recording.held(time).reshape(-1, 2, 3),
        figure=Solids(figure.names, figure.bodies, figure.motion),
        remarks=(
            *_shortened(order, asked, float(seconds)),
            *_less_damped(damped, float(row[0, mat.BENDING_TIME])),
            *_remarks(GARMENT_NAMES[closed.kind], crossed, float(trouble.depths.max()), _stretched(simulator, shapes)),
        ),
    )  # fmt: skip


def _shortened(order: FigureOrder, asked: float, seconds: float) -> tuple[str, ...]:
    """Return a remark if a motion ends before the requested length [s], else nothing."""
    if order.bvh is None or seconds > asked - 1 / MOTION_FPS:
        return ()
    return (f"{order.bvh.name} ends early: the motion lasts {seconds:.1f} s, its lead included, and not {asked:g} s.",)


def _less_damped(fitted: float, used: float) -> tuple[str, ...]:
    """Return a remark if bending is damped less than in the fit, from damping times [s], else nothing."""
    if used >= fitted:
        return ()
    return (
        f"Bending damps over {1e3 * used:g} ms here and over {1e3 * fitted:.3g} ms in the fit: its steps are longer.",
    )


def _stretched(simulator: Simulator, shapes: Singles) -> tuple[float, float]:
    """Return the largest strain between samples of contact, and the largest quantile `MOSTLY` of a frame's strains."""
    surface = simulator.surface
    sides = np.concatenate([surface.quads[:, pair] for pair in ([0, 1], [0, 2])])
    rest = surface.samples.apply(simulator.mesh.rest)
    length = np.linalg.norm(rest[sides[:, 0]] - rest[sides[:, 1]], axis=1)
    most, mostly = 0.0, 0.0
    for nodes in shapes:
        places = surface.samples.apply(nodes.astype(float))
        stretch = np.linalg.norm(places[sides[:, 0]] - places[sides[:, 1]], axis=1) / length
        most, mostly = max(most, float(stretch.max())), max(mostly, float(np.quantile(stretch, MOSTLY)))
    return most - 1, max(mostly - 1, 0.0)


def _remarks(kind: str, crossed: list[int], deepest: float, stretched: tuple[float, float]) -> tuple[str, ...]:
    """Return remarks on self-intersections, on penetration of the body, and on large strains."""
    pictures = sum(1 for count in crossed if count)
    itself = (
        f"The {kind} crosses itself in none of {len(crossed)} frames." if not pictures else
        f"The {kind} crosses itself in {pictures} of {len(crossed)} frames, at {sum(crossed)} places in all."
    )  # fmt: skip
    body = (
        f"Cloth and body overlap by up to {1e3 * deepest:.1f} mm; more than {1e3 * DEEPEST:g} mm are refused."
        if deepest > 0 else
        f"Cloth and body stay at least {-1e3 * deepest:.1f} mm apart."
    )  # fmt: skip
    most, mostly = stretched
    if most <= MOST_STRAIN:
        return itself, body
    far = (
        f"The {kind} is stretched by up to {100 * most:.0f} %, and {100 * MOSTLY:.0f} % of it by {100 * mostly:.0f} % "
        f"at most. The {kind} is tight for these steps, or its fabric is soft."
    )
    return itself, body, far

"""Set-up of a garment on a figure: a skirt's band or a T-shirt's collar follows the body, and the rest hangs freely.

The initial skirt surrounds the standing figure. Each cross-section is the curve of the skirt's own girth there
(`fit.figure.parts`), and the cloth settles from this shape. The band is fixed to the hips without slip. A T-shirt
starts from the shape that `fit.figure.dressing` computes. Its collar is fixed to the neck, and contact alone supports
its shoulders.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.cloth.contact import Contact, Surface
from fit.cloth.crossings import pierces
from fit.cloth.mesh import ClothMesh
from fit.cloth.support import FIRST_SWING, Support, Supporting
from fit.errors import FitError
from fit.figure.collar import APART, collar_nodes, collar_places
from fit.figure.dressing import dressed
from fit.figure.dressmaking import ends_at, girth
from fit.figure.parts import CLEARANCE, Figure, round_of
from fit.recordings.bodies import Body, BodyMotion, placed
from fit.recordings.recording import Curve, Recording
from formats.arrays import Booleans, Floats, Indices
from formats.garment import Garment
from formats.nature import GRAVITY

BEGINS_APART = CLEARANCE + 3e-3  # m: initial distance of a T-shirt's nodes from the body; between nodes cloth is nearer
BODY_FRICTION = 0.3  # 1: smooth woven fabric on skin or tights, which slide
LAYERS_APART = 2e-3  # m: a thick fabric (KES, at 0.05 kPa: 0.2 to 2 mm)
SAMPLES_APART = 0.025  # m; our choice: below the radius of every part, so that no part passes between two samples
DEEPEST = 0.012  # m inside a body: deeper cloth is not pinched between thighs, but a leg passed through it


@dataclass(frozen=True, eq=False)
class Worn:
    """A garment on a figure, prepared for simulation."""

    recording: Recording
    support: Supporting
    contact: Contact


def wear(recording: Recording, figure: Figure, seconds: float, fps: float) -> Worn:
    """Return a recording of a sewn garment on a figure, without tracked points, at `fps` frames a second."""
    time = np.arange(round(seconds * fps) + 1) / fps
    count = recording.points.shape[1]
    bodies, motion = figure.only(figure.touching)
    worn = replace(
        recording, time=time, points=np.full((len(time), count, 3), np.nan), valid=np.zeros((len(time), count), bool),
        windows=None, bodies=(), held=lambda instants: _ends(recording.garment, figure, instants),
        held_seen=_ends(recording.garment, figure, time), held_time=None,
        edge_turn=lambda instants: np.zeros((len(instants), 2)),
    )  # fmt: skip
    contact = Contact(
        thickness=LAYERS_APART, friction=BODY_FRICTION, bodies=bodies, clearance=CLEARANCE, spacing=SAMPLES_APART,
        motion=motion,
    )  # fmt: skip
    return Worn(worn, held_by(recording.garment, figure), contact)


def held_by(garment: Garment, figure: Figure) -> Supporting:
    """Return the support of a sewn garment: a skirt's band on the hips, or a T-shirt's collar round the neck."""

    def support(mesh: ClothMesh) -> Support:
        path = _band_path(figure)
        frame = figure.band[0, 3:].reshape(3, 3)
        if garment.kind == "t-shirt":
            held, way = collar_nodes(garment, mesh)
            places = collar_places(way, _is_back(mesh)[held], _collar_radius(figure), figure.half_side)
            start = _dressed(garment, mesh, figure, held, figure.band[0, :3] + places @ frame)
        else:
            held, skirt = mesh.held_nodes, around(garment, mesh, figure.half_side)
            places, start = skirt[held], figure.band[0, :3] + skirt @ frame
        return Support(
            nodes=held,
            shares=np.column_stack([np.ones(len(held)), places]),
            path=path,
            start=lambda handles: np.repeat(start[None], len(handles), 0),
            settle_damping=float(2 * FIRST_SWING * np.sqrt(GRAVITY / np.ptp(mesh.rest[:, 1]))),
        )

    return support


def around(garment: Garment, mesh: ClothMesh, half_side: float) -> Floats:
    """Return initial positions of a sewn skirt's nodes [m], (nodes, 3): left, back and up from the band."""
    below = mesh.rest[:, 1].max() - mesh.rest[:, 1]
    if round_of(girth(garment, below), half_side).min() <= 0:
        raise FitError(
            "the skirt is too narrow to go round a figure",
            where=garment.name,
            advice="give a wider one, or a smaller figure (--height)",
        )
    places = _round(garment, mesh, half_side)
    heights = np.linspace(0, below.max(), 101)
    radii = round_of(girth(garment, heights), half_side)
    fall = np.sqrt(np.clip(1 - (np.diff(radii) / np.diff(heights)) ** 2, 0.25, 1.0))
    places[:, 2] = -np.interp(below, heights, np.concatenate([[0.0], np.cumsum(fall * np.diff(heights))]))
    return places


def _collar_radius(figure: Figure) -> float:
    """Return the radius of a T-shirt's collar [m]."""
    return figure.bodies[figure.names.index("neck")].radius + APART


def _is_back(mesh: ClothMesh) -> Booleans:
    """Return which nodes of two layers belong to the back only, (nodes,)."""
    is_back = np.ones(len(mesh.rest), bool)
    is_back[mesh.cells[: len(mesh.cells) // 2]] = False
    return is_back


def _dressed(garment: Garment, mesh: ClothMesh, figure: Figure, held: Indices, places: Floats) -> Floats:
    """Return initial positions of a sewn T-shirt's nodes [m], (nodes, 3), world frame, and of its held nodes [m]."""
    names = [name for name in figure.names if name in figure.touching]
    bodies, motion = figure.only(tuple(names))
    standing = tuple(placed(body, pose) for body, pose in zip(bodies, motion.poses[0], strict=True))
    origin = figure.band[0, :3] - [0, 0, max(y for _, y in garment.outline_m)]
    return dressed(mesh, _is_back(mesh), held, places, origin, standing, BEGINS_APART)


def _round(garment: Garment, mesh: ClothMesh, half_side: float) -> Floats:
    """Return positions on cross-sections of a skirt [m], (nodes, 3): left and back, with height 0."""
    below = mesh.rest[:, 1].max() - mesh.rest[:, 1]
    left, right = ends_at(garment, below)
    u = np.clip((mesh.rest[:, 0] - left) / (right - left), 0, 1)
    radius = round_of(girth(garment, below), half_side)
    return _curve(u * (np.pi * radius + 2 * half_side), radius, half_side, _is_back(mesh))


def _curve(way: Floats, radius: Floats, half_side: float, is_back: Booleans) -> Floats:
    """Return positions on curves of two half circles and two straight sides [m], (n, 3): left, back, height 0.

    way [m], (n,): arc length along either layer from the right end
    """
    quarter = np.pi * radius / 2
    first, last = np.clip(way / radius, 0, np.pi / 2), np.clip((way - quarter - 2 * half_side) / radius, 0, np.pi / 2)
    across = -half_side - radius * np.cos(first) + np.clip(way - quarter, 0, 2 * half_side) + radius * np.sin(last)
    depth = radius * (np.sin(first) - 1 + np.cos(last))
    return np.stack([across, np.where(is_back, depth, -depth), 0 * depth], 1)


def _band_path(figure: Figure) -> Curve:
    """Return the centre of the band and its axes at instants [s], (n,) -> (n, 12)."""
    from scipy.interpolate import CubicSpline

    last = figure.motion.spacing * (len(figure.band) - 1)
    curve = CubicSpline(np.linspace(0, last, len(figure.band)), figure.band)
    return lambda instants: np.asarray(curve(np.clip(instants, 0, last)))


def _ends(garment: Garment, figure: Figure, instants: Floats) -> Floats:
    """Return the two seams' ends at the band [m], (n, 6)."""
    pose = _band_path(figure)(instants)
    radius = (
        _collar_radius(figure)
        if garment.kind == "t-shirt"
        else float(round_of(girth(garment, np.zeros(1)), figure.half_side)[0])
    )
    half = figure.half_side + radius
    return np.concatenate([pose[:, :3] - half * pose[:, 3:6], pose[:, :3] + half * pose[:, 3:6]], 1)


@dataclass(frozen=True, eq=False)
class Trouble:
    """Interpenetration of cloth and bodies, per frame.

    - `depths` [m], (frames, bodies): penetration depth of the cloth into a body, negative if outside
    - `is_through`, (frames, bodies): whether the axis of a body passes through the cloth
    """

    depths: Floats
    is_through: Booleans

    def first(self) -> tuple[int, int] | None:
        """Return the first frame in which a body passes through the cloth, and the body's index; None if none does."""
        bad = self.is_through | (self.depths > DEEPEST)
        return None if not bad.any() else (int(np.argmax(bad.any(1))), int(np.argmax(bad[np.argmax(bad.any(1))])))


def looked_at(surface: Surface, shapes: Floats, time: Floats, bodies: tuple[Body, ...], motion: BodyMotion) -> Trouble:
    """Return the interpenetration of cloth and bodies; shapes [m], (frames, nodes, 3), at instants [s]."""
    poses, quads = motion.at(time), surface.quads
    triangles = np.concatenate([quads[:, [0, 2, 3]], quads[:, [0, 3, 1]]])
    halves = np.array([body.half_size[2] for body in bodies])[:, None]
    deep, through = np.empty((len(time), len(bodies))), np.zeros((len(time), len(bodies)), bool)
    for n, nodes in enumerate(shapes):
        places = surface.samples.apply(nodes.astype(float))
        deep[n] = [-placed(b, pose).distance(places).min() for b, pose in zip(bodies, poses[n], strict=True)]
        along = halves * poses[n, :, 9:]
        corners = np.tile(places[triangles], (len(bodies), 1, 1))
        start, end = (np.repeat(poses[n, :, :3] + sign * along, len(triangles), 0) for sign in (-1, 1))
        through[n] = pierces(start, end, corners).reshape(len(bodies), -1).any(1)
    return Trouble(deep, through)

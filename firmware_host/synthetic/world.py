"""One swung garment with its true positions, from which the synthetic sensor renders frames.

A tracked point is visible where it falls into the image and nothing is nearer on its ray:

    z_point < max of true depth over the 3 x 3 pixels around it + 6 mm

The neighbours count because a corner lies on the edge of its cloth, which does not hide the corner.
`firmware_host.synthetic.visibility` computes the visible share of its surroundings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from firmware_host.errors import SensorAddressError
from firmware_host.synthetic.cloth import COLUMNS, ROWS, ClothPhysics, simulate
from firmware_host.synthetic.depth_noise import spoil
from firmware_host.synthetic.lengths import LONGEST_RECORDING, SHORTEST_RECORDING
from firmware_host.synthetic.motion import SHORTEST_MOVING, START, STOP_SHARE, hanger_pose
from firmware_host.synthetic.pattern import lay
from firmware_host.synthetic.render import Renderer, View
from firmware_host.synthetic.scene import CAMERA, FPS, HANGER_REST, Placement, demo_garment, place
from firmware_host.synthetic.surroundings import Panel, Surroundings
from firmware_host.synthetic.visibility import PointSight, point_sight
from formats.arrays import Booleans, Bytes, Floats, Unsigned
from formats.garment import Garment

Progress = Callable[[str, float], None]

TYPICAL = {"none": 0.0, "air_drag": 1.2, "hem": 0.02, "time_offset": 0.03}
LARGEST_TIME_OFFSET = 0.5  # s, bound on a planted time offset of either sign: a silhouette's latency has this size
EXPOSURE = 0.008  # s; our choice: a lit room, at 0.5 m/s 4 mm of blur; half and double were not tried
PIXEL_NOISE = 2.0  # of 255, standard deviation; our choice: no camera's was measured, half and double were not tried
FIRST_STAMP = 0.001  # s: OpenNI ignores a frame at time 0
NODES_OF_BODY = {"t-shirt": (24, 17)}  # nodes down and across, of a garment that is not a panel
# A sleeve is a tube of two layers with a hem, so it is stiffer than a flat sheet.
# The fabrics of a skirt. Felt is far from the starting values of fits.
PLAIN = "plain"
SKIRT_FABRICS = {
    PLAIN: ClothPhysics(),
    "felt": ClothPhysics(stretch_stiffness=90.0, shear_stiffness=14.0, bending_stiffness=1.6e-4, linear_damping=3.5),
}
GARMENT_PHYSICS = {"t-shirt": ClothPhysics(bending_stiffness=1e-3, shear_stiffness=120.0)}
HIDING_STEP = 6e-3  # m by which a surface must be nearer to hide a point: a folded corner lies 10 mm behind
NEAREST_SWING = 0.35  # m towards the sensor, an allowance in the density of drawn points


@dataclass(frozen=True)
class World:
    """Truth in the sensor frame: time [s], (n,); hanger; nodes [m], (n, rows, columns, 3); points [m], (n, 5, 3).

    in_front: objects between sensor and garment, per frame; empty if there are none
    surroundings: None for the bare wall of the demo
    """

    time: Floats
    hanger: Placement
    nodes: Floats
    points: Floats
    seed: int
    garment: Garment = field(default_factory=demo_garment)
    surroundings: Surroundings | None = None
    in_front: tuple[tuple[Panel, ...], ...] = ()

    def at(self, distance: float, *, seed: int, surroundings: Surroundings) -> World:
        """Return the same motion with another rest distance of the hanger [m], other surroundings and other noise."""
        shift = np.array([0.0, 0.0, distance - HANGER_REST[2]])
        hanger = Placement(self.hanger.origin + shift, self.hanger.rotation)
        return replace(
            self, hanger=hanger, nodes=self.nodes + shift, points=self.points + shift, seed=seed,
            surroundings=surroundings,
        )  # fmt: skip

    def visible(self, number: int, renderer: Renderer) -> Booleans:
        """Return which tracked points are visible to the camera in this frame, (points,); the clamp bar hides none."""
        scene = self._without_hanger(number, renderer)
        seen = np.zeros(len(self.points[number]), bool)
        for k, (x, y, z) in enumerate(self.points[number]):
            column, row = round(CAMERA.fx * x / z + CAMERA.cx), round(CAMERA.fy * y / z + CAMERA.cy)
            around = scene.depth[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
            is_inside = 0 <= column < CAMERA.width and 0 <= row < CAMERA.height
            seen[k] = is_inside and z < around.max() + HIDING_STEP
        return seen

    def sight(self, number: int, renderer: Renderer) -> PointSight:
        """Return the visibility of the tracked points and of the cloth around them in this frame."""
        flat = np.array([point.at_m for point in self.garment.points])
        in_front = self.in_front[number] if self.in_front else ()
        in_view = self.visible(number, renderer)
        return point_sight(self.nodes[number], self.points[number], flat, in_view, renderer, in_front)

    def _without_hanger(self, number: int, renderer: Renderer) -> View:
        return renderer.cloth(self.nodes[number], self.in_front[number] if self.in_front else ())

    def frame(self, number: int, renderer: Renderer) -> tuple[Unsigned, Bytes]:
        """Render one frame with the camera's faults; the same number gives the same images.

        Only the hanger is blurred, since nothing reads the cloth's colour.
        """
        rng = np.random.default_rng([self.seed, number])
        origin, rotation = self.hanger.origin, self.hanger.rotation
        ahead, behind = min(number + 1, len(self.time) - 1), max(number - 1, 0)
        span = self.time[ahead] - self.time[behind]
        scene = self._without_hanger(number, renderer)

        def view(step: float) -> View:
            turned, _, back = np.linalg.svd(rotation[number] + step * (rotation[ahead] - rotation[behind]))
            return renderer.with_hanger(scene, origin[number] + step * (origin[ahead] - origin[behind]), turned @ back)

        middle = renderer.with_hanger(scene, origin[number], rotation[number])
        # Motion blur: the middle of the exposure and both its ends.
        colour = middle.colour + view(-0.5 * EXPOSURE / span).colour + view(0.5 * EXPOSURE / span).colour
        colour = colour / 3 + PIXEL_NOISE * rng.standard_normal((CAMERA.height, CAMERA.width, 1))
        return spoil(middle.depth, CAMERA, rng), np.clip(np.rint(colour), 0, 255).astype(np.uint8)

    def renderer(self) -> Renderer:
        """Return a renderer for this world's cloth."""
        rows, columns = self.nodes.shape[1:3] if len(self.garment.outline_m) == 4 else NODES_OF_BODY[self.garment.kind]
        pattern = lay(self.garment, rows, columns)
        if self.surroundings is None:
            return Renderer(pattern)
        nearest = float(self.hanger.origin[:, 2].min()) - NEAREST_SWING
        return Renderer(pattern, self.surroundings, spacing=0.5 * nearest / CAMERA.fx)


def make_world(
    *, motion: str, effect: str, amplitude: float | None, seconds: float, seed: int,
    progress: Progress = lambda stage, share: None, garment: Garment | None = None, fabric: str = PLAIN,
    rest: float = START,
) -> World:  # fmt: skip
    """Simulate the demo's skirt, or another garment, under a named motion with a planted effect.

    The effect has an amplitude or, where none is given, its typical one. A garment that has physics of its own takes
    the plain fabric alone. The hand begins after `rest` seconds.

    Raises:
        SensorAddressError: there is no such effect, motion or fabric, the garment takes no other fabric than the plain
            one, or a number is invalid.
    """
    if fabric not in SKIRT_FABRICS:
        raise SensorAddressError(
            f"there is no fabric {fabric!r}", where="--fabric", advice=f"choose one of {', '.join(SKIRT_FABRICS)}"
        )
    if effect not in TYPICAL:
        raise SensorAddressError(
            f"the synthetic world has no effect {effect!r}",
            where="--effect",
            advice=f"choose one of {', '.join(TYPICAL)}",
        )
    size = TYPICAL[effect] if amplitude is None else amplitude
    if not SHORTEST_RECORDING <= seconds <= LONGEST_RECORDING:
        raise SensorAddressError(
            f"the synthetic world cannot last for {seconds:g} seconds",
            where="--seconds",
            advice=f"give {SHORTEST_RECORDING:g} to {LONGEST_RECORDING:g}",
        )
    longest_rest = max(STOP_SHARE * seconds - SHORTEST_MOVING, START)  # in the shortest worlds nothing moves
    if not 0 <= rest <= longest_rest:
        raise SensorAddressError(
            f"the hand cannot rest for the first {rest:g} of {seconds:g} seconds",
            where="--rest",
            advice=f"give 0 to {longest_rest:g}, or a longer recording",
        )
    if not np.isfinite(size):
        raise SensorAddressError(
            f"{size:g} is no size of an effect", where="--amplitude", advice="give a finite number"
        )
    if effect == "none" and size:
        raise SensorAddressError(
            f"the amplitude {size:g} is of no effect", where="--amplitude",
            advice=f"name the effect too: one of {', '.join(TYPICAL)}",
        )  # fmt: skip
    if effect == "time_offset" and not abs(size) <= LARGEST_TIME_OFFSET:
        raise SensorAddressError(
            f"time_offset cannot be {size:g} s", where="--amplitude",
            advice=f"choose {-LARGEST_TIME_OFFSET:g} to {LARGEST_TIME_OFFSET:g}",
        )  # fmt: skip
    if seed < 0:
        raise SensorAddressError(f"the seed {seed} is below 0", where="--seed", advice="give 0 or more")
    time = np.arange(round(seconds * FPS)) / FPS
    garment = garment or demo_garment()
    if fabric != PLAIN and garment.kind in GARMENT_PHYSICS:
        raise SensorAddressError(
            f"the {garment.name} has a fabric of its own", where="--fabric",
            advice="leave out the fabric, or swing the skirt or the swatch",
        )  # fmt: skip
    rows, columns = NODES_OF_BODY.get(garment.kind, (ROWS, COLUMNS))

    def placed(times: Floats) -> Placement:
        pose = hanger_pose(motion, times, seed, seconds, rest)
        return place(pose.displacement, pose.yaw, pose.roll)

    seen = np.maximum(time - size, 0.0) if effect == "time_offset" else time
    effects = {effect: size} if effect in {"air_drag", "hem"} else {}
    physics = GARMENT_PHYSICS.get(garment.kind, SKIRT_FABRICS[fabric])
    nodes = simulate(
        garment, lambda times: placed(times).held, seen, physics=physics, effects=effects,
        progress=lambda share: progress("cloth", share), rows=rows, columns=columns,
    )  # fmt: skip
    pattern = lay(garment, rows, columns)
    points = np.empty((len(time), len(garment.points), 3))
    for k, point in enumerate(garment.points):
        at, weights = pattern.material(point.at_m)
        points[:, k] = np.einsum("nkx,k->nx", nodes[:, at[:, 0], at[:, 1]], weights)
    return World(time, placed(time), nodes, points, seed, garment)

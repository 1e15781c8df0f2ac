"""One swung skirt with all its truth, ready to be seen frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_host.errors import SensorAddressError
from firmware_host.synthetic.cloth import ClothPhysics, simulate
from firmware_host.synthetic.depth_noise import spoil
from firmware_host.synthetic.motion import hanger_pose
from firmware_host.synthetic.render import Renderer
from firmware_host.synthetic.scene import CAMERA, FPS, Placement, demo_garment, place

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]

TYPICAL = {"none": 0.0, "air_drag": 1.2, "hem": 0.02, "time_offset": 0.03}
EXPOSURE = 0.008  # s
PIXEL_NOISE = 2.0  # of 255
FIRST_STAMP = 0.001  # s: OpenNI ignores a frame at time 0


@dataclass(frozen=True)
class World:
    """Truth in the sensor frame: time [s], (n,); hanger; nodes [m], (n, rows, columns, 3); points [m], (n, 5, 3)."""

    time: Floats
    hanger: Placement
    nodes: Floats
    points: Floats
    seed: int

    def frame(self, number: int, renderer: Renderer) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
        """Render one frame with the camera's faults; the same number gives the same images."""
        rng = np.random.default_rng([self.seed, number])
        origin, rotation, nodes = self.hanger.origin, self.hanger.rotation, self.nodes
        ahead, behind = min(number + 1, len(self.time) - 1), max(number - 1, 0)
        span = self.time[ahead] - self.time[behind]
        middle = renderer.view(origin[number], rotation[number], nodes[number])
        colour = middle.colour
        # Motion blur: the middle of the exposure and both its ends.
        for step in (-0.5 * EXPOSURE / span, 0.5 * EXPOSURE / span):
            turned, _, back = np.linalg.svd(rotation[number] + step * (rotation[ahead] - rotation[behind]))
            moved = origin[number] + step * (origin[ahead] - origin[behind])
            colour = (
                colour
                + renderer.view(moved, turned @ back, nodes[number] + step * (nodes[ahead] - nodes[behind])).colour
            )
        colour = colour / 3 + PIXEL_NOISE * rng.standard_normal((CAMERA.height, CAMERA.width, 1))
        return spoil(middle.depth, CAMERA, rng), np.clip(np.rint(colour), 0, 255).astype(np.uint8)

    def renderer(self) -> Renderer:
        """Return a renderer for this world's cloth."""
        _, rows, columns, _ = self.nodes.shape
        outline = np.array(demo_garment().outline_m)
        return Renderer(rows, columns, float(np.ptp(outline[:, 1])), float(np.ptp(outline[:, 0])))


def make_world(
    *, motion: str, effect: str, amplitude: float | None, seconds: float, seed: int,
    progress: Progress = lambda stage, share: None,
) -> World:  # fmt: skip
    """Simulate the skirt under a named motion with a planted effect at an amplitude, or its typical one.

    Raises:
        SensorAddressError: there is no such effect or motion.
    """
    if effect not in TYPICAL:
        raise SensorAddressError(
            f"the synthetic world has no effect {effect!r}", advice=f"choose of {', '.join(TYPICAL)}"
        )
    size = TYPICAL[effect] if amplitude is None else amplitude
    time = np.arange(round(seconds * FPS)) / FPS
    garment = demo_garment()

    def placed(times: Floats) -> Placement:
        pose = hanger_pose(motion, times, seed, seconds)
        return place(pose.displacement, pose.yaw, pose.roll)

    seen = np.maximum(time - size, 0.0) if effect == "time_offset" else time
    effects = {effect: size} if effect in {"air_drag", "hem"} else {}
    nodes = simulate(
        garment, lambda times: placed(times).held, seen, physics=ClothPhysics(), effects=effects,
        progress=lambda share: progress("cloth", share),
    )  # fmt: skip
    corners = nodes[:, [0, 0, -1, -1], [0, -1, -1, 0]]
    # The centre lies on the middle line; its depth as a share of the height, linear between nodes.
    share = -garment.points[4].at_m[1] / -garment.outline_m[2][1] * (nodes.shape[1] - 1)
    row, column = int(share), 0.5 * (nodes.shape[2] - 1)
    middle = 0.5 * (nodes[:, :, int(np.floor(column))] + nodes[:, :, int(np.ceil(column))])
    centre = (1 - (share - row)) * middle[:, row] + (share - row) * middle[:, row + 1]
    return World(time, placed(time), nodes, np.concatenate([corners, centre[:, None]], 1), seed)

"""The scenes of the tracking benchmark: three garments, four distances, two backgrounds, two swings, several sets.

Each set simulates every garment under every swing once, with its own seeds. Each garment is shown at all distances, in
turn before a bare wall and in a furnished room. In one scene a garment, an arm hides a lower corner. It comes from the
left for an even seed, from the right for an odd one. The sets `development` serve for debugging and for training.
Published figures come from `report-5`, since the earlier sets were seen while rules were chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from firmware_host.depth_sensor import DepthSensor, SensorFrame, SensorInfo
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import CAMERA, FPS
from firmware_host.synthetic.visibility import PointSight
from firmware_host.synthetic.world import FIRST_STAMP, World, make_world
from tests.firmware_host.rooms import arm, cluttered, plain

DISTANCES = (1.2, 1.6, 2.0, 2.5)  # m
SWINGS = ("mixed", "hard")
SEEDS = {
    "development": 100, "development-2": 200, "development-3": 300, "development-4": 400, "development-5": 600,
    "development-6": 150, "development-7": 250, "development-8": 350, "development-9": 450, "development-10": 550,
    "development-11": 651,
    "report": 900, "report-2": 700, "report-3": 800, "report-4": 500, "report-5": 607719,
}  # fmt: skip
SECONDS = 3.4
FIRST, LAST = 0.6, 3.2  # s, the part that is used: still, swung, stopped, ringing down


@dataclass(frozen=True)
class Scene:
    """The description of a scene."""

    garment: str
    swing: str
    distance: float
    background: str
    has_arm: bool
    seed: int

    @property
    def name(self) -> str:
        """One word."""
        arm_word = "-arm" if self.has_arm else ""
        return f"{self.garment}-{self.swing}-{self.distance}-{self.background}{arm_word}-{self.seed}"


@dataclass(frozen=True)
class Shown:
    """Frames of a scene with their truth: time [s]; markers, points [m]; each point's visibility, (n, points).

    in_view, pixels, share: see `firmware_host.synthetic.visibility.PointSight`
    """

    scene: Scene
    time: np.ndarray
    depth: np.ndarray
    colour: np.ndarray
    markers: np.ndarray
    points: np.ndarray
    in_view: np.ndarray
    pixels: np.ndarray
    share: np.ndarray

    @property
    def sight(self) -> PointSight:
        """Return the true visibility of every point in every frame."""
        return PointSight(self.in_view, self.pixels, self.share)


def scenes(chosen: str) -> Iterator[tuple[Scene, Callable[[], World]]]:
    """Yield the scenes of a set with functions that build their worlds; each cloth is simulated once, on demand."""
    for g, garment in enumerate(GARMENTS):
        for s, swing in enumerate(SWINGS):
            seed = SEEDS[chosen] + 10 * g + s
            swung = cache(partial(_swung, garment, swing, seed))
            for k, distance in enumerate(DISTANCES):
                background = ("plain", "cluttered")[(k + s) % 2]
                scene = Scene(garment, swing, distance, background, False, seed + 1000 * k)
                yield scene, partial(_world, swung, scene)
            if swing == "mixed":
                scene = Scene(garment, swing, 1.6, "plain", True, seed + 9000)
                yield scene, partial(_world, swung, scene)


def _swung(garment: str, swing: str, seed: int) -> World:
    return make_world(
        motion=swing, effect="air_drag", amplitude=None, seconds=SECONDS, seed=seed, garment=GARMENTS[garment]()
    )


def _world(swung: Callable[[], World], scene: Scene) -> World:
    world = swung()
    around = plain(scene.distance) if scene.background == "plain" else cluttered(scene.distance, scene.seed)
    shown = world.at(scene.distance, seed=scene.seed, surroundings=around)
    if scene.has_arm:
        side = (-1.0, 1.0)[scene.seed % 2]
        level = float(world.points[0, 2, 1]) - 0.03
        shares = (world.time - 1.2) / 1.4
        shown = replace(shown, in_front=tuple(arm(scene.distance, level, float(share), side) for share in shares))
    return shown


def show(scene: Scene, make: Callable[[], World], keep: Path | None = None) -> Shown:
    """Render a scene's frames, or read them from the cache."""
    path = keep / f"{scene.name}.npz" if keep else None
    if path and path.exists():
        with np.load(path) as kept:
            return Shown(scene, **{name: kept[name] for name in kept.files})
    world = make()
    renderer = world.renderer()
    numbers = np.flatnonzero((world.time >= FIRST) & (world.time < LAST))
    frames = [world.frame(int(n), renderer) for n in numbers]
    sights = [world.sight(int(n), renderer) for n in numbers]
    shown = Shown(
        scene,
        time=world.time[numbers] + FIRST_STAMP,
        depth=np.stack([depth for depth, _ in frames]),
        colour=np.stack([colour for _, colour in frames]),
        markers=world.hanger.markers[numbers],
        points=world.points[numbers],
        in_view=np.stack([sight.in_view for sight in sights]),
        pixels=np.stack([sight.pixels for sight in sights]),
        share=np.stack([sight.share for sight in sights]),
    )
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **{part.name: getattr(shown, part.name) for part in fields(shown) if part.name != "scene"})
    return shown


class ShownSensor(DepthSensor):
    """Plays rendered frames, so that only tracking takes time."""

    def __init__(self, shown: Shown) -> None:
        self._shown, self._next = shown, 0

    @property
    def info(self) -> SensorInfo:
        """Return the synthetic sensor's properties."""
        return SensorInfo(
            name="drawn", uri=self._shown.scene.name, width=CAMERA.width, height=CAMERA.height, fps=FPS,
            intrinsics=CAMERA, is_live=False, frame_count=len(self._shown.time),
        )  # fmt: skip

    def read(self, timeout_s: float = 5.0) -> SensorFrame | None:
        """Return the next frame."""
        if self._next == len(self._shown.time):
            return None
        k = self._next
        self._next += 1
        return SensorFrame(
            index=k, time_s=float(self._shown.time[k]), host_time_s=0.0, depth=self._shown.depth[k],
            colour=self._shown.colour[k],
        )  # fmt: skip

    def close(self) -> None:
        """Nothing to close."""

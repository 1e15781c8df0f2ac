"""Engine of the Kinect-skirt method that runs Blender's cloth in a separate process.

The six parameters go to Blender's cloth settings unchanged: mass per vertex, stiffness and damping of tension and
compression, bending stiffness, air. Shear is a tenth of tension, as in `fit.methods.kinect_skirt`. Velocity is the
share of each velocity kept per frame of 1/25 s. Today's Blender has no such setting, so a drag of the same rate stands
for it. Blender's drag is 0.01 Air on each vertex. Its rate is

    0.01 Air / Mass - 25 ln(Velocity) = 0.01 Air' / Mass'        [1/s]

and Air' may not pass 10. Mass, stiffnesses and drag times one number change no motion of elastic forces. So a candidate
that needs more drag is simulated with all of them smaller. Blender's spring damping is a force too and is scaled along.
Blender's numbers act per vertex and spring. So their meaning depends on the mesh, as in the paper.

The garment starts flat below its first held ends and reaches them within half a second. It settles for 1.5 s and then
follows the recording. `bpy` comes from this Python, or from the one that HANGTIME_BLENDER_PYTHON names.

Source: Blender manual, "Physics", "Cloth", "Settings".
"""

from __future__ import annotations

import numpy as np

from fit.cloth.effect import Effect
from fit.cloth.model import Resolution
from fit.engines.plain_grid import PlainGrid, plain_grid
from fit.errors import FitError
from fit.foreign.process import BLENDER, ForeignProcess
from fit.methods.method import Parameterisation
from fit.recordings.recording import Recording
from formats.arrays import Floats

# Frames a second that Blender simulates; the recording's instants are interpolated. Blender's cloth advances by 1/30 s
# a frame at every frame rate of the scene (24 to 60 tried). So no other rate keeps time. Measured with 5.0.1, tested
# with 5.2.3.
BLENDER_FPS = 30
APPROACH, SETTLE = 0.5, 1.5  # s to reach the first held ends, and to come to rest
SHEAR_OF_TENSION = 0.1  # 1, as in `fit.methods.kinect_skirt`
MOST_AIR = 10.0  # Blender's largest air_damping
AIR_RATE = 0.01  # N s/m per vertex and unit of air_damping
FRAMES_PER_SECOND_OF_VELOCITY = 25.0  # 1/s: the method's Velocity is a share kept per frame of 1/25 s
PARAMETERS_NEEDED = ("mass", "struct", "bend", "spring", "air", "velocity")


def check_blender(method: Parameterisation, effects: tuple[Effect, ...]) -> None:
    """Refuse a request that Blender's cloth cannot simulate, or a missing Blender.

    Raises:
        FitError: another method than kinect-skirt, effects, or no `bpy`.
    """
    _check_fit(method, effects)
    if not BLENDER.is_installed():
        raise BLENDER.absent()


def _check_fit(method: Parameterisation, effects: tuple[Effect, ...]) -> None:
    if tuple(p.name for p in method.parameters) != PARAMETERS_NEEDED:
        raise FitError(
            f"Blender has no {method.name} parameters", where="--engine", advice="use --method kinect-skirt with it"
        )
    if effects:
        raise FitError(
            "Blender's cloth cannot be given effects",
            where="--effect",
            advice="leave out --effect, or --engine blender",
        )


class BlenderEngine:
    """Blender's cloth for one recording."""

    def __init__(
        self, recording: Recording, method: Parameterisation, effects: tuple[Effect, ...], resolution: Resolution
    ) -> None:
        """Prepare the hanger's motion for Blender.

        Raises:
            FitError: another method than kinect-skirt, effects, bodies in the rig, or no `bpy`.
        """
        _check_fit(method, effects)
        if recording.bodies:
            raise FitError("Blender's cloth is given no bodies", where=recording.take_id, advice="leave out --engine")
        self._recording = recording
        self.grid = plain_grid(recording.garment, resolution.spacing)
        self._path = _driven_path(recording, self.grid)
        self._worker = ForeignProcess(BLENDER)

    @property
    def version(self) -> str:
        """Return Blender's version."""
        return self._worker.version

    def points(self, vectors: Floats) -> Floats:
        """Simulate one candidate after the other in Blender."""
        nodes = self._worker.answer(
            quads=self.grid.quads, pinned=self.grid.held_nodes, fps=np.array(BLENDER_FPS), path=self._path,
            settings=blender_settings(vectors),
        )["nodes"].astype(float)  # fmt: skip
        points = np.einsum("pw,cfpwx->cfpx", self.grid.point_weights, nodes[:, :, self.grid.point_nodes])
        instants = (self._recording.time + APPROACH + SETTLE) * BLENDER_FPS
        before = np.minimum(instants.astype(int), points.shape[1] - 2)
        share = (instants - before)[:, None, None]
        return np.asarray((1 - share) * points[:, before] + share * points[:, before + 1])


def blender_settings(vectors: Floats) -> Floats:
    """Return mass, tension, bending, damping, air and shear, (candidates, 6), of the method's six parameters."""
    mass, struct, bend, spring, air, velocity = vectors.T
    rate = AIR_RATE * air / mass - FRAMES_PER_SECOND_OF_VELOCITY * np.log(velocity)
    shrink = np.minimum(1.0, MOST_AIR * AIR_RATE / (rate * mass))
    scaled = np.stack([mass, struct, bend, spring, rate * mass / AIR_RATE, SHEAR_OF_TENSION * struct], 1)
    return np.asarray(scaled * shrink[:, None])


def _driven_path(recording: Recording, grid: PlainGrid) -> Floats:
    """Return node positions [m], (frames, nodes, 3): flat first; in later frames only the held nodes count."""
    frames = int(np.ceil((recording.duration + APPROACH + SETTLE) * BLENDER_FPS)) + 2
    instants = np.arange(frames) / BLENDER_FPS - APPROACH - SETTLE
    ends = recording.held(np.maximum(instants, 0.0)).reshape(frames, 2, 3)
    share = grid.held_fraction[None, :, None]
    held = (1 - share) * ends[:, None, 0] + share * ends[:, None, 1]
    along = ends[0, 1] - ends[0, 0]
    along = along / np.linalg.norm(along)
    local = grid.rest - 0.5 * (grid.rest[grid.held_nodes[0]] + grid.rest[grid.held_nodes[-1]])
    flat = ends[0].mean(0) + local[:, :1] * along + local[:, 1:] * np.array([0.0, 0.0, 1.0])
    path = np.repeat(flat[None], frames, 0)
    lead = np.clip((instants + APPROACH + SETTLE) / APPROACH, 0.0, 1.0)[:, None, None]
    path[:, grid.held_nodes] = (1 - lead) * flat[None, grid.held_nodes] + lead * held
    return path

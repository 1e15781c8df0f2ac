"""Clip slack: the held ends are nearer to each other, or further apart, than the rig's file states.

    held_k(t) = measured_k(t) ± (a / 2) x(t)

towards each other for positive a, so that the top edge sags or folds between them.

The amplitude is a: positive where the clips are nearer to each other than the rig says.

Believe it when the top edge sags or folds in every take. Measure the distance between the clips.

Source: kinematics; a tape measure over clips is off by 2 to 20 mm.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Curve, Effect
from fit.recordings.hanger_path import hanger_axes
from fit.recordings.recording import Recording
from formats.arrays import Floats


@dataclass(frozen=True)
class ClipSlack(Effect):
    """Distance by which the held ends are nearer than measured."""

    name: ClassVar[str] = "clip_slack"
    title: ClassVar[str] = "slack between the clips"
    acts_on: ClassVar[str] = "boundary"
    unit: ClassVar[str] = "m"
    low: ClassVar[float] = -0.03  # our choice: as far as `high`
    high: ClassVar[float] = 0.03  # our choice: half as much again as the 20 mm of a tape measure
    typical: ClassVar[float] = 0.008  # our choice: within the 2 to 20 mm of a tape measure
    # Our choice: on either side of the typical size, as a fold is far from linear.
    probes: ClassVar[tuple[float, ...]] = (0.003, 0.018)

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends, moved towards each other."""

        def drive(instants: Floats) -> Floats:
            ends = path(instants)
            inwards = 0.5 * amplitude[0] * hanger_axes(ends)[:, :, 0]
            return np.asarray(ends + np.concatenate([inwards, -inwards], 1))

        return drive

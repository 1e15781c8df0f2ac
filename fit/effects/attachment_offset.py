"""Attachment offset: the cloth hangs from another place of the hanger than the rig says.

    held_k(t) = measured_k(t) + R(t) d

with the axes of the hanger's frame as the columns of R (`formats.hanger`).

The amplitude is d [m] along, down and out of the hanger's frame; positive lets the cloth hang further along that
axis.

Believe it when points near the held edge miss by the same vector in every take. A tape measure settles the question.

Source: rigid-body kinematics; offsets of a few millimetres to centimetres are what a tape measure gives.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Curve, Effect
from fit.recordings.hanger_path import hanger_axes
from fit.recordings.recording import Recording
from formats.arrays import Floats


@dataclass(frozen=True)
class AttachmentOffset(Effect):
    """Offset of the held edge in the hanger's frame."""

    name: ClassVar[str] = "attachment_offset"
    title: ClassVar[str] = "cloth attached elsewhere on the hanger"
    acts_on: ClassVar[str] = "boundary"
    unit: ClassVar[str] = "m"
    low: ClassVar[float] = -0.05  # our choice: as far as `high`
    high: ClassVar[float] = 0.05  # our choice: five times the typical size
    typical: ClassVar[float] = 0.01  # our choice: within the millimetres to centimetres of a tape measure
    # A clip holds a patch of cloth, which turns a little. Our choice: laws leave less than any law may, up to twice of
    # it (`fit.observer.edge.LEAST_BY_LAW`). So half and twice only change the amplitude's interval.
    law_spread: ClassVar[float] = 0.03
    components: ClassVar[tuple[str, ...]] = ("along", "down", "out")

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends, moved in the hanger's frame."""

        def drive(instants: Floats) -> Floats:
            ends = path(instants)
            return np.asarray(ends + np.tile(hanger_axes(ends) @ amplitude, 2))

        return drive

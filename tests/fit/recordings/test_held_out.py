"""The choice of held-out takes by their motion."""

from __future__ import annotations

import numpy as np
import pytest

from fit.errors import FitError
from fit.recordings.selection import split_by_motion
from tests.fit.scenes import sheet, take_of

TIME = np.arange(0, 2, 1 / 30)
WAVE = 0.05 * np.sin(2 * np.pi * TIME)
FACE_ON, SIDEWAYS = (
    take_of(sheet(), TIME, np.outer(WAVE, way), name=name) for name, way in (("a", [0, 1, 0]), ("b", [1, 0, 0]))
)


def test_takes_of_a_motion_are_held_out():
    assert split_by_motion([FACE_ON, SIDEWAYS], ["sideways"]) == ([FACE_ON], [SIDEWAYS])
    assert split_by_motion([FACE_ON, SIDEWAYS], []) == ([FACE_ON, SIDEWAYS], [])


def test_takes_that_cannot_be_held_out_are_named():
    with pytest.raises(FitError, match="no kind of motion named 'wobble'"):
        split_by_motion([FACE_ON], ["wobble"])
    with pytest.raises(FitError, match="no take moves 'twist'") as caught:
        split_by_motion([FACE_ON, SIDEWAYS], ["twist"])
    assert caught.value.advice == (
        "hold out another kind, or add a take of this one; the takes move like this: a face-on, b sideways"
    )
    with pytest.raises(FitError, match="none is left to fit to") as caught:
        split_by_motion([FACE_ON], ["face-on"])
    assert caught.value.advice == "add a take of another kind; the takes move like this: a face-on"

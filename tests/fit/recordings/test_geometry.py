"""Takes whose geometry is impossible are refused before anything is simulated."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import SI
from fit.recordings.geometry import check_geometry
from fit.recordings.recording import prepare
from formats.importers.swung_cloth import import_swung_cloth
from tests.fit.scenes import hung, sheet, swing, take_of
from tests.shared_data import SHARED_DATA

TIME = np.arange(60) / 30


def a_take(garment=None):
    """A 400 mm wide, 450 mm high sheet, swung stiffly."""
    flat = sheet()
    path = swing(TIME)
    take = take_of(flat, TIME, path, hung(flat, TIME) + path[:, None])
    return take if garment is None else dataclasses.replace(take, garment=garment)


def scaled(garment, factor):
    return msgspec.structs.replace(
        garment,
        outline_m=tuple((factor * x, factor * y) for x, y in garment.outline_m),
        points=tuple(msgspec.structs.replace(p, at_m=(factor * p.at_m[0], factor * p.at_m[1])) for p in garment.points),
    )


def test_a_possible_take_passes():
    check_geometry(prepare(a_take()))


@pytest.mark.parametrize(
    ("factor", "sentence"),
    [(0.5, "held ends are 400 mm apart, the garment's held edge is 200 mm"), (10.0, "held edge is 4000 mm long")],
)
def test_a_garment_in_another_unit_is_refused(factor, sentence):
    with pytest.raises(FitError, match=sentence):
        calibrate([a_take(scaled(sheet(), factor))], [], request_of(SI, [], iterations=1, seed=0, spacing=0.1))


def test_exchanged_held_ends_are_refused():
    """The top left point is 400 mm from what is called the left end."""
    take = a_take()
    with pytest.raises(FitError, match="'top_left' is 400 mm from the left held end, on the flat garment 0 mm"):
        check_geometry(prepare(dataclasses.replace(take, held=take.held[:, ::-1])))


def test_points_named_upside_down_are_refused():
    take = a_take()
    order = [3, 2, 1, 0, 4]
    with pytest.raises(FitError, match="'top_left' is 450 mm from the left held end"):
        check_geometry(prepare(dataclasses.replace(take, points=take.points[:, order])))


@pytest.mark.shared_data
def test_all_real_swung_cloth_passes():
    """Sixteen takes whose corners are 26 mm off in the median: poor, but possible."""
    files = sorted((SHARED_DATA / "swung-cloth").glob("*.npz"))
    if not files:
        pytest.skip("the real recordings are not here")
    for file in files:
        check_geometry(prepare(import_swung_cloth(file)))

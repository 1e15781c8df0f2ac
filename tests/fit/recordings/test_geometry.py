"""Takes whose geometry is impossible are refused before anything is simulated."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

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
from tests.fit.recordings.silhouettes import path, silhouette_sheet, swung, uneven
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


@pytest.mark.parametrize("off", [1.0, -0.399])
def test_held_ends_that_are_too_far_or_too_close_in_a_few_frames_are_no_reason_to_refuse(off):
    """Three of sixty frames, in which one end is a metre away or 1 mm from the other; the median counts."""
    recording = prepare(a_take())

    def held(instants):
        ends = recording.held(instants).copy()
        ends[:3, 3] += off
        return ends

    check_geometry(dataclasses.replace(recording, held=held))


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
@pytest.mark.slow
def test_all_real_swung_cloth_passes():
    """Sixteen takes whose corners are 26 mm off in the median: poor, but possible."""
    files = sorted((SHARED_DATA / "swung-cloth").glob("*.npz"))
    if not files:
        pytest.skip("the real recordings are not here")
    for file in files:
        check_geometry(prepare(import_swung_cloth(file)))


def held_at(*, edge=0.4, flat=0.2, away=0.2, frames=9, far=9):
    """Held ends 0.4 m apart on an edge of another length, and a point below the left one, so far away in some frames.

    The right end is twice as far from the point as it needs to be.
    """
    outline = ((0.0, 0.0), (edge, 0.0), (edge, -2.0), (0.0, -2.0))
    point = SimpleNamespace(name="low", at_m=(0.0, -flat))
    places = np.zeros((frames, 1, 3))
    places[:far, 0, 2] = -away
    places[far:, 0, 2] = -flat
    return SimpleNamespace(
        camera=SimpleNamespace(timing=None),
        garment=SimpleNamespace(outline_m=outline, points=[point]), time=np.arange(frames), take_id="a",
        held=lambda instants: np.tile([0.0, 0, 0, 0.4, 0, 0], (len(instants), 1)), seen_points=places,
        valid=np.ones((frames, 1), bool),
    )  # fmt: skip


@pytest.mark.parametrize(("edge", "is_possible"), [(0.271, False), (0.273, True), (1.6, True), (1.61, False)])
def test_held_ends_are_a_quarter_to_five_quarters_of_the_edge_and_a_little_slack_apart(edge, is_possible):
    """0.4 m: 1.25 e + 60 mm at the most, e / 4 at the least."""
    if is_possible:
        check_geometry(held_at(edge=edge))
    else:
        with pytest.raises(FitError, match="held ends are 400 mm apart"):
            check_geometry(held_at(edge=edge))


@pytest.mark.parametrize(("away", "is_possible"), [(0.309, True), (0.311, False)])
def test_a_point_is_a_quarter_further_from_a_held_end_than_on_the_cloth_and_a_little_slack(away, is_possible):
    """0.2 m: 250 mm and 60 mm, in the median of the frames."""
    check_geometry(held_at(away=away, far=4))
    unseen = held_at(away=away)
    unseen.valid[:] = False
    check_geometry(unseen)
    if is_possible:
        check_geometry(held_at(away=away))
    else:
        with pytest.raises(FitError, match=r"the point 'low' is 311 mm from the left held end, .* 200 mm"):
            check_geometry(held_at(away=away, far=5))


def test_points_far_from_a_path_of_another_clock_are_refused_for_that_clock():
    """The hanger swings at another rate and farther than the row that it holds by the take."""
    time = uneven()
    take = swung(silhouette_sheet(), time, time)
    fine = np.linspace(time[0], time[-1], 4000)
    slower = np.stack([np.interp(0.6 * time, fine, axis) for axis in path(fine).T], 1)
    far = take.held + ((3 * slower - path(time)) * [0, 1, 0])[:, None]
    recording = prepare(dataclasses.replace(take, held=far, markers=far))
    with pytest.raises(FitError, match="points' clock cannot be the hanger's"):
        check_geometry(recording)
    for explained, said in ((0.64, "64"), (0.694, "69"), (0.696, "69.6"), (0.69999, "69.9"), (-0.2, "0")):
        timing = dataclasses.replace(recording.camera.timing, explained=explained)
        told = dataclasses.replace(recording, camera=dataclasses.replace(recording.camera, timing=timing))
        with pytest.raises(FitError, match=rf"explain 70 % of the held row's motion \(best: {said} %\)"):
            check_geometry(told)
    timing = dataclasses.replace(recording.camera.timing, explained=0.704, latency=-0.49)
    told = dataclasses.replace(recording, camera=dataclasses.replace(recording.camera, timing=timing))
    words = r"motion, 70 %, at a shift of -0\.49 s, and none beyond 0\.5 s is looked at; check that path and points"
    with pytest.raises(FitError, match=words):
        check_geometry(told)


def test_points_of_a_silhouette_that_lie_beside_the_path_are_refused_where_they_were_seen():
    """200 mm to one side, more than 60 mm and a quarter of 214 mm; their material positions are below the path."""
    time = uneven()
    take = swung(silhouette_sheet(), time, time)
    check_geometry(prepare(take))
    beside = prepare(dataclasses.replace(take, points=take.points + np.array([0.2, 0.0, 0.0])))
    assert np.linalg.norm(np.nanmedian(beside.points - beside.seen_points, axis=(0, 1))) > 0.1
    with pytest.raises(FitError, match=r"is 414 mm from the left held end, on the flat garment 214 mm"):
        check_geometry(beside)

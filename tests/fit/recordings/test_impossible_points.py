"""Points that the cloth cannot reach, and hangers that move as no hand can."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.errors import DriveError
from fit.gap.gates import data_gates
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, sheet, swing, take_of

TIME = np.arange(0, 4, 1 / 60)  # s, 240 frames
GRID = 9  # points a side of 400 mm x 450 mm: 50 mm and 56 mm apart


def a_take(change=lambda points: None, *, sd=0.002):
    """A swung sheet with 81 points, 2 mm of noise, and a change of where they are."""
    garment, path = sheet(grid=GRID), swing(TIME)
    points = hung(garment, TIME) + path[:, None]
    points += np.random.default_rng(0).normal(0, sd, points.shape)
    change(points)
    return take_of(garment, TIME, path, points, sd=sd)


def left_out(take, recording):
    """Frame and point of every sighting that is left out."""
    return {(int(f), int(k)) for f, k in np.argwhere(take.points_valid & ~recording.valid)}


def hygiene(recording):
    return next(g for g in data_gates([recording], []) if g.name == "impossible points")


@pytest.mark.slow
def test_points_within_the_reach_of_the_cloth_are_all_kept():
    """Stretched by a fifth, with gaps: apparel may do that."""
    garment = sheet(grid=GRID)
    stretched = hung(garment, TIME) * [1.0, 1.0, 1.2]
    valid = np.random.default_rng(1).uniform(size=stretched.shape[:2]) > 0.1
    take = take_of(garment, TIME, swing(TIME), stretched + swing(TIME)[:, None], sd=0.002)
    take = dataclasses.replace(take, points_valid=valid)
    recording = prepare(take)
    assert left_out(take, recording) == set()
    assert recording.impossible == 0.0
    assert hygiene(recording).sentence == "No point is further from the others than the cloth reaches."


def test_two_markers_that_are_confused_are_left_out_and_no_other():
    """Neighbours 50 mm apart, for ten frames: each is 100 mm from its outer neighbour, 62 + 5 + 17 mm are possible."""

    def swap(points):
        points[100:110, [40, 41]] = points[100:110, [41, 40]]

    take = a_take(swap)
    recording = prepare(take)
    assert left_out(take, recording) == {(f, k) for f in range(100, 110) for k in (40, 41)}
    found = hygiene(recording)
    assert found.passed
    assert found.figure == pytest.approx(100 * 20 / (240 * 81))
    assert "These positions are left out." in found.sentence


def test_a_marker_that_jumps_out_of_the_cloth_is_left_out():
    def jump(points):
        points[50, 80] += [0.0, 0.3, 0.0]

    take = a_take(jump)
    assert left_out(take, prepare(take)) == {(50, 80)}


def test_a_take_with_many_impossible_points_is_not_diagnosed():
    """A tenth of the points is elsewhere by half a metre at random: of another marker set, which nothing repairs."""

    def scatter(points):
        wrong = np.random.default_rng(2).uniform(size=points.shape[:2]) < 0.1
        points[wrong] += np.random.default_rng(3).normal(0, 0.5, (wrong.sum(), 3))

    take = a_take(scatter)
    recording = prepare(take)
    assert left_out(take, recording) == set()
    found = hygiene(recording)
    assert not found.passed
    assert found.figure == pytest.approx(10, abs=1.5)
    assert "check the markers' names" in found.sentence


@pytest.mark.parametrize("frames", [1, 20, 140], ids=["one frame", "a third of a second", "to the end"])
def test_a_hanger_that_jumps_slower_than_a_marker_lost_in_the_room_is_refused(frames):
    """80 mm from one frame to the next are 4.8 m/s, which a hand may reach, and 288 m/s2, which it cannot."""
    take = a_take()
    take.held[100 : 100 + frames, :, 0] += 0.08
    with pytest.raises(DriveError, match=r"the hanger jumps at 1\.\d+ s \(\d{3} m/s2\); no hand moves like that"):
        prepare(take)


def test_a_hard_swing_seen_with_noise_is_no_jump():
    """40 m/s2 at 2 Hz and 0.25 m, frames 5 to 25 ms apart, 2 mm of noise on the held ends though 0.1 mm are stated."""
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.005, 0.025, 300))
    garment = sheet(grid=GRID)
    path = swing(time, amplitude=0.25, hz=2.0)
    take = take_of(garment, time, path, hung(garment, time) + path[:, None])
    take.held[...] += rng.normal(0, 0.002, take.held.shape)
    assert prepare(take).duration == pytest.approx(time[-1] - time[0])

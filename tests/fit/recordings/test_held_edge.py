"""What tracked points on the held edge tell of a slip, against slips that were put there."""

from __future__ import annotations

import numpy as np
import pytest

from fit.recordings.held_edge import HeldEdge
from tests.fit.scenes import swing

FRAME = 1 / 30
ACROSS = np.linspace(-0.2, 0.2, 5)


def edge(slip=0.0, at=3.0, noise=0.002, across=ACROSS, seed=0):
    """A held edge that sways, whose right end drops by `slip` [m] at some time, seen with noise; jerked at 1 s."""
    time = np.arange(0, 6, FRAME)
    path = swing(time, amplitude=0.05, hz=0.7, start=0.5)
    path[:, 1] += 0.03 * np.clip((time - 1.0) / 0.1, 0, 1)
    bar = np.array([0.2, 0.0, 0.0])
    ends = np.concatenate([path - bar, path + bar], 1)

    def held(instants):
        return np.stack([np.interp(instants, time, column) for column in ends.T], 1)

    points = path[:, None] + np.stack([across, 0 * across, 0 * across], 1)
    drop = slip * (across + 0.2) / 0.4
    points[:, :, 2] -= drop * (time > at)[:, None]
    return HeldEdge(time, points + np.random.default_rng(seed).normal(0, noise, points.shape), across, held)


@pytest.mark.parametrize("at", [1.7, 4.2])
def test_a_slip_is_where_one_side_drops_and_stays(at):
    assert edge(slip=0.004, at=at).slip_at() == pytest.approx(at, abs=0.1)


def test_one_corner_alone_shows_a_slip():
    assert edge(slip=0.006, at=4.2, across=np.array([-0.2, 0.2])).slip_at() == pytest.approx(4.2, abs=0.1)


def test_without_a_step_or_a_point_it_is_the_hardest_jerk():
    for held in (edge(), edge(seed=1), edge(slip=0.01, across=np.zeros(0))):
        assert held.slip_at() == pytest.approx(1.05, abs=0.1)


def test_gaps_are_passed_over():
    seen = edge(slip=0.004, at=4.2)
    seen.points[50:60] = np.nan
    seen.points[:, 4] = np.nan
    assert seen.slip_at() == pytest.approx(4.2, abs=0.1)


@pytest.mark.parametrize("off", [0.0, 0.02])
@pytest.mark.parametrize("missing", [0.0, 0.1])
def test_the_turn_of_the_edge_is_its_slope_whatever_is_off_or_missing(off, missing):
    """A roll of 20 mrad rms about the middle, 1 mm of noise on nine points 0.13 m from it in rms: 2.6 mrad a frame."""
    across = np.linspace(-0.2, 0.2, 9)
    seen = edge(noise=0.001, across=across)
    roll = 0.02 * np.sqrt(2) * np.sin(2 * np.pi * 0.5 * seen.time)
    seen.points[:, :, 2] += off + roll[:, None] * across
    seen.points[np.random.default_rng(1).uniform(size=seen.points.shape[:2]) < missing] = np.nan
    course, rms = seen.turn()
    turn = course(seen.time)[:, 1]
    assert np.corrcoef(turn, roll)[0, 1] > 0.995
    assert np.sqrt((turn**2).mean()) == pytest.approx(0.02, rel=0.1)
    assert rms[1] == pytest.approx(0.02, rel=0.1)


def test_an_edge_of_which_one_side_alone_is_seen_tells_no_turn():
    seen = edge(across=np.linspace(-0.2, 0.2, 9))
    seen.points[:, 3:] = np.nan
    course, rms = seen.turn()
    assert not course(seen.time).any()
    assert not rms.any()

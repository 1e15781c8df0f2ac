"""Kinds of motion, worked by hand: a bar that moves one way only, and errors in that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from formats.motion import axes_of, kind_of, reach_of
from formats.rig import Rig
from tests.fit.scenes import sheet, take_of

TIME = np.arange(0, 4, 1 / 30)
WAVE = 0.05 * np.sin(2 * np.pi * 0.75 * TIME)  # three whole swings: 0.05 / sqrt(2) rms


def moved(direction):
    return take_of(sheet(), TIME, np.outer(WAVE, direction))


def turned(angle):
    """The bar, 0.4 m long, turning about its middle by an angle [rad], (frames,)."""
    take = take_of(sheet(), TIME, np.zeros((len(TIME), 3)))
    half = 0.2 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    return replace(take, held=np.stack([-half, half], 1))


@pytest.mark.parametrize(
    ("kind", "take"),
    [
        ("sideways", moved([1, 0, 0])), ("face-on", moved([0, 1, 0])), ("up-and-down", moved([0, 0, 1])),
        ("twist", turned(0.3 * WAVE / 0.05)), ("mixed", moved([1, 1, 0])), ("still", moved([0.05, 0, 0])),
    ],
)  # fmt: skip
def test_the_way_the_bar_moves_names_the_motion(kind, take):
    assert kind_of(take) == kind


def test_the_reach_is_the_root_mean_square_of_the_middle_and_of_the_ends_turning():
    assert reach_of(moved([0, 1, 0]))["face-on"] == pytest.approx(0.05 / np.sqrt(2), rel=0.01)
    assert reach_of(turned(0.3 * WAVE / 0.05))["twist"] == pytest.approx(0.2 * 0.3 / np.sqrt(2), rel=0.01)


def test_the_rigs_gravity_says_what_is_up_and_down():
    """With the sensor's y down, motion along y is up and down."""
    take = moved([0, 1, 0])
    assert kind_of(replace(take, rig=Rig(format="hangtime-rig/1", name="r", gravity=(0.0, 1.0, 0.0)))) == "up-and-down"


def test_a_hanger_that_is_never_seen_is_still():
    take = moved([0, 1, 0])
    assert kind_of(replace(take, held_valid=np.zeros_like(take.held_valid))) == "still"


@pytest.mark.parametrize(("share", "kind"), [(0.71, "face-on"), (0.69, "mixed"), (0.31, "mixed"), (0.29, "sideways")])
def test_a_way_names_the_motion_where_it_has_more_than_seven_tenths_of_it(share, kind):
    assert kind_of(moved([np.sqrt(1 - share), np.sqrt(share), 0])) == kind


@pytest.mark.parametrize(("rms", "kind"), [(0.0041, "up-and-down"), (0.0039, "still")])
def test_a_motion_of_less_than_four_millimetres_is_none(rms, kind):
    assert kind_of(moved([0, 0, rms / np.std(WAVE)])) == kind


def test_of_a_single_sight_no_motion_is_reported():
    take = moved([0, 1, 0])
    once = np.zeros_like(take.held_valid)
    once[7] = True
    assert reach_of(replace(take, held_valid=once)) == dict.fromkeys(
        ("sideways", "face-on", "up-and-down", "twist"), 0.0
    )
    once[3] = True
    assert reach_of(replace(take, held_valid=once))["face-on"] == pytest.approx(abs(WAVE[7] - WAVE[3]) / 2)


def test_a_turn_of_more_than_half_a_round_goes_on():
    """Two rounds at one pace: the deviation of an even way of 4 pi is 4 pi / sqrt(12)."""
    turns = turned(np.linspace(0, 4 * np.pi, len(TIME)))
    assert reach_of(turns)["twist"] == pytest.approx(0.2 * 4 * np.pi / np.sqrt(12), rel=0.02)


def test_without_a_sight_the_axes_of_the_bar_are_nothing():
    take = moved([0, 1, 0])
    axes = axes_of(replace(take, held_valid=np.zeros_like(take.held_valid)))
    assert [axes[way].tolist() for way in ("sideways", "face-on", "up-and-down")] == [[0] * 3, [0] * 3, [0, 0, 1]]

"""Numbers of a block at their bounds, and its coding computed one by one as `formats/SPEC.md` says."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from formats.blocks import (
    ANGLE_STEP,
    FARTHEST_PLACE,
    LARGEST_SD,
    LATEST,
    MOST_TURN,
    PLACE_STEPS,
    SD_STEPS,
    SMALLEST_SD,
    TICKS,
    _filled,
    _quantised,
    _sd_codes,
    _steps,
    check_columns,
    cut_into_blocks,
    decode_blocks,
    encode_blocks,
)
from formats.errors import TakeError

POINTS, FRAMES = 3, 4


def columns(**changes):
    """Four frames of three points, changed at the second frame; a value of one frame, or of one place in it."""
    found = {
        "time": np.arange(FRAMES) / 10 + 5.0, "state": np.zeros(FRAMES), "quality": np.full(FRAMES, 0.5),
        "pitch": np.zeros(FRAMES), "pitch_sd": np.full(FRAMES, 0.01), "held_valid": np.ones((FRAMES, 2), bool),
        "points_valid": np.ones((FRAMES, POINTS), bool), "points_hidden": np.zeros((FRAMES, POINTS), bool),
        **{name: np.full((FRAMES, 2, 3), 0.5) for name in ("held", "markers")}, "points": np.ones((FRAMES, POINTS, 3)),
        "held_sd": np.full((FRAMES, 2, 3), 0.002), "points_sd": np.full((FRAMES, POINTS, 3), 0.003),
    }  # fmt: skip
    for name, value in changes.items():
        found[name][(1,) + (1,) * (found[name].ndim - 1)] = value
    return found


def check(given, after=-math.inf):
    check_columns(given, points=POINTS, take_id="a", first=70, after=after)


LEAST = sys.float_info.min


def more(value):
    return math.nextafter(value, math.inf)


def less(value):
    """The next number below; below 0 the next normal one, as Taichi lets the processor take subnormal ones for 0."""
    return math.nextafter(value, -math.inf) if value else -LEAST


NAN, FAR = math.nan, FARTHEST_PLACE
BOUNDS = [
    *(
        (name, ok, bad, f"{name} is {bad:g}, not between {least:g} and {most:g}; give one of these")
        for name, least, most in (("quality", 0.0, 1.0), ("pitch", -MOST_TURN, MOST_TURN))
        for ok, bad in ((least, less(least)), (most, more(most)), (NAN, less(least)))
    ),
    ("state", 65535, 65536, "state is 65536, not between 0 and 65535; give one of these"),
    ("state", 0, -1, "state is -1, not between 0 and 65535; give one of these"),
    ("state", 7, 7.5, "state is 7.5, no whole number; give one between 0 and 65535"),
    *(
        (name, ok, bad, f"{name} has a standard deviation of {bad:g}; give 0, or {SMALLEST_SD:g} to {LARGEST_SD:g}")
        for name in ("points_sd", "held_sd", "pitch_sd")
        for ok, bad in (
            (0.0, -LEAST), (SMALLEST_SD, less(SMALLEST_SD)), (LARGEST_SD, more(LARGEST_SD)), (math.inf, LEAST),
            (NAN, -math.inf),
        )
    ),
    *(
        (name, sign * FAR, sign * more(FAR), f"{thing} 1 lies {FAR:g} m away; give metres, at most {FAR:g}")
        for name, thing in (("points", "point"), ("held", "held end"), ("markers", "marker")) for sign in (1, -1)
    ),
    *(
        (name, 0.0, bad, f"{thing} 1 is marked valid but is not a number; mark it invalid, or give its place")
        for name, thing in (("points", "point"), ("held", "held end")) for bad in (NAN, math.inf)
    ),
    ("markers", NAN, math.inf, "marker 1 is infinite; give NaN where it was not seen"),
    ("markers", NAN, -math.inf, "marker 1 is infinite; give NaN where it was not seen"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "within", "beyond", "words"), BOUNDS)
def test_a_number_is_taken_up_to_its_bound_and_refused_beyond_it_with_its_frame(name, within, beyond, words):
    check(columns(**{name: within}))
    with pytest.raises(TakeError) as caught:
        check(columns(**{name: beyond}))
    assert str(caught.value) == f"a, frame 71: {words}"


@pytest.mark.parametrize("name", ["points", "held"])
@pytest.mark.parametrize("value", [NAN, math.inf, 1e9])
def test_a_place_that_is_not_valid_may_be_anything(name, value):
    given = columns(**{name: value})
    given[f"{name}_valid"][1, 1] = False
    check(given)


@pytest.mark.parametrize(("sign", "end"), [(1, -1), (-1, 0)])
def test_times_lie_within_three_centuries(sign, end):
    time = LATEST / TICKS * sign
    given = columns()
    given["time"] = np.sort(time - sign * np.arange(FRAMES))
    check(given)
    given["time"][end] = more(time) if sign > 0 else less(time)
    with pytest.raises(TakeError, match=r"lies centuries away; give it in seconds$"):
        check(given)


@pytest.mark.parametrize(
    ("after", "words"),
    [
        (5.0, "time goes from 5.000000 s to 5.000000 s; frames must come in the order of their time stamps"),
        (NAN, "time goes from nan s to 5.000000 s; frames must come in the order of their time stamps"),
        (less(5.0), "time goes from 5.000000000 s by less than a microsecond; leave out one of the two frames"),
        (5.0 - 0.4e-6, "time goes from 4.999999600 s by less than a microsecond; leave out one of the two frames"),
        (5.0 - 0.6e-6, ""), (-math.inf, ""),
    ],
)  # fmt: skip
def test_a_frame_is_a_microsecond_behind_the_one_before_it_at_least(after, words):
    if not words:
        check(columns(), after)
        return
    with pytest.raises(TakeError) as caught:
        check(columns(), after)
    assert str(caught.value) == f"a, frame 70: {words}"


def filled_by_definition(column, valid):
    last = next((value for value, good in zip(column, valid, strict=True) if good), column[0])
    found = []
    for value, good in zip(column, valid, strict=True):
        last = value if good else last
        found.append(last)
    return found


@pytest.mark.parametrize("seed", range(8))
def test_what_is_not_valid_repeats_the_value_before_it_or_the_first(seed):
    rng = np.random.default_rng(seed)
    values, valid = rng.integers(0, 99, (7, 4)), rng.random((7, 4)) < 0.5
    expected = [filled_by_definition(values[:, k], valid[:, k]) for k in range(4)]
    assert _filled(values, valid).T.tolist() == expected


def test_places_are_stored_in_the_nearest_whole_steps():
    """Half a step is rounded to the even one. Invalid places count for nothing."""
    step = np.array([0.5, 0.25, 0.5])
    values = np.array([[[0.25, 0.75, -0.25]], [[1.0, 1.1, -2.0]], [[np.nan, 9e99, np.inf]]])
    found = _quantised(values, np.array([[True], [True], [False]]), step)
    assert found.tolist() == [[0, 2, 0], [4, 4, -8], [4, 4, -8]]


def test_a_place_that_no_step_holds_is_a_fault_that_is_told():
    with pytest.raises(TakeError) as caught:
        _quantised(np.full((1, 1, 3), 1e12), np.ones((1, 1), bool), np.array([1e-5]))
    assert str(caught.value) == "a place would be stored off by more than half a step; this is a fault of Hangtime"


@pytest.mark.parametrize("factor", [10.0, 9.99])
def test_a_step_is_a_tenth_of_every_valid_deviation_at_most(factor):
    """The coarsest such step of each block; the finest where none is fine enough."""
    starts = np.array([0, 2, 5])
    for number, step in enumerate(PLACE_STEPS):
        sd, valid = np.full((7, 2, 3), 1.0), np.ones((7, 2), bool)
        sd[3, 1, 2] = factor * step
        sd[6, 0, 1], valid[6, 0] = factor * step, False
        sd[0, 0, 0] = np.nan
        coarsest = int(np.argmax(PLACE_STEPS))
        fits = [k for k, one in enumerate(PLACE_STEPS) if factor * step >= 10 * one * (1 - 1e-9)]
        middle = fits[0] if fits else len(PLACE_STEPS) - 1
        assert _steps(sd, valid, starts).tolist() == [coarsest, middle, coarsest], number


def test_deviations_are_coded_by_their_logarithms():
    sd = np.array([[np.nan, 0.0, np.inf, SMALLEST_SD, LARGEST_SD, 0.003, 2 * SMALLEST_SD]]).T
    codes = _sd_codes(sd, np.ones(sd.shape, bool)).ravel().tolist()
    assert codes[:3] == [0, 1, 2]
    assert codes[3:] == [3 + round(SD_STEPS * math.log2(one / SMALLEST_SD)) for one in sd.ravel()[3:].tolist()]
    hidden = _sd_codes(sd, np.array([[True], [False], [True], [False], [False], [True], [False]])).ravel().tolist()
    assert hidden == [codes[k] for k in (0, 0, 2, 2, 2, 5, 5)]


@pytest.mark.parametrize("seed", range(6))
def test_coded_blocks_come_back_within_half_a_step(seed):
    rng = np.random.default_rng(seed)
    given = columns()
    for name in ("held", "points", "markers"):
        given[name] = rng.normal(0, 1, given[name].shape)
    for name in ("held_valid", "points_valid", "points_hidden"):
        given[name] = rng.random(given[name].shape) < 0.6
    given["markers"][rng.random((FRAMES, 2)) < 0.3] = np.nan
    given["pitch"] = np.where(rng.random(FRAMES) < 0.3, np.nan, rng.uniform(-1, 1, FRAMES))
    given["quality"] = np.where(rng.random(FRAMES) < 0.3, np.nan, rng.random(FRAMES))
    given["state"] = rng.integers(0, 65536, FRAMES)
    blocks = encode_blocks(given, np.array([1, 3]), 40)
    assert [(one["first"], one["frames"], one["start"]) for one in blocks] == [(40, 1, 5_000_000), (41, 3, 5_100_000)]
    found, sound = decode_blocks(blocks, POINTS)
    assert sound.tolist() == [True, True]
    for name, step in (("held", PLACE_STEPS[blocks[0]["steps"][0]]), ("points", PLACE_STEPS[blocks[0]["steps"][1]])):
        expected = np.where(given[f"{name}_valid"][..., None], given[name], np.nan)
        np.testing.assert_allclose(found[name], expected, rtol=0, atol=0.5 * step * (1 + 1e-6))
    np.testing.assert_allclose(found["markers"], given["markers"], rtol=0, atol=0.5 * max(PLACE_STEPS))
    np.testing.assert_allclose(found["pitch"], given["pitch"], rtol=0, atol=0.5 * ANGLE_STEP * (1 + 1e-6))
    np.testing.assert_allclose(found["pitch_sd"], np.where(np.isnan(given["pitch"]), np.nan, 0.01), rtol=0.02)
    np.testing.assert_allclose(found["quality"], given["quality"], rtol=0, atol=0.003)
    np.testing.assert_allclose(found["time"], given["time"], rtol=0, atol=0.5 / TICKS)
    for name in ("held_valid", "points_valid", "points_hidden", "state"):
        assert np.array_equal(found[name], given[name]), name


@pytest.mark.parametrize(
    ("time", "most", "rows"),
    [
        ([], 9, []), ([0.0], 9, [1]), ([0.0, 0.5, 1.0, 1.5], 9, [3, 1]), ([0.0, 0.5, 0.99, 1.0], 9, [4]),
        ([0.0, 0.5, 1.99], 9, [3]), ([0.0, 0.5, 2.0], 9, [2, 1]), ([0.0, 2.0], 9, [1, 1]), ([0.0, 1.99], 9, [2]),
        ([0.0, 0.1, 0.2, 0.3, 0.4], 2, [2, 2, 1]), ([0.0, 0.1, 0.2], 1, [1, 1, 1]),
    ],
)  # fmt: skip
def test_a_block_ends_with_the_frame_that_reaches_a_second_or_before_a_gap(time, most, rows):
    assert cut_into_blocks(np.array(time), 1.0, most).tolist() == rows

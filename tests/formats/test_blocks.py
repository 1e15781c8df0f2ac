"""Columns of blocks by hand: where a block ends, how a deviation is coded, and what no archive holds."""

from __future__ import annotations

import numpy as np
import pytest

from formats.blocks import (
    FARTHEST_PLACE,
    MOST_ROWS,
    PLACE_STEPS,
    Frame,
    check_columns,
    cut_into_blocks,
    decode_blocks,
    encode_blocks,
    widths,
)
from formats.errors import TakeError

FRAMES = 6


def columns_of(**changed):
    """Six frames of two points at 30 frames a second, all of them sound."""
    given = {
        "time": np.arange(FRAMES) / 30, "markers": np.ones((FRAMES, 2, 3)), "held": np.full((FRAMES, 2, 3), 2.0),
        "held_valid": np.ones((FRAMES, 2), bool), "held_sd": np.full((FRAMES, 2, 3), 0.01),
        "points": np.full((FRAMES, 2, 3), 3.0), "points_valid": np.ones((FRAMES, 2), bool),
        "points_sd": np.full((FRAMES, 2, 3), 0.01), "state": np.zeros(FRAMES, np.uint16),
        "pitch": np.full(FRAMES, 0.1), "pitch_sd": np.full(FRAMES, 0.02),
        "points_hidden": np.zeros((FRAMES, 2), bool), "quality": np.full(FRAMES, 0.5),
    }  # fmt: skip
    return {**given, **changed}


def changed(name, value, row=2):
    values = columns_of()[name].astype(float)
    values[row] = value
    return {name: values}


def check(**given):
    check_columns(columns_of(**given), points=2, take_id="a", first=10, after=-1.0)


def come_back(**given):
    """What is read of one block of six frames."""
    decoded, sound = decode_blocks(encode_blocks(columns_of(**given), np.array([FRAMES]), 0), 2)
    assert sound.tolist() == [True]
    return decoded


METRES = "give metres, at most 1000"
DEVIATIONS = "give 0, or 1e-09 to 1e+09"
ORDER = "frames must come in the order of their time stamps"


@pytest.mark.parametrize(
    ("name", "good", "bad", "words"),
    [
        ("points", FARTHEST_PLACE, 1000.1, f"point 0 lies 1000.1 m away; {METRES}"),
        ("points", -1000.0, -1000.1, f"point 0 lies 1000.1 m away; {METRES}"),
        ("points", 0.0, np.nan, "point 0 is marked valid but is not a number; mark it invalid, or give its place"),
        ("held", 999.0, np.inf, "held end 0 is marked valid but is not a number; mark it invalid, or give its place"),
        ("markers", np.nan, 2000.0, f"marker 0 lies 2000 m away; {METRES}"),
        ("points_sd", 1e-9, 0.9e-9, f"points_sd has a standard deviation of 9e-10; {DEVIATIONS}"),
        ("held_sd", 0.0, -1e-3, f"held_sd has a standard deviation of -0.001; {DEVIATIONS}"),
        ("held_sd", 1e9, 1.1e9, f"held_sd has a standard deviation of 1.1e+09; {DEVIATIONS}"),
        ("pitch_sd", np.inf, 2e9, f"pitch_sd has a standard deviation of 2e+09; {DEVIATIONS}"),
        ("quality", 0.0, -0.1, "quality is -0.1, not between 0 and 1; give one of these"),
        ("quality", 1.0, 1.1, "quality is 1.1, not between 0 and 1; give one of these"),
        ("pitch", -1000.0, -1001.0, "pitch is -1001, not between -1000 and 1000; give one of these"),
        ("pitch", 1000.0, 1001.0, "pitch is 1001, not between -1000 and 1000; give one of these"),
        ("state", 65535, 65536, "state is 65536, not between 0 and 65535; give one of these"),
        ("state", 0, -1, "state is -1, not between 0 and 65535; give one of these"),
    ],
)
def test_values_that_an_archive_cannot_hold_are_refused_with_its_frame(name, good, bad, words):
    check(**changed(name, good))
    with pytest.raises(TakeError) as refused:
        check(**changed(name, bad))
    assert str(refused.value) == f"a, frame 12: {words}"


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([0.0, 0.1, 0.1, 0.3, 0.4, 0.5], f"time goes from 0.100000 s to 0.100000 s; {ORDER}"),
        ([0.0, 0.1, np.nan, 0.3, 0.4, 0.5], f"time goes from 0.100000 s to nan s; {ORDER}"),
        (
            [0.0, 0.1, 0.1 + 4e-7, 0.3, 0.4, 0.5],
            "time goes from 0.100000000 s by less than a microsecond; leave out one of the two frames",
        ),
        ([0.0, 0.1, 1.1e10, 1.2e10, 1.3e10, 1.4e10], "the time 1.1e+10 s lies centuries away; give it in seconds"),
    ],
)
def test_times_come_in_order_a_microsecond_apart_and_within_centuries(times, words):
    check(time=np.array([0.0, 0.1, 0.1 + 1.1e-6, 0.3, 0.4, 9.9e9]))
    with pytest.raises(TakeError) as refused:
        check(time=np.array(times))
    assert str(refused.value) == f"a, frame 12: {words}"


def test_the_first_frame_comes_after_the_row_before():
    with pytest.raises(TakeError, match=r"time goes from 0\.000000 s to 0\.000000 s") as refused:
        check_columns(columns_of(), points=2, take_id="a", first=10, after=0.0)
    assert "a, frame 10" in str(refused.value)
    with pytest.raises(TakeError, match=r"points have shape \(2, 3\), not \(3, 3\)"):
        check_columns(columns_of(), points=3, take_id="a", first=0, after=-1.0)


def test_a_position_that_is_not_valid_may_be_anything():
    valid = np.ones((FRAMES, 2), bool)
    valid[2] = False
    for wild in (np.nan, 1e30):
        check(points_valid=valid, **changed("points", wild))


@pytest.mark.parametrize(
    ("times", "rows"),
    [
        (np.arange(61) / 30, [31, 30]),  # the frame that reaches a second ends the block
        ([0.0, 0.5, 0.9, 3.0, 3.5], [3, 2]),  # 3 s are not within two of the first: they begin a block
        ([0.0, 0.5, 1.9, 3.0], [3, 1]),  # 1.9 s are
        ([0.0, 0.5, 2.0, 3.0], [2, 2]),  # nor are 2 s
        ([0.0, 5.0], [1, 1]),
        (np.arange(MOST_ROWS + 10) * 1e-4, [MOST_ROWS, 10]),
        ([], []),
    ],
)
def test_a_block_ends_with_the_frame_that_reaches_its_length_or_before_a_gap(times, rows):
    assert cut_into_blocks(np.array(times, float), 1.0).tolist() == rows


@pytest.mark.parametrize(
    ("sd", "step"), [(1e-3, 0), (0.99e-3, 1), (2e-4, 1), (1.99e-4, 2), (1e-9, 2), (np.inf, 0), (np.nan, 0)]
)
def test_a_block_keeps_positions_in_the_coarsest_step_of_a_tenth_of_every_valid_deviation(sd, step):
    """One coordinate of one point decides; where it is not seen, the others' 10 mm do."""
    deviations = np.full((FRAMES, 2, 3), 0.01)
    deviations[4, 1, 2] = sd
    (block,) = encode_blocks(columns_of(points_sd=deviations), np.array([FRAMES]), 0)
    assert block["steps"] == [0, step]
    valid = np.ones((FRAMES, 2), bool)
    valid[4, 1] = False
    (block,) = encode_blocks(columns_of(points_sd=deviations, points_valid=valid), np.array([FRAMES]), 0)
    assert block["steps"] == [0, 0]
    assert PLACE_STEPS.tolist() == [1e-4, 2e-5, 1e-6]


def test_a_deviation_comes_back_to_half_a_thirty_second_of_an_octave():
    """2^(1/64) is 1.1 %; powers of two of a nanometre are exact; unknown, none and boundless are kept."""
    sizes = np.array([1e-9, 2e-9, 1024e-9, 0.0, np.nan, np.inf])
    found = come_back(held_sd=np.repeat(sizes[:, None], 6, 1).reshape(FRAMES, 2, 3))["held_sd"][:, 0, 0]
    assert found == pytest.approx(sizes, rel=1e-12, nan_ok=True)
    rough = np.array([1e-3, 1.234e-3, 5e-3, 0.7, 12.0, 1e9])
    for name in ("held_sd", "points_sd"):
        back = come_back(**{name: np.repeat(rough[:, None], 6, 1).reshape(FRAMES, 2, 3)})[name][:, 1, 2]
        assert np.abs(np.log2(back / rough)).max() <= 1 / 64 + 1e-9
    assert np.abs(np.log2(come_back(pitch_sd=rough)["pitch_sd"] / rough)).max() <= 1 / 64 + 1e-9


def test_quality_pitch_state_and_flags_come_back():
    hidden = np.zeros((FRAMES, 2), bool)
    hidden[3, 1] = True
    given = {
        "quality": np.array([0.0, 1.0, 0.5, np.nan, 1 / 254, 0.25]), "pitch": np.array([0.1, -0.2, np.nan, 0, 3, -9.0]),
        "state": np.array([0, 1, 2, 65535, 16, 0], np.uint16), "points_hidden": hidden,
        "time": np.array([-5.0, -4.9, 0.0, 1e-6, 0.5, 3.0]),
    }  # fmt: skip
    found = come_back(**given)
    assert found["quality"] == pytest.approx(given["quality"], abs=0.5 / 254, nan_ok=True)
    assert found["quality"][4] == pytest.approx(1 / 254)
    assert found["pitch"] == pytest.approx(given["pitch"], abs=0.5e-4, nan_ok=True)
    assert np.isnan(found["pitch_sd"]).tolist() == [False, False, True, False, False, False]
    assert found["state"].tolist() == given["state"].tolist()
    assert found["points_hidden"].tolist() == hidden.tolist()
    assert found["time"] == pytest.approx(given["time"], abs=1e-9)


def test_markers_held_ends_and_points_come_back_by_their_own_validity():
    rng = np.random.default_rng(0)
    markers, held, points = (rng.normal(size=(FRAMES, 2, 3)) for _ in range(3))
    markers[:2, 0] = np.nan
    held_valid, points_valid = np.ones((2, FRAMES, 2), bool)
    held_valid[0], points_valid[3:, 1] = False, False
    found = come_back(markers=markers, held=held, points=points, held_valid=held_valid, points_valid=points_valid)
    for name, value, valid in (("held", held, held_valid), ("points", points, points_valid)):
        assert found[name] == pytest.approx(np.where(valid[..., None], value, np.nan), abs=0.5001e-4, nan_ok=True)
        assert found[f"{name}_valid"].tolist() == valid.tolist()
    assert found["markers"] == pytest.approx(markers, abs=0.5001e-4, nan_ok=True)


def test_a_point_that_is_not_seen_yet_has_the_place_and_deviation_of_its_first_sight():
    """So each of its six columns is constant: no difference, no bit."""
    valid = np.ones((FRAMES, 2), bool)
    valid[:2, 1] = False
    moved = np.full((FRAMES, 2, 3), 3.0)
    moved[:2, 1] = np.nan
    (block,) = encode_blocks(columns_of(points=moved, points_valid=valid), np.array([FRAMES]), 0)
    begin = sum(widths(2)[name] for name in list(widths(2))[: list(widths(2)).index("points")])
    assert block["table"][begin : begin + 12] == bytes(12)
    assert block["table"][0] > 0


def test_blocks_begin_with_their_own_first_frame_and_time():
    """Three and three frames of ticks from 0 and 100000 on; the file's first is the seventh."""
    first, second = encode_blocks(columns_of(), np.array([3, 3]), 7)
    assert (first["first"], first["frames"], first["start"]) == (7, 3, 0)
    assert (second["first"], second["frames"], second["start"]) == (10, 3, 100000)
    assert sum(widths(2).values()) == 3 + 3 + 6 * 3 + 2 * 2 + 2 * (3 + 3 + 1 + 1)


def test_a_frame_is_a_row_of_each_column_and_hides_nothing_that_nobody_judged():
    frame = Frame(
        time=1.5, markers=np.ones((2, 3)), held=np.zeros((2, 3)), held_valid=np.ones(2, bool),
        held_sd=np.zeros((2, 3)), points=np.zeros((4, 3)), points_valid=np.ones(4, bool), points_sd=np.zeros((4, 3)),
    )  # fmt: skip
    row = frame.as_columns()
    assert row["time"].tolist() == [1.5]
    assert row["points_hidden"].tolist() == [[False] * 4]
    assert row["state"].tolist() == [0]
    assert np.isnan([row["pitch"][0], row["pitch_sd"][0], row["quality"][0]]).all()
    assert set(row) == {*columns_of()}

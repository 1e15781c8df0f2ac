"""Location of the gap: shares of a residual with known region, phase and direction."""

from __future__ import annotations

import copy
import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.gap.where import _phases, find_where
from fit.methods import SI
from fit.observer.residuals import Observer
from tests.fit.gap.test_gap_statistics import a_still_take


@pytest.fixture(scope="module")
def scene():
    """A grid of 5 x 5 beside a hanger that swings from 0.5 to 2 s of four; the top row is on the held edge."""
    recording = a_still_take(0.0, rate=30)
    return recording, Observer([recording], SI, (), frequency=0.0)


def missed(scene, by):
    """Where the gap lies, of an error [m], (frames, points, 3)."""
    recording, observer = scene
    return find_where(observer, observer.residuals_of([(recording.points - by)[None]])[0])


def test_an_error_of_one_point_is_found_there_and_nowhere_else(scene):
    """5 mm sideways of the bottom left corner, of 20 points: 1.1 mm over all, 100 % of it bottom left and sideways."""
    by = np.zeros(scene[0].points.shape)
    by[:, 20, 0] = 0.005
    found = missed(scene, by)
    assert [(b.name, b.share) for b in found.space if b.share > 0] == [("bottom left", pytest.approx(1.0))]
    assert found.space[0].value_mm == pytest.approx(5.0 / np.sqrt(4))  # of four points at the bottom left
    assert {b.name: b.share for b in found.term} == pytest.approx(
        {"sideways (x)": 1.0, "to and from the sensor (y)": 0.0, "vertical (z)": 0.0}
    )
    judged = [point.at_m for point in scene[0].garment.points[5:]]  # below the held edge
    assert [v.at_m for v in found.vertices] == judged
    values = [v.value_mm for v in found.vertices]
    assert max(values) == pytest.approx(5.0)
    assert sum(v > 1e-6 for v in values) == 1


def test_a_point_that_was_never_seen_has_no_error_and_takes_none_from_the_others(scene):
    """The last of 25 points is hidden; 5 mm of the one before it, of 19 that were seen."""
    recording, _ = scene
    valid = recording.valid.copy()
    valid[:, 24] = False
    observer = Observer([dataclasses.replace(recording, valid=valid)], SI, (), frequency=0.0)
    by = np.zeros(recording.points.shape)
    by[:, 23, 0] = 0.005
    found = find_where(observer, observer.residuals_of([(recording.points - by)[None]])[0])
    assert [v.at_m for v in found.vertices] == [point.at_m for point in recording.garment.points[5:24]]
    assert [v.value_mm for v in found.vertices] == pytest.approx([*[0.0] * 18, 5.0])
    assert [b.name for b in found.space if b.share > 0] == ["bottom right"]


def test_components_add_up_in_squares_and_regions_and_phases_in_weighted_squares(scene):
    """3, 4 and 12 mm along the axes are 13 mm in all; parts of all points add up, groups of points average."""
    recording, observer = scene
    by = np.zeros(recording.points.shape) + np.array([0.003, 0.004, 0.012])
    found = missed(scene, by)
    assert [b.value_mm for b in found.term] == pytest.approx([3.0, 4.0, 12.0])
    by *= np.random.default_rng(0).normal(size=(*by.shape[:2], 1))
    residual = observer.residuals_of([(recording.points - by)[None]])[0]
    whole = float(observer.in_mm(residual))
    found = find_where(observer, residual)
    for components in (found.term, found.frequency):
        assert np.sqrt(sum(b.value_mm**2 for b in components)) == pytest.approx(whole)
        assert [b.value_mm for b in components] == pytest.approx([whole * np.sqrt(b.share) for b in components])
    for groups in (found.space, found.time):  # share = weight times square over the whole's square
        weights = [b.share * (whole / b.value_mm) ** 2 for b in groups]
        assert sum(weights) == pytest.approx(1.0)
    assert np.mean([v.value_mm**2 for v in found.vertices]) == pytest.approx(whole**2)


def test_an_error_of_the_ring_down_is_found_in_it(scene):
    """The hanger rests from 2.3 s on; motion is the cloth's own a third of a second later."""
    recording, _ = scene
    by = np.where(recording.time > 2.75, 0.003, 0.0)[:, None, None] * np.ones(recording.points.shape)
    found = missed(scene, by)
    ringing = next(b for b in found.time if b.name == "ring-down, hanger at rest")
    assert ringing.share == pytest.approx(1.0, abs=0.01)
    before = next(b for b in found.time if b.name == "hanger at rest before the swing")
    assert before.share == pytest.approx(0.0, abs=1e-9)
    assert sum(b.share for b in found.time) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("hertz", "band"),
    [(0.0, "0 to 0.3 Hz"), (0.5, "0.3 to 0.7 Hz"), (1.0, "0.7 to 1.5 Hz"), (2.0, "1.5 to 3 Hz"), (5.0, "above 3 Hz")],
)
def test_an_oscillation_is_found_in_its_band(scene, hertz, band):
    """4 mm cos over four seconds: 4 sqrt(3) / sqrt(2) = 4.9 mm of distance, or 6.9 where it is constant."""
    recording, _ = scene
    by = 0.004 * np.cos(2 * np.pi * hertz * recording.time)[:, None, None] * np.ones(recording.points.shape)
    found = {b.name: b for b in missed(scene, by).frequency}
    assert found[band].share == pytest.approx(1.0, abs=0.01)
    assert found[band].value_mm == pytest.approx(4 * np.sqrt(3 if hertz == 0.0 else 1.5), rel=0.01)


@pytest.mark.parametrize(
    ("point", "name"),
    [(6, "top left"), (7, "top centre"), (9, "top right"), (11, "middle left"), (12, "middle centre"),
     (13, "middle right"), (16, "bottom left"), (17, "bottom centre"), (23, "bottom right")],
)  # fmt: skip
def test_a_region_is_named_by_its_thirds_of_the_height_and_the_width(scene, point, name):
    """Of five rows and columns the second lies at a quarter, the third in the middle, the fourth at three quarters."""
    by = np.zeros(scene[0].points.shape)
    by[:, point] = 0.002
    assert [b.name for b in missed(scene, by).space if b.share > 1e-9] == [name]


@pytest.mark.parametrize("wide", [0.2, 5.0])
def test_regions_are_thirds_of_a_narrow_and_of_a_wide_garment_too(scene, wide):
    """The middle one of the lowest five points, and its neighbour to the right, of any garment's width."""
    recording, observer = scene
    points = recording.garment.points
    other = tuple(msgspec.structs.replace(p, at_m=(wide * p.at_m[0] + 0.3, p.at_m[1] - 0.7)) for p in points)
    shown = SimpleNamespace(layout=observer.layout, recordings=[replace_garment(recording, other)])
    for point, name in ((22, "bottom centre"), (23, "bottom right"), (20, "bottom left"), (12, "middle centre")):
        by = np.zeros(recording.points.shape)
        by[:, point] = 0.002
        found = find_where(shown, observer.residuals_of([(recording.points - by)[None]])[0])
        assert [b.name for b in found.space if b.share > 1e-9] == [name]


def replace_garment(recording, points):
    return dataclasses.replace(recording, garment=msgspec.structs.replace(recording.garment, points=points))


def stroke(top, begin=1.0):
    """A hanger whose speed rises to `top` [m/s] in half a second from `begin` on, and falls again; four seconds."""
    time = np.arange(120) / 30
    speed = np.interp(time, [begin, begin + 0.5, begin + 1.0], [0.0, top, 0.0])
    ends = np.zeros((120, 6))
    ends[:, 0], ends[:, 3] = -0.2, 0.2
    ends[:, [1, 4]] = np.concatenate([[0.0], np.cumsum(speed[1:] + speed[:-1]) / 60])[:, None]
    return SimpleNamespace(time=time, held=lambda instants: ends)


def test_phases_are_those_of_the_hangers_speed():
    """0.6 m/s at 1.5 s: slower than 30 mm/s from 1.975 s on; cloth is on its own a third of a second later."""
    named = dict(zip(np.arange(120), _phases(stroke(0.6)), strict=True))
    for frames, name in (
        (range(30), "hanger at rest before the swing"), (range(33, 44), "hanger speeding up"),
        (range(46, 59), "hanger slowing down"), (range(61, 68), "hanger turning or just stopped"),
        (range(70, 120), "ring-down, hanger at rest"),
    ):  # fmt: skip
        assert {str(named[k]) for k in frames} == {name}


def test_a_hanger_that_turns_about_its_middle_is_at_rest():
    """Its ends go 0.3 m/s in opposite directions; where one of them stays, the middle goes at half the speed."""
    time = np.arange(120) / 30
    ends = np.zeros((120, 6))
    ends[:, 1], ends[:, 4] = 0.3 * time, -0.3 * time
    hanger = SimpleNamespace(time=time, held=lambda instants: ends)
    assert set(_phases(hanger)) == {"hanger at rest before the swing"}
    for half, is_still in ((0.02, True), (0.04, False)):  # m/s of the middle
        ends[:, 1], ends[:, 4] = 2 * half * time, 0.0
        assert (set(_phases(hanger)) == {"hanger at rest before the swing"}) == is_still


@pytest.mark.parametrize(("top", "moves"), [(0.029, False), (0.033, True)])
def test_a_hanger_moves_from_three_centimetres_a_second_on(top, moves):
    names = set(_phases(stroke(top)))
    assert ("hanger speeding up" in names) == moves
    assert ("ring-down, hanger at rest" in names) == moves
    assert moves or names == {"hanger at rest before the swing"}


def test_the_highest_frequency_of_an_even_number_of_frames_counts_once(scene):
    """3 mm constant and 4 mm from frame to frame to and fro: 9 and 16 of 25 mm^2 (Parseval)."""
    recording, _ = scene
    assert len(recording.time) % 2 == 0
    to_and_fro = (-1.0) ** np.arange(len(recording.time))
    by = (0.003 + 0.004 * to_and_fro)[:, None, None] * np.ones(recording.points.shape)
    shares = {b.name: b.share for b in missed(scene, by).frequency}
    assert shares["0 to 0.3 Hz"] == pytest.approx(9 / 25)
    assert shares["above 3 Hz"] == pytest.approx(16 / 25)


def test_bands_share_the_squares_of_all_frames_of_all_takes():
    """3 mm constant and 4 mm cos at 1 Hz are 9 and 8 mm^2; a take of half as many frames at 1 Hz has half the part."""
    recordings = [a_still_take(0.0, rate=rate) for rate in (30, 15)]
    observer = Observer(recordings, SI, (), frequency=0.0)
    frames = [len(one.time) for one in recordings]
    assert frames[0] == 2 * frames[1]

    def shares(*errors):
        away = [by[:, None, None] * np.ones(one.points.shape) for by, one in zip(errors, recordings, strict=True)]
        residual = observer.residuals_of([(r.points - by)[None] for r, by in zip(recordings, away, strict=True)])[0]
        return {b.name: b.share for b in find_where(observer, residual).frequency}

    waves = [np.cos(2 * np.pi * one.time) for one in recordings]
    mixed = shares(*(0.003 + 0.004 * wave for wave in waves))
    assert (mixed["0 to 0.3 Hz"], mixed["0.7 to 1.5 Hz"]) == pytest.approx((9 / 17, 8 / 17))
    apart = shares(0.003 + 0.0 * waves[0], 0.004 * waves[1])
    assert (apart["0 to 0.3 Hz"], apart["0.7 to 1.5 Hz"]) == pytest.approx((18 / 26, 8 / 26))


def test_points_exactly_on_a_line_between_thirds_belong_to_the_middle_third(scene):
    """Columns at 0, 1, 1.5, 2 and 3 of three widths, and rows likewise; the top row is not judged."""
    recording, observer = scene
    thirds = (0.0, 1.0, 1.5, 2.0, 3.0)
    points = tuple(
        msgspec.structs.replace(point, at_m=(thirds[k % 5], -thirds[k // 5]))
        for k, point in enumerate(recording.garment.points)
    )
    garment = msgspec.structs.replace(recording.garment, points=points)
    divided = copy.copy(observer)
    divided.recordings = [dataclasses.replace(recording, garment=garment)]
    named = []
    for k in range(5, 25):
        by = np.zeros(recording.points.shape)
        by[:, k, 0] = 0.005
        residual = observer.residuals_of([(recording.points - by)[None]])[0]
        named.append(find_where(divided, residual).space[0].name)
    assert named == [
        f"{row} {column}"
        for row in ("middle", "middle", "middle", "bottom")
        for column in ("left", "centre", "centre", "centre", "right")
    ]

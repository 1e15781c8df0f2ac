"""Takes that share frames of one recording, after any change, and takes that agree by chance only."""

from __future__ import annotations

import dataclasses
from time import process_time

import msgspec
import numpy as np
import pytest

from fit.recordings.copies import Track, are_copies, share_positions
from fit.recordings.intact import FRAME_FIELDS
from formats.archive import read_take, write_take
from formats.exporters.marker_files import write_csv
from formats.importers.swatch_mocap import import_marker_take
from tests.fit.scenes import hung, sheet, swing, take_of

TIME = np.arange(0, 5, 1 / 30)


def recorded(hz=0.7, noise=1e-3, seed=0, *, start=0.5, amplitude=0.08, garment=None):
    """A take whose points follow the hanger, the lower ones behind it, with white noise [m]."""
    garment = garment or sheet()
    points = hung(garment, TIME)
    for at, point in enumerate(garment.points):
        points[:, at] += swing(TIME + 0.4 * min(point.at_m[1], 0.0), hz=hz, start=start, amplitude=amplitude)
    points += np.random.default_rng(seed).normal(0, noise, points.shape)
    return take_of(garment, TIME, swing(TIME, hz=hz, start=start, amplitude=amplitude), points)


def part(take, kept):
    arrays = {name: array[kept] for name in FRAME_FIELDS if (array := getattr(take, name)) is not None}
    return dataclasses.replace(take, **arrays)


def with_lost(take, share, seed):
    """The take without a share of its points, drawn by the seed."""
    lost = np.random.default_rng(seed).random(take.points_valid.shape) < share
    points = np.where(lost[..., None], np.nan, take.points)
    return dataclasses.replace(take, points=points, points_valid=take.points_valid & ~lost)


def copies(one, other):
    return are_copies(Track(one), Track(other))


def same_places(one, other):
    return share_positions(Track(one), Track(other))


COPIES = {
    "rounded to 0.1 mm": lambda take: (take, dataclasses.replace(take, points=take.points.round(4))),
    "40 % in common": lambda take: (part(take, slice(0, 100)), part(take, slice(60, 150))),
    "every fourth frame": lambda take: (take, part(take, slice(0, None, 4))),
    "each frame twice": lambda take: (take, part(take, np.repeat(np.arange(150), 2))),
    "twice in one take": lambda take: (take, part(take, np.tile(np.arange(150), 2))),
    "other points lost": lambda take: (with_lost(take, 0.3, 1), with_lost(take, 0.3, 2)),
}


@pytest.mark.parametrize("change", COPIES)
def test_takes_that_hold_frames_of_one_recording_are_copies(change):
    one, other = COPIES[change](recorded())
    assert copies(one, other)
    assert copies(other, one)


def test_a_take_that_went_through_the_archive_an_export_and_an_import_is_a_copy(tmp_path):
    take = read_take(write_take(tmp_path / "a.mcap", recorded()))
    write_csv(tmp_path / "a.csv", take)
    back = import_marker_take(tmp_path / "a.csv", take.garment)
    again = read_take(write_take(tmp_path / "b.mcap", back))
    shown = again.points_valid & take.points_valid
    assert 0 < np.abs(again.points - take.points)[shown].max() <= 6e-5  # m: not one place need be the same
    assert copies(take, again)
    assert not copies(read_take(write_take(tmp_path / "c.mcap", recorded(seed=1))), again)


@pytest.mark.parametrize("noise", [2e-5, 1e-4, 1e-3])
def test_other_recordings_are_no_copies(noise):
    take = recorded(noise=noise)
    others = [recorded(hz, noise, seed) for hz, seed in ((0.9, 0), (0.71, 0), (0.75, 3))]
    if noise >= 1e-4:
        others.append(recorded(noise=noise, seed=5))  # a machine that repeats its motion
    for other in others:
        assert not copies(take, other)


@pytest.mark.parametrize("noise", [0.0, 2e-5, 1e-4, 5e-4])
def test_takes_at_rest_are_no_copies(noise):
    """One free point of cloth at rest comes near its positions of another recording in most frames, in no order."""
    corners = sheet()
    one_free = msgspec.structs.replace(corners, points=corners.points[:3])
    for garment in (corners, one_free):
        still = [recorded(noise=noise, seed=seed, amplitude=0.0, garment=garment) for seed in (1, 2)]
        assert not copies(*still)


def test_frames_that_come_again_and_cloth_that_has_not_moved_give_no_evidence():
    """The hanger goes by a centimetre after 0.7 s; the lower points are later."""
    take = recorded(amplitude=0.08)
    informative = Track(take).informative
    away = np.linalg.norm(take.points - take.points[0], axis=2)[:, 2:].max(1)
    assert informative.tolist() == np.flatnonzero(away > 0.01).tolist()
    for again in (np.repeat(np.arange(150), 2), np.tile(np.arange(150), 2)):
        assert len(Track(part(take, again)).informative) == 0
    once = part(take, np.r_[0:150, 60:70])  # ten of them come again
    assert len(Track(once).informative) == len(informative) - 10


@pytest.mark.parametrize(("count", "is_one"), [(9, False), (10, False), (11, True), (40, True)])
def test_ten_steps_from_one_shared_frame_to_the_next_make_a_copy(count, is_one):
    """A piece of so many frames, which is all that the other take holds."""
    take = recorded()
    piece = part(take, np.r_[0:2, 100 : 100 + count])
    assert copies(take, piece) == is_one


@pytest.mark.parametrize(("step", "is_one"), [(10, True), (11, False)])
def test_a_copy_may_keep_one_frame_in_ten(step, is_one, monkeypatch):
    monkeypatch.setattr("tests.fit.recordings.test_copies.TIME", np.arange(0, 10, 1 / 30))
    take = recorded()
    assert copies(take, part(take, slice(0, None, step))) == is_one


def test_most_points_of_a_frame_must_be_at_their_positions():
    """Three of six free points are half, four are most of them."""
    garment = sheet(grid=3)
    free = Track(recorded(garment=garment)).free
    take = recorded(garment=garment)
    for count in range(len(free) + 1):
        points = take.points.copy()
        points[:, free[:count]] += 0.001
        assert same_places(take, dataclasses.replace(take, points=points)) == (2 * (len(free) - count) > len(free))


@pytest.mark.parametrize(("apart", "is_one"), [(0.95e-4, True), (1.05e-4, False)])
def test_positions_are_the_same_within_a_tenth_of_a_millimetre(apart, is_one):
    take = recorded()
    assert same_places(take, dataclasses.replace(take, points=take.points + np.array([0.0, apart, 0.0]))) == is_one


@pytest.mark.parametrize(("kept", "is_one"), [(26, True), (22, False)])
def test_a_fifth_of_the_frames_in_common_makes_a_copy(kept, is_one):
    """Of two pieces of 120 frames each, all of which give evidence but some of the first ones."""
    whole = recorded(start=-1.0, hz=0.73, seed=4)
    more = part(recorded(start=-1.0, hz=0.61, seed=5), slice(0, 120 - kept))
    mixed = {name: np.concatenate([getattr(part(whole, slice(120 - kept, 120)), name), getattr(more, name)])
             for name in ("points", "points_valid")}  # fmt: skip
    other = dataclasses.replace(part(whole, slice(0, 120)), **mixed)
    assert copies(part(whole, slice(0, 120)), other) == is_one


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_long_takes_of_many_equal_positions_are_compared_in_a_second(noise, monkeypatch):
    """Ten minutes at rest or with a tracker that stands: all positions are one, or some hundreds."""
    monkeypatch.setattr("tests.fit.recordings.test_copies.TIME", np.arange(0, 600, 1 / 30))
    takes = [recorded(hz, noise, seed, start=590.0) for hz, seed in ((0.7, 1), (0.9, 2))]
    takes = [dataclasses.replace(take, points=take.points.round(5)) for take in takes]
    begin = process_time()
    assert not copies(*takes)
    assert process_time() - begin < 5.0  # s: without a look at equal places it takes minutes


def test_a_long_take_is_compared_in_parts_and_its_copy_is_known(monkeypatch):
    monkeypatch.setattr("tests.fit.recordings.test_copies.TIME", np.arange(0, 100, 1 / 30))
    monkeypatch.setattr("fit.recordings.copies.MOST_ASKED", 400)
    take = recorded()
    assert len(Track(take).informative) <= 400
    assert copies(take, part(recorded(), slice(1000, None)))
    assert not copies(take, recorded(seed=1))


def test_takes_without_a_common_point_are_no_copies():
    take = recorded()
    assert not copies(take, with_lost(take, 1.0, 0))


def test_a_point_is_seen_where_it_is_valid_and_all_of_its_position_is_known():
    take = recorded()
    points, valid = take.points.copy(), take.points_valid.copy()
    points[3, 2, 1], valid[4, 2] = np.nan, False
    track = Track(dataclasses.replace(take, points=points, points_valid=valid))
    assert np.flatnonzero(~track.seen[:, 2]).tolist() == [3, 4]
    assert track.counts[2] == len(take.time) - 2


@pytest.mark.parametrize(("step", "is_one"), [(10, True), (11, False)])
def test_of_a_copy_one_frame_in_ten_may_show_points(step, is_one, monkeypatch):
    """The other frames are there, and nothing is seen in them."""
    monkeypatch.setattr("tests.fit.recordings.test_copies.TIME", np.arange(0, 10, 1 / 30))
    take = recorded()
    seen = (np.arange(300) % step == 0)[:, None] & take.points_valid
    shown = dataclasses.replace(take, points=np.where(seen[..., None], take.points, np.nan), points_valid=seen)
    assert same_places(take, shown) == is_one

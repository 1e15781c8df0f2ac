"""Markers whose labels are exchanged for some frames are named with their seconds, and honest ones are not."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.importers.c3d_file import read_c3d
from formats.importers.marker_exchanges import remove_exchanged
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.importers.path_roughness import noise_of, roughness, roughness_of
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_c3d_moved_frames import KINDS, motion
from tests.shared_data import c3d_recording

FRAMES, MARKERS = 300, 25
LABELS = tuple(f"m{k}" for k in range(MARKERS))


def cloth(rate=100.0, far=0.3, hertz=1.0, pitch=0.06, noise=3e-4, markers=5, seed=0):
    """A grid of markers [m] that swings, its lower rows behind the upper ones."""
    time, k = np.arange(FRAMES)[:, None] / rate, np.arange(markers**2)
    places = np.tile(np.stack([pitch * (k % markers), 0 * k, 1.5 - pitch * (k // markers)], 1), (FRAMES, 1, 1))
    swing = far * np.sin(2 * np.pi * hertz * time - (k // markers) / markers)
    places[..., 1] += swing
    places[..., 2] += 0.1 * np.abs(swing)
    return places + np.random.default_rng(seed).normal(0, noise, places.shape)


def told(places, rate=100.0):
    labels = [f"m{k}" for k in range(places.shape[1])]
    return remove_exchanged(np.arange(len(places)) / rate, places, labels, lambda k: f"frame {k + 1}")


def with_exchanged(places, frames, *markers):
    """Positions of which some frames have each marker's label at the next one."""
    found = places.copy()
    found[np.ix_(frames, markers)] = places[np.ix_(frames, np.roll(markers, 1))]
    return found


def without(places, frames, *markers):
    found = places.copy()
    found[np.ix_(frames, markers)] = np.nan
    return found


SPANS = {
    "one": (np.array([130]), "in frame 131 (1.30 s)"),
    "first": (np.arange(1), "in frame 1 (0.00 s)"),
    "last": (np.arange(FRAMES - 1, FRAMES), "in frame 300 (2.99 s)"),
    "stretch": (np.arange(130, 150), "from frame 131 to frame 150 (1.30 to 1.49 s)"),
    "head": (np.arange(100), "from frame 1 to frame 100 (0.00 to 0.99 s)"),
    "tail": (np.arange(200, FRAMES), "from frame 201 to frame 300 (2.00 to 2.99 s)"),
    "most": (np.arange(100, FRAMES), "from frame 1 to frame 100 (0.00 to 0.99 s)"),
}


@pytest.mark.parametrize("span", SPANS)
@pytest.mark.parametrize("markers", [(0, 1), (7, 18), (3, 4, 9), (20, 0, 12, 5)])
def test_exchanged_labels_are_named_with_their_seconds_and_count_as_not_seen(span, markers):
    frames, when = SPANS[span]
    places = with_exchanged(cloth(), frames, *markers)
    other = np.arange(100) if span == "most" else frames
    expected = without(places, other, *markers)
    names = [f"m{k}" for k in sorted(markers)]
    shown = ", ".join(names[:3]) + " and 1 more" * (len(names) > 3)
    assert told(places) == f"labels seem exchanged, so these count as not seen: {shown} {when}"
    np.testing.assert_array_equal(places, expected)


@pytest.mark.parametrize("rate", [60.0, 100.0, 200.0])
@pytest.mark.parametrize("step", [7, 9, 20])
def test_labels_exchanged_in_one_frame_of_several_are_named_throughout(rate, step):
    frames = np.arange(5, FRAMES, step)
    places = with_exchanged(cloth(rate), frames, 7, 8)
    expected = without(places, frames, 7, 8)
    sentence = told(places, rate)
    np.testing.assert_array_equal(places, expected)
    assert sentence.startswith(
        f"labels seem exchanged, so these count as not seen: m7, m8 in frame 6 ({5 / rate:.2f} s); m7, m8 in frame "
    )
    assert sentence.endswith(f" and {len(frames) - 3} more times")


def test_all_labels_in_reverse_are_named():
    places = cloth()
    places[5::9] = places[5::9, ::-1]
    told(places)
    assert np.isnan(places[5::9][:, [0, 5, 24]]).all()
    assert np.isfinite(np.delete(places, np.s_[5::9], axis=0)).all()


def test_two_pairs_that_overlap_are_told_apart():
    places = with_exchanged(with_exchanged(cloth(), np.arange(50, 90), 1, 17), np.arange(70, 120), 4, 23)
    expected = without(without(places, np.arange(50, 90), 1, 17), np.arange(70, 120), 4, 23)
    assert "m1, m4, m17 and 1 more from frame 71 to frame 90 (0.70 to 0.89 s)" in told(places)
    np.testing.assert_array_equal(places, expected)


@pytest.mark.parametrize("rate", [30.0, 60.0, 100.0])
def test_noise_hides_no_end_of_an_exchange_whose_other_end_shows(rate):
    """The noise is 3 mm. With the other end alone, the honest positions beside it would count as not seen."""
    rng, found = np.random.default_rng(0), list[str]()
    for seed in range(30):
        frames, first = np.arange(*rng.integers([20, 260], [240, 290])), int(rng.choice([0, 1, 6, 12, 18]))
        places = with_exchanged(cloth(rate, noise=3e-3, seed=seed), frames, first, first + 1)
        expected = without(places, frames, first, first + 1)
        before = places.copy()
        found.append(told(places, rate))
        if len(frames) > FRAMES / 2:
            expected = without(before, np.delete(np.arange(FRAMES), frames), first, first + 1)
        np.testing.assert_array_equal(places, expected if found[-1] else before)
    assert found.count("") <= 3


@pytest.mark.parametrize("gap", [1, 3, 5])
def test_labels_exchanged_behind_a_short_gap_are_named(gap):
    places = with_exchanged(cloth(), np.arange(130, 150), 7, 18)
    places[130 - gap : 130, 7] = np.nan
    expected = without(places, np.arange(130, 150), 7, 18)
    assert "m7, m18 from frame 131 to frame 150 (" in told(places)
    np.testing.assert_array_equal(places, expected)


def test_unseen_frames_are_not_named():
    places = with_exchanged(cloth(), np.arange(130, 150), 7, 18)
    places[100:130] = places[150:180] = np.nan
    assert told(places) == ""


@pytest.mark.parametrize("kind", KINDS)
def test_undamaged_motion_noise_and_rounding_show_no_exchange(kind):
    rng = np.random.default_rng(2)
    assert [told(*motion(kind, rng)) for _ in range(100)] == [""] * 100


@pytest.mark.parametrize("rate", [20.0, 30.0, 60.0, 100.0])
def test_fast_markers_that_cross_each_other_show_no_exchange(rate):
    """At 20 frames a second the fastest one moves 0.75 m in a frame, and many lie 50 mm from each other."""
    rng, time = np.random.default_rng(3), np.arange(FRAMES)[:, None, None] / rate
    for _ in range(60):
        shape = (int(rng.integers(2, 30)), 3)
        swing = np.sin(2 * np.pi * rng.uniform(0.3, 4, shape) * time + rng.uniform(0, 6, shape))
        places = rng.uniform(-0.1, 0.1, shape) + rng.uniform(0, 0.6, shape) * swing
        assert told(places + rng.normal(0, 3e-4, places.shape), rate) == ""


@pytest.mark.parametrize(("far", "hertz"), [(0.3, 1.0), (0.8, 2.0), (0.1, 3.0)])
@pytest.mark.parametrize("rate", [30.0, 100.0])
@pytest.mark.parametrize("pitch", [0.012, 0.06])
def test_swinging_cloth_shows_no_exchange(far, hertz, rate, pitch):
    assert told(cloth(rate, far, hertz, pitch, markers=7), rate) == ""


def folding(rate, rng):
    """A skirt's 36 markers 10 mm apart [m] that swing, fold and turn; their times [s], and the noise is 2 mm."""
    time, row, column = np.arange(FRAMES)[:, None] / rate, np.arange(36) // 6, np.arange(36) % 6
    swing = rng.uniform(0.1, 0.6) * np.sin(2 * np.pi * rng.uniform(0.5, 3) * time - row / 4)
    wide = 0.01 * (column - 2.5)
    deep = swing + 0.05 * np.sin(2.1 * column + 5 * time * rng.uniform(0.5, 3))
    turn = rng.choice([0, 3]) * np.sin(4 * time) * (0.3 + row / 6)
    places = [wide * np.cos(turn) - deep * np.sin(turn), wide * np.sin(turn) + deep * np.cos(turn)]
    places.append(1.5 - 0.01 * row + 0.3 * swing**2)
    return np.stack(places, 2) + rng.normal(0, 2e-3, (FRAMES, 36, 3)), time[:, 0]


def told_at(time, places):
    return remove_exchanged(time, places, [f"m{k}" for k in range(places.shape[1])], lambda k: f"frame {k + 1}")


@pytest.mark.parametrize("rate", [9.0, 30.0, 100.0])
@pytest.mark.parametrize("are_shown", [True, False])
def test_folding_cloth_with_lost_frames_shows_no_exchange(rate, are_shown):
    """Stretches of 3 to 24 frames are lost; the times show them, or go on as if none were."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        places, time = folding(rate, rng)
        lost = [np.arange(at, at + rng.integers(3, 25)) for at in rng.integers(5, FRAMES - 30, 4)]
        places, times = (np.delete(one, np.concatenate(lost), axis=0) for one in (places, time))
        assert told_at(times if are_shown else time[: len(times)], places) == ""


@pytest.mark.parametrize("rate", [9.0, 30.0, 100.0])
def test_folding_cloth_of_which_three_sightings_of_ten_lack_shows_no_exchange(rate):
    """Half of the takes are interpolated to more frames, so that most of these lie on straight lines."""
    rng = np.random.default_rng(7)
    for k in range(20):
        places, time = folding(rate, rng)
        if k % 2:
            more = np.arange(0, time[-1], 0.4 / rate)
            flat = places.reshape(FRAMES, -1).T
            places, time = np.stack([np.interp(more, time, one) for one in flat], 1).reshape(len(more), -1, 3), more
        places[rng.random(places.shape[:2]) < 0.2] = np.nan
        assert told_at(time, places) == ""


def test_two_markers_that_meet_rest_and_part_are_not_named():
    """They touch nearer than a marker's diameter."""
    time = np.arange(FRAMES) / 100
    places = np.zeros((FRAMES, 2, 3))
    places[:, 0, 0] = np.maximum(np.abs(time - 1.5) - 0.1, 0)
    places[:, 1, 0] = -places[:, 0, 0]
    assert told(places) == told(places[:, :1]) == told(places[:4]) == ""


@pytest.mark.parametrize("name", ["BTS", "Qualisys", "Vicon", "kt_racing_full"])
def test_real_recordings_show_no_exchange_and_show_those_made(name):
    tracks = read_c3d(c3d_recording(name), None)
    assert "exchanged" not in tracks.warning
    rng, whole = np.random.default_rng(4), tracks.positions
    first = int(np.isfinite(whole[..., 0]).sum(1)[:-30].argmax()) + 5
    span = np.arange(first, first + 20)
    seen = np.flatnonzero(np.isfinite(whole[first - 3 : first + 24]).all((0, 2)))
    found = list[bool]()
    for _ in range(30):
        pair = rng.choice(seen, 2, replace=False)
        places = with_exchanged(whole, span, *pair)
        told(places, tracks.rate)
        found.append(np.array_equal(places, without(whole, span, *pair), equal_nan=True))
    assert np.mean(found) > 0.8


@pytest.mark.parametrize("kind", ["csv", "c3d"])
def test_files_of_every_kind_are_read_with_a_warning(tmp_path, kind):
    places = with_exchanged(cloth(), np.arange(130, 150), 7, 18)
    tracks, path = MarkerTracks(LABELS, np.arange(FRAMES) / 100, places), tmp_path / f"a.{kind}"
    if kind == "csv":
        write_marker_csv(path, tracks)
    else:
        path.write_bytes(c3d_bytes(1e3 * places, LABELS))
    found = read_marker_tracks(path)
    where = "line 132 to line 151" if kind == "csv" else "frame 131 to frame 150"
    assert re.search(rf"exchanged, so these count as not seen: m7, m18 from {where} \(1.30 to 1.49 s\)", found.warning)
    expected = without(places, np.arange(130, 150), 7, 18)
    np.testing.assert_allclose(found.positions, expected, atol=2e-6)


def test_a_marker_of_four_positions_is_not_exchanged():
    """Each of two markers is seen for two frames, at the other's place behind a gap."""
    places = cloth(noise=0.0)[:20, :4]
    found = with_exchanged(places, np.arange(6, 20), 0, 2)
    found[2:6, [0, 2]] = found[8:, [0, 2]] = np.nan
    as_given = found.copy()
    assert told(found) == ""
    np.testing.assert_array_equal(found, as_given)
    whole = with_exchanged(places, np.arange(6, 20), 0, 2)
    whole[2:6, [0, 2]] = np.nan
    assert "m0, m2" in told(whole)


def test_markers_that_leap_in_all_frames_have_no_paths_to_exchange():
    """Each leaps by 5 m in one frame of seven, so that others seem to go on there."""
    places = cloth()
    places[(np.arange(FRAMES)[:, None] + np.arange(MARKERS)) % 7 == 0] += 5.0
    as_given = places.copy()
    assert told(places) == ""
    np.testing.assert_array_equal(places, as_given)


def test_an_exchange_is_found_among_many_brief_gaps():
    """Behind a gap no line leads on, so that no marker leaps off one."""
    places = with_exchanged(cloth(), np.arange(130, 150), 7, 18)
    hidden = np.random.default_rng(0).random(places.shape[:2]) < 0.2
    hidden[125:155, [7, 18]] = False
    places[hidden] = np.nan
    assert "m7, m18 from frame 131 to frame 150" in told(places)


@pytest.mark.parametrize("pairs", [2, 3])
def test_rare_exchanges_of_several_pairs_are_all_found(pairs):
    """They come in most frames together, each in one frame of twelve."""
    found, expected = cloth(), cloth()
    for k in range(pairs):
        frames, markers = np.arange(5 + 3 * k, FRAMES - 5, 12), (5 * k, 5 * k + 1)
        found, expected = with_exchanged(found, frames, *markers), without(expected, frames, *markers)
    assert told(found) != ""
    np.testing.assert_array_equal(found, expected)


def flicked(rng):
    """A grid of 7 x 7 markers [m] that swings and is flicked hard, at few frames a second; its times [s]."""
    rate, row, column = float(rng.choice([25, 30, 50])), np.arange(49) // 7, np.arange(49) % 7
    time = np.arange(FRAMES)[:, None] / rate
    places = cloth(rate, rng.uniform(0.1, 0.5), rng.uniform(0.3, 2.5), rng.uniform(0.015, 0.06), 5e-4, 7)
    for _ in range(2):
        late = time - rng.uniform(0, time[-1, 0]) - row * rng.uniform(0, 0.05)
        bump = np.exp(-((rng.uniform(8, 25) * late) ** 2)) * np.sin(rng.uniform(0, 2) * column + rng.uniform(0, 6))
        places[..., rng.integers(3)] += rng.uniform(0.02, 0.15) * bump
    return places, time[:, 0]


def test_cloth_that_is_flicked_shows_no_exchange():
    rng = np.random.default_rng(1)
    assert [told_at(*flicked(rng)[::-1]) for _ in range(150)] == [""] * 150


@pytest.mark.parametrize("gap", [1, 3, 5])
@pytest.mark.parametrize("rate", [30.0, 100.0])
def test_an_exchange_that_ends_while_one_marker_is_hidden_loses_no_honest_position(rate, gap):
    frames = np.arange(130, 150)
    places = with_exchanged(cloth(rate), frames, 7, 18)
    places[150 : 150 + gap, 7] = np.nan
    expected = without(places, frames, 7, 18)
    assert "m7, m18 from frame 131 to frame 150 (" in told(places, rate)
    np.testing.assert_array_equal(places, expected)


@pytest.mark.parametrize("markers", [(0, 1), (7, 18), (3, 4, 9)])
def test_one_frame_alone_of_fast_cloth_at_few_frames_a_second_is_named(markers):
    """The swing takes a marker 0.1 m off its line in a frame; the positions on both sides leave 10 mm."""
    places = with_exchanged(cloth(25.0, 0.5, 1.5), np.array([130]), *markers)
    expected = without(places, np.array([130]), *markers)
    assert told(places, 25.0).endswith("in frame 131 (5.20 s)")
    np.testing.assert_array_equal(places, expected)


@pytest.mark.parametrize("share", [0.6, 0.75, 0.95])
def test_markers_that_leap_in_most_frames_have_no_paths_to_exchange(share):
    rng, places = np.random.default_rng(0), cloth()
    for frame in np.flatnonzero(rng.random(FRAMES) < share):
        some = rng.permutation(MARKERS)[:6]
        places[frame, some] = places[frame, rng.permutation(some)] + rng.normal(0, 0.5, (6, 3))
    as_given = places.copy()
    assert told(places) == ""
    np.testing.assert_array_equal(places, as_given)


def test_constant_acceleration_has_no_roughness_and_noise_as_much_at_uneven_times():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.choice([1.0, 2.0, 5.0], 4000))
    path = np.outer(time**2, [1e-5, 0, 2e-5]) + np.outer(time, [1e-3, 2e-3, 0])
    assert roughness(time, path)[1].max() < 1e-6
    noise = rng.normal(0, 1e-3, path.shape)
    rough = roughness_of(time, path + noise, np.arange(4000), is_grown=True)
    assert np.sqrt((rough**2).mean()) == pytest.approx(1e-3 * np.sqrt(3), rel=0.05)
    assert noise_of(time, path + noise, 1.538e-3) == pytest.approx(1.538e-3, rel=0.1)

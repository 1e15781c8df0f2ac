"""A hanger with a clock of its own: its sights and the pictures of the points are frames of one take."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fit.recordings.recording import prepare
from formats.archive import read_take, write_take
from formats.errors import ImplausibleError, TakeError
from formats.importers import arm_path
from formats.importers.arm_path import ArmPath, check_arm_path, read_arm_path
from formats.importers.clock_shift import find_clock_shift
from formats.importers.swung_cloth import import_swung_cloth
from formats.summary import summarise
from formats.take import FrameState
from formats.two_clocks import at_times, hanger_gap, shows_hanger, shows_points, with_hanger
from tests.formats.test_command_line import hangtime, swung_cloth
from tests.shared_data import SHARED_DATA

FAST, HIGH = 1.6, 0.05  # Hz and m: between pictures at 9 Hz the arm's path bends by centimetres
QUARTER = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])  # a quarter turn about z


def arm_moves(time):
    """Place of the tool [m], (n, 3)."""
    return np.stack([0 * time, HIGH * np.sin(2 * np.pi * FAST * time), 0 * time], 1)


def recorded(folder, **changes):
    """A recording of 40 pictures, and an arm's path of 20 poses a second beside it, in `arm`."""
    swung_cloth(folder / "a.npz")
    with np.load(folder / "a.npz") as archive:
        data = dict(archive)
    moves = arm_moves(data["t"])[:, None]
    corners = data["hanger_corners"][0]
    np.savez(folder / "a.npz", **{**data, **{k: data[k] + moves for k in ("points", "hanger_corners")}})
    time = np.arange(-0.6, 4.2, 0.05)
    to_corner = corners[:, [1, 0, 2]] * [1, -1, 1]  # seen from the turned tool
    path = {
        "tcp_t": time, "tcp_pose": np.column_stack([arm_moves(time), np.tile(QUARTER, (len(time), 1))]),
        "tcp_to_corner_m": to_corner,
    }  # fmt: skip
    (folder / "arm").mkdir()
    np.savez(folder / "arm/a.npz", **{**path, **changes})
    return corners


def test_the_path_of_an_arm_gives_the_corners_after_its_turn(tmp_path):
    corners = recorded(tmp_path)
    arm = read_arm_path(tmp_path / "arm/a.npz")
    np.testing.assert_allclose(arm.held, corners + arm_moves(arm.time)[:, None], atol=1e-12)


def test_a_take_keeps_the_sights_of_both_clocks(tmp_path):
    """40 pictures, and 96 poses. A picture and a pose at the same time are one frame."""
    recorded(tmp_path)
    take = import_swung_cloth(tmp_path / "a.npz", hanger=tmp_path / "arm")
    take = read_take(write_take(tmp_path / "a.mcap", take))
    both = shows_points(take) & shows_hanger(take)
    pictures, poses = np.arange(40) * 0.11 - 0.34, np.arange(-0.6, 4.2, 0.05)
    assert both.sum() == (np.abs(pictures[:, None] - poses).min(1) < 1e-3).sum() == 8
    assert (shows_points(take).sum(), shows_hanger(take).sum()) == (40, len(poses))
    assert np.array_equal(take.held_valid.all(1), shows_hanger(take))
    assert np.array_equal(take.points_valid.any(1), shows_points(take))
    np.testing.assert_allclose(take.time[shows_points(take)], pictures + 0.34, atol=1e-6)
    summary = summarise(take)
    assert (summary["hanger_seen_percent"], summary["points"][0]["seen_percent"]) == (100.0, 100.0)
    assert summary["rate_hz"] == pytest.approx(1 / 0.11, abs=0.01)


def test_a_simulation_is_driven_along_the_hangers_own_clock(tmp_path):
    """Through the corners at the pictures alone the path misses a bend of 1.6 Hz ten times as far."""
    corners = recorded(tmp_path)
    instants = np.linspace(0.2, 4.0, 400)
    truth = arm_moves(instants - 0.34)[:, 1]
    missed = []
    for hanger in (None, tmp_path / "arm/a.npz"):
        recording = prepare(import_swung_cloth(tmp_path / "a.npz", hanger=hanger))
        found = recording.held(instants)[:, [0, 1, 2]] - corners[0]
        missed.append(np.sqrt(((found[:, 1] - truth) ** 2).mean()))
        assert len(recording.time) == 40
        assert recording.valid[:, recording.judged].all()
    assert missed[1] < 0.1 * missed[0]


def test_marks_of_frames_say_what_was_measured_in_them(tmp_path):
    recorded(tmp_path)
    take = import_swung_cloth(tmp_path / "a.npz")
    at = take.time[3] + np.array([-5e-4, 4e-4, 0.03])  # the second is the nearer one of two at one picture
    found = with_hanger(take, at, np.zeros((3, 2, 3)), 0.002)
    alone = found.state == FrameState.HANGER_ALONE
    assert found.time[alone].tolist() == [at[2]]
    assert np.flatnonzero(found.state == 0).tolist() == [3]
    assert (found.state == FrameState.POINTS_ALONE).sum() == 39


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"tcp_t": np.zeros(96)}, "its time does not increase from pose to pose"),
        (
            {"tcp_pose": np.zeros((96, 6))},
            r"the array 'tcp_pose' has shape \(96, 6\) of numbers, not \(96, 7\) of real numbers",
        ),
        ({"tcp_pose": np.full((96, 7), 1e300)}, r"a place lies 1e\+300 m away; give metres, at most 1000"),
        ({"tcp_pose": np.full((96, 7), 1e300) * [0, 0, 0, 1, 1, 1, 1]}, "a rotation in 'tcp_pose' is no unit quat"),
        ({"tcp_to_corner_m": np.full((2, 3), 1001)}, "a place lies 1001 m away"),
        ({"tcp_pose": np.ones((96, 7))}, "a rotation in 'tcp_pose' is no unit quaternion"),
        ({"tcp_to_corner_m": np.full((2, 3), np.nan)}, "the array 'tcp_to_corner_m' holds a value that is not finite"),
        ({"tcp_t": np.arange(96) + 900.0}, "its frames are 1 s apart in the median"),
        ({"tcp_t": np.arange(96) * 0.05 + 900.0}, "its times are none of the recording's"),
    ],
)
def test_a_file_that_is_no_path_of_the_take_is_refused(tmp_path, changes, sentence):
    recorded(tmp_path, **changes)
    with pytest.raises((TakeError, ImplausibleError), match=sentence):
        import_swung_cloth(tmp_path / "a.npz", hanger=tmp_path / "arm")


def times(*factors):
    return lambda values: values * np.array(factors)


@pytest.mark.parametrize(
    ("name", "change", "advice"),
    [
        ("tcp_pose", lambda pose: pose + np.array([0.0, 0.04, 0.0, 0, 0, 0, 0]), "give the path of the same take"),
        ("tcp_pose", times(1e3, 1e3, 1e3, 1, 1, 1, 1), "'tcp_pose' in metres: the values seem to be milli"),
        pytest.param(
            "tcp_pose",
            times(1e2, 1e2, 1e2, 1, 1, 1, 1),
            "the places of 'tcp_pose' in metres: the values seem to be centi",
            marks=pytest.mark.slow,
        ),
        ("tcp_to_corner_m", times(1e3, 1e3, 1e3), "'tcp_to_corner_m' in metres: the values seem to be millimetres"),
        (
            "both",
            lambda values: values,
            "give 'tcp_pose' and 'tcp_to_corner_m' in metres: the values seem to be millimetres",
        ),
        ("tcp_pose", lambda pose: pose[:, [0, 1, 2, 6, 3, 4, 5]], "as x y z w: the file's order seems to be w x y z"),
        pytest.param("tcp_pose", times(1, 1, 1, -1, -1, -1, 1), "seems to hold their inverses", marks=pytest.mark.slow),
    ],
)
def test_a_path_that_is_not_where_the_pictures_have_the_corners_is_refused(tmp_path, name, change, advice):
    recorded(tmp_path)
    path = tmp_path / "arm/a.npz"
    with np.load(path) as archive:
        data = dict(archive)
    data["tcp_pose"][:, :3] += 0.5  # so that millimetres are far away
    with np.load(tmp_path / "a.npz") as archive:
        recording = dict(archive)
    shifted = {k: recording[k] + 0.5 for k in ("points", "hanger_corners")}
    np.savez(tmp_path / "a.npz", **{**recording, **shifted})
    np.savez(path, **data)
    assert import_swung_cloth(tmp_path / "a.npz", hanger=path).held_valid.any()
    if name == "both":
        data["tcp_pose"][:, :3] *= 1e3
        data["tcp_to_corner_m"] *= 1e3
    else:
        data[name] = change(data[name])
    np.savez(path, **data)
    with pytest.raises(TakeError, match=rf"held corners are .* m from those of the recording's pictures.*{advice}"):
        import_swung_cloth(tmp_path / "a.npz", hanger=path)


@pytest.mark.parametrize(
    ("shift", "told"),
    [(-0.3, "0.30 s behind the recording's (or 0.32 s ahead"), (0.12, "0.12 s ahead"), (0.0, "")],
)  # fmt: skip
@pytest.mark.parametrize("has_corners", [True, False])
def test_a_path_on_a_late_clock_is_imported_and_its_shift_is_reported(tmp_path, shift, told, has_corners):
    """A swing of 1.6 Hz is as near after 0.625 s. Without corners the held row of the points gives the same."""
    recorded(tmp_path, tcp_t=np.arange(-0.6, 4.2, 0.05) + shift)
    with np.load(tmp_path / "a.npz") as archive:
        data = dict(archive)
    noise = np.random.default_rng(4).normal(0, 2e-3, data["hanger_corners"].shape)
    corners = data["hanger_corners"] + noise if has_corners else np.nan * noise
    np.savez(tmp_path / "a.npz", **{**data, "hanger_corners": corners})
    done = hangtime("import", tmp_path / "a.npz", "--hanger", tmp_path / "arm", "--out", tmp_path / "takes")
    assert done.returncode == 0, done.stderr
    assert ("Warning: a.npz: its clock is" in done.stdout) == bool(told)
    assert f"its clock is {told}" * bool(told) in done.stdout
    assert read_take(tmp_path / "takes/a.mcap").notes.get("clock", "").startswith("a.npz: its clock" * bool(told))


def swept(time):
    """Corners [m], (n, 2, 3), that swing ever faster, from 0.3 to 1.5 Hz by 10 cm: no shift brings them back."""
    y = 0.1 * np.sin(2 * np.pi * (0.3 * time + 0.06 * time**2))
    return np.stack([np.stack([x + 0 * time, y, 0 * time], 1) for x in (-0.2, 0.2)], 1)


def circling(period):
    """Return corners that move on a circle of 10 cm with this period [s], so that each instant has another position."""

    def moves(time):
        y, z = (0.1 * turn(2 * np.pi * time / period) for turn in (np.sin, np.cos))
        return np.stack([np.stack([x + 0 * time, y, z], 1) for x in (-0.2, 0.2)], 1)

    return moves


def swept_arm(moves=swept, shift=0.0, end=13):
    time = np.arange(-10 if end > 13 else -3, end, 0.05)
    place = moves(time).mean(1)[:, None]
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1))
    return ArmPath(Path("arm.npz"), time + shift, place, turn, np.array([[-0.2, 0, 0], [0.2, 0, 0]]))


@pytest.mark.parametrize(
    ("shift", "words", "advice"),
    [
        (0.6, "its clock is 0.60 s ahead of the recording's", "subtract 0.60 s from 'tcp_t'"),
        (-0.6, "its clock is 0.60 s behind the recording's", "add 0.60 s to 'tcp_t'"),
        (2.0, "its clock is 2.00 s ahead of the recording's", "subtract 2.00 s from 'tcp_t'"),
    ],
)
def test_a_path_on_a_clock_that_is_too_far_off_is_refused_with_the_offset(shift, words, advice):
    """Corners with the 10 mm of noise that a camera has: the offset is found to 5 ms."""
    time = np.arange(0, 10, 0.11)
    noise = np.random.default_rng(1).normal(0, 0.01, (len(time), 2, 3))
    with pytest.raises(TakeError, match=words) as caught:
        check_arm_path(swept_arm(shift=shift), time, swept(time) + noise)
    assert str(caught.value).endswith(advice)


@pytest.mark.parametrize("kind", ["still", "covered in part"])
def test_an_offset_that_the_corners_do_not_determine_is_not_invented(kind):
    """At rest no shift is nearer."""
    time = np.arange(0, 10, 0.11)
    if kind == "still":
        arm, corners = swept_arm(lambda t: swept(0 * t), 0.6), swept(0 * time)
    else:  # a second of it fits anywhere
        arm, corners = swept_arm(), np.where((time < 1.0)[:, None, None], swept(time), np.nan)
    assert check_arm_path(arm, time, corners) == ""


@pytest.mark.parametrize(
    ("shift", "period"),
    [
        (0.55, 0.8), (-0.7, 3.7), (0.2, 5.1), (0.0, 5.1),
        *(pytest.param(shift, period, marks=pytest.mark.slow) for shift, period in (
            (0.55, 3.7), (0.55, 5.1), (-0.7, 0.8), (-0.7, 5.1), (0.2, 0.8), (0.2, 3.7), (0.0, 0.8), (0.0, 3.7),
        )),
    ],
)  # fmt: skip
def test_of_the_shifts_of_a_swing_that_repeats_itself_the_smallest_is_named(period, shift):
    """With 10 mm of noise, and with none: of both ends of the path the pictures still cover most."""
    time = np.arange(0, 20, 0.11)
    smallest = (shift + period / 2) % period - period / 2
    for noise in (0.0, 0.01):
        seen = circling(period)(time) + np.random.default_rng(2).normal(0, noise, (len(time), 2, 3))
        found = find_clock_shift(time, seen, swept_arm(circling(period), shift, 30).at)
        assert found.seconds == pytest.approx(smallest, abs=0.01)
        assert found.is_significant == (shift != 0)
        is_near = [abs(abs(other - smallest) / period - 1) < 0.02 for other in found.others]
        assert any(is_near) == (period - abs(smallest) < 5)


@pytest.mark.parametrize(("noise", "least"), [(1e-3, 0.005), (0.01, 0.02), (0.02, 0.03)])
def test_a_shift_is_distinguished_from_none_where_noise_lets_it(noise, least):
    """In recordings of 10 s, one in 300 of which may be wrong: never without a shift, always from `least` on."""
    time, arm = np.arange(0, 10, 0.11), swept_arm()
    rng = np.random.default_rng(5)
    for shift in (0.0, 1.2 * least):
        for _ in range(5):
            found = find_clock_shift(time, swept(time + shift) + rng.normal(0, noise, (len(time), 2, 3)), arm.at)
            assert found.is_significant == (shift > 0)
            assert abs(found.seconds - shift) < 4.5 * max(found.error, 5e-4)
            assert not found.others


REAL = sorted((SHARED_DATA / "swung-cloth-arm").glob("*.npz"))


@pytest.mark.shared_data
@pytest.mark.skipif(not REAL, reason=f"no real recordings at {SHARED_DATA}")
@pytest.mark.parametrize("shift", [0.0, -0.1, 0.55, -3.0])
def test_a_shift_planted_in_the_path_of_a_real_arm_is_found_and_no_other(shift):
    """Of four sizes of swing; the second of these takes repeats itself within 4 mm after 2.14 s."""
    for file in REAL[::5]:
        arm = read_arm_path(file)
        with np.load(SHARED_DATA / "swung-cloth" / file.name) as recording:
            time, corners = recording["t"], recording["hanger_corners"]
        found = find_clock_shift(time, corners, replace(arm, time=arm.time + shift).at)
        assert found.seconds == pytest.approx(shift, abs=1e-3), file
        assert found.is_significant == (shift != 0)


def test_a_path_that_leaves_the_corners_for_the_last_second_is_refused_and_a_corner_that_jumps_is_not(tmp_path):
    """The last 12 of 40 pictures are at odds; before, one of both corners jumped in 4 of any 9.

    The positions in a gap of the path are not compared.
    """
    recorded(tmp_path)
    with np.load(tmp_path / "arm/a.npz") as archive:
        path = dict(archive)
    with np.load(tmp_path / "a.npz") as archive:
        recording = dict(archive)
    time, corners = recording["t"], recording["hanger_corners"]
    corners[(np.arange(len(time)) % 9 < 4), 1] += 0.5
    np.savez(tmp_path / "a.npz", **recording)
    assert import_swung_cloth(tmp_path / "a.npz", hanger=tmp_path / "arm").held_valid.any()
    hole = (path["tcp_t"] < 0.8) | (path["tcp_t"] > 2.4)
    holed = {name: path[name][hole] for name in ("tcp_t", "tcp_pose")}
    np.savez(tmp_path / "arm/a.npz", **{**path, **holed})
    corners[(time > 1.0) & (time < 2.2)] += 0.2
    np.savez(tmp_path / "a.npz", **recording)
    assert import_swung_cloth(tmp_path / "a.npz", hanger=tmp_path / "arm").held_valid.any()
    corners[(time > 1.0) & (time < 2.2)] -= 0.2
    np.savez(tmp_path / "a.npz", **recording)
    path["tcp_pose"][path["tcp_t"] > time[28] - 1e-9, 0] += 0.2
    np.savez(tmp_path / "arm/a.npz", **path)
    sentence = r"leave those of .*: both are 0\.2 m apart from 2\.\d to 3\.\d s; give the path of the whole take"
    with pytest.raises(TakeError, match=sentence):
        import_swung_cloth(tmp_path / "a.npz", hanger=tmp_path / "arm")


def test_a_recording_without_corners_takes_any_path(tmp_path):
    recorded(tmp_path)
    with np.load(tmp_path / "a.npz") as archive:
        data = dict(archive)
    np.savez(tmp_path / "a.npz", **{**data, "hanger_corners": np.full(data["hanger_corners"].shape, np.nan)})
    assert import_swung_cloth(tmp_path / "a.npz", hanger=tmp_path / "arm").held_valid.any()


def test_a_path_that_is_no_archive_or_holds_too_much_is_refused(tmp_path, monkeypatch):
    recorded(tmp_path)
    monkeypatch.setattr(arm_path, "MOST_ARM_BYTES", 1000)
    with pytest.raises(TakeError, match=r"its arrays have [0-9.]+ [kM]B; import shorter recordings"):
        read_arm_path(tmp_path / "arm/a.npz")
    for content, sentence in ((b"", "is empty"), (b"PK" * 99, "is no .npz archive")):
        (tmp_path / "arm/a.npz").write_bytes(content)
        with pytest.raises(TakeError, match=f"{sentence}; give a .npz with tcp_t, tcp_pose and tcp_to_corner_m"):
            read_arm_path(tmp_path / "arm/a.npz")


def test_the_command_imports_both_and_names_a_path_that_is_not_there(tmp_path):
    recorded(tmp_path)
    done = hangtime("import", tmp_path / "a.npz", "--hanger", tmp_path / "arm", "--out", tmp_path / "takes")
    assert done.returncode == 0, done.stderr
    assert "40 with the points and 96 with the hanger" in done.stdout
    assert "only" not in done.stdout
    with np.load(tmp_path / "arm/a.npz") as archive:
        path = dict(archive)
    short = {name: path[name][30:60] for name in ("tcp_t", "tcp_pose")}
    np.savez(tmp_path / "arm/a.npz", **{**path, **short})
    done = hangtime("import", tmp_path / "a.npz", "--hanger", tmp_path / "arm", "--out", tmp_path / "short")
    assert "40 with the points and 30 with the hanger, from 1.2 to 2.7 s only" in done.stdout
    (tmp_path / "arm/a.npz").unlink()
    done = hangtime("import", tmp_path / "a.npz", "--hanger", tmp_path / "arm", "--out", tmp_path / "others")
    assert (done.returncode, (tmp_path / "others").exists()) == (2, False)
    assert "arm/a.npz: cannot be read (No such file or directory)" in done.stderr


@pytest.mark.parametrize(
    ("first", "last", "is_reported"), [(0, 38, False), (1, 37, False), (0, 34, True), (5, 39, True)]
)
def test_a_path_over_less_than_nine_tenths_of_the_pictures_says_so(tmp_path, first, last, is_reported):
    """40 pictures: 39 intervals, of which 36 are enough."""
    recorded(tmp_path)
    take = import_swung_cloth(tmp_path / "a.npz")
    at = take.time[first : last + 1]
    found = with_hanger(take, at, np.zeros((len(at), 2, 3)), 0.002)
    assert hanger_gap(found) == (f", from {at[0]:.1f} to {at[-1]:.1f} s only" if is_reported else "")
    for alone in (FrameState.HANGER_ALONE, FrameState.POINTS_ALONE):
        assert hanger_gap(replace(found, state=np.full(len(found.time), alone, np.uint16))) == ""


def test_ends_between_sights_are_on_straight_lines_and_beyond_them_unknown():
    held = np.arange(18.0).reshape(3, 2, 3)
    found = at_times(np.array([-0.1, 0.0, 0.5, 3.0, 3.1]), np.array([0.0, 1.0, 3.0]), held)
    assert np.isnan(found[[0, 4]]).all()
    assert found[1:4].tolist() == [held[0].tolist(), (held[0] + 3.0).tolist(), held[2].tolist()]


@pytest.mark.parametrize("changed", [("a.npz", "arm/a.npz"), ("arm/a.npz",)])
def test_times_that_no_robot_has_are_taken_where_they_are_to_be_taken_anyway(tmp_path, changed):
    """In milliseconds: refused, by the command with the name of the option, which takes them."""
    recorded(tmp_path)
    for name in changed:
        with np.load(tmp_path / name) as archive:
            data = dict(archive)
        np.savez(tmp_path / name, **{k: 1e3 * v if k in ("t", "tcp_t") else v for k, v in data.items()})
    with pytest.raises(ImplausibleError) as caught:
        import_swung_cloth(tmp_path / "a.npz", hanger=tmp_path / "arm")
    assert "--anyway" not in str(caught.value)
    words = ("import", tmp_path / "a.npz", "--hanger", tmp_path / "arm", "--out", tmp_path / "takes")
    refused = hangtime(*words)
    assert refused.returncode == 2
    assert "--anyway" in refused.stderr
    taken = hangtime(*words, "--anyway")
    assert taken.returncode == 0
    assert "--anyway" not in taken.stderr

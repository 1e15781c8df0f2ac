"""`hangtime import` names the fault: the option, the single pose or marker that jumps, the number."""

from __future__ import annotations

import shlex
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.descriptions import load_garment
from formats.descriptions_beside import check_description
from formats.errors import DescriptionError, ImplausibleError, TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import write_marker_csv
from formats.importers.path_outliers import refuse_jumps
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from formats.importers.swung_cloth import import_swung_cloth
from formats.meant_units import unit_of
from formats.plain_text import plain
from tests.fit.here import hangtime_here
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_import import GARMENT, hanging_tracks
from tests.formats.test_marker_tables import TRC
from tests.formats.test_other_programs_files import LABELS, drawn
from tests.formats.test_swung_cloth_import import changed
from tests.formats.test_two_clocks import recorded


@pytest.mark.parametrize("frames", [1, 19])
def test_too_few_frames_by_the_option_name_the_option_before_the_file_is_read(tmp_path, frames):
    words = rf"^--frames: a fit needs 20 frames or more, not {frames}; give 20 or more, or leave it out$"
    with pytest.raises(TakeError, match=words):
        import_marker_take(tmp_path / "absent.csv", GARMENT, MarkerOptions(frames=frames))


def test_more_frames_than_a_recording_has_is_the_options_fault_for_that_recording_alone(tmp_path):
    write_marker_csv(tmp_path / "short.csv", hanging_tracks())
    tracks = hanging_tracks()
    longer = replace(tracks, time=np.arange(60) / 100, positions=np.tile(tracks.positions, (2, 1, 1)))
    write_marker_csv(tmp_path / "long.csv", longer)
    hangtime_here("swatch", "g.toml", "--mass", "0.05", folder=tmp_path)
    done = hangtime_here("import", "short.csv", "long.csv", "--garment", "g.toml", "--frames", 40, folder=tmp_path)
    assert done.returncode == 2
    assert "long.mcap: 40 frames" in done.stdout
    told = "lost: short.csv: has 30 frames, --frames asks for 40; give --frames 30 or fewer, or leave it out"
    assert told in done.stdout + done.stderr


def test_a_file_whose_name_begins_as_an_option_keeps_no_other_from_its_import(tmp_path):
    write_marker_csv(tmp_path / "a.csv", hanging_tracks())
    (tmp_path / "--frames.csv").write_text("nonsense")
    hangtime_here("swatch", "g.toml", "--mass", "0.05", folder=tmp_path)
    done = hangtime_here("import", "--garment", "g.toml", "--", "--frames.csv", "a.csv", folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, "")
    assert "a.mcap: 30 frames" in done.stdout
    assert "lost: --frames.csv: no line names the columns" in done.stdout


@pytest.mark.parametrize(("option", "value"), [("--frames", 30), ("--unit", "mm"), ("--subject", "Who")])
def test_an_option_of_motion_capture_is_not_ignored_for_swung_cloth(tmp_path, option, value):
    changed(tmp_path / "r.npz")
    done = hangtime_here("import", "r.npz", option, value, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{option}: is for motion capture, and r.npz is none; leave out {option}" in done.stderr
    assert not (tmp_path / "takes").exists()


def swung(rate, poses=60, amplitude=0.4):
    """A bar that swings at 1 Hz: 16 m/s^2."""
    time = np.arange(poses) / rate
    place = np.stack([amplitude * np.sin(2 * np.pi * time), 0 * time, 1 + 0 * time], 1)
    return time, np.stack([place, place + np.array([0.4, 0, 0])], 1)


def test_single_jumps_are_counted_and_the_first_is_named_by_number_time_and_size():
    time, ends = swung(20.0)
    refuse_jumps(time, ends, "a.npz", one="pose", advice="leave it out")
    refuse_jumps(time, 100 * ends, "a.npz", one="pose", advice="")  # of another unit from end to end
    ends[20] += [0, 2, 0]
    with pytest.raises(ImplausibleError, match=r"1 pose jumps away .*, first number 21 at 1\.00 s, by 2 m; leave it"):
        refuse_jumps(time, ends, "a.npz", one="pose", advice="leave it out")
    ends[40, 1] -= [0, 0, 0.5]
    with pytest.raises(ImplausibleError, match=r"2 poses jump away .*, first number 21 .*, or --anyway to accept it"):
        refuse_jumps(time, ends, "a.npz", one="pose", advice="leave it out", offers_anyway=True)


@pytest.mark.parametrize("rate", [10.0, 30.0, 100.0, 500.0])
def test_noise_hard_swings_gaps_and_a_step_that_stays_are_no_single_jumps(rate):
    time, ends = swung(rate, 200, amplitude=0.0)
    noise = np.random.default_rng(0).normal(0, 0.005, ends.shape)
    refuse_jumps(time, ends + noise, "a", one="pose", advice="")
    step = ends.copy()
    step[100:] += 2.0  # not back: the path of another take, which other checks name
    refuse_jumps(time, step, "a", one="pose", advice="")
    gaps = ends.copy()
    gaps[50:60], gaps[70] = np.nan, np.nan
    refuse_jumps(time, gaps, "a", one="pose", advice="")
    refuse_jumps(time[:2], ends[:2], "a", one="pose", advice="")


def test_a_pose_of_an_arms_path_that_jumps_is_refused_and_anyway_reads_it(tmp_path):
    recorded(tmp_path)
    path = tmp_path / "arm/a.npz"
    with np.load(path) as archive:
        data = dict(archive)
    data["tcp_pose"][45, 1] += 2.0
    np.savez(path, **data)
    words = r"a\.npz: 1 pose jumps .* number 46 at 2\.25 s, by 2 m; leave such poses out of 'tcp_t' and 'tcp_pose'$"
    with pytest.raises(ImplausibleError, match=words):
        import_swung_cloth(tmp_path / "a.npz", hanger=path)
    assert np.nanmax(import_swung_cloth(tmp_path / "a.npz", hanger=path, anyway=True).held[:, :, 1]) > 1.9


def test_a_top_corner_that_jumps_is_refused_with_its_frame_and_names(tmp_path):
    """By 50 mm: one that jumps farther counts as not seen, as every marker does."""
    tracks = hanging_tracks()
    tracks.positions[12, 0, 1] += 0.05
    path = write_marker_csv(tmp_path / "a.csv", tracks)
    corner = GARMENT.points[0].name
    with pytest.raises(ImplausibleError, match=rf"1 frame jumps .* number 13 at .* by 0\.05 m; empty '{corner}' or"):
        import_marker_take(path, GARMENT)
    assert len(import_marker_take(path, GARMENT, MarkerOptions(anyway=True)).time) == 30
    tracks.positions[12, 0] = np.nan
    import_marker_take(write_marker_csv(path, tracks), GARMENT)


@pytest.mark.parametrize(
    ("value", "question"),
    [(0.3, ""), (0.6, ""), (0.99, ""), (0.001, ""), (60.0, "; were millimetres meant?"),
     (6.0, "; were millimetres or centimetres or inches meant?")],
)  # fmt: skip
def test_a_length_near_its_range_is_meant_as_it_is(value, question):
    """A marker of 0.6 m, 0.5 m being the most, is a slip of the hand: 0.6 cm or 0.6 inches are no marker's side."""
    assert unit_of(value, 0.005, 0.5) == question


def test_no_description_is_written_that_no_command_would_read(tmp_path):
    for code in "\t\n\x1b\u202e":
        named = msgspec.structs.replace(GARMENT, name=f"a{code}b")
        with pytest.raises(DescriptionError, match="name has the control character"):
            check_description(tmp_path / "garment.toml", named, overwrite=False)


@pytest.mark.parametrize(
    "name", ['a"b', "a'b", '"""', "a\\b", "=cmd|x", "<script>", "x" * 200, "a\tb", "a\nb", "a\x1b[31m", "\u202e"]
)
def test_a_swatch_of_any_name_is_read_again(tmp_path, name):
    assert hangtime_here("swatch", f"{name}.toml", "--mass", "0.05", folder=tmp_path).returncode == 0
    assert load_garment(tmp_path / f"{name}.toml").name == plain(name)


def test_a_description_where_a_recording_should_be_is_reported_where_it_belongs(tmp_path):
    done = hangtime_here("import", "g.toml", "--garment", "a.mcap", folder=tmp_path)
    assert done.stderr == "hangtime: g.toml: is a description, and no recording; give it as --garment g.toml\n"
    assert done.returncode == 2


def test_the_option_that_is_named_for_a_description_has_its_whole_path_as_a_shell_reads_it(tmp_path):
    done = hangtime_here("import", "my takes/it's.toml", folder=tmp_path)
    option = done.stderr.rstrip().rpartition("give it as ")[2]
    assert shlex.split(option) == ["--garment", "my takes/it's.toml"]


def test_a_swatch_is_no_take_by_its_name(tmp_path):
    done = hangtime_here("swatch", "g.mcap", "--mass", "0.05", folder=tmp_path)
    assert done.stderr == "hangtime: g.mcap: a garment is written as TOML; give a name that ends in .toml\n"
    assert not list(tmp_path.iterdir())


def test_a_wrong_ending_is_reported_with_the_right_one(tmp_path):
    (tmp_path / "a.c3d").write_text(TRC * 9)
    with pytest.raises(TakeError, match=r"the file lacks a C3D header\); the file is text: give it the ending \.trc"):
        read_marker_tracks(tmp_path / "a.c3d")
    (tmp_path / "b.c3d").write_bytes(bytes(600))
    with pytest.raises(TakeError, match=r"the file lacks a C3D header\); export it again"):
        read_marker_tracks(tmp_path / "b.c3d")
    (tmp_path / "a.csv").write_bytes(c3d_bytes(1e3 * drawn(), LABELS))
    with pytest.raises(TakeError, match=r"not a text file\); the file looks like C3D: give it the ending \.c3d"):
        read_marker_tracks(tmp_path / "a.csv")

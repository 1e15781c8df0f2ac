"""Marker files that contradict themselves are read with a warning, or refused with an error that quotes them."""

from __future__ import annotations

import numpy as np
import pytest

from formats.errors import ImplausibleError, TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from formats.plausible import check_plausible_times
from formats.swatch import swatch
from tests.fit.here import hangtime_here
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_tables import VICON
from tests.formats.test_other_programs_files import LABELS, check, drawn, motive, qualisys, trc


def read(tmp_path, text, name="a.csv", unit=None):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_marker_tracks(path, unit)


@pytest.mark.parametrize(("writer", "name"), [(trc, "a.trc"), (motive, "a.csv"), (qualisys, "a.tsv")])
def test_a_text_file_of_more_frames_than_it_states_is_read_whole_and_says_so(tmp_path, writer, name):
    found = read(tmp_path, writer(drawn(20), frames=17), name)
    check(found, drawn(20), 1e-6)
    assert found.warning == "the file states 17 frames and holds 20; all of them were read"
    assert read(tmp_path, writer(drawn(20)), name).warning == ""


def test_a_c3d_file_of_more_frames_than_it_states_says_how_many_were_read(tmp_path):
    """Zeros behind the last frame fill a block, and more; they are no frames."""
    raw = c3d_bytes(1e3 * drawn(60), LABELS, frames_said=20)
    found = read(tmp_path, raw, "a.c3d")
    check(found, drawn(60)[:20], 3e-7)
    assert found.warning.startswith("the file states 20 frames and has room for 6")
    whole = c3d_bytes(1e3 * drawn(60), LABELS)
    assert read(tmp_path, whole, "a.c3d").warning == read(tmp_path, whole + bytes(4096), "a.c3d").warning == ""


def test_a_line_of_more_cells_than_the_header_names_is_refused(tmp_path):
    text = trc(drawn(20)).rstrip("\n")
    assert len(read(tmp_path, text + "\t\t\n", "a.trc").time) == 20
    with pytest.raises(TakeError, match="line 26 has 12 cells, the header names 11"):
        read(tmp_path, text + "\t4.5\n", "a.trc")


@pytest.mark.parametrize("row", [",,,,,,,\n", "\n", ""])
def test_a_table_of_vicon_without_units_takes_the_unit_that_is_given(tmp_path, row):
    """A first frame that is taken for units would be lost, and its numbers called several units."""
    text = VICON.replace(",,mm,mm,mm,mm,mm,mm\n", row)
    with pytest.raises(TakeError, match="states no unit of length; give --unit"):
        read(tmp_path, text)
    found = read(tmp_path, text, unit="mm")
    assert found.time == pytest.approx([0.11, 0.12])
    assert found.positions[0] == pytest.approx(1e-3 * np.array([[1, 2, 3], [4, 5, 6]]))


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("d",), "the file names 4 markers and has the paths of 3; 'd' has none"),
        (("d", "", "e"), "the file names 5 markers and has the paths of 3; 'd', 'e' have none"),
        (tuple("defgh"), "the file names 8 markers and has the paths of 3; 'd', 'e', 'f' and 2 more have none"),
        (("", ""), ""),
    ],
)
def test_names_of_a_c3d_file_behind_its_last_point_are_reported(tmp_path, more, told):
    found = read(tmp_path, c3d_bytes(1e3 * drawn(), (*LABELS, *more)), "a.c3d")
    check(found, drawn(), 3e-7)
    assert found.warning == told


def test_a_marker_that_a_c3d_file_names_without_a_path_is_reported_as_such(tmp_path):
    names = swatch(0.05, side=0.4, markers=4).point_names
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(1e3 * drawn(60).reshape(12, 15, 3), names))
    words = (
        f"names {names[15]!r} and has no path of it: the file has 15 paths and 16 names; export it again with the paths"
    )
    with pytest.raises(TakeError, match=words):
        import_marker_take(tmp_path / "a.c3d", swatch(0.05, side=0.4, markers=4))


def test_a_second_section_of_trajectories_is_refused_with_its_line(tmp_path):
    second = VICON[VICON.index("Trajectories") : VICON.index("\nModel")]
    with pytest.raises(TakeError, match="has trajectories twice, in lines 5 and 15"):
        read(tmp_path, VICON + second)


def test_a_warning_reaches_who_imports_a_file_and_stays_in_the_take(tmp_path):
    garment, frames = swatch(0.05, side=0.4, markers=4), 24
    places = np.array([[x, 0.0, 1 + y] for x, y in (point.at_m for point in garment.points)])
    time = np.arange(frames) / 100
    swung = places + 0.01 * np.sin(6 * time)[:, None, None]
    names = garment.point_names
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(1e3 * swung, names, frames_said=20))
    hangtime_here("swatch", "g.toml", "--mass", "0.05", "--side", "0.4", "--markers", "4", folder=tmp_path)
    done = hangtime_here("import", "a.c3d", "--garment", "g.toml", "--out", "out", folder=tmp_path)
    assert "Warning: the file states 20 frames and has room for" in done.stdout, done.stderr
    take = import_marker_take(tmp_path / "a.c3d", garment, MarkerOptions())
    assert take.notes["file"].startswith("the file states 20 frames")
    with pytest.raises(TakeError, match=r"--frames: a fit needs 20 frames or more, not 1"):
        import_marker_take(tmp_path / "a.c3d", garment, MarkerOptions(frames=1))


@pytest.mark.parametrize(("rate", "advice"), [(4.9, "record with more frames"), (1200.0, "leave out frames")])
def test_a_rate_that_just_misses_the_range_is_reported_as_a_rate(rate, advice):
    with pytest.raises(ImplausibleError, match=f"has {rate:g} frames a second; a garment needs 5 to 1000; {advice}"):
        check_plausible_times(np.arange(40) / rate, "a.csv")


def test_a_rate_that_is_far_off_is_reported_as_times_in_another_unit():
    with pytest.raises(ImplausibleError, match="are these milliseconds"):
        check_plausible_times(np.arange(40) * 10.0, "a.csv")


def test_a_long_cell_for_a_frame_rate_is_not_shown_whole(tmp_path):
    with pytest.raises(TakeError, match=r"its frame rate is '9{40}'"):
        read(tmp_path, VICON.replace("Trajectories\n100", "Trajectories\n" + "9" * 5000))

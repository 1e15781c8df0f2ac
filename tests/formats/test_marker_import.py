"""Motion capture files become takes, or say in one sentence why not."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from formats.archive import read_take
from formats.descriptions import dump_description, load_garment
from formats.errors import ImplausibleError, TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.importers.swatch_mocap import DOWNWARD, MarkerOptions, import_marker_take
from formats.swatch import swatch
from tests.fit.here import hangtime_here

GARMENT = swatch(0.05)


def hanging_tracks(frames=30, rate=120.0):
    """The 81 markers of a swatch that hangs still in the x-z plane, z up."""
    flat = np.array([p.at_m for p in GARMENT.points])
    place = np.stack([flat[:, 0], 0 * flat[:, 0], 1.5 + flat[:, 1]], 1)
    positions = np.broadcast_to(place, (frames, *place.shape)).copy()
    return MarkerTracks(GARMENT.point_names, np.arange(frames) / rate, positions)


def write_c3d(path, tracks, *, unit="mm", subject=""):
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [120.0]
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["LABELS"]["value"] = [subject + label for label in tracks.labels]
    scale = {"mm": 1e3, "m": 1.0, "ell": 0.87}[unit]
    points = np.ones((4, len(tracks.labels), len(tracks.time)))
    points[:3] = scale * np.moveaxis(tracks.positions, 2, 0).swapaxes(1, 2)
    file["data"]["points"] = points
    file.write(str(path))
    return path


def test_nine_by_nine_markers_on_half_a_metre_are_62_5_mm_apart():
    assert len(GARMENT.points) == 81
    assert GARMENT.points[1].at_m[0] - GARMENT.points[0].at_m[0] == pytest.approx(0.0625)
    assert GARMENT.points[0].at_m == GARMENT.outline_m[0]
    assert GARMENT.points[80].at_m == GARMENT.outline_m[2]


def test_csv_comes_back_to_a_micrometre_with_its_gaps(tmp_path):
    tracks = hanging_tracks()
    tracks.positions[3, 7] = np.nan
    again = read_marker_tracks(write_marker_csv(tmp_path / "a.csv", tracks))
    assert again.labels == tracks.labels
    assert np.isnan(again.positions[3, 7]).all()
    assert np.nanmax(np.abs(again.positions - tracks.positions)) <= 0.51e-6


def test_c3d_in_millimetres_with_a_subjects_name_gives_the_same_markers(tmp_path):
    """A marker at 1.5 m height is at 1500 in the file; absent ones come back as absent."""
    tracks = hanging_tracks()
    tracks.positions[5, 2] = np.nan
    again = read_marker_tracks(write_c3d(tmp_path / "a.c3d", tracks, subject="Swatch:"))
    assert again.labels == tuple(f"Swatch:{label}" for label in tracks.labels)
    assert again.time[1] == pytest.approx(1 / 120)
    assert np.isnan(again.positions[5, 2]).all()
    assert np.nanmax(np.abs(again.positions - tracks.positions)) < 1e-6
    assert again.positions[0, 0, 2] == pytest.approx(1.5)


def test_c3d_in_an_unknown_unit_is_refused(tmp_path):
    with pytest.raises(TakeError, match="unit of its points is 'ell'"):
        read_marker_tracks(write_c3d(tmp_path / "a.c3d", hanging_tracks(), unit="ell"))


def test_the_command_keeps_so_many_frames_from_the_beginning(tmp_path):
    write_marker_csv(tmp_path / "a.csv", hanging_tracks())
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    done = hangtime_here("import", "a.csv", "--garment", "g.toml", "--frames", 20, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert read_take(tmp_path / "takes" / "a.mcap").time == pytest.approx(np.arange(20) / 120, abs=1e-5)


def test_a_take_is_driven_by_the_markers_on_its_top_corners(tmp_path):
    take = import_marker_take(write_marker_csv(tmp_path / "a.csv", hanging_tracks()), GARMENT)
    assert take.held[0] == pytest.approx(np.array([[-0.25, 0.0, 1.5], [0.25, 0.0, 1.5]]))
    assert take.rig.gravity == (0.0, 0.0, -1.0)
    assert take.points.shape == (30, 81, 3)


def standing(tracks, axis):
    """The same markers in a frame in which this axis points up instead of z."""
    sign, k = (-1 if axis.startswith("-") else 1), "xyz".index(axis[-1])
    turned = np.roll(tracks.positions, k - 2, axis=2)
    turned[..., k] *= sign
    return MarkerTracks(tracks.labels, tracks.time, turned)


def test_y_up_means_gravity_along_minus_y(tmp_path):
    path = write_marker_csv(tmp_path / "a.csv", standing(hanging_tracks(), "y"))
    assert import_marker_take(path, GARMENT, MarkerOptions(up="y")).rig.gravity == (0.0, -1.0, 0.0)


@pytest.mark.parametrize("fitting", DOWNWARD)
@pytest.mark.parametrize("given", DOWNWARD)
def test_only_the_axis_along_which_the_cloth_hangs_is_taken_as_up(tmp_path, given, fitting):
    """Eight rows hang 62.5 to 500 mm below the held corners, 281 mm in the median."""
    path = write_marker_csv(tmp_path / "a.csv", standing(hanging_tracks(), fitting))
    if given == fitting:
        import_marker_take(path, GARMENT, MarkerOptions(up=given))
        return
    drop = "281 mm above" if given[-1] == fitting[-1] else "0 mm below"
    with pytest.raises(
        TakeError,
        match=f"with {given} up the markers are {drop} the held .*, and 281 mm below on the .*; give --up {fitting},",
    ):
        import_marker_take(path, GARMENT, MarkerOptions(up=given))


def test_cloth_that_is_swung_by_60_degrees_throughout_is_taken_and_cloth_that_lies_on_a_table_is_not(tmp_path):
    """cos 60 degrees = 1/2 of the flat drop."""
    swung, lying = hanging_tracks(), hanging_tracks()
    down = swung.positions[..., 2] - 1.5
    swung.positions[..., 1:] = np.stack([down * np.sin(np.pi / 3), 1.5 + down / 2], -1)
    import_marker_take(write_marker_csv(tmp_path / "a.csv", swung), GARMENT)
    # Gathered towards the middle of the table as well, so that it hangs along no axis.
    lying.positions[..., 1:] = np.stack([np.abs(down + 0.25) / 2, 1.5 + 0 * down], -1)
    with pytest.raises(TakeError, match=r"with z up the markers are 0 mm .*; record cloth that hangs"):
        import_marker_take(write_marker_csv(tmp_path / "b.csv", lying), GARMENT)


def test_markers_whose_held_corners_were_never_seen_together_with_them_are_not_judged(tmp_path):
    tracks = hanging_tracks()
    tracks.positions[::2, [0, 8]] = np.nan
    tracks.positions[1::2, 9:] = np.nan
    take = import_marker_take(write_marker_csv(tmp_path / "a.csv", tracks), GARMENT)
    assert take.held_valid.all(1).sum() == 15


def renamed(tracks):
    return MarkerTracks(("M1", *tracks.labels[1:]), tracks.time, tracks.positions)


def in_centimetres(tracks):
    return MarkerTracks(tracks.labels, tracks.time, 100 * tracks.positions)


def backwards(tracks):
    return MarkerTracks(tracks.labels, tracks.time[::-1], tracks.positions)


def swapped(tracks):
    order = [8, *range(1, 8), 0, *range(9, 81)]
    return MarkerTracks(tuple(tracks.labels[k] for k in order), tracks.time, tracks.positions)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (renamed, "1 of the garment's 81 markers is not in the file, first 'row1_column1'"),
        (in_centimetres, "are 6250 mm apart, on the flat garment 62 mm"),
        (backwards, "time does not increase"),
        (swapped, "are 438 mm apart, on the flat garment 62 mm"),
    ],
)
def test_markers_that_do_not_fit_the_garment_are_refused(tmp_path, change, sentence):
    path = write_marker_csv(tmp_path / "a.csv", change(hanging_tracks()))
    with pytest.raises(TakeError, match=sentence):
        import_marker_take(path, GARMENT)


def test_fewer_frames_than_asked_for_are_refused(tmp_path):
    path = write_marker_csv(tmp_path / "a.csv", hanging_tracks())
    with pytest.raises(
        TakeError, match="has 30 frames, --frames asks for 500; give --frames 30 or fewer, or leave it out"
    ):
        import_marker_take(path, GARMENT, MarkerOptions(frames=500))


def test_a_garment_without_markers_on_its_corners_is_refused(tmp_path):
    import msgspec

    wide = msgspec.structs.replace(GARMENT, outline_m=((-0.3, 0.05), (0.3, 0.05), (0.3, -0.55), (-0.3, -0.55)))
    path = write_marker_csv(tmp_path / "a.csv", hanging_tracks())
    with pytest.raises(TakeError, match="no marker sits on the garment's top left corner, the nearest is 71 mm off"):
        import_marker_take(path, wide)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time_s,a_x_m,a_y_m\n0,1,2\n", "column 4 of line 1 is missing, not 'a_z_m'"),
        ("time_s,a_x_m,a_y_m,a_z_m\n0,1,2\n", "line 2 has 3 columns, not 4"),
        ("", "is empty"),
        ("time_s,a_x_m,a_y_m,a_z_m\n0,1,2,1e999\n", "line 2 holds '1e999', which is no number"),
        ("time_s,a_x_m,a_y_m,a_z_m\n0,1,2," + 200_000 * "3" + "\n", "has a cell of more than 131072 characters"),
        ("time_s,a_x_m,a_y_m,a_z_m\n0,1,2,three\n", "line 2 holds .three., which is no number"),
        ("time_s,a_x_m,a_y_m,a_z_m\n0,,,\n1,0,0,0\n", "no marker was ever seen"),
    ],
)
def test_malformed_csv_names_its_line(tmp_path, text, sentence):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(TakeError, match=sentence):
        read_marker_tracks(tmp_path / "a.csv")


def test_a_byte_order_mark_is_no_part_of_the_first_column(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,a_x_m,a_y_m,a_z_m\n0,1,2,3\n", encoding="utf-8-sig")
    assert read_marker_tracks(tmp_path / "a.csv").labels == ("a",)


def test_bytes_that_are_no_c3d_are_refused(tmp_path):
    (tmp_path / "a.c3d").write_bytes(b"nothing of the kind" * 100)
    with pytest.raises(TakeError, match="no C3D file that can be read"):
        read_marker_tracks(tmp_path / "a.c3d")


def test_from_the_command_line_a_csv_becomes_an_archive(tmp_path):
    write_marker_csv(tmp_path / "a.csv", hanging_tracks())
    assert "81 markers, 62.5 mm apart" in hangtime_here("swatch", "s.toml", "--mass", 0.05, folder=tmp_path).stdout
    assert load_garment(tmp_path / "s.toml").points == GARMENT.points
    done = hangtime_here("import", "a.csv", "--garment", "s.toml", "--out", "takes", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    take = read_take(tmp_path / "takes" / "a.mcap")
    assert take.points == pytest.approx(hanging_tracks().positions, abs=1e-4)
    assert (tmp_path / "takes" / "garment.toml").read_text() == dump_description(load_garment(tmp_path / "s.toml"))


@pytest.mark.parametrize("mass", ["inf", "60", "nan", "0"])
def test_a_swatch_of_a_weight_that_no_command_reads_is_not_written(tmp_path, mass):
    done = hangtime_here("swatch", "s.toml", "--mass", mass, folder=tmp_path)
    assert done.returncode == 2
    assert f"{mass} kg" in done.stderr or f"got {mass}" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_times_in_milliseconds_are_refused_and_nothing_is_written(tmp_path):
    """120 frames a second lie 8.3 ms apart."""
    tracks = hanging_tracks()
    write_marker_csv(tmp_path / "a.csv", MarkerTracks(tracks.labels, 1e3 * tracks.time, tracks.positions))
    (tmp_path / "s.toml").write_text(dump_description(GARMENT))
    done = hangtime_here("import", "a.csv", "--garment", "s.toml", "--out", "takes", folder=tmp_path)
    assert done.returncode == 2
    assert "a.csv: its frames are 8.33333 s apart in the median; are these milliseconds?" in done.stderr
    assert not (tmp_path / "takes").exists()


def test_motion_capture_without_a_garment_gives_one_sentence_and_exit_code_2(tmp_path):
    write_marker_csv(tmp_path / "a.csv", hanging_tracks())
    done = hangtime_here("import", "a.csv", folder=tmp_path)
    assert done.returncode == 2
    assert "motion capture needs to know the garment; give --garment FILE" in done.stderr
    assert not (tmp_path / "takes").exists()


def test_a_text_file_takes_a_few_times_its_own_size_of_memory(tmp_path):
    """Two megabytes: the bytes, the lines, and 8 bytes for each number of 10 letters; all cells at once took 60 MB."""
    cells = "0.1234567," * 120
    text = "time_s" + "".join(f",m{k}_x_m,m{k}_y_m,m{k}_z_m" for k in range(40)) + "\n"
    text += "".join(f"{k / 100},{cells[:-1]}\n" for k in range(1700))
    (tmp_path / "a.csv").write_text(text)
    tracemalloc.start()
    try:
        tracks = read_marker_tracks(tmp_path / "a.csv")
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert tracks.positions.shape == (1700, 40, 3)
    assert most < 6 * len(text)


@pytest.mark.parametrize(("turn", "front"), [([1, 1], "-y"), ([-1, 1], "y")])
def test_the_import_says_which_way_the_front_looks_as_a_mirror_image_looks_like_a_back(tmp_path, turn, front):
    """Left to right along x with z up: the front looks along -y, and of the mirrored file along y."""
    tracks = hanging_tracks()
    tracks.positions[..., 0] *= turn[0]
    write_marker_csv(tmp_path / "a.csv", tracks)
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    done = hangtime_here("import", "a.csv", "--garment", "g.toml", folder=tmp_path)
    assert done.stdout.partition("\n")[0].endswith(f" s, its front looks along {front}")


def test_a_take_begins_at_0_s_wherever_the_clock_of_its_file_does(tmp_path):
    tracks = hanging_tracks()
    late = MarkerTracks(tracks.labels, tracks.time + 5.0, tracks.positions)
    take = import_marker_take(write_marker_csv(tmp_path / "a.csv", late), GARMENT)
    assert take.time == pytest.approx(tracks.time, abs=2e-6)


def test_a_rate_that_the_times_contradict_is_refused_with_the_files_name(tmp_path):
    tracks, path = hanging_tracks(), tmp_path / "a.trc"
    head = ["PathFileType\t4\t(X/Y/Z)\ta.trc", "DataRate\tNumFrames\tNumMarkers\tUnits", "240\t30\t81\tm"]
    names = "Frame#\tTime\t" + "".join(f"{name}\t\t\t" for name in tracks.labels)
    rows = [
        "\t".join([str(k + 1), f"{time:.6f}", *(f"{value:.6f}" for value in tracks.positions[k].ravel())])
        for k, time in enumerate(tracks.time)
    ]
    path.write_text("\n".join([*head, names, *rows]) + "\n")
    with pytest.raises(ImplausibleError) as refused:
        import_marker_take(path, GARMENT)
    assert str(refused.value).startswith(f"{path}: its times come at 120 frames a second, and the file states 240; ")


def test_the_first_frame_of_a_trc_file_without_a_line_of_axes_is_read(tmp_path):
    """Some programs leave out the line of X1, Y1, Z1."""
    head = ["PathFileType\t4\t(X/Y/Z)\ta.trc", "DataRate\tNumFrames\tNumMarkers\tUnits", "100\t3\t1\tm"]
    frames = [f"{k}\t{(k - 1) / 100:.2f}\t0.1\t0.2\t{k}.5" for k in (1, 2, 3)]
    for axes in ([], ["\t\tX1\tY1\tZ1"]):
        path = tmp_path / "a.trc"
        path.write_text("\n".join([*head, "Frame#\tTime\ta\t\t", *axes, *frames]) + "\n")
        assert read_marker_tracks(path).positions[:, 0, 2].tolist() == [1.5, 2.5, 3.5]


def test_the_rate_of_motive_is_that_of_its_export_where_it_states_both(tmp_path):
    path = tmp_path / "a.csv"
    head = "Format Version,1.23,Capture Frame Rate,240,Export Frame Rate,120,Length Units,Meters"
    rows = [",Type,Marker,Marker,Marker", ",Name,a,a,a", ",,Position,Position,Position", "Frame,Time,X,Y,Z"]
    frames = [f"{k},{k / 120:.6f},0.1,0.2,0.3" for k in range(4)]
    path.write_text("\n".join([head, *rows, *frames]) + "\n")
    assert read_marker_tracks(path).rate == 120.0

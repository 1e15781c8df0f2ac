"""Files of other programs give the same marker paths, or one true sentence."""

from __future__ import annotations

import contextlib
import os
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from formats.errors import TakeError
from formats.importers.c3d_file import read_c3d
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import MarkerTracks
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from formats.swatch import swatch
from tests.formats.c3d_by_hand import c3d_bytes
from tests.shared_data import SHARED_DATA

LABELS = ("a", "b", "c")
REAL_C3D = SHARED_DATA / "c3d"


def drawn(frames=20):
    """Three markers at 100 frames a second; b was not seen in frames 5 to 7. Metres, whole tenths of millimetres."""
    rng = np.random.default_rng(1)
    positions = rng.integers(-20_000, 20_000, (frames, 3, 3)) * 1e-4
    positions[5:8, 1] = np.nan
    return positions


def check(tracks, positions, tolerance):
    assert [label.rpartition(":")[2] for label in tracks.labels] == list(LABELS)
    np.testing.assert_allclose(np.diff(tracks.time), 0.01, atol=1e-6)
    np.testing.assert_allclose(tracks.positions, positions, atol=tolerance)


@pytest.mark.parametrize("processor", ["intel", "dec", "sgi"])
@pytest.mark.parametrize("scale", [-1.0, 0.1])
def test_c3d_of_every_byte_order_as_floats_and_integers(tmp_path, processor, scale):
    """Integers are in tenths of a millimetre."""
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(1e3 * drawn(), LABELS, processor=processor, scale=scale))
    check(read_marker_tracks(path), drawn(), 2e-7 if scale < 0 else 5.1e-5)


@pytest.mark.parametrize("unit", ["mm", "MM", "Millimeters", "cm", "m", "meters", "Metres", "inches"])
def test_c3d_in_a_unit_however_it_is_spelt(tmp_path, unit):
    metres = {"mm": 1e-3, "mi": 1e-3, "cm": 1e-2, "m": 1.0, "me": 1.0, "in": 0.0254}[unit.lower()[:2]]
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(drawn() / metres, LABELS, units=(unit,)))
    check(read_marker_tracks(path), drawn(), 3e-7)


def test_c3d_with_a_unit_for_each_point_and_with_none(tmp_path):
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(drawn() * [[1e3], [1e2], [1e3]], LABELS, units=("mm", "cm", "mm")))
    check(read_marker_tracks(path), drawn(), 3e-7)
    path.write_bytes(c3d_bytes(1e3 * drawn(), LABELS, units=()))
    with pytest.raises(TakeError, match="states no unit of length; give --unit"):
        read_marker_tracks(path)
    check(read_marker_tracks(path, "mm"), drawn(), 3e-7)
    path.write_bytes(c3d_bytes(1e3 * drawn(), LABELS))
    with pytest.raises(TakeError, match="states its lengths in mm, not cm"):
        read_marker_tracks(path, "cm")


def test_c3d_with_more_labels_than_points_and_with_fewer(tmp_path):
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(1e3 * drawn(), (*LABELS, "spare", "spare")))
    check(read_marker_tracks(path), drawn(), 3e-7)
    path.write_bytes(c3d_bytes(1e3 * drawn(), LABELS[:2]))
    assert read_marker_tracks(path).labels == ("a", "b", "unlabelled_2")


def test_c3d_at_an_odd_rate_keeps_it(tmp_path):
    """69.99 Hz is what a real system calls 70."""
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(1e3 * drawn(), LABELS, rate=69.99))
    assert read_marker_tracks(path).time[-1] == pytest.approx(19 / 69.99, rel=1e-6)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (c3d_bytes(1e3 * drawn(60), LABELS)[:-2048], r"holds \d\d of the 60 frames that its header states"),
        (c3d_bytes(1e3 * drawn(20), LABELS, frames_said=500), "of the 500 frames that its header states"),
        (c3d_bytes(1e3 * drawn(), LABELS, rate=0.0), "states no frame rate above 0"),
        (c3d_bytes(np.zeros((20, 0, 3)), ()), r"has no marker paths \(0 points"),
        (b"\x02\x50" + bytes(300), "is no C3D file"),
        (b"hello" * 300, "is no C3D file"),
    ],
)
def test_c3d_that_cannot_be_used_says_why(tmp_path, content, words):
    path = tmp_path / "a.c3d"
    path.write_bytes(content)
    with pytest.raises(TakeError, match=words):
        read_marker_tracks(path)


def test_a_c3d_file_of_any_name_is_read(tmp_path):
    path = tmp_path / os.fsdecode("Rück-\u80cc \u202e".encode() + b"\xff.c3d")
    path.write_bytes(c3d_bytes(1e3 * drawn(), LABELS))
    check(read_marker_tracks(path), drawn(), 3e-7)


@pytest.mark.shared_data
@pytest.mark.skipif(not REAL_C3D.is_dir(), reason=f"no real recordings at {REAL_C3D}")
@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("Vicon", (51, 580)), ("Qualisys", (55, 340)), ("BTS", (22, 675)), ("Optotrak", "holds 29 of the 1149 frames"),
        ("kt_racing_full", (46, 700)), ("Kistler", r"has no marker paths \(0 points, 3969 frames"),
        ("C3DRotationExample", r"has no marker paths \(0 points, 340 frames, 21 rotations"),
    ],
)  # fmt: skip
def test_real_c3d_files_are_read_or_refused_with_a_true_sentence(name, found):
    path = REAL_C3D / f"{name}.c3d"
    if isinstance(found, str):
        with pytest.raises(TakeError, match=found):
            read_marker_tracks(path)
        return
    tracks = read_marker_tracks(path)
    assert (len(tracks.labels), len(tracks.time)) == found
    assert 0.3 < np.nanmax(np.abs(tracks.positions)) < 20, "metres"


def cell(value, digits=5):
    return "" if np.isnan(value) else f"{value:.{digits}f}"


def trc(positions, *, gap=cell, frames=None, unit="mm"):
    head = [
        "PathFileType\t4\t(X/Y/Z)\ta.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        f"100.00\t100.00\t{frames or len(positions)}\t3\t{unit}", "Frame#\tTime\t" + "\t\t\t".join(LABELS) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{k}" for k in (1, 2, 3) for axis in "XYZ"), "",
    ]  # fmt: skip
    rows = [f"{k + 1}\t{k / 100:.5f}\t" + "\t".join(gap(1e3 * v) for v in p.ravel()) for k, p in enumerate(positions)]
    return "\n".join([*head, *rows, ""])


def vicon(positions, *, gap=cell, separator=","):
    def line(*cells):
        return separator.join(cells)

    head = ["Trajectories", "100", line("", "", *(f"Bar:{label}{2 * separator}" for label in LABELS)),
            line("Frame", "Sub Frame", *"XYZ" * 3), line("", "", *["mm"] * 9)]  # fmt: skip
    rows = [line(str(71 + k), "0", *(gap(1e3 * v) for v in p.ravel())) for k, p in enumerate(positions)]
    devices = [
        line("Devices"),
        "1000",
        line("", "", "Force plate"),
        line("Frame", "Sub Frame", "Fx"),
        line("71", "0", "9.81"),
    ]
    return "\r\n".join([*devices, "", *head, *rows, ""])


def motive(positions, *, gap=cell, frames=None):
    head = [
        "Format Version,1.23,Take Name,a,Capture Frame Rate,100.000000,Export Frame Rate,100.000000,"
        f"Total Exported Frames,{frames or len(positions)},Length Units,Meters,Coordinate Space,Global",
        "", ",Type," + ",".join(["Rigid Body"] * 3 + ["Marker"] * 9),
        ",Name," + ",".join(["Bar"] * 3 + [f"Cloth:{label}" for label in LABELS for _ in range(3)]),
        ",ID," + ",".join(["1"] * 12), ",," + ",".join(["Rotation"] * 3 + ["Position"] * 9),
        "Frame,Time (Seconds)," + ",".join("XYZ" * 4),
    ]  # fmt: skip
    rows = [f"{k},{k / 100:.6f},1,2,3," + ",".join(gap(v, 6) for v in p.ravel()) for k, p in enumerate(positions)]
    return "\n".join([*head, *rows, ""])


def qualisys(positions, *, gap=cell, frames=None):
    head = [f"NO_OF_FRAMES\t{frames or len(positions)}", "NO_OF_CAMERAS\t8", "NO_OF_MARKERS\t3", "FREQUENCY\t100",
            "NO_OF_ANALOG\t0", "DESCRIPTION\t--", "MARKER_NAMES\t" + "\t".join(LABELS)]  # fmt: skip
    rows = ["\t".join(gap(1e3 * v, 3) for v in p.ravel()) for p in positions]
    return "\n".join([*head, *rows, ""])


def ours(positions, *, gap=cell, separator=","):
    head = separator.join(["time_s", *(label + axis for label in LABELS for axis in ("_x_m", "_y_m", "_z_m"))])
    rows = [separator.join([f"{k / 100:.6f}", *(gap(v) for v in p.ravel())]) for k, p in enumerate(positions)]
    return "\n".join([head, *rows, ""])


def as_zero(value, digits=5):
    return f"{0.0 if np.isnan(value) else value:.{digits}f}"


WRITERS = {"trc": trc, "vicon.csv": vicon, "motive.csv": motive, "qualisys.tsv": qualisys, "ours.csv": ours}


@pytest.mark.parametrize("gap", [cell, as_zero], ids=["empty", "zero"])
@pytest.mark.parametrize("name", WRITERS)
def test_a_text_file_of_each_program_gives_the_same_paths_however_it_writes_gaps(tmp_path, name, gap):
    path = tmp_path / f"a.{name}"
    path.write_text(WRITERS[name](drawn(), gap=gap))
    check(read_marker_tracks(path), drawn(), 1e-6)


HALF_A_DIGIT = {"trc": 5e-9, "vicon.csv": 5e-9, "motive.csv": 5e-7, "qualisys.tsv": 5e-7, "ours.csv": 5e-6}  # m


@pytest.mark.parametrize("name", WRITERS)
@given(data=st.data())
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_positions_of_any_size_and_sign_come_back_to_half_a_digit_and_gaps_as_gaps(tmp_path, name, data):
    """Up to 50 m; a position at the origin means a gap, so that no coordinate is smaller than a millimetre."""
    frames = data.draw(st.integers(1, 12))
    size = st.floats(1e-3, 50.0) | st.floats(-50.0, -1e-3)
    positions = np.array(data.draw(st.lists(size, min_size=9 * frames, max_size=9 * frames))).reshape(frames, 3, 3)
    hidden = np.array(data.draw(st.lists(st.booleans(), min_size=3 * frames, max_size=3 * frames))).reshape(frames, 3)
    hidden[0, 0] = False
    positions[hidden] = np.nan
    path = tmp_path / f"a.{name}"
    path.write_text(WRITERS[name](positions))
    found = read_marker_tracks(path).positions
    np.testing.assert_array_equal(np.isnan(found), np.isnan(positions))
    assert np.nanmax(np.abs(found - positions)) <= 1.001 * HALF_A_DIGIT[name]


@pytest.mark.parametrize("name", ["NO_OF_MARKERS", "FREQUENCY", "NO_OF_FRAMES", "MARKER_NAMES"])
def test_a_line_of_qualisys_head_without_its_value_is_one_sentence(tmp_path, name):
    """The fuzzer found it."""
    text = "\n".join(name if line.startswith(name) else line for line in qualisys(drawn()).split("\n"))
    (tmp_path / "a.tsv").write_text(text)
    with pytest.raises(TakeError, match=r"a\.tsv: (its|names 0 markers)"):
        read_marker_tracks(tmp_path / "a.tsv")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("name", WRITERS)
def test_a_text_file_of_any_encoding(tmp_path, name, encoding):
    path = tmp_path / f"a.{name}"
    path.write_bytes(WRITERS[name](drawn()).encode(encoding))
    check(read_marker_tracks(path), drawn(), 1e-6)


@pytest.mark.parametrize("writer", [ours, vicon])
def test_semicolons_and_decimal_commas(tmp_path, writer):
    path = tmp_path / "a.csv"
    path.write_text(writer(drawn(), separator=";").replace(".", ","))
    check(read_marker_tracks(path), drawn(), 1e-6)


@pytest.mark.parametrize("writer", [trc, motive, qualisys])
def test_a_text_file_of_fewer_frames_than_it_states_is_refused_with_the_counts(tmp_path, writer):
    path = tmp_path / "a.tsv"
    path.write_text(writer(drawn(), frames=29))
    with pytest.raises(TakeError, match="holds 20 of the 29 frames that it states"):
        read_marker_tracks(path)


@pytest.mark.parametrize("count", [150, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", WRITERS)
def test_a_text_file_that_is_cut_or_spoilt_is_one_sentence_or_read(tmp_path, name, count):
    """Of so many accidents for each program, no other error than ours."""
    raw, rng = WRITERS[name](drawn()).encode(), np.random.default_rng(3)
    path = tmp_path / f"a.{name}"
    for _ in range(count):
        broken = bytearray(raw[: int(rng.integers(len(raw)))] if rng.random() < 0.5 else raw)
        for at in rng.integers(max(len(broken), 1), size=int(rng.integers(4))):
            broken[at : at + 1] = rng.bytes(int(rng.integers(3)))
        path.write_bytes(bytes(broken))
        with contextlib.suppress(TakeError):
            read_marker_tracks(path, "mm" if rng.random() < 0.2 else None)


def test_doubled_labels_matter_only_among_the_markers_of_the_garment(tmp_path):
    """Two subjects have a marker `tip`; two others have all of the swatch's."""
    garment = swatch(0.05, markers=4)
    flat = np.array([point.at_m for point in garment.points])
    place = np.broadcast_to(np.stack([flat[:, 0], 0 * flat[:, 0], 1.5 + flat[:, 1]], 1), (30, 16, 3))
    names = [f"Swatch:{name}" for name in garment.point_names]
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(1e3 * np.concatenate([place, place[:, :2]], 1), [*names, "Bar:tip", "Stand:tip"]))
    assert len(import_marker_take(path, garment).time) == 30
    others = [f"Other:{name}" for name in garment.point_names]
    path.write_bytes(c3d_bytes(1e3 * np.concatenate([place, place + 0.5], 1), names + others))
    with pytest.raises(TakeError, match="'row1_column1' comes 2 times; give --subject, one of Other, Swatch"):
        import_marker_take(path, garment)
    take = import_marker_take(path, garment, MarkerOptions(subject="Other"))
    np.testing.assert_allclose(take.points, place + 0.5, atol=1e-6)


def test_tracks_find_a_whole_label_before_a_name_after_a_colon():
    tracks = MarkerTracks(("s:a", "a"), np.zeros(1), np.zeros((1, 2, 3)))
    assert (tracks.columns_named("a"), tracks.columns_named("a", "s"), tracks.columns_named("s:a")) == ([1], [0], [0])


@pytest.mark.parametrize("ending", [b"", b"x"])
def test_a_c3d_file_of_sgi_order_whose_data_begin_nowhere_is_read_or_refused(tmp_path, ending):
    """Its header says that the data begin in block 0, and no parameter knows better; the fuzzer found it."""
    raw = bytearray(c3d_bytes(1e3 * drawn(), LABELS, processor="sgi"))
    raw[16:18] = bytes(2)
    whole = raw.replace(b"DATA_START", b"DATA_STOPS")
    path = tmp_path / "a.c3d"
    path.write_bytes(whole[: len(whole) - len(ending)] + ending)  # what fills the last block is not zeros
    if ending:
        with pytest.raises(TakeError, match="states block 0 as the first of its frames, which is before the"):
            read_c3d(path, None)
    else:
        check(read_marker_tracks(path), drawn(), 3e-7)


def test_of_a_thousand_damaged_c3d_files_none_ends_the_command(tmp_path):
    raw, rng = c3d_bytes(1e3 * drawn(), LABELS), np.random.default_rng(0)
    path = tmp_path / "a.c3d"
    for _ in range(1000):
        broken = bytearray(raw)
        for at in rng.integers(1024, size=3):
            broken[at] = int(rng.integers(256))
        path.write_bytes(bytes(broken))
        with contextlib.suppress(TakeError):
            read_marker_tracks(path)


@pytest.mark.parametrize(
    ("label", "read"),
    [
        ("Rücken".encode(), "Rücken"), ("Rücken".encode("latin-1"), "Rücken"),
        ("R\u0075\u0308cken".encode(), "Ru\u0308cken"), ("背中".encode(), "背中"), (b"R\x81cken", "R\\x81cken"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("processor", ["intel", "sgi"])
def test_a_label_beyond_ascii_is_kept_and_a_byte_of_no_sign_is_shown_by_its_code(tmp_path, label, read, processor):
    """UTF-8, western Windows, an accent of its own, and a byte that is in neither encoding."""
    path = tmp_path / "a.c3d"
    place = label.ljust(24).decode("latin-1")
    raw = c3d_bytes(1e3 * drawn(), ("x" * 24, *LABELS[1:]), processor=processor)
    path.write_bytes(raw.replace(b"x" * 24, place.encode("latin-1")))
    assert read_marker_tracks(path).labels == (read, *LABELS[1:])


def test_a_long_c3d_file_costs_little_more_than_its_positions(tmp_path):
    """60,000 frames of 10 points: 14 MB of positions."""
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(np.ones((60_000, 10, 3)), [f"m{k}" for k in range(10)], scale=0.1))
    tracemalloc.start()
    try:
        tracks = read_c3d(path, None)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert tracks.positions[-1, -1] == pytest.approx([1e-3] * 3)
    assert most < 2 * tracks.positions.nbytes + 64e6


def test_a_parameter_that_no_marker_path_needs_may_be_wrong(tmp_path):
    """A group POINT whose rate has no such kind is refused; a group of another name is not read."""
    raw = c3d_bytes(1e3 * drawn(), LABELS)
    at = raw.index(b"FRAMES") + 8
    path = tmp_path / "a.c3d"
    path.write_bytes(raw[:at] + b"\x07" + raw[at + 1 :])
    with pytest.raises(TakeError, match="its parameters are malformed"):
        read_marker_tracks(path)
    path.write_bytes(raw.replace(b"POINT", b"OTHER"))
    with pytest.raises(TakeError, match="states no unit of length"):
        read_marker_tracks(path)

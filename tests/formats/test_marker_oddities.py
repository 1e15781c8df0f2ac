"""Marker files as other computers, spreadsheets and accidents leave them: read alike, or refused with the cause."""

from __future__ import annotations

import errno
import struct
from dataclasses import replace

import numpy as np
import pytest

from formats.errors import ImplausibleError, TakeError
from formats.exporters.marker_files import at_one_rate
from formats.importers import marker_lines
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from formats.importers.units import metres_of
from formats.swatch import swatch
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_other_programs_files import LABELS, WRITERS, cell, check, drawn, ours, qualisys, vicon

GARMENT = swatch(0.05, markers=4)


def hanging(frames=30, rate=100.0):
    """The 16 markers of a swatch that hangs still, z up."""
    flat = np.array([point.at_m for point in GARMENT.points])
    place = np.stack([flat[:, 0], np.zeros(len(flat)), 1.5 + flat[:, 1]], 1)
    return MarkerTracks(GARMENT.point_names, np.arange(frames) / rate, np.tile(place, (frames, 1, 1)))


@pytest.mark.parametrize("name", WRITERS)
def test_a_last_line_that_is_cut_is_named_and_one_without_its_end_is_read(tmp_path, name):
    path = tmp_path / f"a.{name}"
    whole = WRITERS[name](np.abs(drawn())).rstrip("\n\r")
    path.write_text(whole)
    check(read_marker_tracks(path), np.abs(drawn()), 1e-6)
    path.write_text(whole[: max(whole.rfind("\t"), whole.rfind(","))])
    with pytest.raises(TakeError, match=r"ends within line \d+, after \d+ of its \d+ cells; the file is cut off"):
        read_marker_tracks(path)


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "csv"])
def test_a_line_in_the_middle_that_is_cut_within_a_number_is_named(tmp_path, name):
    """A position of 1.500000 would else be one of 1, in a frame whose other markers are gaps."""
    path = tmp_path / f"a.{name}"
    lines = WRITERS[name](np.abs(drawn()) + 1.0).splitlines()
    separator = "\t" if "\t" in lines[-2] else ","
    cells = lines[-2].split(separator)
    cut = separator.join([*cells[:6], cells[6][:3]])
    path.write_text("\n".join([*lines[:-2], cut, lines[-1], ""]))
    with pytest.raises(TakeError, match=rf"line {len(lines) - 1} (ends within a marker|has 7 columns)"):
        read_marker_tracks(path)


@pytest.mark.parametrize(
    "word", ["NaN", "-nan(ind)", "nan(snan)", "1.#QNAN", "-1.#IND00", "#N/A", "NA", "null", "-", "-0.000"]
)
def test_a_gap_is_a_gap_in_every_programs_word(tmp_path, word):
    path = tmp_path / "a.csv"
    path.write_text(vicon(drawn(), gap=lambda value: word if np.isnan(value) else cell(value)))
    check(read_marker_tracks(path), drawn(), 1e-6)


@pytest.mark.parametrize("word", ["1_000", "١", "1e999", "inf", "-Infinity", "?", "0x1p3", "1.500,0"])
def test_text_that_only_looks_like_a_number_is_named(tmp_path, word):
    path = tmp_path / "a.csv"
    lines = ours(drawn(), separator=";").splitlines()
    path.write_text("\n".join([*lines[:-1], lines[-1].rpartition(";")[0] + f";{word}", ""]), encoding="utf-8")
    with pytest.raises(TakeError, match=rf"line {len(lines)} holds .*, which is no number"):
        read_marker_tracks(path)


def test_a_text_of_western_windows_and_one_that_ends_with_ctrl_z_are_read(tmp_path):
    path = tmp_path / "a.csv"
    text = vicon(1e3 * drawn()).replace("mm", "µm").replace("Bar:", "Stück:")
    path.write_bytes(text.encode("cp1252") + b"\x1a")
    tracks = read_marker_tracks(path)
    check(replace(tracks, labels=tuple(label.replace("Stück", "Bar") for label in tracks.labels)), drawn(), 1e-6)
    path.write_bytes(b"\x89PNG\x01\x02\xff" + text.encode("cp1252"))
    with pytest.raises(TakeError, match="not a text file"):
        read_marker_tracks(path)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_a_text_that_ends_within_a_letter_is_cut_off(tmp_path, encoding):
    path = tmp_path / "a.csv"
    path.write_bytes(vicon(1e3 * drawn()).encode(encoding)[:-3])
    with pytest.raises(TakeError, match="ends within a character; the file is cut off: copy or export the file again"):
        read_marker_tracks(path)


def test_a_file_that_cannot_be_read_gets_the_step_of_its_cause(tmp_path, monkeypatch):
    def refused(path):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(marker_lines, "read_text_lines", refused)
    (tmp_path / "a.csv").write_text(vicon(1e3 * drawn()))
    with pytest.raises(TakeError, match=r"cannot be read \(Permission denied\); ") as caught:
        read_marker_tracks(tmp_path / "a.csv")
    assert "export" not in str(caught.value)


def test_a_head_of_qualisys_may_have_a_line_for_each_of_many_events(tmp_path):
    path = tmp_path / "a.tsv"
    events = "".join(f"EVENT\tstep\t{k}\t{k / 100}\n" for k in range(40))
    path.write_text(qualisys(drawn()).replace("MARKER_NAMES", f"{events}MARKER_NAMES"))
    check(read_marker_tracks(path), drawn(), 1e-6)


def test_times_and_numbers_of_frames_of_qualisys_are_no_positions(tmp_path):
    """Where they are exported, a row of names stands above them."""
    path = tmp_path / "a.tsv"
    lines = qualisys(drawn()).splitlines()
    body = [f"{k + 1}\t{k / 50:.5f}\t{line}" for k, line in enumerate(lines[7:])]
    path.write_text("\n".join([*lines[:7], "Frame\tTime\t" + "\t".join("XYZ" * 3), *body, ""]))
    tracks = read_marker_tracks(path)
    assert tracks.time[1] == 0.02
    assert tracks.rate == 100.0
    check(replace(tracks, time=tracks.time / 2), drawn(), 1e-6)


@pytest.mark.parametrize(
    ("stated", "metres"),
    [("Meter (m)", 1.0), ("millimetre(s)", 1e-3), ("millim\u00e8tres", 1e-3), ("\u03bcm", 1e-6), ("\u00b5m", 1e-6),
     ("'mm'", 1e-3), ("centimeters [cm]", 1e-2)],
)  # fmt: skip
def test_a_unit_with_its_symbol_an_accent_or_either_letter_mu(stated, metres):
    assert metres_of(stated, None, "a") == metres


def test_a_unit_whose_symbol_is_of_another_is_refused():
    with pytest.raises(TakeError, match=r"the unit of its points is 'metre \(mm\)'"):
        metres_of("metre (mm)", None, "a")


@pytest.mark.parametrize("name", ["trc", "motive.csv"])
def test_times_are_held_against_the_frame_rate_that_a_text_states(tmp_path, name):
    path = tmp_path / f"a.{name}"
    path.write_text(WRITERS[name](drawn()))
    assert read_marker_tracks(path).rate == 100.0
    path.write_text(WRITERS[name](drawn()).replace("100.00", "no", 2))
    assert read_marker_tracks(path).rate is None


@pytest.mark.parametrize(("stated", "is_refused"), [(50.0, True), (81.0, True), (84.0, False), (119.0, False),
                                                    (121.0, True), (0.0, False), (float("nan"), False)])  # fmt: skip
@pytest.mark.parametrize("processor", ["intel", "dec", "sgi"])
def test_a_c3d_file_that_states_two_rates_more_than_a_fifth_apart_is_refused(tmp_path, stated, is_refused, processor):
    tracks = hanging()
    raw = bytearray(c3d_bytes(1e3 * tracks.positions, tracks.labels, processor=processor))
    if processor == "dec":
        float_bytes = struct.pack("<f", 4 * stated)
        raw[20:24] = float_bytes[2:] + float_bytes[:2]
    else:
        raw[20:24] = struct.pack(">f" if processor == "sgi" else "<f", stated)
    path = tmp_path / "a.c3d"
    path.write_bytes(raw)
    if is_refused:
        with pytest.raises(ImplausibleError, match=rf"states 100 frames a second, and its header {stated:g}; export"):
            import_marker_take(path, GARMENT)
    take = import_marker_take(path, GARMENT, MarkerOptions(anyway=True if is_refused else None))
    assert take.time[1] == pytest.approx(0.01)


def test_a_c3d_file_whose_parameters_begin_before_it_is_one_sentence(tmp_path):
    raw = bytearray(c3d_bytes(1e3 * drawn(), LABELS))
    raw[0] = 0
    (tmp_path / "a.c3d").write_bytes(raw)
    with pytest.raises(TakeError, match="the file lacks a C3D header"):
        read_marker_tracks(tmp_path / "a.c3d")


def test_a_c3d_file_of_fewer_frames_than_the_most_that_its_header_counts_is_refused(tmp_path):
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(np.ones((64, 1, 3)), ["a"], scale=0.1, frames_said=65535))
    with pytest.raises(TakeError, match="holds 64 of the 65535 frames that its header states"):
        read_marker_tracks(path)


def test_a_c3d_file_of_more_frames_than_its_header_counts_is_not_read_in_part(tmp_path):
    """ezc3d writes such files."""
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["UNITS"]["value"], point["RATE"]["value"], point["LABELS"]["value"] = ["mm"], [100.0], ["a"]
    file["data"]["points"] = np.ones((4, 1, 65_696))
    file.write(str(tmp_path / "a.c3d"))
    with pytest.raises(TakeError, match="has room for 65728 frames and states 65535: its header counts no further"):
        read_marker_tracks(tmp_path / "a.c3d")


def test_a_take_of_more_frames_than_c3d_counts_is_not_exported_in_part():
    tracks = MarkerTracks(("a",), np.arange(65535) / 100, np.ones((65535, 1, 3)))
    with pytest.raises(TakeError, match="has 65535 frames, a C3D file 65534 at most; export it as CSV"):
        at_one_rate(tracks, "t")
    shorter = replace(tracks, time=tracks.time[1:], positions=tracks.positions[1:])
    assert len(at_one_rate(replace(shorter, time=shorter.time - 0.01), "t")[1]) == 65534


def exchanged(tracks, one, other):
    order = list(range(16))
    order[one], order[other] = other, one
    return replace(tracks, positions=tracks.positions[:, order])


@pytest.mark.parametrize(("one", "other"), [(0, 1), (5, 10), (6, 9), (3, 15), (0, 3), (14, 15), (4, 9)])
def test_two_exchanged_markers_are_found_whichever_they_are(tmp_path, one, other):
    """Every neighbour counts, not only the first of those that are as near."""
    path = write_marker_csv(tmp_path / "a.csv", exchanged(hanging(), one, other))
    with pytest.raises(TakeError, match=r"mm apart, on the flat garment 167 mm"):
        import_marker_take(path, GARMENT)


def test_inches_read_as_centimetres_are_refused(tmp_path):
    tracks = hanging()
    path = write_marker_csv(tmp_path / "a.csv", replace(tracks, positions=tracks.positions / 2.54))
    with pytest.raises(TakeError, match=r"neighbouring markers are 0\.39 of their distance .*\? Check the unit"):
        import_marker_take(path, GARMENT)
    folded = tracks.positions * [0.7, 1, 1]
    import_marker_take(write_marker_csv(tmp_path / "b.csv", replace(tracks, positions=folded)), GARMENT)


@pytest.mark.parametrize(
    ("hidden", "sentence"),
    [([(slice(None), 0)], "'row1_column1' was never seen; the markers on the two top corners"),
     ([(slice(None), 0), (slice(None), 3)], "'row1_column1' and 'row1_column4' were never seen"),
     ([(slice(0, 15), 0), (slice(15, 30), 3)], "the two markers on its top corners were never seen together")],
)  # fmt: skip
def test_a_take_whose_top_corners_were_never_seen_together_is_refused(tmp_path, hidden, sentence):
    tracks = hanging()
    for place in hidden:
        tracks.positions[place] = np.nan
    with pytest.raises(TakeError, match=sentence):
        import_marker_take(write_marker_csv(tmp_path / "a.csv", tracks), GARMENT)

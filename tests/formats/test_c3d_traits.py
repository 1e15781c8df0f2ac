"""C3D files of the traits that programs write, in any mixture: the same paths come out, or a true sentence."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from formats.errors import TakeError
from formats.importers.c3d_file import _scale, read_c3d
from formats.importers.marker_tracks import Wanted
from tests.formats.c3d_by_hand import PROCESSORS, c3d_bytes

MIXTURES = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def paths(points=5, frames=12):
    """Places within 2 m [mm], each point lost for a while."""
    rng = np.random.default_rng(points)
    places = rng.uniform(-2000, 2000, (frames, points, 3))
    places[rng.uniform(size=(frames, points)) < 0.2] = np.nan
    return places


def read(tmp_path, raw):
    (tmp_path / "a.c3d").write_bytes(raw)
    return read_c3d(tmp_path / "a.c3d", None)


@given(
    processor=st.sampled_from(sorted(PROCESSORS)), scale=st.sampled_from([-1.0, -0.1, 0.0625, 0.1, 1.0]),
    analogue=st.sampled_from([0, 1, 17]), first=st.sampled_from([1, 51, 40_000]), points=st.sampled_from([1, 5, 300]),
    is_locked=st.booleans(), has_lower_names=st.booleans(), is_group_last=st.booleans(),
    lost=st.sets(st.sampled_from(["scale", "start", "rate"])),
)  # fmt: skip
@MIXTURES
def test_traits_in_any_mixture_give_the_same_paths(
    tmp_path, processor, scale, analogue, first, points, is_locked, has_lower_names, is_group_last, lost
):
    """`lost`: copies in the header that are zero. More than 255 points have their labels in LABELS2."""
    wanted, labels = paths(points), tuple(f"marker {k}" for k in range(points))
    raw = c3d_bytes(
        wanted, labels, processor=processor, scale=scale, analogue=analogue, is_locked=is_locked,
        has_lower_names=has_lower_names, is_group_last=is_group_last,
        header={"first": first} | dict.fromkeys(lost, 0),
    )  # fmt: skip
    tracks = read(tmp_path, raw)
    assert tracks.labels == labels
    np.testing.assert_allclose(tracks.time, np.arange(12) / 100, atol=1e-9)
    step = scale / 2 if scale > 0 else 1e-3
    np.testing.assert_allclose(1e3 * tracks.positions, wanted, atol=1.01 * step, equal_nan=True)


@pytest.mark.parametrize(
    ("rate", "copy", "camera", "found"),
    [(100.0, 100.0, 50.0, 100.0), (None, 100.0, 50.0, 100.0), (0.0, 0.0, 59.94, 59.94), (None, 0.0, 120.0, 120.0)],
)
def test_a_rate_is_that_of_the_points_its_copy_or_that_of_the_cameras(tmp_path, rate, copy, camera, found):
    raw = c3d_bytes(paths(), list("abcde"), rate=rate, header={"rate": copy}, camera_rate=camera)
    assert 1 / np.diff(read(tmp_path, raw).time)[0] == pytest.approx(found)


def test_a_file_without_any_rate_is_refused(tmp_path):
    with pytest.raises(TakeError, match="states no frame rate above 0"):
        read(tmp_path, c3d_bytes(paths(), list("abcde"), rate=None, header={"rate": 0.0}))


@pytest.mark.parametrize(("scale", "copy"), [(0.05, 0.1), (-1.0, 1.0)])
def test_a_scale_and_its_copy_that_contradict_each_other_are_refused(tmp_path, scale, copy):
    """Integers times the wrong one are twice as far off; floats that are taken for integers are noise."""
    raw = c3d_bytes(0.1 * paths(), list("abcde"), scale=scale, header={"scale": copy}) + bytes(4096)
    with pytest.raises(TakeError, match=rf"its header states a scale of {copy:g}, its parameter POINT:SCALE {scale:g}"):
        read(tmp_path, raw)


def test_a_scale_that_is_no_number_is_refused(tmp_path):
    raw = c3d_bytes(0.1 * paths(), list("abcde"), scale=0.0625)
    for value in (np.inf, np.nan):
        broken = raw.replace(struct.pack("<f", 0.0625), struct.pack("<f", value))
        with pytest.raises(TakeError, match=f"states a scale of {value:g}"):
            read(tmp_path, broken)


def test_a_damaged_number_is_a_gap_and_brings_no_warning(tmp_path):
    """A signalling NaN, of which every sum and product warns."""
    places = np.nan_to_num(paths(), nan=7.0)
    raw = bytearray(c3d_bytes(places, list("abcde")))
    at = raw.index(struct.pack("<f", places[4, 1, 2]))
    raw[at : at + 4] = bytes.fromhex("0100807f")
    found = read(tmp_path, bytes(raw)).positions
    assert np.argwhere(np.isnan(found)).tolist() == [[4, 1, 0], [4, 1, 1], [4, 1, 2]]


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_an_infinite_position_is_refused_as_in_a_text(tmp_path, value):
    places = np.nan_to_num(paths(), nan=7.0)
    places[4:6, 1, 2] = value
    raw = c3d_bytes(np.nan_to_num(places, posinf=7e33, neginf=-7e33), list("abcde"))
    raw = raw.replace(struct.pack("<f", np.sign(value) * 7e33), struct.pack("<f", value))
    told = "frame 5 holds inf, which is no number, for b, the first of 2 such positions; export it again, with markers"
    with pytest.raises(TakeError, match=told):
        read(tmp_path, raw)
    assert len(read_c3d(tmp_path / "a.c3d", None, Wanted(names=("a", "c"))).time) == 12
    assert len(read_c3d(tmp_path / "a.c3d", None, Wanted(frames=4)).time) == 4


@pytest.mark.parametrize(
    ("first", "told"),
    [
        (100, "its header states frames 100 to 20, and its parameter POINT:FRAMES 12 frames; 12 were read"), (9, ""),
    ],
)  # fmt: skip
def test_frames_by_the_parameter_are_read_where_the_header_states_none(tmp_path, first, told):
    raw = bytearray(c3d_bytes(paths(), list("abcde"), header={"first": first}))
    if told:
        struct.pack_into("<H", raw, 8, 20)
    found = read(tmp_path, bytes(raw))
    assert (len(found.time), found.warning) == (12, told)
    np.testing.assert_allclose(1e3 * found.positions, paths(), rtol=1e-6, equal_nan=True)


def test_frames_that_nothing_counts_are_refused_with_the_room_for_them(tmp_path):
    raw = bytearray(c3d_bytes(paths(), list("abcde"), header={"first": 9}))
    struct.pack_into("<H", raw, 8, 8)
    at = raw.index(b"FRAMES") + 10
    raw[at : at + 2] = bytes(2)
    with pytest.raises(TakeError, match="states 0 frames and has room for 12 of its 5 points; export it again"):
        read(tmp_path, bytes(raw))


@pytest.mark.parametrize(("header", "copy"), [(40, 0), (0, 40), (1, 0), (-1, 0), (0, -1), (0, 1)])
def test_the_block_of_the_frames_that_agrees_with_the_size_counts(tmp_path, header, copy):
    """One of the header and the parameter is off by so many blocks."""
    raw = bytearray(c3d_bytes(paths(), list("abcde")))
    true = struct.unpack_from("<H", raw, 16)[0]
    struct.pack_into("<H", raw, 16, true + header)
    struct.pack_into("<H", raw, raw.index(b"DATA_START") + 14, true + copy)
    found = read(tmp_path, bytes(raw))
    np.testing.assert_allclose(1e3 * found.positions, paths(), rtol=1e-6, equal_nan=True)
    stated = f"state blocks {true + header} and {true + copy} as the first of its frames"
    assert found.warning == (
        f"its header and its parameter POINT:DATA_START {stated}; the frames were read from block {true}"
    )  # fmt: skip


@pytest.mark.parametrize("used", [4, 8])
def test_two_numbers_of_points_are_reported_and_refused_where_the_size_agrees_with_neither(tmp_path, used):
    raw = bytearray(c3d_bytes(paths(), list("abcde")))
    struct.pack_into("<H", raw, raw.index(b"USED") + 8, used)
    told = f"its header states 5 points, and its parameter POINT:USED {used}"
    assert read(tmp_path, bytes(raw)).warning == f"{told}; 5 were read"
    with pytest.raises(TakeError, match=f"{told}, and its size agrees with neither; export it again"):
        read(tmp_path, bytes(raw) + bytes(4096))


def test_of_a_unit_that_nobody_knows_twenty_letters_are_reported(tmp_path):
    with pytest.raises(TakeError, match=r"the unit of its points is 'e{20}'; give --unit, one of m"):
        read(tmp_path, c3d_bytes(paths(), list("abcde"), units=("e" * 200,)))


def test_of_floats_only_the_sign_of_the_scale_counts(tmp_path):
    raw = c3d_bytes(paths(), list("abcde"), scale=-0.1, header={"scale": -1.0})
    np.testing.assert_allclose(1e3 * read(tmp_path, raw).positions, paths(), rtol=1e-6, equal_nan=True)


def test_a_file_of_analogue_values_alone_has_no_marker_paths(tmp_path):
    with pytest.raises(TakeError, match=r"has no marker paths .0 points, 12 frames."):
        read(tmp_path, c3d_bytes(np.zeros((12, 0, 3)), [], analogue=6))


@pytest.mark.parametrize(
    ("units", "unit", "metres"),
    [
        (["mm"], None, [1e-3] * 3), (["mm", "m", "cm"], None, [1e-3, 1.0, 1e-2]), (["mm", "m"], None, [1e-3] * 3),
        (["", "mm", "mm"], None, [1e-3] * 3), (["mm", "mm", "mm", "m"], None, [1e-3] * 3), ([], "cm", [1e-2] * 3),
    ],
)  # fmt: skip
def test_a_file_has_one_unit_for_all_points_or_one_for_each(units, unit, metres):
    assert _scale(units, 3, unit, "a.c3d")[0].tolist() == metres


def test_a_garment_whose_points_have_the_names_that_takes_labels_lists_is_read(tmp_path):
    """`takes labels` names the points of a file without labels, and a garment file may use these names."""
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(np.ones((30, 3, 3)), []))
    listed = read_c3d(tmp_path / "a.c3d", None).labels
    assert read_c3d(tmp_path / "a.c3d", None, Wanted(names=listed)).labels == listed


@pytest.mark.parametrize("labels", [[], ["", " ", ""]])
def test_a_file_without_labels_is_refused_where_markers_are_needed(tmp_path, labels):
    """A label that the reader makes up, `unlabelled_0`, stands nowhere in the file."""
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(np.ones((30, 3, 3)), labels))
    with pytest.raises(TakeError, match=r"a\.c3d: has the trajectories of 3 points and no label; label the markers, a"):
        read_c3d(tmp_path / "a.c3d", None, Wanted(names=("a",)))
    assert read_c3d(tmp_path / "a.c3d", None).positions.shape == (30, 3, 3)


@pytest.mark.parametrize(
    ("rotations", "analogue", "sentence"),
    [
        (21, 0, "has no marker paths (0 points, 12 frames, 21 rotations); export trajectories, not only rotations"),
        (1, 6, "has no marker paths (0 points, 12 frames, 1 rotation); export trajectories, not only analogue data "
         "and rotations"),
        (0, 6, "has no marker paths (0 points, 12 frames); export trajectories, not only analogue data"),
        (0, 0, "has no marker paths (0 points, 12 frames); export trajectories"),
    ],
)  # fmt: skip
def test_a_file_without_points_says_what_it_holds(tmp_path, rotations, analogue, sentence):
    """The frames are those that it states, though none of them has a byte of points."""
    more = [("USED", struct.pack("<h", rotations), 2, [], 4)] if rotations else []
    raw = c3d_bytes(np.zeros((12, 0, 3)), [], analogue=analogue, more=more)
    with pytest.raises(TakeError) as refused:
        read(tmp_path, raw)
    assert str(refused.value) == f"{tmp_path / 'a.c3d'}: {sentence}"

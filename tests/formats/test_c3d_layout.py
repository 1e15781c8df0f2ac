"""Where the header and the parameters of a C3D file contradict each other, the file's size decides."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.c3d_file import read_c3d
from formats.importers.marker_tracks import Wanted
from tests.formats.c3d_by_hand import c3d_bytes

PLACES = np.random.default_rng(4).uniform(100, 900, (60, 16, 3))  # mm
NAMES = [f"marker {k}" for k in range(16)]
POINTS, ANALOGUE, FIRST, LAST, START = 2, 4, 6, 8, 16  # offsets of the header's words


def made(*, places=PLACES, edits=(), **traits):
    """The file, with other words at some offsets of its header or behind the names of parameters."""
    raw = bytearray(c3d_bytes(places, NAMES[: places.shape[1]], **traits))
    for at, word in edits:
        begin = at if isinstance(at, int) else raw.index(at) + len(at) + 4
        struct.pack_into("<H", raw, begin, word)
    return bytes(raw)


def read(tmp_path, raw, **wanted):
    (tmp_path / "a.c3d").write_bytes(raw)
    return read_c3d(tmp_path / "a.c3d", None, **wanted)


def fields(start, end):
    """Frame numbers in two words of 16 bits each, the lower first."""
    return [
        (f"ACTUAL_{name}_FIELD", struct.pack("<HH", at % 65536, at // 65536), 2, [2], 2)
        for name, at in (("START", start), ("END", end))
    ]


CONTRADICTIONS = [
    ([(POINTS, 10)], {}, "its header states 10 points, and its parameter POINT:USED 16; 16 were read"),
    ([(POINTS, 0)], {}, "its header states 0 points, and its parameter POINT:USED 16; 16 were read"),
    ([(b"USED", 10)], {}, "its header states 16 points, and its parameter POINT:USED 10; 16 were read"),
    ([(b"USED", 0)], {}, "its header states 16 points, and its parameter POINT:USED 0; 16 were read"),
    ([(FIRST, 0), (LAST, 0)], {},
     "its header states frames 0 to 0, and its parameter POINT:FRAMES 60 frames; 60 were read"),
    ([(LAST, 70)], {}, "its header states frames 1 to 70, and its parameter POINT:FRAMES 60 frames; 60 were read"),
    ([(b"FRAMES", 50)], {}, "its header states frames 1 to 60, and its parameter POINT:FRAMES 50 frames; 60 were read"),
    ([(FIRST, 65535), (LAST, 65535)], {"more": fields(70_000, 70_059)}, ""),
    ([(FIRST, 70_000 % 65536), (LAST, 70_059 % 65536)], {"more": fields(70_000, 70_059)}, ""),
    ([(FIRST, 65_500), (LAST, 65535)], {}, ""),
    ([(b"FRAMES", 65535)], {}, ""),
    ([], {"more": fields(1, 500)}, ""),
    ([], {"scale": 0.1, "header": {"scale": -0.1}},
     "its header states a scale of -0.1, its parameter POINT:SCALE 0.1; its numbers were read as integers"),
    ([], {"scale": -0.1, "header": {"scale": 0.1}},
     "its header states a scale of 0.1, its parameter POINT:SCALE -0.1; its numbers were read as floats"),
    ([(ANALOGUE, 0)], {"analogue": 6, "more": [("USED", struct.pack("<H", 3), 2, [], 3),
                                               ("RATE", struct.pack("<f", 200.0), 4, [], 3)]},
     "its header states 0 analogue values a frame, and its parameters 6, with which its size agrees"),
]  # fmt: skip


@pytest.mark.parametrize(("edits", "traits", "told"), CONTRADICTIONS)
def test_the_statement_that_agrees_with_the_size_counts_and_is_told(tmp_path, edits, traits, told):
    found = read(tmp_path, made(edits=edits, **traits))
    step = 0.05 if traits.get("scale", -1) > 0 else 1e-3
    assert found.labels == tuple(NAMES)
    np.testing.assert_allclose(1e3 * found.positions, PLACES, atol=1.01 * step)
    assert found.warning == told


@pytest.mark.parametrize("edits", [[(LAST, 72_000 % 65536)], [(LAST, 65535)]], ids=["wrapped", "clipped"])
@pytest.mark.parametrize("more", [fields(1, 72_000), [("LONG_FRAMES", struct.pack("<f", 72_000), 4, [], 1)]])
def test_frames_beyond_the_header_are_all_read_or_the_file_is_refused(tmp_path, edits, more):
    places = np.tile(PLACES[:, :1], (1200, 1, 1))
    raw = made(places=places, frames_said=72_000 % 65536, edits=edits, more=more)
    found = read(tmp_path, raw)
    assert (len(found.time), found.warning) == (72_000, "")
    np.testing.assert_allclose(1e3 * found.positions[-1], places[-1], atol=1e-3)
    with pytest.raises(TakeError, match="holds 71968 of the 72000 frames that its parameters state; the file is cut"):
        read(tmp_path, raw[:-512])


def test_a_file_of_as_many_frames_as_one_of_three_contradicting_counts_is_not_cut(tmp_path):
    """The header states 100 frames, LONG_FRAMES 65,636, of which 100 is the word, and FRAMES its 70,016."""
    more = [("LONG_FRAMES", struct.pack("<f", 65_636), 4, [], 1)]
    raw = bytearray(made(places=np.tile(PLACES[:, :1], (1167, 1, 1))[:70_016], frames_said=100, more=more))
    changed = raw.replace(
        b"\x06\x01FRAMES\x07\0\x02\0\x64\0\0", b"\x06\x01FRAMES\x09\0\x04\0" + struct.pack("<f", 70_016) + b"\0"
    )
    assert changed != raw
    found = read(tmp_path, bytes(changed))
    assert len(found.time) == 65_636
    assert found.warning.endswith("the file states 65636 frames and has room for 70016; the first 65636 were read")


@pytest.mark.parametrize("cut", [512, 4096])
@pytest.mark.parametrize(("edits", "traits", "told"), CONTRADICTIONS)
def test_a_file_that_is_cut_is_refused_whatever_it_states(tmp_path, edits, traits, told, cut):
    if edits == [(b"FRAMES", 50)]:
        cut -= 256  # so that it does not end with 50 frames
    with pytest.raises(TakeError, match=r"holds \d+ of the \d+ frames|agrees with neither|its header states a scale"):
        read(tmp_path, made(edits=edits, **traits)[:-cut])


def test_units_of_points_that_are_not_used_do_not_count(tmp_path):
    raw = c3d_bytes(PLACES, NAMES, units=["mm"] * 14 + ["deg", ""])
    found = read(tmp_path, raw, wanted=Wanted(names=tuple(NAMES[:14])))
    np.testing.assert_allclose(1e3 * found.positions[:, :14], PLACES[:, :14], atol=1e-3)
    with pytest.raises(TakeError, match=re.escape("the unit of its points is 'deg'; give --unit, one of m")):
        read(tmp_path, raw)


def test_two_units_for_more_points_are_told(tmp_path):
    found = read(tmp_path, c3d_bytes(PLACES, NAMES, units=["mm", "m"]))
    np.testing.assert_allclose(1e3 * found.positions, PLACES, atol=1e-3)
    assert found.warning == "the file states the units 'mm', 'm' for 16 points; the first was taken for all"


def test_a_text_ends_at_its_first_zero_byte(tmp_path):
    raw = c3d_bytes(PLACES[:, :2], ["abc", "defgh"]).replace(b"abc  ", b"abc\0\xcc")
    assert read(tmp_path, raw).labels == ("abc", "defgh")


@pytest.mark.parametrize("off", [-2, 7, 60, 3000])
@pytest.mark.parametrize("name", [b"USED", b"SCALE", b"RATE", b"UNITS"])
def test_a_record_whose_offset_is_wrong_ends_where_its_values_end(tmp_path, name, off):
    """Programs that remove or lengthen a parameter may leave the old offset."""
    raw = bytearray(c3d_bytes(PLACES, NAMES))
    at = raw.index(name) + len(name)
    struct.pack_into("<H", raw, at, struct.unpack_from("<H", raw, at)[0] + off)
    found = read(tmp_path, bytes(raw))
    assert (found.labels, found.warning) == (tuple(NAMES), "")
    np.testing.assert_allclose(1e3 * found.positions, PLACES, atol=1e-3)


@pytest.mark.parametrize("edits", [[], [(POINTS, 10)]])
def test_rotations_behind_the_frames_are_no_frames(tmp_path, edits):
    begin = len(c3d_bytes(PLACES, NAMES)) // 512 + 1
    more = [("DATA_START", struct.pack("<H", begin), 2, [], 4), ("USED", struct.pack("<H", 1), 2, [], 4)]
    raw = made(edits=edits, more=more)
    assert len(raw) == 512 * (begin - 1)
    found = read(tmp_path, raw + np.full(60 * 17, 0.5, "<f4").tobytes())
    np.testing.assert_allclose(1e3 * found.positions, PLACES, atol=1e-3)
    assert found.warning == CONTRADICTIONS[0][2] * bool(edits)


@pytest.mark.parametrize("used", [0, 1])
def test_the_block_of_rotations_wraps_round_in_a_large_file(tmp_path, used):
    """65,000 frames of 40 points are 41.6 MB; a word of blocks ends at 33.6 MB. ezc3d states it without rotations."""
    places = np.tile(PLACES[:, :1], (1084, 40, 1))[:65_000]
    names = [f"m{k}" for k in range(40)]
    begin = len(c3d_bytes(places, names)) // 512 + 1
    more = [("DATA_START", struct.pack("<H", begin % 65536), 2, [], 4), ("USED", struct.pack("<H", used), 2, [], 4)]
    raw = c3d_bytes(places, names, more=more)
    assert len(raw) == 512 * (begin - 1) > 512 * 65536
    found = read(tmp_path, raw + np.full(60_000, 0.5, "<f4").tobytes() * used)
    assert (found.positions.shape, found.warning) == ((65_000, 40, 3), "")


def test_long_frames_may_be_two_words(tmp_path):
    places = np.tile(PLACES[:, :1], (1200, 1, 1))
    more = [("LONG_FRAMES", struct.pack("<HH", 72_000 % 65536, 1), 2, [2], 1)]
    assert len(read(tmp_path, made(places=places, frames_said=65535, more=more)).time) == 72_000


def test_units_of_more_than_255_points_go_on_in_units2(tmp_path):
    places, names = np.tile(PLACES, (1, 17, 1)), [f"marker {k}" for k in range(272)]
    places[:, 260:] /= 10
    texts = b"mm" * 5 + b"cm" * 12
    raw = c3d_bytes(places, names, units=["mm"] * 255, more=[("UNITS2", texts, -1, [2, 17], 1)])
    np.testing.assert_allclose(1e3 * read(tmp_path, raw).positions, np.tile(PLACES, (1, 17, 1)), atol=1e-3)


WIDE = np.random.default_rng(5).uniform(100, 900, (30, 80, 3))  # mm; frames of 1280 bytes, more than two blocks


def started(raw, by, *, order="<"):
    """The file, whose header and POINT:DATA_START both state the block of the frames so many blocks away."""
    raw = bytearray(raw)
    start = struct.unpack_from(order + "H", raw, START)[0]
    for at in (START, raw.index(b"DATA_START") + 14):
        struct.pack_into(order + "H", raw, at, start + by)
    return bytes(raw), start


@pytest.mark.parametrize("by", [-2, -1, 1, 2, 5])
@pytest.mark.parametrize("traits", [
    {}, {"processor": "sgi", "scale": 0.1, "places": PLACES[:59]}, {"places": WIDE},
])  # fmt: skip
def test_frames_right_behind_the_parameters_are_read_where_all_copies_state_another_block(tmp_path, by, traits):
    """The wide frames also agree with the size of the file where they begin a block too early.

    Integers need zeros behind the last frame, which 60 frames of 16 markers do not have.
    """
    places, scale = traits.get("places", PLACES), traits.get("scale", -1)
    names = [f"a long name of a marker {k}" for k in range(places.shape[1])]
    raw = c3d_bytes(places, names, **{name: one for name, one in traits.items() if name != "places"})
    raw, start = started(raw, by, order=">" if "processor" in traits else "<")
    found = read(tmp_path, raw)
    np.testing.assert_allclose(1e3 * found.positions, places, atol=1.01 * (0.05 if scale > 0 else 1e-3))
    assert found.warning == (
        f"its header states block {start + by} as the first of its frames; the frames fill the file from block {start} "
        "on, and were read from there"
    )


@pytest.mark.parametrize("scale", [-1.0, 0.1])
@pytest.mark.parametrize("gap", [bytes(1024), b"left over " * 102 + b"text"])
def test_a_file_that_is_cut_by_as_much_as_stands_before_its_frames_is_refused(tmp_path, gap, scale):
    """Its frames would fill the file from the block behind the parameters on, as far as its size tells."""
    raw, start = started(made(scale=scale), 2)
    begin = 512 * (start - 1)
    whole = raw[:begin] + gap + raw[begin:]
    np.testing.assert_allclose(1e3 * read(tmp_path, whole).positions, PLACES, atol=0.06)
    with pytest.raises(TakeError, match=r"holds \d+ of the 60 frames that its header states; the file is cut off, or"):
        read(tmp_path, whole[: -len(gap)])


def test_frames_that_would_begin_within_the_parameters_are_refused(tmp_path):
    """Neither the stated block nor the one behind the parameters agrees with a file that is cut besides."""
    raw, start = started(made(), -1)
    for cut in (600, 5000):
        with pytest.raises(TakeError, match=f"states block {start - 1} as the first of its frames, which holds its p"):
            read(tmp_path, raw[:-cut])
    raw, _ = started(made(), 1 - start)
    with pytest.raises(TakeError, match="states block 1 as the first of its frames, which holds its header; export"):
        read(tmp_path, raw[:-600])


@pytest.mark.parametrize(("more", "is_refused"), [(65_536, True), (66_200, False), (131_072, True), (60_000, False)])
def test_a_count_that_has_wrapped_round_is_refused(tmp_path, more, is_refused):
    """Programs that write the count into 16 bits leave 464 of 66000 frames; any other room is told and left out."""
    places = np.tile(PLACES[:1, :8], (464 + more, 1, 1))
    raw = made(places=places, frames_said=464, scale=0.1)
    held = (len(raw) - 512 * (struct.unpack_from("<H", raw, START)[0] - 1)) // 64  # with what fills the last block
    told = f"room for {held} "
    if is_refused:
        with pytest.raises(TakeError, match=f"{told}frames and states 464: its header counts no further; export it in"):
            read(tmp_path, raw)
    else:
        assert read(tmp_path, raw).warning == f"the file states 464 frames and has {told[:-1]}; the first 464 were read"

"""How many frames a C3D file has, where its header, its parameters and its size disagree, and how it is refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.c3d_file import LARGEST_C3D, read_c3d
from formats.importers.c3d_parameters import DEC, FLOAT, INTEL, SGI, SHORT, NoParametersError, Parameters, numbers_of
from tests.formats.c3d_by_hand import c3d_bytes

MOST = 65535  # frames that the header can state
CUT = "the file is cut off, or that number is wrong: copy or export the file again"


def read(tmp_path, raw, unit=None):
    (tmp_path / "a.c3d").write_bytes(raw)
    return read_c3d(tmp_path / "a.c3d", unit)


def refused(tmp_path, raw):
    with pytest.raises(TakeError) as error:
        read(tmp_path, raw)
    return str(error.value).removeprefix(f"{tmp_path}/a.c3d: ")


def words(first, second):
    return struct.pack("<hh", first, second)


def fields(start, end):
    """The frames that a file states by two words of 16 bits each, the lower first."""
    return [("ACTUAL_START_FIELD", words(*start), 2, [2], 2), ("ACTUAL_END_FIELD", words(*end), 2, [2], 2)]


def long_file(frames, more=(), cut=0):
    """One point, 8 bytes a frame, 64 frames a block, whose header states as many frames as it can."""
    places = 0.1 * (np.arange(3 * frames) % 1000 + 1).reshape(-1, 1, 3)
    raw = c3d_bytes(places, ["a"], scale=0.1, frames_said=MOST, more=more)
    return raw[: len(raw) - cut]


@pytest.mark.parametrize(
    ("held", "more", "found"),
    [
        (65600, fields((1, 0), (64, 1)), 65600),
        (65600, fields((11, 0), (74, 1)), 65600),
        (65600, fields((-25535, 0), (-25472, 1)), 65600),
        (65664, fields((1, 0), (64, 1)), 65600),
        (65600, [("LONG_FRAMES", struct.pack("<f", 65600), 4, [], 1)], 65600),
        (65600, [*fields((1, 0), (64, 1))[:1], ("LONG_FRAMES", struct.pack("<f", 65600), 4, [], 1)], 65600),
        (65536, (), MOST),
    ],
)
def test_parameters_count_frames_further_than_the_header_can(tmp_path, held, more, found):
    tracks = read(tmp_path, long_file(held, more))
    assert len(tracks.time) == len(tracks.positions) == found
    last = 0.1e-3 * ((3 * found - 3 + np.arange(3)) % 1000 + 1)
    np.testing.assert_allclose(tracks.positions[-1, 0], last, rtol=1e-6)


@pytest.mark.parametrize(
    ("raw", "sentence"),
    [
        (long_file(65600), "has room for 65600 frames and states 65535: its header counts no further; export it in "
         "shorter parts, or as text"),
        (long_file(65536, fields((1, 0), (64, 1))), "holds 65536 of the 65600 frames that its parameters state; "
         f"{CUT}"),
        (long_file(65472), f"holds 65472 of the 65535 frames that its header states; {CUT}"),
    ],
    ids=["longer", "shorter than its parameters", "shorter than its header"],
)  # fmt: skip
def test_a_file_of_other_frames_than_it_can_state_is_refused(tmp_path, raw, sentence):
    assert refused(tmp_path, raw) == sentence


def test_the_rest_of_the_last_block_is_no_frame(tmp_path):
    """64 frames of 8 bytes."""
    assert len(read(tmp_path, long_file(65600, cut=8)).time) == MOST


@pytest.mark.parametrize(("extra", "is_reported"), [(511, False), (512, True), (600, True)])
def test_room_for_a_frame_and_a_block_more_than_it_states_is_reported(tmp_path, extra, is_reported):
    """A frame of 16 bytes behind 32 of them, which fill a block, and so many bytes."""
    raw = c3d_bytes(np.ones((32, 1, 3)), ["a"]) + struct.pack("<ffff", 1, 1, 1, 0) + b"\1" * extra
    told = f"the file states 32 frames and has room for {33 + extra // 16}; the first 32 were read"
    assert read(tmp_path, raw).warning == (told if is_reported else "")
    assert len(read(tmp_path, raw).time) == 32


def swinging(frames, points=9, noise=0.1):
    """Positions [mm] at 100 frames a second, with noise; one marker is never seen."""
    way = 100 * np.sin(np.arange(frames) / 16)[:, None, None] * [1.0, 0.3, 0.1]
    rng = np.random.default_rng(0)
    places = rng.uniform(-300, 300, (points, 3)) + way + rng.normal(0, noise, (frames, points, 3))
    places[:, -1] = np.nan
    return places


@pytest.mark.parametrize("scale", [-1.0, 0.1])
@pytest.mark.parametrize(("points", "fewer"), [(9, 1), (9, 2), (2, 1), (2, 2), (55, 1)])
@pytest.mark.parametrize("is_filled", [True, False])
def test_frames_behind_the_last_stated_one_are_reported(tmp_path, scale, points, fewer, is_filled):
    places = swinging(130, points)
    raw = c3d_bytes(places, [f"m{k}" for k in range(points)], scale=scale, frames_said=130 - fewer)
    width = 4 * points * (4 if scale < 0 else 2)
    begin = 512 * (struct.unpack_from("<H", raw, 16)[0] - 1)
    tracks = read(tmp_path, raw if is_filled else raw[: begin + 130 * width])
    many = "1 frame more stands" if fewer == 1 else f"{fewer} frames more stand"
    first = 130 - fewer
    assert tracks.warning == f"the file states {first} frames, and {many} behind them; the first {first} were read"
    assert len(tracks.time) == first


@pytest.mark.parametrize("kind", ["zeros", "noise", "memory", "elsewhere", "unseen"])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_what_fills_the_last_block_is_no_frame(tmp_path, kind, noise):
    """A program's memory holds the bytes of the block before: of 8 markers, a frame four frames earlier."""
    points = 8
    raw = c3d_bytes(swinging(130, points, noise), [f"m{k}" for k in range(points)])
    begin = 512 * (struct.unpack_from("<H", raw, 16)[0] - 1)
    end = begin + 130 * 16 * points
    rest = {
        "zeros": bytes(512), "noise": np.random.default_rng(0).bytes(512), "memory": raw[end - 512 : end],
        "elsewhere": raw[begin + 6400 : begin + 6912], "unseen": struct.pack("<ffff", 0, 0, 0, -1) * 32,
    }[kind]  # fmt: skip
    assert read(tmp_path, raw[:end] + rest[: -end % 512]).warning == ""


def test_too_few_frames_to_know_the_motion_tell_no_further_one(tmp_path):
    raw = c3d_bytes(swinging(3), [f"m{k}" for k in range(9)], frames_said=2)
    assert read(tmp_path, raw).warning == ""


def test_zeros_behind_the_frames_and_parameters_there_are_no_frames(tmp_path):
    raw = c3d_bytes(np.ones((32, 1, 3)), ["a"])
    assert read(tmp_path, raw + bytes(16) + b"\1" * 600).warning == ""
    begin = 512 * (struct.unpack_from("<H", raw, 16)[0] - 1)
    head = bytearray(raw[:512])
    head[0], head[16:18] = 3, struct.pack("<H", 2)
    at = raw.index(b"DATA_START") + 14
    moved = bytes(head) + raw[begin:] + raw[512:at] + struct.pack("<H", 2) + raw[at + 2 : begin]
    assert (read(tmp_path, moved).labels, read(tmp_path, moved).warning) == (("a",), "")
    np.testing.assert_array_equal(read(tmp_path, moved).positions, read(tmp_path, raw).positions)


@pytest.mark.parametrize("stated", [0, 1])
def test_a_section_of_parameters_may_be_longer_than_it_states(tmp_path, stated):
    raw = bytearray(c3d_bytes(np.ones((20, 40, 3)), [f"marker {k}" for k in range(40)]))
    raw[514] = stated
    assert read(tmp_path, bytes(raw)).labels[39] == "marker 39"


@pytest.mark.parametrize(
    ("raw", "sentence"),
    [
        (b"", "is no C3D file that can be read (the file lacks a C3D header); export it again"),
        (b"\2\x50" + bytes(509), "is no C3D file that can be read (the file lacks a C3D header); export it again"),
        (b"\0\x50" + bytes(600), "is no C3D file that can be read (the file lacks a C3D header); export it again"),
        (b"x\ty\r\n" * 200, "is no C3D file that can be read (the file lacks a C3D header); the file is text: "
         "give it the ending .trc, .csv or .tsv"),
        (c3d_bytes(np.ones((20, 1, 3)), ["a"], rate=10_001.0), "states 10001 frames a second; 5 to 1000 can be "
         "used; export it again with its frame rate"),
        (c3d_bytes(np.ones((20, 1, 3)), ["a"], rate=None, header={"rate": 0}), "states no frame rate above 0; "
         "export it again with its frame rate"),
        (c3d_bytes(np.ones((20, 0, 3)), [], analogue=3), "has no marker paths (0 points, 20 frames); export "
         "trajectories, not only analogue data"),
        (c3d_bytes(np.ones((20, 1, 3)), ["a"], scale=0.1, header={"scale": 0.2}), "its header states a scale of 0.2, "
         "its parameter POINT:SCALE 0.1; export it again"),
        (c3d_bytes(np.ones((64, 1, 3)), ["a"])[:-16], f"holds 63 of the 64 frames that its header states; {CUT}"),
    ],
    ids=["empty", "short", "no parameters", "text", "rate", "no rate", "analogue", "scale", "cut"],
)  # fmt: skip
def test_a_c3d_file_that_cannot_be_read_says_why_and_what_to_do(tmp_path, raw, sentence):
    assert refused(tmp_path, raw) == sentence


def test_rates_to_ten_thousand_and_scales_to_a_thousandth_are_as_they_are_stated(tmp_path):
    tracks = read(tmp_path, c3d_bytes(np.ones((20, 1, 3)), ["a"], rate=10_000.0))
    assert tracks.time[-1] == pytest.approx(19e-4)
    assert tracks.rate is None
    assert read(tmp_path, c3d_bytes(np.ones((20, 1, 3)), ["a"], rate=120.0)).rate == 120.0
    read(tmp_path, c3d_bytes(np.ones((20, 1, 3)), ["a"], scale=0.1, header={"scale": 0.10009}))


def test_a_file_larger_than_any_is_refused_unread(tmp_path):
    with (tmp_path / "a.c3d").open("wb") as file:
        file.truncate(LARGEST_C3D + 1)
    with pytest.raises(TakeError, match=r"a\.c3d: has 1\.1 GB, which no C3D file has; check the path$"):
        read_c3d(tmp_path / "a.c3d", None)
    with (tmp_path / "a.c3d").open("wb") as file:
        file.truncate(LARGEST_C3D)
    with pytest.raises(TakeError, match="the file lacks a C3D header"):
        read_c3d(tmp_path / "a.c3d", None)


@pytest.mark.parametrize(
    ("raw", "kind", "processor", "numbers"),
    [
        (b"\1\2\xff", 1, INTEL, [1, 2, 255]), (b"\1\0\xff\xff\7", SHORT, INTEL, [1, -1]),
        (b"\0\1\xff\xfe", SHORT, SGI, [1, -2]), (b"\0\1", SHORT, DEC, [256]),
        (struct.pack("<f", 2.5) + b"\1\2\3", FLOAT, INTEL, [2.5]), (struct.pack(">ff", 2.5, -1), FLOAT, SGI, [2.5, -1]),
        (struct.pack("<f", 10.0)[2:] + struct.pack("<f", 10.0)[:2], FLOAT, DEC, [2.5]), (b"\1", SHORT, INTEL, []),
    ],
)  # fmt: skip
def test_numbers_of_each_kind_and_byte_order_are_whole(raw, kind, processor, numbers):
    assert numbers_of(raw, kind, processor).tolist() == numbers


@pytest.mark.parametrize(
    ("bits", "processor", "kept"),
    [
        ("01000000", INTEL, 0x00800000),
        ("ffff7f80", INTEL, 0x80800000),
        ("00000001", SGI, 0x00800000),
        ("00000080", INTEL, 0x80000000),
        ("00008000", INTEL, 0x00800000),
        ("01008000", INTEL, 0x00800001),
        ("00000100", DEC, 0x00800000),
        ("7f010000", DEC, 0x00800000),
        ("80010000", DEC, 0x00800000),
        ("80010100", DEC, 0x00800001),
    ],
)
def test_no_float_of_a_file_is_one_that_a_library_can_have_the_processor_take_for_zero(bits, processor, kept):
    """Compared by bits, as the comparison with a subnormal number is in doubt: the least normal one takes its place."""
    assert numbers_of(bytes.fromhex(bits), FLOAT, processor).view("<u4").tolist() == [kept]


def test_a_damaged_number_in_dec_order_is_no_number():
    """A signalling NaN, of which every product warns."""
    assert np.isnan(numbers_of(bytes.fromhex("807f0100"), FLOAT, DEC)).tolist() == [True]


def section(*parts):
    return b"\0\0\1" + bytes([INTEL]) + b"".join(parts)


GROUP = b"\5\xffPOINT\3\0\0"


def parameter(name, body, group=1, *, is_last=False):
    return bytes([len(name), group]) + name + struct.pack("<H", 0 if is_last else len(body) + 2) + body


@pytest.mark.parametrize(
    ("parts", "numbers", "texts"),
    [
        ((GROUP, parameter(b"a", b"\2\1\2\5\0\6\0\0")), [5, 6], []),
        ((GROUP, parameter(b"A", b"\2\0\5\0\0")), [5], []),
        ((GROUP, parameter(b"A", b"\1\2\2\1\7\x08\0")), [7, 8], []),
        ((GROUP, parameter(b"A", b"\xff\2\3\2ab d  \0")), [], ["ab", "d"]),
        ((GROUP, parameter(b"A", b"\xff\1\3ab \0")), [], ["ab"]),
        ((GROUP, parameter(b"A", b"\xff\0x\0")), [], ["x"]),
        ((GROUP, parameter(b"A", b"\xff\2\0\0\0")), [], []),
        ((parameter(b"A", b"\2\0\5\0\0"), GROUP), [5], []),
        ((GROUP, parameter(b"A", b"\2\0\5\0\0", is_last=True), parameter(b"A", b"\2\0\6\0\0")), [5], []),
        ((GROUP, parameter(b"A", b"\2\0\5\0\0", 0)), [], []),
        ((GROUP, parameter(b"A", b"\2\0\5\0\0", 2)), [], []),
        ((GROUP, parameter(b"B", b"\2\0\5\0\0")), [], []),
        ((GROUP, parameter(b"C", b"\3\0\5\0\0", 2), parameter(b"A", b"\2\0\5\0\0")), [5], []),
        ((GROUP, parameter(b"A", b"\2\0\5\0")), [5], []),
    ],
)
def test_parameters_are_found_by_group_and_name(parts, numbers, texts):
    found = Parameters(section(*parts))
    assert found.numbers("POINT", "A").tolist() == numbers
    assert found.texts("POINT", "A") == texts


@pytest.mark.parametrize(
    "parts",
    [
        (GROUP, parameter(b"A", b"\3\0\5\0\0")), (GROUP, parameter(b"A", b"\2\0\5")), (GROUP, b"\1\1A\3"),
        (GROUP, parameter(b"A", b"\2\1\2\5\0\6")), (GROUP, parameter(b"A", b"\2")),
    ],
    ids=["kind", "cut number", "cut name", "cut numbers", "cut head"],
)  # fmt: skip
def test_a_wrong_parameter_of_marker_paths_is_refused(parts):
    with pytest.raises(NoParametersError):
        Parameters(section(*parts))
    assert Parameters(section()).texts("POINT", "A") == Parameters(b"").texts("POINT", "A") == []

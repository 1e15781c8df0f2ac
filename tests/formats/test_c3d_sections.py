"""A header may point to no parameters, or to a stale copy of them: the file's other parameters decide."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.c3d_file import read_c3d
from tests.formats.c3d_by_hand import c3d_bytes

PLACES = np.random.default_rng(6).uniform(100, 900, (60, 3, 3)).astype("f4").astype(float)  # mm
NAMES, OLD_NAMES = ("a", "b", "c"), ("x", "y", "z")
BLOCK, START = 512, 16  # bytes; offset of the header's word for the first block of the frames


def read(tmp_path, raw, unit=None):
    (tmp_path / "a.c3d").write_bytes(raw)
    return read_c3d(tmp_path / "a.c3d", unit)


def made(order, pointed, *, processor="intel", old=None, frames=40):
    """A file of the sections `new`, `old` and `data` in an order, whose header points to one of them.

    - old: another file whose parameters are the old ones, by default of fewer frames and other names
    - frames: of the old file
    """

    def parts(raw):
        begin = BLOCK * (struct.unpack_from(">H" if processor == "sgi" else "<H", raw, START)[0] - 1)
        return raw[:BLOCK], raw[BLOCK:begin], raw[begin:]

    old = old or c3d_bytes(PLACES[:frames], OLD_NAMES, processor=processor)
    whole = c3d_bytes(PLACES, NAMES, processor=processor)
    head, new, data = parts(whole)
    blocks, at, places = {"old": parts(old)[1], "new": new, "data": data}, 2, {}
    for name in order:
        places[name], at = at, at + len(blocks[name]) // BLOCK
    word = struct.pack(">H" if processor == "sgi" else "<H", places["data"])
    stated = blocks["new"].index(b"DATA_START") + 14
    blocks["new"] = new[:stated] + word + new[stated + 2 :]
    head = bytearray(head)
    head[0], head[START : START + 2] = places[pointed], word
    return bytes(head) + b"".join(blocks[name] for name in order), places


@pytest.mark.parametrize("processor", ["intel", "dec", "sgi"])
@pytest.mark.parametrize("order", [("old", "new", "data"), ("new", "old", "data"), ("old", "data", "new")])
def test_an_old_copy_beside_the_parameters_that_the_header_states_changes_nothing(tmp_path, order, processor):
    raw, _ = made(order, "new", processor=processor)
    found = read(tmp_path, raw)
    assert (found.labels, found.warning) == (NAMES, "")
    np.testing.assert_allclose(found.positions, PLACES / 1000, atol=1e-9)


@pytest.mark.parametrize("processor", ["intel", "dec", "sgi"])
@pytest.mark.parametrize("order", [("old", "new", "data"), ("new", "old", "data"), ("new", "data", "old")])
def test_parameters_that_agree_with_the_header_count_before_an_old_copy_that_it_points_to(tmp_path, order, processor):
    """The old copy has other names and fewer frames."""
    raw, places = made(order, "old", processor=processor)
    found = read(tmp_path, raw)
    assert found.labels == NAMES
    np.testing.assert_allclose(found.positions, PLACES / 1000, atol=1e-9)
    assert found.warning == (
        f"its header states block {places['old']} as the first of its parameters, which contradict it; those from "
        f"block {places['new']} agree with it and were read"
    )


def test_two_copies_that_agree_with_the_header_are_read_as_it_states(tmp_path):
    raw, _ = made(("new", "data", "old"), "new", frames=60)
    assert read(tmp_path, raw).labels == NAMES


@pytest.mark.parametrize("block", [1, 3, 5, 200])
def test_parameters_that_are_not_where_the_header_states_are_searched(tmp_path, block):
    """The header itself, the frames, and a block behind the file's end."""
    raw = c3d_bytes(PLACES, NAMES)
    found = read(tmp_path, bytes([block]) + raw[1:])
    assert found.labels == NAMES
    np.testing.assert_allclose(found.positions, PLACES / 1000, atol=1e-9)
    assert found.warning == (
        f"its header states block {block} as the first of its parameters, where there are none; those from block 2 "
        "agree with it and were read"
    )


def test_a_file_without_parameters_is_not_asked_for_a_unit(tmp_path):
    """A unit would give markers without names."""
    raw = c3d_bytes(PLACES, NAMES)
    begin = BLOCK * (struct.unpack_from("<H", raw, START)[0] - 1)
    raw = raw[:BLOCK] + bytes(begin - BLOCK) + raw[begin:]
    for unit in (None, "mm"):
        with pytest.raises(TakeError, match="its header states block 2 as the first of its parameters, where there ar"):
            read(tmp_path, raw, unit)


def test_parameters_of_another_rate_points_or_block_are_not_taken_in_place_of_others(tmp_path):
    """Both contradict the header, which has another frame rate: the parameters that it states are read and told."""
    raw = bytearray(made(("new", "old", "data"), "old")[0])
    raw[20:24] = struct.pack("<f", 120.0)
    found = read(tmp_path, bytes(raw))
    assert found.labels == OLD_NAMES
    assert "its parameter POINT:FRAMES 40 frames; 60 were read" in found.warning


@pytest.mark.parametrize(
    ("name", "data", "kind", "sides"),
    [("UNITS", b"m ", -1, [2, 1]), ("LABELS", b"xyz", -1, [1, 3]), ("RATE", struct.pack("<f", 50.0), 4, [])],
)
def test_a_parameter_with_two_values_is_refused_and_one_that_comes_twice_is_not(tmp_path, name, data, kind, sides):
    """A program that adds a parameter may leave the old one: neither says which is valid."""
    with pytest.raises(TakeError, match=rf"a\.c3d: states POINT:{name} twice, with two values; export it again"):
        read(tmp_path, c3d_bytes(PLACES, NAMES, more=[(name, data, kind, sides, 1)]))
    same = {"UNITS": b"mm", "LABELS": b"abc", "RATE": struct.pack("<f", 100.0)}[name]
    found = read(tmp_path, c3d_bytes(PLACES, NAMES, more=[(name, same, kind, sides, 1)]))
    assert (found.labels, found.warning, found.rate) == (NAMES, "", 100.0)
    other_group = c3d_bytes(PLACES, NAMES, more=[(name, data, kind, sides, 3)])
    assert read(tmp_path, other_group).labels == NAMES


@pytest.mark.parametrize("processor", [0, 1, 83])
@pytest.mark.parametrize("rate", [100.0, 31.0])
def test_parameters_of_no_known_processor_are_read_where_the_header_points(tmp_path, processor, rate):
    """Some programs leave the processor's byte at zero; the header's frame rate may be an old one."""
    raw = bytearray(c3d_bytes(PLACES, NAMES))
    raw[BLOCK + 3] = processor
    raw[20:24] = struct.pack("<f", rate)
    found, known = read(tmp_path, bytes(raw)), read(tmp_path, c3d_bytes(PLACES, NAMES))
    assert (found.labels, found.warning) == (known.labels, "")
    assert (found.positions == known.positions).all()
    assert (found.time == known.time).all()


@pytest.mark.parametrize("scale", [-1.0, 0.05])
@pytest.mark.parametrize("written", ["intel", "dec", "sgi"])
@pytest.mark.parametrize(("code", "stated"), [(84, "Intel"), (85, "DEC"), (86, "SGI"), (0, ""), (1, "")])
def test_a_file_whose_parameters_state_another_byte_order_is_read_in_its_own(tmp_path, code, stated, written, scale):
    raw = bytearray(c3d_bytes(PLACES, NAMES, processor=written, scale=scale))
    own = {84: "Intel", 85: "DEC", 86: "SGI"}[raw[BLOCK + 3]]
    raw[BLOCK + 3] = code
    found = read(tmp_path, bytes(raw))
    np.testing.assert_allclose(found.positions, PLACES / 1000, atol=1e-9 if scale < 0 else 2.6e-5)
    told = f"state the byte order of {stated}" if stated else "state no byte order"
    as_stated = own == stated or (own == "Intel" and not stated)  # files without a known code are Intel's
    assert found.warning == (
        "" if as_stated
        else f"its parameters {told}, and its numbers agree in that of {own}, which was used"
    )  # fmt: skip


def test_a_stated_byte_order_counts_where_header_and_parameters_contradict_each_other_in_each(tmp_path):
    raw = bytearray(c3d_bytes(PLACES, NAMES, processor="sgi"))
    raw[20:24] = struct.pack(">f", 1e-30)
    assert read(tmp_path, bytes(raw)).warning == ""

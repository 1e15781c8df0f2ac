"""A written C3D file has every word that the format's user guide asks for, each at its place.

Format: https://www.c3d.org, user guide. The reader here is the test's own, and knows only what the writer writes.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.exporters.c3d_writer import c3d_pieces

BLOCK = 512  # bytes
TEXT, SHORT, FLOAT = -1, 2, 4  # kinds of parameters
POINT, ANALOG, FORCE_PLATFORM = 1, 2, 3  # groups
RATE = 62.5  # 1/s; a float holds it exactly
HEADER = "<BBHHHHHfHHf"


def written(labels, frames=2):
    return b"".join(c3d_pieces(labels, np.ones((frames, len(labels), 3)), RATE))


def records_of(section):
    """Return groups as (name, -number), parameters as (name, number, kind, dimensions, data), and what follows them."""
    found, at = [], 4
    while section[at]:
        length, group = struct.unpack_from("<bb", section, at)
        name, at = section[at + 2 : at + 2 + length].decode(), at + 2 + length
        (step,) = struct.unpack_from("<H", section, at)
        body, at = section[at + 2 : at + step], at + step
        assert body[-1] == 0, "no description"
        if group < 0:
            assert len(body) == 1
            found.append((name, group))
            continue
        kind, sides = struct.unpack_from("<bB", body)
        found.append((name, group, kind, tuple(body[2 : 2 + sides]), body[2 + sides : -1]))
    return found, section[at:]


def words(name, group, number):
    return name, group, SHORT, (), struct.pack("<H", number)


def floats(name, group, number):
    return name, group, FLOAT, (), struct.pack("<f", number)


def texts(name, group, width, *some):
    return name, group, TEXT, (width, len(some)), "".join(one.ljust(width) for one in some).encode()


@pytest.mark.parametrize(("labels", "frames"), [(["left", "right hand"], 65534), ([], 3)])
def test_header_and_parameters_hold_every_word_that_other_programs_ask_for(labels, frames):
    raw = written(labels, frames)
    blocks = raw[BLOCK + 2]
    start = 2 + blocks
    assert struct.unpack_from(HEADER, raw) == (2, 80, len(labels), 0, 1, frames, 0, -1.0, start, 1, RATE)
    assert not any(raw[struct.calcsize(HEADER) : BLOCK])
    section = raw[BLOCK : BLOCK * (start - 1)]
    assert tuple(section[:4]) == (1, 80, blocks, 84)
    records, behind = records_of(section)
    assert records == [
        ("POINT", -POINT), ("ANALOG", -ANALOG), ("FORCE_PLATFORM", -FORCE_PLATFORM),
        words("USED", POINT, len(labels)), floats("SCALE", POINT, -1.0), floats("RATE", POINT, RATE),
        words("DATA_START", POINT, start), words("FRAMES", POINT, frames),
        texts("LABELS", POINT, 10 if labels else 0, *labels), texts("DESCRIPTIONS", POINT, 0, *[""] * len(labels)),
        texts("UNITS", POINT, 2, "mm"),
        words("USED", ANALOG, 0), floats("GEN_SCALE", ANALOG, 1.0), floats("RATE", ANALOG, RATE),
        *(texts(name, ANALOG, 0) for name in ("LABELS", "UNITS", "DESCRIPTIONS")),
        ("SCALE", ANALOG, FLOAT, (0,), b""), ("OFFSET", ANALOG, SHORT, (0,), b""),
        words("USED", FORCE_PLATFORM, 0),
    ]  # fmt: skip
    assert not any(behind)
    assert len(raw) == BLOCK * (1 + blocks) + -(-frames * len(labels) * 16 // BLOCK) * BLOCK


@pytest.mark.parametrize("points", [255, 256, 510, 511])
def test_labels_that_one_parameter_cannot_hold_go_on_in_the_next(points):
    """One holds 255 at most, since a byte counts them."""
    labels = [f"m{k:03}" for k in range(points)]
    records, _ = records_of(written(labels)[BLOCK:])
    for name, width in (("LABELS", 4), ("DESCRIPTIONS", 0)):
        found = [one for one in records if one[0].startswith(name) and one[1] == POINT]
        assert [one[0] for one in found] == [name, f"{name}2", f"{name}3"][: len(found)]
        assert [one[3] for one in found] == [(width, len(labels[k : k + 255])) for k in range(0, points, 255)]
        if width:
            assert b"".join(one[4] for one in found).decode() == "".join(labels)


def test_a_parameter_of_more_bytes_than_a_signed_number_counts_is_written_whole():
    """Of 255 labels of 255 bytes, the longest that the format has: 65,025 bytes."""
    labels = [f"{k:03}" * 85 for k in range(255)]
    records, behind = records_of(written(labels)[BLOCK:])
    assert texts("LABELS", POINT, 255, *labels) in records
    assert records[-1] == words("USED", FORCE_PLATFORM, 0)
    assert set(behind[:2]) == {0}


@pytest.mark.parametrize(("points", "frames"), [(1, 33), (3, 21), (4, 8), (5, 1)])
def test_each_frame_has_four_floats_a_point_and_unseen_ones_are_zeros_with_a_negative_residual(points, frames):
    """Positions in millimetres; one lacking coordinate makes a point unseen, whatever the others are."""
    places = np.arange(3.0 * points * frames).reshape(frames, points, 3) / 1e3 + 1.0
    for axis in range(3):
        places[axis % frames, axis % points, axis] = (np.nan, np.inf, -np.inf)[axis]
    raw = b"".join(c3d_pieces([f"m{k}" for k in range(points)], places, RATE))
    body = raw[BLOCK * (struct.unpack_from(HEADER, raw)[8] - 1) :]
    size = 16 * points * frames
    values = np.frombuffer(body[:size], "<f4").reshape(frames, points, 4)
    seen = np.isfinite(places).all(2)
    np.testing.assert_array_equal(values[~seen], np.tile(np.float32([0, 0, 0, -1]), ((~seen).sum(), 1)))
    np.testing.assert_array_equal(values[seen][:, :3], (1e3 * places[seen]).astype("<f4"))
    assert not values[seen][:, 3].any()
    assert (len(body) % BLOCK, body[size:].strip(b"\0")) == (0, b"")
    assert len(body) - size < BLOCK


def test_the_most_names_that_fit_are_written_and_a_byte_more_each_is_refused():
    """255 blocks of 512 bytes hold the parameters: 130,560 bytes. 510 names take 66,300, the rest 250 each."""
    fits = written(["x" * 130] * 510 + ["z" * 250] * 255, 1)
    start = struct.unpack_from(HEADER, fits)[8]
    assert (start, fits[BLOCK + 2]) == (257, 255)
    assert records_of(fits[BLOCK : BLOCK * (start - 1)])[0][-1] == words("USED", FORCE_PLATFORM, 0)
    with pytest.raises(ValueError, match=r"^the names of its 765 points take more than 130560 bytes$"):
        written(["x" * 130] * 510 + ["z" * 251] * 255, 1)

"""Lines of a text file, compared with those that Python splits the whole text into."""

from __future__ import annotations

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers import text_lines
from formats.importers.text_lines import read_text_lines

ENDS = ["\n", "\r\n", "\r", "\x0b", "\x0c", "\u2028", "\x85"]
WORDS = ["", "a", "1,5;2", "\u00e4\u00b5", "\U0001f455\u4e00", " ", "x" * 40]
BOM = {"utf-8": b"", "utf-8-sig": b"\xef\xbb\xbf", "utf-16-le": b"\xff\xfe", "utf-16-be": b"\xfe\xff"}


def read(folder, raw):
    (folder / "a.csv").write_bytes(raw)
    return read_text_lines(folder / "a.csv")


def drawn(seed, ends=tuple(ENDS)):
    """A text of words and line ends in any order, which begins with a word of Latin letters."""
    rng = np.random.default_rng(seed)
    parts = ["first", *(str(rng.choice(WORDS)) + str(rng.choice([*ends, ""])) for _ in range(int(rng.integers(30))))]
    return "".join(parts)


@pytest.mark.parametrize("encoding", BOM)
@pytest.mark.parametrize("at_once", [1, 2, 3, 5, 8, 1 << 20])
def test_lines_are_those_of_the_whole_text_however_many_bytes_are_decoded_at_once(
    tmp_path, monkeypatch, encoding, at_once
):
    monkeypatch.setattr(text_lines, "PIECE_BYTES", at_once)
    for seed in range(20):
        text = drawn(seed)
        found = read(tmp_path, BOM[encoding] + text.encode(encoding.removesuffix("-sig")))
        expected = text.splitlines()
        assert list(found) == expected, seed
        assert len(found) == len(expected)
        assert found.is_cut == (text.splitlines(keepends=True)[-1] == expected[-1])
        assert list(found[1:5]) == expected[1:5]
        assert list(found[::-2]) == expected[::-2]
        assert list(found.at([0, len(expected) - 1])) == [expected[0], expected[-1]]
        assert found[1:5].is_cut is found.is_cut
        assert found[-1] == expected[-1]


@pytest.mark.parametrize("at_once", [1, 4, 1 << 20])
def test_a_text_that_is_no_utf_8_is_read_letter_by_letter(tmp_path, monkeypatch, at_once):
    """Windows-1252 has no sign for five of its bytes, which leave a mark."""
    monkeypatch.setattr(text_lines, "PIECE_BYTES", at_once)
    raw = "time;h\u00f6he [\u00b5m]\r\n1;2\n".encode("cp1252") + b"a\x81b\x8d\x8f\x90\x9d\n"
    assert list(read(tmp_path, raw)) == ["time;h\u00f6he [\u00b5m]", "1;2", "a\ufffdb\ufffd\ufffd\ufffd\ufffd"]


@pytest.mark.parametrize("byte", [0, 1, 8, 0x0B, 0x0E, 0x1A, 0x1F])
def test_a_byte_that_no_text_has_makes_a_file_that_is_no_utf_8_none(tmp_path, byte):
    with pytest.raises(UnicodeDecodeError):
        read(tmp_path, b"time\xe4\n" + bytes([byte]) + b"1;2\n")


@pytest.mark.parametrize("blank", [b"", b" \t\r\n", b"\x1a", b"\n" * 9 + b"\x1a" * 3, b"\0\0 \n"])
def test_a_file_without_a_visible_sign_has_no_lines(tmp_path, blank):
    found = read(tmp_path, blank)
    assert (len(found), list(found), list(found[:]), found.is_cut) == (0, [], [], False)


@pytest.mark.parametrize("marks", [0, 1, 4096])
def test_marks_of_the_end_of_a_dos_file_are_no_text(tmp_path, marks):
    found = read(tmp_path, b"a\n1" + b"\x1a" * marks)
    assert (list(found), found.is_cut) == (["a", "1"], True)


def test_more_marks_than_any_editor_writes_are_text(tmp_path):
    found = read(tmp_path, b"a\n1" + b"\x1a" * 4097)
    assert list(found) == ["a", "1\x1a"]


@pytest.mark.parametrize(("lines", "is_read"), [(7, True), (8, False)])
def test_a_file_of_too_many_lines_is_refused_with_their_number(tmp_path, monkeypatch, lines, is_read):
    monkeypatch.setattr(text_lines, "MOST_LINES_OF_A_FILE", 7)
    monkeypatch.setattr(text_lines, "PIECE_BYTES", 4)
    if is_read:
        assert len(read(tmp_path, b"1;2\n" * lines)) == lines
        return
    with pytest.raises(TakeError) as caught:
        read(tmp_path, b"1;2\n" * lines)
    assert (caught.value.what, caught.value.where) == ("has 8 lines", tmp_path / "a.csv")
    assert caught.value.advice == "export fewer frames at once"

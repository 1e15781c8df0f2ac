"""Text from files is harmless to terminals, and otherwise as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from formats.errors import TakeError
from formats.plain_text import LONGEST_TEXT, counted, in_one_line, lines_of, plain, shortened, sized


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Rück-\u80cc 5 %", "Rück-\u80cc 5 %"),
        ("\x1b[31mred", "\\x1b[31mred"),
        ("a\nb\tc", "a\\nb\\tc"),
        ("\x9b\u202e\u2066", "\\x9b\\u202e\\u2066"),
        ("\udcff\udc9b", "\udcff\\udc9b"),
        ("a" * (LONGEST_TEXT + 1), "a" * LONGEST_TEXT + " ..."),
    ],
)
def test_a_character_that_cannot_be_printed_is_shown_by_its_code(text, shown):
    """A byte of a name that is no UTF-8 stays, but for those that are control characters to a terminal."""
    assert plain(text) == shown


def test_a_text_for_a_picture_is_one_line_without_codes_and_surrogates():
    assert in_one_line("a\r\n\tb\u2028\udcff\ud800\x1b") == r"a\r\n\tb\u2028\udcff\ud800\x1b"


def test_lines_keep_their_ends_and_tabs_and_no_code_of_a_terminal():
    assert lines_of("\r\x1b[Ka\n\tb\x1b[2J\r\x9b") == "\\r\\x1b[Ka\n\tb\\x1b[2J\\r\\x9b"
    assert lines_of("\rhalf\r") == "\\rhalf\\r"
    assert lines_of("a" * (LONGEST_TEXT + 1)) == "a" * (LONGEST_TEXT + 1)


def test_an_error_shows_a_files_text_by_its_code():
    assert str(TakeError("is \x1b[2J", where="a\x07b", advice="\0")) == "a\\x07b: is \\x1b[2J; \\x00"


def test_a_name_longer_than_a_files_may_be_is_shown_by_its_ends_and_leaves_room_for_the_step():
    assert shortened("a" * 255) == "a" * 255
    assert shortened("a" * 200 + "b" * 2800) == f"{'a' * 60} ... {'b' * 60}"
    told = str(TakeError("is empty", where="n" * 3000, advice="record again"))
    assert told == f"{'n' * 60} ... {'n' * 60}: is empty; record again"
    path = Path("f" * 255) / "a.mcap"
    assert str(TakeError("is empty", where=path, advice="record again")) == f"{path}: is empty; record again"


def test_one_is_reported_without_the_letter_of_many():
    assert [counted(n, "take") for n in (0, 1, 2)] == ["0 takes", "1 take", "2 takes"]


@pytest.mark.parametrize(
    ("count", "words"),
    [(0, "0 bytes"), (1, "1 byte"), (999, "999 bytes"), (1000, "1.0 kB"), (52_000, "52.0 kB"), (3.2e6, "3.2 MB"),
     (322.1e9, "322.1 GB")],
)  # fmt: skip
def test_a_number_of_bytes_is_reported_in_a_unit_that_fits(count, words):
    assert sized(count) == words

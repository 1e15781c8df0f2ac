"""Prepare text from files for display: detect the encoding, and escape control characters."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Sequence

LONGEST_TEXT = 2000  # characters of one text; our choice: 25 rows of 80, about the terminal's height
NAME_SHOWN = 255  # characters of a name in a sentence: the most bytes of a file name in Linux, limits.h
MOST_LISTED = 3  # items of one kind that a sentence lists; our choice: a longer list hides the advice behind it
# characters at either end of a longer name. Our choice: both ends of a name fit two lines of a terminal.
ENDS_SHOWN = 60
MARKS = ((b"\xff\xfe\0\0", "utf-32"), (b"\0\0\xfe\xff", "utf-32"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"),
         (b"\xef\xbb\xbf", "utf-8-sig"))  # fmt: skip


# Control characters but tab and line feed, other line breaks, marks of the writing direction, and surrogates
# (https://www.unicode.org/reports/tr9/, table 4). Joiners stay: Persian and Indian names need them.
CODES = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def encoding_of(head: bytes) -> str:
    """Return the encoding of a text from its first bytes, four or more, by its byte order mark.

    Without a mark, every other byte of plain UTF-16 text is zero. A text without zero bytes is UTF-8.
    """
    marked = next((name for mark, name in MARKS if head.startswith(mark)), None)
    if marked is not None or b"\0" not in head:
        return marked or "utf-8"
    return "utf-16-le" if head[1:2] == b"\0" else "utf-16-be"


def plain(text: object) -> str:
    """Return a text with control characters escaped, including those that reverse the writing direction.

    Bytes of a file name that are not UTF-8 stay unchanged, so that the name can be typed as shown.
    """
    letters = str(text)
    shown = "".join(letter if is_harmless(letter) else _escaped(letter) for letter in letters[:LONGEST_TEXT])
    return shown if len(letters) <= LONGEST_TEXT else shown + " ..."


def as_typed(words: Iterable[str]) -> str:
    """Return words as a command line that a shell takes apart into just these words.

    Control characters and bytes that are not UTF-8 appear as in `$'caf\\xe9.oni'`, for bash, zsh and POSIX.1-2024.
    """
    return " ".join(shlex.quote(word) if word.isprintable() else f"$'{_in_ansi_quotes(word)}'" for word in words)


def _in_ansi_quotes(word: str) -> str:
    return "".join(
        f"\\{letter}"
        if letter in "\\'"
        else letter
        if letter.isprintable()
        else "".join(f"\\x{byte:02x}" for byte in letter.encode("utf-8", "surrogateescape"))
        for letter in word
    )


def shortened(name: str) -> str:
    """Return a name for a sentence; of a name longer than a file name may be, only the beginning and the end."""
    return name if len(name) <= NAME_SHOWN else f"{name[:ENDS_SHOWN]} ... {name[-ENDS_SHOWN:]}"


def lines_of(text: str) -> str:
    """Return a text of several lines for a terminal, of any length, with control characters escaped."""
    return "".join(letter if letter in "\n\t" or is_harmless(letter) else _escaped(letter) for letter in text)


def without_codes(text: str) -> str:
    """Return a text for an output file, such as a page or a table, with control characters escaped."""
    return CODES.sub(lambda found: _escaped(found[0]), text)


def in_one_line(text: str) -> str:
    """Return a text for a picture, which measures single lines only; line breaks and control codes are escaped."""
    return plain(without_codes(text))


def in_utf8(name: str) -> str:
    """Return a file name as UTF-8 text; bytes that are not UTF-8 are escaped as in `caf\\xe9.oni`."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def code_in(name: str) -> str:
    """Return the first control character of a name, escaped; '' without one."""
    found = re.search(r"[\t\n]", name) or CODES.search(name)
    return _escaped(found[0]) if found else ""


def counted(number: int, word: str) -> str:
    """Return "1 take" or "2 takes" of the word "take"."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def with_advice(what: str, advice: str) -> str:
    """Return a statement and its next step as one sentence, or as two where the statement has its end already."""
    if not advice:
        return what
    is_ended = what.endswith(("?", "!", ".")) and not what.endswith("..")  # dots also stand for what is left out
    return f"{what} {advice[0].upper()}{advice[1:]}" if is_ended else f"{what}; {advice}"


def first_few(words: Sequence[str], count: int | None = None, most: int = MOST_LISTED) -> str:
    """Return the first words, `most` of them, with commas between, and the number of the others.

    count: how many there are, if `words` holds the first ones alone
    """
    more = (len(words) if count is None else count) - most
    return ", ".join(words[:most]) + f" and {more} more" * (more > 0)


def joined(words: Sequence[str], last: str = "and") -> str:
    """Return `a, b and c` of some words; last: before the last one."""
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def sized(count: float) -> str:
    """Return a number of bytes in the largest unit of at least one: "3.2 GB", "14.0 kB", "12 bytes"."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return counted(round(count), "byte")


def is_harmless(letter: str) -> bool:
    """Return whether a terminal displays a character and does nothing else."""
    # Surrogates represent bytes of a name; those from 0x80 to 0x9F are control characters to some terminals.
    return letter.isprintable() or "\udca0" <= letter <= "\udcff"


def _escaped(letter: str) -> str:
    return (
        "\\n"
        if letter == "\n"
        else "\\t"
        if letter == "\t"
        else letter.encode("unicode_escape", "surrogatepass").decode()
    )

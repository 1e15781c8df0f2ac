"""Text from files: its encoding by its mark, and made safe for a terminal, which sees codes of control characters."""

from __future__ import annotations

import re
from collections.abc import Sequence

LONGEST_TEXT = 2000  # characters of one text
LONGEST_SHOWN = 255  # letters of a name in a sentence: Linux lets no file's name have more bytes, limits.h
MOST_TOLD = 3  # of things of one kind, stated by us
ENDS_SHOWN = 60  # letters at either end of a longer name
MARKS = ((b"\xff\xfe\0\0", "utf-32"), (b"\0\0\xfe\xff", "utf-32"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"),
         (b"\xef\xbb\xbf", "utf-8-sig"))  # fmt: skip


# Control characters but tab and line break, other breaks of lines, marks that turn the direction of writing, and halves
# of letters (https://www.unicode.org/reports/tr9/, table 4). Joiners stay: Persian and Indian names need them.
CODES = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def encoding_of(head: bytes) -> str:
    """Return the encoding of a text by its first bytes, four or more, where editors of other systems put a mark.

    Without a mark every other byte of plain text in UTF-16 is zero; a text without a zero is UTF-8.
    """
    marked = next((name for mark, name in MARKS if head.startswith(mark)), None)
    if marked is not None or b"\0" not in head:
        return marked or "utf-8"
    return "utf-16-le" if head[1:2] == b"\0" else "utf-16-be"


def plain(text: object) -> str:
    """Return a text whose control characters, also those that turn the direction of writing, are escaped.

    Bytes of a file's name that are no UTF-8 stay as they are: the name must be shown as it can be typed.
    """
    letters = str(text)
    shown = "".join(letter if is_harmless(letter) else _escaped(letter) for letter in letters[:LONGEST_TEXT])
    return shown if len(letters) <= LONGEST_TEXT else shown + " ..."


def shortened(name: str) -> str:
    """Return a name for a sentence: of one that is longer than a file's may be, the beginning and the end."""
    return name if len(name) <= LONGEST_SHOWN else f"{name[:ENDS_SHOWN]} ... {name[-ENDS_SHOWN:]}"


def lines_of(text: str) -> str:
    """Return text of several lines for a terminal, of any length: names of files and words from files are in it."""
    return "".join(letter if letter in "\n\t" or is_harmless(letter) else _escaped(letter) for letter in text)


def without_codes(text: str) -> str:
    """Return a text for a file that others open, a page or a table: codes that no name needs are escaped."""
    return CODES.sub(lambda found: _escaped(found[0]), text)


def in_utf8(name: str) -> str:
    """Return a file's name for a file that holds it as text: bytes of it that are no UTF-8 as in `caf\\xe9.oni`."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def code_in(name: str) -> str:
    """Return the first letter of a name that is a code, escaped, and nothing where there is none."""
    found = re.search(r"[\t\n]", name) or CODES.search(name)
    return _escaped(found[0]) if found else ""


def counted(number: int, word: str) -> str:
    """Return "1 take" or "2 takes" of the word "take"."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def first_few(words: Sequence[str], count: int) -> str:
    """Return the first words of so many with commas between, and how many more there are."""
    more = count - MOST_TOLD
    return ", ".join(words[:MOST_TOLD]) + f" and {more} more" * (more > 0)


def sized(count: float) -> str:
    """Return a number of bytes in the largest unit of which there is one: "3.2 GB", "14.0 kB", "12 bytes"."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return counted(round(count), "byte")


def is_harmless(letter: str) -> bool:
    """Return whether a terminal shows a letter and does nothing else."""
    # Surrogates stand for bytes of a name; those from 0x80 to 0x9F are control characters to some terminals.
    return letter.isprintable() or "\udca0" <= letter <= "\udcff"


def _escaped(letter: str) -> str:
    return (
        "\\n"
        if letter == "\n"
        else "\\t"
        if letter == "\t"
        else letter.encode("unicode_escape", "surrogatepass").decode()
    )

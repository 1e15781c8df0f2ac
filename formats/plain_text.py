"""Text from files, made safe for a terminal: what is no letter, sign or space is shown by its code."""

from __future__ import annotations

LONGEST_TEXT = 2000  # characters of one text


def plain(text: object) -> str:
    """Return a text whose control characters, also those that turn the direction of writing, are escaped.

    Bytes of a file's name that are no UTF-8 stay as they are: the name must be shown as it can be typed.
    """
    letters = str(text)
    shown = "".join(letter if is_harmless(letter) else _escaped(letter) for letter in letters[:LONGEST_TEXT])
    return shown if len(letters) <= LONGEST_TEXT else shown + " ..."


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

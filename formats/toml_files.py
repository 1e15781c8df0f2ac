"""Read a TOML file of Hangtime: rig, garment, the appliance's configuration, or credentials.

TOML is UTF-8 (https://toml.io/en/v1.0.0). Some editors add a byte order mark, or save as UTF-16. The first bytes show
the encoding, and files in both forms are read.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from formats.errors import DescriptionError, HangtimeError
from formats.meant_units import number_meant, question_of
from formats.plain_text import encoding_of
from formats.system_causes import step_to_read
from formats.whole_files import check_ends

LARGEST_TOML = 1 << 20  # bytes of a file; our choice: hundreds of times a rig's or a garment's description
# characters of a line that are searched for a number. Our choice: nobody writes a longer line by hand, and the
# search's time stays bounded.
LONGEST_LINE = 1000
# Limits of characters in a file, including strings and comments. Python takes 1 kB and 12 us for each part of a table's
# name, hence gigabytes for a file of a megabyte. A garment of 1000 corners, 1000 corners of holes and 2000 points has
# 8000 of each, but 4000 equals signs.
MOST_CHARACTERS = {
    "[{": (12_000, "opening brackets"), "=": (10_000, "equals signs"), ",": (30_000, "commas"), ".": (30_000, "dots"),
}  # fmt: skip
# Keys of 20 parts or more: Python's time and memory grow with the square of their number, gigabytes for 200,000 parts.
LONG_KEY = re.compile(r"""(?:(?:(?<![\w-])[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){20}""")

# A key of one part or more. None of these gives back what it took, so a line costs time in proportion to its length.
KEY_PART = r"""(?:[\w-]++|"(?:[^"\\]|\\.)*+"|'[^']*+')"""
WHOLE_KEY = rf"({KEY_PART}(?:[ \t]*+\.[ \t]*+{KEY_PART})*+)[ \t]*+"
TABLE_LINE = re.compile(rf"[ \t]*+(\[\[?+)[ \t]*+{WHOLE_KEY}\]\]?+[ \t]*+(?:#.*)?$")
KEY_LINE = re.compile(rf"[ \t]*+{WHOLE_KEY}=")


# Characters of one number, with a comma, a unit or another minus sign, and the end of a value behind it.
NUMBER_SIGNS = re.compile(
    r"(?<![\w.,+-])[+\u2212\u2013-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?(?:[ \t]*[^\W\d_]+|\u00b0|%)?"
)
VALUE_ENDS = re.compile(r"[ \t]*(?:[#,}\]].*)?$")
LAST_KEY = re.compile(r"([\w.-]+)[ \t]*=(?=[^=]*$)")
LISTED_NUMBER = re.compile(r"[+-]?\d+,0(?!00(?!\d))\d+")  # in a list 05 is no TOML, so that the comma is no separator


# Words of Python's parser about a key or table that is there before; source: `tomllib` of Python 3.11
STATED_TWICE = re.compile(
    r"Cannot overwrite a value|Cannot declare |Cannot (?:mutate immutable|redefine) |Duplicate inline table key '(.*?)'"
)


class Tables(dict[str, Any]):
    """The tables of a file, and the text from which they were parsed."""

    text = ""


def read_toml(path: Path, failure: type[HangtimeError] = DescriptionError) -> Tables:
    """Return the tables of a file.

    failure: class of the error to raise

    Raises:
        HangtimeError: of the class `failure`; the file cannot be read, or is not TOML.
    """
    try:
        check_ends(path)
        with path.open("rb") as file:
            raw = file.read(LARGEST_TOML + 1)
    except OSError as error:
        raise failure(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    return parse_toml(raw, path, failure)


def parse_toml(raw: bytes, path: Path, failure: type[HangtimeError]) -> Tables:
    """Return the tables in a file's bytes; arguments and errors as in `read_toml`."""
    if len(raw) > LARGEST_TOML:
        raise failure(
            f"has more than {LARGEST_TOML} bytes, which no such file has", where=path, advice="check the path"
        )
    encoding = encoding_of(raw[:4])
    try:
        text = raw.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        name = encoding.removesuffix("-sig").upper()
        line = error.object[: error.start].count(b"\n") + 1
        what, advice = f"is no text in {name} (at line {line})", "save it as UTF-8 text"
        if b"\0" in raw:
            what, advice = "is a binary file, and no TOML", "check the path: is it another file, or in another place?"
        raise failure(what, where=path, advice=advice) from error
    if long := LONG_KEY.search(text):
        line = text.count("\n", 0, long.start()) + 1
        raise failure(f"has a key of twenty parts or more (at line {line})", where=path, advice="mend it")
    for signs, (most, words) in MOST_CHARACTERS.items():
        if sum(map(text.count, signs)) > most:
            raise failure(f"has more than {most} {words}, which no such file has", where=path, advice="check the path")
    try:
        tables = Tables(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        lines = text.rstrip().split("\n")
        detail = str(error).replace("(at end of document)", f"(at line {len(lines)}, the last)")
        named = re.search(r"\(at line (\d+)(?:, column (\d+))?", detail)
        if named and STATED_TWICE.match(detail):
            raise failure(_twice(lines, int(named[1]), detail), where=path, advice="leave out one") from error
        meant = _meant_on(lines[min(int(named[1]), len(lines)) - 1], int(named[2] or 0)) if named else ""
        raise failure(f"is not valid TOML: {detail}{meant}", where=path, advice="mend that line") from error
    except ValueError as error:  # Python reads no more than 4300 digits
        line = re.split(r"\d{4300}", text.replace("_", "0"), maxsplit=1)[0].count("\n") + 1
        raise failure(f"has a number of thousands of digits (at line {line})", where=path, advice="mend it") from error
    except RecursionError as error:
        raise failure("has too many brackets in each other", where=path, advice="mend it") from error
    tables.text = text
    return tables


def _twice(lines: list[str], until: int, detail: str) -> str:
    """Return which key or table a file states twice, and in which lines; `until`: line at which the second one ends."""
    inline = STATED_TWICE.match(detail)
    if inline and inline[1]:
        return f"states {inline[1]} twice in one table (at line {until})"
    keys, table, second = list[tuple[int, tuple[str, ...], bool]](), tuple[str, ...](), ""
    for number, line in enumerate(lines[:until], 1):
        if found := TABLE_LINE.match(line[:LONGEST_LINE]):
            second, table = found[2], _parts(found[2])
            keys.append((number, table, True))
        elif found := KEY_LINE.match(line[:LONGEST_LINE]):
            second = found[1]
            keys.append((number, (*table, *_parts(found[1])), False))
    *earlier, (at, whole, _) = keys
    same = [number for number, key, _ in earlier if key == whole]
    within = [
        number for number, key, is_table in earlier
        if key[: len(whole)] == whole or (whole[: len(key)] == key and not is_table)
    ]  # fmt: skip
    tables = max(
        ((len(key), number) for number, key, is_table in earlier if is_table and key == whole[: len(key)]),
        default=(0, None),
    )
    first = next(reversed(same or within), tables[1])
    return f"states {second} twice (at line {at}{'' if first is None else f', and before at line {first}'})"


def _parts(key: str) -> tuple[str, ...]:
    """Return the parts of a key without their quotation marks."""
    return tuple(part.strip("\"'") for part in re.findall(KEY_PART, key))


def _meant_on(line: str, column: int) -> str:
    """Return a question that names the number meant at a column of a line that is no TOML, '' if none is seen."""
    line = line[:LONGEST_LINE]
    at = column - 1
    found = next((one for one in NUMBER_SIGNS.finditer(line) if one.start() <= at <= one.end()), None)
    key = LAST_KEY.search(line, 0, found.start()) if found else None
    if found is None:
        return ""
    field, number = key[1] if key else "", found[0].rstrip(",")
    if not VALUE_ENDS.match(line, found.start() + len(number)):
        return ""
    if key is None or "[" in line[key.end() : found.start()]:  # in a list, which may begin on an earlier line
        field += "[0]"
        if "," in number and not LISTED_NUMBER.match(number):
            return ""
    return question_of(number_meant(number, field), field)


def place_in(path: object, tables: dict[str, Any], words: str, *, table: str = "") -> object:
    """Return the path with the line of the field that an error names, or the path alone.

    table: the table of the error, where its words do not name it
    """
    unknown = re.search(r"(?s)(?:unknown field|the field) `(.+?)`(?: is missing)?(?: in ([\w.\[\]]+))?", words)
    if unknown:
        parts = [unknown[2], unknown[1]]
    else:
        found = re.match(r"[a-z]\w*(?:\[\d+\]|\.\w+)*", words)
        parts = [found[0] if found else None]
    field = ".".join(part for part in (table, *parts) if part)
    line = line_of(getattr(tables, "text", ""), field)
    return path if line is None else f"{path}, line {line}"


def line_of(text: str, field: str) -> int | None:
    """Return the line of a field such as `hanger.ids` or `points[2].name`, or of its table; None if not found."""
    places: dict[str, int] = {}
    counts: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.split("\n"), 1):
        if header := TABLE_LINE.match(line):
            name = _name_of(header[2])
            if header[1] == "[[":
                counts[name] = counts.get(name, -1) + 1
                places.setdefault(name, number)
                name = f"{name}[{counts[name]}]"
            table = name
            places.setdefault(name, number)
        elif key := KEY_LINE.match(line):
            name = _name_of(key[1])
            places.setdefault(f"{table}.{name}" if table else name, number)
    while field:
        if field in places:
            return places[field]
        field = field[: max(field.rfind("."), field.rfind("["), 0)]  # always shorter, whatever the key's signs
    return None


def _name_of(key: str) -> str:
    """Return a key with dots between its parts, without quotes and escapes; "" if it is none."""
    parts: list[str] = []
    try:
        table: Any = tomllib.loads(f"{key} = 0")
    except tomllib.TOMLDecodeError:  # of a text of several lines
        return ""
    while isinstance(table, dict):
        ((part, table),) = table.items()
        parts.append(part)
    return ".".join(parts)

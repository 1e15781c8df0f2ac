"""Read a TOML file of Hangtime's: rig, garment, the appliance's configuration, or credentials.

TOML is UTF-8 (https://toml.io/en/v1.0.0). Editors of other systems put a mark before it, or save as UTF-16. The first
bytes show the encoding, and the file is read all the same.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from formats.errors import DescriptionError, HangtimeError
from formats.plain_text import encoding_of
from formats.system_causes import step_to_read
from formats.whole_files import check_ends

LARGEST_TOML = 1 << 20  # bytes of a file
# Parts of a key, each with its dot: Python reads them in the square of their number, gigabytes for 200,000 of them.
LONG_KEY = re.compile(r"""(?:(?:(?<![\w-])[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){20}""")


def read_toml(path: Path, failure: type[HangtimeError] = DescriptionError) -> dict[str, Any]:
    """Return the tables of a file.

    failure: the error that is raised

    Raises:
        HangtimeError: of the given kind; the file cannot be read, or is no TOML.
    """
    try:
        check_ends(path)
        with path.open("rb") as file:
            raw = file.read(LARGEST_TOML + 1)
    except OSError as error:
        raise failure(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    return parse_toml(raw, path, failure)


def parse_toml(raw: bytes, path: Path, failure: type[HangtimeError]) -> dict[str, Any]:
    """Return the tables of a file's bytes; else as `read_toml`."""
    if len(raw) > LARGEST_TOML:
        raise failure(
            f"has more than {LARGEST_TOML} bytes, which no such file has", where=path, advice="check the path"
        )
    encoding = encoding_of(raw[:4])
    try:
        text = raw.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        name = encoding.removesuffix("-sig").upper()
        raise failure(f"is no text in {name}", where=path, advice="save it as UTF-8 text") from error
    if LONG_KEY.search(text):
        raise failure("has a key of twenty parts or more", where=path, advice="mend it")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise failure(f"is not valid TOML: {error}", where=path, advice="mend that line") from error
    except ValueError as error:  # Python reads no more than 4300 digits
        raise failure("has a number of thousands of digits", where=path, advice="mend it") from error
    except RecursionError as error:
        raise failure("has too many brackets in each other", where=path, advice="mend it") from error

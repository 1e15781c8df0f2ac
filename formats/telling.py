"""Report a command's results: sentences for people, a JSON document (`--json`), or nothing (`--quiet`).

A command calls `tell` for every sentence, with its facts as plain values. The facts of all calls form one document. A
key with several entries, such as the takes of `hangtime takes list`, is reported with `tell_entry` and becomes a list.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any

from formats import terminal
from formats.plain_text import lines_of


class _Mode:
    as_json = False
    indent: int | None = 2  # blanks a level of JSON; our choice: as people write JSON
    document: dict[str, Any] = {}  # noqa: RUF012 - replaced by `begin`


def begin() -> None:
    """Reset the output mode and the facts of an earlier command in this process."""
    _Mode.as_json, _Mode.indent, _Mode.document = False, 2, {}
    terminal.hush(is_quiet=False)


def ask_json(is_asked: bool) -> None:
    """From now on, collect facts for JSON instead of printing sentences."""
    _Mode.as_json = is_asked or _Mode.as_json


def ask_lines() -> None:
    """Print the JSON document on one line, since the command has printed one object a line before it."""
    _Mode.indent = None


def ask_quiet(is_asked: bool) -> None:
    """From now on, print no sentences and no progress; errors are still printed."""
    if is_asked:
        terminal.hush()


def tell(words: str, /, **facts: Any) -> None:
    """Print a sentence on stdout, or keep its facts for the JSON document."""
    _Mode.document.update(facts)
    if not _Mode.as_json and not terminal.is_hushed():
        _print(words)


def know(**facts: Any) -> None:
    """Keep facts for the JSON document that have no sentence."""
    _Mode.document.update(facts)


def tell_entry(name: str, words: str, /, **facts: Any) -> None:
    """Print a sentence on stdout, or keep its facts as one entry of the list `name` in the JSON document."""
    _Mode.document.setdefault(name, []).append(facts)
    if not _Mode.as_json and not terminal.is_hushed():
        _print(words)


def tell_fault(sentence: str) -> None:
    """Keep the sentence of a fault that makes the command fail; the first one becomes `error` in the JSON document.

    The command has already printed the sentence, except under `--quiet` or `--json`, where it is printed on stderr.
    """
    _Mode.document.setdefault("error", sentence)
    if terminal.is_hushed() or _Mode.as_json:
        terminal.say(f"hangtime: {sentence}", is_error=True)


def end() -> None:
    """Print the JSON document, if it was requested."""
    if _Mode.as_json:
        _print(as_json(_Mode.document, indent=_Mode.indent))
        _Mode.as_json = False


def _print(text: str) -> None:
    sys.stdout.write(f"{lines_of(text)}\n")
    sys.stdout.flush()  # a full disk or a closed pipe is met here


def as_json(value: Any, *, indent: int | None = 2) -> str:  # our choice: as people write JSON
    """Return plain values as JSON; a number that is not finite becomes null, since JSON has none.

    Control characters, including those of the writing direction, are escaped for terminals. A byte of a file name that
    is not UTF-8 is escaped as its surrogate, from which `os.fsencode` restores the byte.
    """
    text = json.dumps(_finite(value), indent=indent, allow_nan=False, ensure_ascii=False)
    return "".join(letter if letter == "\n" or letter.isprintable() else json.dumps(letter)[1:-1] for letter in text)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

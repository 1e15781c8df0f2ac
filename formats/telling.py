"""Tell the results of a command: words for people, a JSON document for programs (`--json`), or nothing (`--quiet`).

A command calls `tell` for every sentence, with its facts as plain values. Facts of several calls make one document.
A name with several entries, such as the takes of `hangtime takes list`, is told with `tell_entry` and becomes a list.
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
    indent: int | None = 2
    document: dict[str, Any] = {}  # noqa: RUF012 - replaced by `begin`


def begin() -> None:
    """Forget the words of an earlier command of this process, and their form."""
    _Mode.as_json, _Mode.indent, _Mode.document = False, 2, {}
    terminal.hush(is_quiet=False)


def ask_json(is_asked: bool) -> None:
    """Tell facts instead of words from here on."""
    _Mode.as_json = is_asked or _Mode.as_json


def ask_lines() -> None:
    """Let a JSON document take one line: the command has printed others, one a line, before it."""
    _Mode.indent = None


def ask_quiet(is_asked: bool) -> None:
    """Tell no words, and show no progress, from here on; errors are still said."""
    if is_asked:
        terminal.hush()


def tell(words: str, /, **facts: Any) -> None:
    """Print words on stdout, or keep the facts that they are of for the JSON document."""
    _Mode.document.update(facts)
    if not _Mode.as_json and not terminal.is_hushed():
        _print(words)


def know(**facts: Any) -> None:
    """Keep facts for the JSON document for which there are no words."""
    _Mode.document.update(facts)


def tell_entry(name: str, words: str, /, **facts: Any) -> None:
    """Print words on stdout, or keep their facts as one entry of the list `name` of the JSON document."""
    _Mode.document.setdefault(name, []).append(facts)
    if not _Mode.as_json and not terminal.is_hushed():
        _print(words)


def tell_fault(sentence: str) -> None:
    """Keep a sentence for which the command will fail, the first of several as `error` of the JSON document.

    The words of the command have told it already; where `--quiet` asks for none, it is said on stderr.
    """
    _Mode.document.setdefault("error", sentence)
    if terminal.is_hushed():
        terminal.say(f"hangtime: {sentence}", is_error=True)


def end() -> None:
    """Print the JSON document, where one is asked for."""
    if _Mode.as_json:
        _print(as_json(_Mode.document, indent=_Mode.indent))
        _Mode.as_json = False


def _print(text: str) -> None:
    sys.stdout.write(f"{lines_of(text)}\n")
    sys.stdout.flush()  # a full disk or a closed pipe is met here


def as_json(value: Any, *, indent: int | None = 2) -> str:
    """Return plain values as JSON; a number that is not finite, which JSON does not have, becomes null.

    Control characters and those that turn the direction of writing are escaped, for a terminal may show it. So is a
    byte of a file's name that is no UTF-8, as its surrogate: JSON is UTF-8, and `os.fsencode` gives the byte again.
    """
    text = json.dumps(_finite(value), indent=indent, allow_nan=False, ensure_ascii=False)
    return "".join(letter if letter == "\n" or letter.isprintable() else json.dumps(letter)[1:-1] for letter in text)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

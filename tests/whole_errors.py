"""Every error that a test meets says what, where and what to do next; else the test fails.

A test asks for an error's gist, and would not miss a place or an advice that is gone. So this rule holds for all
tests, through `tests/conftest.py`, whether a command said the error or a reader raised it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from formats.errors import HangtimeError

# Sentences that name their own place: the word that was given, or what was asked for as a whole.
OWN_PLACE = re.compile(
    "there is no .+ named |no take moves |no take was given|every take is held out|the takes are too short|"
    "a library failed|a place would be stored|the method .+ cannot start |.+ is not installed|"
    ".+ complete commands|.+ lacks a // behind |.+ is neither a folder nor a bucket|no folder or bucket was given"
)


def missing_of(error: HangtimeError) -> list[str]:
    """The parts that an error lacks."""
    has_place = error.where not in (None, "") or bool(OWN_PLACE.match(error.what or ""))
    return [part for part, is_there in (("what", error.what), ("where", has_place), ("advice", error.advice))
            if not is_there]  # fmt: skip


@pytest.fixture(autouse=True)
def whole_errors(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail a test during which an error was made that lacks a part."""
    made, plainly = [], HangtimeError.__init__

    def noted(self: HangtimeError, *words: Any, **more: Any) -> None:
        plainly(self, *words, **more)
        made.append(self)

    monkeypatch.setattr(HangtimeError, "__init__", noted)
    yield
    lacking = [(str(error), missing) for error in made if (missing := missing_of(error))]
    assert not lacking, lacking

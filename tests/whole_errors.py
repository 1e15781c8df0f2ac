"""Fail every test in which an error lacks its fault, its place or its next action.

Single tests check an error's main words, and would not notice a missing place or advice. So `tests/conftest.py` applies
this rule to all tests, whether a command printed the error or a reader raised it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from formats.errors import HangtimeError

# Sentences that contain their place: the given word, or the whole request.
OWN_PLACE = re.compile(
    "there is no .+ named |no take moves |no take was given|every take is held out|the takes are too short|"
    "a library failed|a place would be stored|the method .+ cannot start |.+ is not installed|"
    ".+ complete commands|.+ lacks a // behind |.+ is neither a folder nor a bucket|no folder or bucket was given"
)


def missing_of(error: HangtimeError) -> list[str]:
    """Return the missing parts of an error."""
    has_place = error.where not in (None, "") or bool(OWN_PLACE.match(error.what or ""))
    return [part for part, is_there in (("what", error.what), ("where", has_place), ("advice", error.advice))
            if not is_there]  # fmt: skip


@pytest.fixture(autouse=True)
def whole_errors(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail a test during which an incomplete error was created."""
    made, plainly = [], HangtimeError.__init__

    def noted(self: HangtimeError, *words: Any, **more: Any) -> None:
        plainly(self, *words, **more)
        made.append(self)

    monkeypatch.setattr(HangtimeError, "__init__", noted)
    yield
    lacking = [(str(error), missing) for error in made if (missing := missing_of(error))]
    assert not lacking, lacking

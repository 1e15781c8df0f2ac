"""One sentence for every error: where, what, and what to do next."""

from __future__ import annotations

import pytest

from formats.errors import HangtimeError


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"what": "is empty"}, "is empty"),
        ({"what": "is empty", "where": "a.mcap"}, "a.mcap: is empty"),
        ({"what": "is empty", "advice": "record again"}, "is empty; record again"),
        ({"what": "are these milliseconds?", "where": 3, "advice": "give s"}, "3: are these milliseconds? Give s"),
        ({"what": "why?", "advice": "`fit` says"}, "why? `fit` says"),
    ],
)
def test_an_error_says_where_what_and_what_to_do_next(words, sentence):
    error = HangtimeError(**words)
    assert str(error) == sentence
    assert (error.what, error.where, error.advice) == (words["what"], words.get("where"), words.get("advice", ""))
    assert error.exit_code == 2

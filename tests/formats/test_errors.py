"""One sentence for every error: where, what, and what to do next."""

from __future__ import annotations

import pytest

from formats.errors import HangtimeError
from tests.whole_errors import missing_of

NOTHING = {"where": None, "advice": ""}


@pytest.fixture
def whole_errors():
    """Disable the check for whole errors, since the errors here lack parts on purpose."""


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
    error = HangtimeError(**NOTHING | words)
    assert str(error) == sentence
    assert (error.what, error.where, error.advice) == (words["what"], words.get("where"), words.get("advice", ""))
    assert error.exit_code == 2


@pytest.mark.parametrize(
    ("words", "missing"),
    [
        ({"what": "is empty", "where": "a.mcap", "advice": "record again"}, []),
        ({"what": "is empty", "where": "", "advice": "record again"}, ["where"]),
        ({"what": "is empty", "where": "a.mcap"}, ["advice"]),
        ({"what": "there is no search named 'a'", "advice": "give another"}, []),
        ({"what": ""}, ["what", "where", "advice"]),
    ],
)
def test_an_error_that_lacks_a_part_fails_the_test_that_meets_it(words, missing):
    assert missing_of(HangtimeError(**NOTHING | words)) == missing


@pytest.mark.parametrize("words", [{"where": "a.mcap"}, {"advice": "record again"}, {}])
def test_no_error_is_made_without_a_word_on_its_place_and_the_next_step(words):
    """So that the type check refuses one, whether a test meets it or not."""
    with pytest.raises(TypeError, match="required keyword-only argument"):
        HangtimeError("is empty", **words)

"""A keyword that no call knows is refused with every argument of that call, the nearest first."""

from __future__ import annotations

import inspect

import pytest

import hangtime


@pytest.mark.parametrize(
    ("call", "misspelt", "meant"),
    [
        (hangtime.fit, "held_outt", "held_out"),
        (hangtime.fit, "heldoutmotion", "held_out_motion"),
        (hangtime.fit, "methud", "method"),
        (hangtime.diagnose, "checkpont", "checkpoint"),
        (hangtime.simulate, "any_way", "anyway"),
        (hangtime.report, "overwite", "overwrite"),
        (hangtime.export, "thicknes", "thickness"),
        (hangtime.load, "pat", "path"),
    ],
)
def test_a_misspelt_argument_is_answered_with_the_nearest_and_then_all_others(call, misspelt, meant):
    with pytest.raises(hangtime.HangtimeError) as caught:
        call("a.mcap", **{misspelt: None})
    others = [name for name in inspect.signature(call).parameters if name != meant]
    assert str(caught.value) == (
        f"{call.__name__}: there is no argument named {misspelt!r}; did you mean {meant}?"
        + (f" The others: {', '.join(others)}" if others else "")
    )


def test_an_argument_that_resembles_none_is_answered_without_a_guess():
    with pytest.raises(hangtime.HangtimeError) as caught:
        hangtime.load("a.mcap", zzz=1)
    assert str(caught.value) == "load: there is no argument named 'zzz'; its arguments: path"


def test_the_arguments_of_a_fit_are_those_that_help_shows():
    with pytest.raises(hangtime.HangtimeError, match=r"held_out_motion, anyway, checkpoint, progress, .*, engine$"):
        hangtime.fit("a.mcap", held_outt="b.mcap")

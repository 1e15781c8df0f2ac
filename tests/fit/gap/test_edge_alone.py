"""An effect that the held edge alone identifies, beside effects that close the gap of the cloth below."""

from __future__ import annotations

import re

import pytest

from tests.fit.gap.linear_cloth import World, diagnosed, three_takes

WORLD = World(on_edge=("clock_drift",))  # a drift moves the held edge, and the cloth by a fifth of a usual effect
DRIFT = 0.005


def told(sizes, **options):
    training, held_out = three_takes(WORLD, sizes, **options)
    return diagnosed(training, held_out, WORLD).diagnosis


def finding(diagnosis, name):
    return next(one for one in diagnosis.effects if one.id == name)


@pytest.mark.parametrize("drag", [0.3, 1.2])
def test_an_effect_that_closes_the_gap_is_named_beside_the_one_that_the_edge_identifies(drag):
    d = told({"clock_drift": DRIFT, "air_drag": drag})
    assert d.verdict == "several"
    assert set(d.named) == {"clock_drift", "air_drag"}
    assert finding(d, "clock_drift").amplitude == pytest.approx(DRIFT, rel=0.05)
    assert finding(d, "air_drag").amplitude == pytest.approx(drag, abs=0.05)


def test_an_effect_that_closes_the_gap_but_moves_the_edge_elsewhere_is_not_named_and_the_sentence_says_why():
    """The cloth moves as with an offset of 40 ms, the edge as with a drift alone: an offset would move the edge."""
    d = told({"clock_drift": DRIFT}, more={"time_offset": 0.04})
    assert (d.verdict, d.named) == ("effect", ["clock_drift"])
    offset = finding(d, "time_offset")
    assert offset.closure.value > 0.95
    assert offset.probability < 0.01
    said = re.search(r"The rest of the gap, (\d+) %, no effect in the library explains: (.*?)\. ", d.sentence)
    assert int(said[1]) == pytest.approx(100 - 100 * finding(d, "clock_drift").closure.value, abs=1)
    assert said[2] == (
        f"a time offset between markers and points would close {100 * offset.closure.value:.0f} % of the gap, but the "
        "held edge contradicts it"
    )


def test_an_identified_effect_stays_named_where_all_effects_together_explain_too_little():
    """Drag and a motion that no effect makes: without the drag the drift is named, and with it as well."""
    for sizes in {}, {"air_drag": 1.2}:
        d = told({"clock_drift": DRIFT, **sizes}, unknown=4e-3)
        assert (d.verdict, d.named) == ("effect", ["clock_drift"]), d.sentence
        assert finding(d, "clock_drift").amplitude == pytest.approx(DRIFT, rel=0.05)
        assert finding(d, "clock_drift").probability > 0.95
    left = re.search(r"air drag beside this effect would leave (\d+) % of the gap, more than a true cause", d.sentence)
    assert 20 < int(left[1]) < 40


def test_a_named_effect_that_leaves_the_edge_off_does_not_hide_this():
    """The edge moves 3 mm beside the hanger's path, as no effect does, and the cloth follows it."""
    d = told({"air_drag": 1.5}, off=3e-3)
    assert (d.verdict, d.named) == ("effect", ["air_drag"])
    assert f"With it the held edge is still {d.gap.edge_with_effect_mm:.1f} mm off, beyond noise." in d.sentence
    quiet = told({"air_drag": 1.5})
    assert quiet.named == ["air_drag"]
    assert "edge" not in quiet.sentence

"""Effects that are refitted on request: what they change in a diagnosis, and what is said of them without a gap."""

from __future__ import annotations

import functools

import pytest

from fit.api.shown import diagnosis_tables
from fit.api.tables import as_text
from tests.fit.gap.linear_cloth import World, diagnosed, three_takes

WEAK = 0.0022  # kg/m of hem, a fifth of its typical size: the squared error exceeds that of the noise by a tenth


@functools.cache
def of_a_weak_hem(by, *added):
    world = World()
    training, held_out = three_takes(world, {"hem": WEAK})
    return diagnosed(training, held_out, world, by=by, added=added).diagnosis


@pytest.mark.parametrize("by", ["rules", "evidence"])
def test_a_requested_effect_changes_neither_the_noise_nor_the_verdict(by):
    alone, beside = of_a_weak_hem(by), of_a_weak_hem(by, "hem", "draught")
    assert beside.gap.floor_mm == alone.gap.floor_mm
    assert beside.gap.base_mm.value == pytest.approx(alone.gap.base_mm.value, rel=0.01)
    assert beside.verdict == alone.verdict
    refitted = {one.id for one in beside.effects if one.fitted_share is not None}
    assert {"hem", "draught"} <= refitted


def test_where_no_gap_shows_no_effect_closes_a_share_of_it():
    found = of_a_weak_hem("rules", "hem", "draught")
    squares = (found.gap.base_mm.value / found.gap.floor_mm.value) ** 2
    assert 1.05 < squares < 1.2  # enough for a ratio, and too little for a gap
    assert found.sentence.startswith("No gap")
    assert [one.id for one in found.effects if one.closure is not None] == []
    (hem,) = [one for one in found.effects if one.id == "hem"]
    assert hem.amplitude_interval is not None  # it was refitted
    said = as_text(diagnosis_tables(found, ("hem",)))
    assert "no gap shows that it could close (p = " in said
    assert "of the gap [" not in said

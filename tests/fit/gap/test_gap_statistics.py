"""The diagnosis' statistics where there is little to count: few half-seconds, few replicas; and its frequency map."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.base_fit import coarsened
from fit.gap.closure import BlockErrors, gain_p_value
from fit.gap.rounds import Rounds
from fit.gap.screening import _p_values
from fit.gap.where import find_where
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.verdict_scene import hypothesis
from tests.fit.scenes import hung, sheet, swing, take_of


def gaining(gains):
    """Errors of half-seconds before and after something that closes so much of each."""
    counts, none = np.ones(len(gains)), np.zeros(3)
    return BlockErrors(np.full(len(gains), 9.0), counts, none), BlockErrors(9.0 - np.asarray(gains), counts, none)


@pytest.mark.parametrize("blocks", [4, 6, 8])
def test_few_half_seconds_that_all_improve_prove_no_more_than_their_number(blocks):
    """All signs alike come up once in 2^blocks draws, whatever the gains are: no p-value can be below that."""
    rng = np.random.default_rng(blocks)
    for _ in range(10):
        p_value = gain_p_value(*gaining(rng.uniform(0.1, 3.0, blocks)))
        assert p_value == pytest.approx(0.5**blocks, rel=0.35)


def test_of_few_blocks_no_effect_is_significant_more_often_than_it_says():
    """Twenty effects that are none, five blocks, two-sided: 5 % of 400 trials, with three deviations of chance."""
    rng = np.random.default_rng(3)
    found = 0
    for _ in range(400):
        gain = rng.normal(size=(20, 5))
        signs = rng.choice([-1.0, 1.0], size=(2000, 5))
        drawn = np.array([(signs @ g) ** 2 for g in gain])
        _, family = _p_values(gain.sum(1) ** 2, drawn)
        found += family.min() < 0.05
    assert found <= 400 * 0.05 + 3 * np.sqrt(400 * 0.05 * 0.95)


def test_a_further_effect_that_one_of_two_tests_finds_counts_half_as_sure(monkeypatch):
    monkeypatch.setattr("fit.gap.rounds.gain_p_value", lambda before, after: 0.001)
    search = SimpleNamespace(judge=1, observer=2)
    start, found = hypothesis(("hem",), 9.0), hypothesis(("hem", "air_drag"), 6.0)
    assert Rounds._p_value(search, 0.2, start, found, 25) == pytest.approx(2 * 25 * 0.001)
    assert Rounds._p_value(search, 0.004, start, found, 25) == pytest.approx(2 * 0.004)
    assert Rounds._p_value(search, 0.7, start, found, 900) == 1.0
    alone = SimpleNamespace(judge=1, observer=1)  # nothing is held out
    assert Rounds._p_value(alone, 0.004, start, found, 25) == 0.004


def a_still_take(noise, rate=60, seconds=4.0):
    """A grid of points that only noise moves, beside a hanger that swings."""
    garment = sheet(grid=5)
    time = np.arange(0, seconds, 1 / rate)
    points = hung(garment, time) + np.random.default_rng(1).normal(0, noise, (len(time), 25, 3))
    return prepare(take_of(garment, time, swing(time, amplitude=0.05, hz=0.7, stop=2.0), points, sd=noise))


def test_white_noise_is_above_three_hertz_up_to_half_the_frame_rate():
    """Of 30 Hz there are 27 above 3 Hz: 90 %, of any band below less than its share of the scale and a half."""
    recording = a_still_take(0.003)
    observer = Observer([recording], SI, (), frequency=0.0)
    noise = recording.points - recording.points.mean(0)
    residual = np.zeros(len(observer.layout.sd))
    judged = observer.layout.is_judged
    chosen = (a[judged] for a in (observer.layout.frame, observer.layout.point, observer.layout.axis))
    residual[judged] = noise[tuple(chosen)] / observer.layout.sd[judged]
    bands = {b.name: b.share for b in find_where(observer, residual).frequency}
    assert list(bands)[-1] == "above 3 Hz"
    assert bands["above 3 Hz"] == pytest.approx(0.9, abs=0.02)
    assert sum(bands.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(("spacing", "coarser"), [(0.03, 0.045), (0.05, 0.06), (0.06, 0.06), (0.08, 0.08)])
def test_starts_are_never_looked_for_on_a_finer_mesh(spacing, coarser):
    asked = []
    resolution = SimpleNamespace(spacing=spacing, step_share=1.0)
    coarsened(SimpleNamespace(resolution=resolution, at_resolution=lambda r: asked.append(r.spacing)))
    assert asked == [pytest.approx(coarser)]

"""Statistics of the diagnosis with few half-seconds or few replicas; and its frequency map."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.base_fit import coarsened
from fit.gap.rounds import Rounds
from fit.gap.where import find_where
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.verdict_scene import EFFECTS, hypothesis, with_edge
from tests.fit.scenes import hung, sheet, swing, take_of


def test_a_further_effect_counts_among_those_that_were_refitted_beside_the_same_ones(monkeypatch):
    """Of three where other takes judge; of all five that were tested where none do; none where the edge decides."""
    monkeypatch.setattr("fit.gap.rounds.gain_p_value", lambda before, after, floor: 0.01)
    search = SimpleNamespace(judge=1, observer=SimpleNamespace(**EFFECTS), base=hypothesis((), 12.0), tested=[""] * 5)
    start, found = hypothesis(("hem",), 9.0), hypothesis(("hem", "air_drag"), 6.0)
    assert Rounds._p_value(search, start, found, 3, 5.0) == pytest.approx(0.03)
    assert Rounds._p_value(search, start, found, 900, 5.0) == 1.0
    search.judge = search.observer
    assert Rounds._p_value(search, start, found, 3, 5.0) == pytest.approx(0.05)
    assert Rounds._p_value(search, with_edge(start, 2000), with_edge(found, 1150), 3, 5.0) == 0.0


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
def test_starts_are_never_searched_on_a_finer_mesh(spacing, coarser):
    asked = []
    resolution = SimpleNamespace(spacing=spacing, step_share=1.0)
    coarsened(SimpleNamespace(resolution=resolution, at_resolution=lambda r: asked.append(r.spacing)))
    assert asked == [pytest.approx(coarser)]

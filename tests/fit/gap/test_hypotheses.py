"""Where refits begin, on a linear model whose best amplitude is known."""

from __future__ import annotations

import numpy as np
import pytest

from fit.gap.hypotheses import ITERATIONS, POLISHING, polishing, refits, shortlist
from fit.gap.screening import screen
from fit.methods import SI
from tests.fit.gap.linear_scene import LinearObserver, layout_of
from tests.fit.gap.verdict_scene import KINDS, signature

NUMBERS = len(layout_of().take)


@pytest.mark.parametrize("size", [0.6, 1.0])
def test_a_refit_begins_at_the_joint_linear_solution_of_parameters_and_amplitude(size):
    """r = -50 size s for a typical size s: that size, and the parameters stay where they are."""
    rng = np.random.default_rng(0)
    row = np.linalg.qr(rng.normal(size=(NUMBERS, 1)))[0].T[0]
    typical = KINDS["hem"].typical
    jacobian = np.zeros((NUMBERS, len(SI.initial)))
    observer = LinearObserver(-50.0 * size * row, jacobian, {"hem": 50.0 * row / typical})
    start = observer.fitted()
    screened = screen(observer, start, ("hem", "air_drag"), rng)
    task, other = refits(observer, start, screened, ["hem", "air_drag"])
    assert task.active == ("hem",)
    assert task.amplitudes[observer.columns["hem"]] == pytest.approx(size * typical, rel=1e-6)
    assert task.vector == pytest.approx(SI.initial)
    assert task.iterations == ITERATIONS
    assert task.jacobian.shape == (NUMBERS, len(SI.initial) + 1)
    # What explains nothing begins at three tenths of its size, of which the least share costs least, or the same.
    assert other.amplitudes[observer.columns["air_drag"]] == pytest.approx(0.09 * KINDS["air_drag"].typical)
    again = polishing(start)
    assert (again.iterations, again.jacobian) == (POLISHING, None)


def test_a_guess_beyond_an_effects_range_begins_inside():
    """Fifty typical sizes of a hem are ten times its range: nine tenths of that, and no share of it beyond."""
    rng = np.random.default_rng(1)
    row = np.linalg.qr(rng.normal(size=(NUMBERS, 1)))[0].T[0]
    hem = KINDS["hem"]
    observer = LinearObserver(-2500.0 * row, np.zeros((NUMBERS, len(SI.initial))), {"hem": 50.0 * row / hem.typical})
    screened = screen(observer, observer.fitted(), ("hem", "air_drag"), rng)
    (task,) = refits(observer, observer.fitted(), screened, ["hem"])
    assert task.amplitudes[observer.columns["hem"]] == pytest.approx(hem.high)  # 1.5 shares of 0.9, within bounds


def test_five_effects_and_no_trifle_are_refitted():
    """Of 100 a twentieth is 5: what saves less is not refitted, and no more than five are, twins apart."""
    rows = np.eye(8)
    saved = (100.0, 50.0, 20.0, 10.0, 6.0, 5.5, 4.0, 1.0)
    found = {f"e{n}": signature(rows[n], predicted=s, predicted_mm2=0.0) for n, s in enumerate(saved)}
    assert shortlist(found) == ["e0", "e1", "e2", "e3", "e4"]
    few = {name: found[name] for name in ("e0", "e6", "e7")}
    assert shortlist(few) == ["e0"]
    twins = {**few, "twin": signature(rows[0] + 0.1 * rows[1], predicted=1.0, predicted_mm2=0.0)}
    assert shortlist(twins) == ["e0", "twin"]

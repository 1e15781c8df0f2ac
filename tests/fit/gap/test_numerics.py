"""What a finer mesh says of a coarse one's error."""

from __future__ import annotations

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.gap.fitting import Fitted
from fit.gap.numerics import LEAST_REFINEMENT, motion_mm, refine
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, sheet, swing, take_of

CONVERGED = Resolution(spacing=0.02)


@pytest.mark.parametrize(
    "spacing",
    [0.2, 0.15, 0.08, *(pytest.param(size, marks=pytest.mark.slow) for size in (0.085, 0.05))],
)
def test_a_finer_mesh_is_finer_and_says_how_far_the_coarse_one_is_off(spacing):
    """A square of 0.4 m has one element of 0.15 m or more, which 1.5 times as many would leave as one, and two of 0.08.

    What is told is no less than what separates the mesh from one that has converged, and not far more.
    """
    time = np.arange(0, 3, 1 / 30)
    garment = sheet(width=0.4, height=0.4, grid=5)
    moved = swing(time, amplitude=0.05, hz=0.8, stop=2.0)
    take = take_of(garment, time, moved, hung(garment, time) + moved[:, None], sd=1e-3)
    vector = SI.initial.copy()
    observer = Observer([prepare(take)], SI, (), frequency=0.0, resolution=Resolution(spacing=spacing))
    residual = observer.residuals(vector[None], observer.off[None])[0]
    nothing = np.zeros((len(residual), len(vector)))
    base = Fitted(vector, observer.off, (), residual, nothing, np.zeros(len(vector)), True)
    refined = refine(observer, observer, base)
    assert refined.ratio >= LEAST_REFINEMENT
    true = observer.at_resolution(CONVERGED).residuals(vector[None], observer.off[None])[0]
    apart = float(observer.in_mm(true - residual))
    assert 0.8 * apart < refined.mesh_mm < 4 * apart
    # Sound solvers differ by 1.5 % of the motion besides.
    assert refined.numerics_mm == pytest.approx(np.hypot(refined.mesh_mm, 0.015 * motion_mm(observer)))

"""The next recording to make: imagined motions, and what they would tell apart."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.cloth.effect import amplitudes_of
from fit.effects import LIBRARY
from fit.gap.hypotheses import Hypothesis
from fit.gap.next_experiment import MENU, _apart, _inflation, _pairs, followed, imagine, propose
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.linear_scene import LinearObserver, layout_of
from tests.fit.gap.test_diagnosis_parts import COARSE, a_take, fitted_at, truth_vector


@pytest.mark.slow
def test_turning_cloth_or_rig_tells_a_draught_from_tilted_gravity():
    """Both only lean the cloth; a twist of the hanger, or a turned rig, puts the wind on another side of it."""
    observer = Observer([prepare(a_take())], SI, LIBRARY, frequency=0.0, resolution=COARSE)
    base = fitted_at(observer, truth_vector())
    alive = []
    for name, size in (("gravity_tilt", (0.0, 0.02)), ("draught", (0.0, 0.35))):
        row = amplitudes_of(LIBRARY, **{name: size})
        assert row[observer.columns[name]].any()
        alive.append(Hypothesis((name,), dataclasses.replace(base, amplitudes=row, active=(name,)), None))
    found = propose(observer, base, alive, [0.5, 0.5])
    assert found is not None
    assert found.id in {"S7", "S9"}
    assert found.separates == ["gravity_tilt", "draught"]
    assert found.sigmas_next > 2 * found.sigmas_now


def test_every_motion_of_the_menu_can_be_imagined():
    recording = prepare(a_take())
    for motion in MENU:
        imagined = imagine(recording, motion)
        path = imagined.held(imagined.time)
        assert np.isfinite(path).all(), motion.id
        gap = np.linalg.norm(path[:, 3:] - path[:, :3], axis=1)
        assert gap == pytest.approx(np.full(len(gap), 0.4), abs=2e-3), motion.id


def test_the_next_recording_is_imagined_of_cloth_that_follows_the_hanger():
    """Under a pull to where the base model has it; pulled to a cloth that stands still it would hardly move."""
    observer = Observer([prepare(a_take())], SI, (), frequency=2.0, resolution=COARSE)
    swung = next(m for m in MENU if m.id == "S3")
    base = SimpleNamespace(vector=truth_vector())
    (imagined,) = followed(observer, [imagine(observer.recordings[0], swung)], base)
    under = observer.of([imagined])
    (pulled,) = under.trajectories(truth_vector()[None], observer.off[None])
    assert np.abs(pulled[0] - imagined.points).max() < 5e-3
    assert np.ptp(imagined.points[:, -1, 1]) > 0.2


def test_an_outline_may_begin_anywhere():
    """Moved by 0.3 m in its own plane, the garment hangs from the same place."""
    recording = prepare(a_take())
    garment = recording.garment
    aside = msgspec.structs.replace(
        garment, outline_m=tuple((x + 0.3, y - 0.1) for x, y in garment.outline_m),
        points=tuple(msgspec.structs.replace(p, at_m=(p.at_m[0] + 0.3, p.at_m[1] - 0.1)) for p in garment.points),
    )  # fmt: skip
    moved = dataclasses.replace(recording, garment=aside, offset_sd=0.002, held_error=0.004)
    one, other = (imagine(r, MENU[3]) for r in (recording, moved))
    assert other.points == pytest.approx(one.points)
    assert (other.offset_sd, other.held_error) == (0.002, 0.004)


def test_explanations_are_apart_by_what_parameters_and_the_other_one_cannot_imitate():
    """Of (3, 4, 12) the parameter along the first axis imitates 3, and the other effect along the second 4."""
    numbers = 3
    observer = LinearObserver(np.zeros(numbers), np.zeros((numbers, len(SI.initial))), {}, layout=layout_of(1, 1, 1))
    jacobian = np.zeros((numbers, len(SI.initial)))
    jacobian[0, 0] = 1e6
    changes = [np.array([3.0, 4.0, 12.0]), np.array([0.0, 1e3, 0.0])]
    assert _apart(observer, 0 * jacobian, changes, 0, -1) == pytest.approx(13.0)
    assert _apart(observer, jacobian, changes, 0, -1) == pytest.approx(np.hypot(4, 12), rel=1e-6)
    assert _apart(observer, jacobian, changes, 0, 1) == pytest.approx(12.0, rel=1e-6)
    assert _pairs(1) == [(0, -1)]
    assert _pairs(3) == [(0, 1), (0, 2), (1, 2)]


def test_standard_deviations_are_larger_by_what_blocks_have_in_common():
    """A residual and a change of five equal numbers a block: block scores of 5 where white noise makes sqrt(5)."""
    rng = np.random.default_rng(0)
    blocks = layout_of(400, 6, 5).block
    observer = LinearObserver(
        np.zeros(len(blocks)), np.zeros((len(blocks), len(SI.initial))), {}, layout=layout_of(400)
    )
    change = np.ones(len(blocks))
    alike = rng.normal(size=80)[blocks]
    base = dataclasses.replace(observer.fitted(), residual=alike - alike.mean())
    assert _inflation(observer, base, [change]) == pytest.approx(90.0, rel=0.3)  # five frames of 18 numbers
    white = dataclasses.replace(observer.fitted(), residual=rng.normal(size=len(blocks)))
    assert 1.0 <= _inflation(observer, white, [change]) < 1.5
    explained = dataclasses.replace(observer.fitted(), residual=7.0 * change)
    assert _inflation(observer, explained, [change]) == 1.0

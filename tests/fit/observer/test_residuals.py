"""Residuals of given points: their normalisation and their layout."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.cloth.material import DENSITY
from fit.cloth.model import Resolution
from fit.effects import LIBRARY
from fit.errors import FitError
from fit.methods import SI
from fit.observer.residuals import BLOWN_UP_CHARGE, Observer, trajectories_together
from fit.recordings.recording import MARKER_OFFSET
from tests.fit.gap.test_gap_statistics import a_still_take

SD, FRAMES = 0.002, 60


@pytest.fixture(scope="module")
def still():
    """Two seconds of a grid of 5 x 5 whose top row is held, with 2 mm of stated noise and none in fact."""
    recording = a_still_take(0.0, rate=30, seconds=2.0)
    return dataclasses.replace(recording, point_sd=np.full(25, SD))


def observer_of(*recordings):
    return Observer(list(recordings), SI, (), frequency=0.0)


def residual_of(observer, *by):
    """Whitened residual of points that are off by so much [m], (frames, points, 3) a take."""
    return observer.residuals_of([(r.points - b)[None] for r, b in zip(observer.recordings, by, strict=True)])[0]


def test_varying_errors_are_divided_by_the_noise_and_constant_ones_by_their_prior_deviation(still):
    """A constant 3 mm along y, and 1 mm to and fro along z: 0.5 deviations, and 3 of sqrt(1 + 4 / 60) mm."""
    observer, by = observer_of(still), np.zeros(still.points.shape)
    by[:, :, 1] = 0.003
    by[:, :, 2] = 0.001 * np.tile([1.0, -1.0], FRAMES // 2)[:, None]
    found, layout = residual_of(observer, by), observer.layout
    assert len(found) == 20 * 3 * FRAMES + 20 * 3
    moving = found[layout.is_judged].reshape(FRAMES, 20, 3)
    assert moving[..., :2] == pytest.approx(0.0, abs=1e-9)
    assert moving[..., 2] == pytest.approx(0.5 * np.tile([1.0, -1.0], FRAMES // 2)[:, None] * np.ones(20))
    known = np.sqrt(MARKER_OFFSET**2 + SD**2 / FRAMES)
    assert found[~layout.is_judged].reshape(20, 3) == pytest.approx(np.tile([0.0, 0.003 / known, 0.0], (20, 1)))
    assert layout.sd[layout.is_judged] == pytest.approx(SD)
    assert layout.sd[~layout.is_judged] == pytest.approx(known)
    assert layout.metres(found).reshape(FRAMES, 20, 3) == pytest.approx(by[:, 5:])
    assert float(observer.in_mm(found)) == pytest.approx(np.sqrt(9 + 1))
    assert observer.in_mm(np.stack([found, 2 * found])) == pytest.approx(np.sqrt(9 + 1) * np.array([1.0, 2.0]))


def test_the_weighed_mass_is_spread_over_the_cloths_own_area(still):
    """kg over m^2 of the flat outline."""
    (left, bottom), (right, top) = (f(np.array(still.garment.outline_m), axis=0) for f in (np.min, np.max))
    assert observer_of(still).densities == pytest.approx([still.garment.mass_kg / ((right - left) * (top - bottom))])


def test_a_point_is_never_known_better_than_a_tenth_of_a_millimetre(still):
    fine = dataclasses.replace(still, point_sd=np.full(25, 1e-6))
    assert observer_of(fine).layout.sd[0] == pytest.approx(1e-4)


def test_half_seconds_and_thirds_of_the_cloth_are_blocks_of_their_own_in_each_take(still):
    """Four half-seconds a take, then top, middle and bottom: rows at 0, 3/4, 3/2, 9/4 and 3 thirds."""
    layout = observer_of(still, still).layout
    judged = layout.is_judged
    frames = np.repeat(np.arange(FRAMES), 60)
    assert layout.block[judged].tolist() == [*(frames // 15), *(4 + frames // 15)]
    assert layout.frame[judged].tolist() == [*frames, *frames]
    assert layout.take[judged].tolist() == [0] * 3600 + [1] * 3600
    thirds = np.repeat([0, 1, 2, 2], 15)
    assert layout.block[~judged].tolist() == [*(8 + thirds), *(11 + thirds)]
    assert layout.take[~judged].tolist() == [0] * 60 + [1] * 60
    assert set(layout.frame[~judged]) == {-1}
    assert layout.static_of[judged][:3600].tolist() == [*np.tile(7200 + np.arange(60), FRAMES)]
    assert layout.static_of[judged][3600:].tolist() == [*np.tile(7260 + np.arange(60), FRAMES)]


def test_every_judged_number_names_the_mean_of_its_own_take_and_no_other_number_names_one(still):
    """Three takes have 3600 judged numbers each; 60 means a take stand behind all of these."""
    layout = observer_of(still, still, still).layout
    named = layout.static_of[layout.is_judged].reshape(3, FRAMES, 60)
    assert (named == 3 * 3600 + 60 * np.arange(3)[:, None, None] + np.arange(60)).all()
    assert set(layout.static_of[~layout.is_judged]) == {-1}


def test_values_are_arranged_by_frame_point_and_axis_of_their_own_take(still):
    """The held edge's five points come first, and have no values."""
    values = np.arange(2 * 3600.0)
    grids = observer_of(still, still).by_place(values)
    for grid, own in zip(grids, values.reshape(2, FRAMES, 20, 3), strict=True):
        assert (grid[:, 5:] == own).all()
        assert np.isnan(grid[:, :5]).all()


def test_a_point_that_was_seen_once_has_a_mean_of_one_frame(still):
    """2 mm in frame 7, known to a marker's offset and the noise of a frame."""
    valid, by = still.valid.copy(), np.zeros(still.points.shape)
    valid[:, 12], by[:, 12] = False, np.nan
    valid[7, 12], by[7, 12] = True, (0.002, 0.0, 0.0)
    observer = observer_of(dataclasses.replace(still, valid=valid))
    found, layout = residual_of(observer, by), observer.layout
    known, mine = np.hypot(MARKER_OFFSET, SD), layout.point == 12
    assert found[mine] == pytest.approx([0.0, 0.0, 0.0, 0.002 / known, 0.0, 0.0])
    assert layout.sd[mine] == pytest.approx([SD] * 3 + [known] * 3)


def test_unseen_points_have_no_residual_and_no_part_in_a_mean(still):
    """Of point 12 half of the frames: 2 mm there, whose mean is known to sd / sqrt(30)."""
    valid = still.valid.copy()
    valid[::2, 12] = valid[:, 24] = False
    observer = observer_of(dataclasses.replace(still, valid=valid))
    by = np.zeros(still.points.shape)
    by[1::2, 12, 0] = 0.002
    by[::2, 12] = by[:, 24] = np.nan
    found, layout = residual_of(observer, by), observer.layout
    assert len(found) == (18 * FRAMES + FRAMES // 2) * 3 + 19 * 3
    assert found[layout.is_judged] == pytest.approx(0.0, abs=1e-9)
    known = np.sqrt(MARKER_OFFSET**2 + SD**2 / 30)
    mine = found[~layout.is_judged & (layout.point == 12)]
    assert mine == pytest.approx([0.002 / known, 0.0, 0.0])
    assert not (layout.point == 24).any()


def test_a_simulation_that_blew_up_is_charged_a_thousand_deviations_a_number(still):
    observer = observer_of(still)
    points = np.stack([still.points, still.points, still.points])
    points[1, 30, 10] = np.nan
    points[2, 30, 10] += 1e6
    found = observer.residuals_of([points])
    assert not found[0].any()
    assert np.isfinite(found).all()
    assert np.abs(found[1:]).max(1).tolist() == [BLOWN_UP_CHARGE, BLOWN_UP_CHARGE] == [1e3, 1e3]
    sound = observer.sound_residuals_of([points])
    assert np.isnan(sound).all(1).tolist() == [False, True, False]
    assert sound[2] == pytest.approx(found[2])


def test_a_silhouettes_constant_offset_is_not_judged(still):
    outline = dataclasses.replace(still, garment=msgspec.structs.replace(still.garment, kind="skirt_panel"))
    observer, by = observer_of(outline), np.zeros(still.points.shape)
    by[..., 1] = 0.003
    by[:30, :, 0], by[30:, :, 0] = 0.001, -0.001
    found = residual_of(observer, by)
    assert len(found) == 20 * 3 * FRAMES
    assert observer.layout.static_of.tolist() == [-1] * len(found)
    assert float(observer.in_mm(found)) == pytest.approx(1.0)


def test_observers_of_other_pulls_are_not_simulated_side_by_side(still):
    observer = observer_of(still)
    other = observer.with_frequency(2.0)
    assert (other.frequency, observer.frequency, other.layout) == (2.0, 0.0, observer.layout)
    with pytest.raises(FitError, match=r"pulls of \[0.0, 2.0\] Hz") as refused:
        trajectories_together([(one, SI.initial[None], one.off[None]) for one in (observer, other)])
    assert refused.value.where == "observers"


def test_points_are_simulated_with_the_observers_pull_or_the_one_that_is_asked_for(still):
    """The hanger swings by 50 mm beside points that rest: a pull leaves the cloth nearer to them."""
    free = observer_of(still)
    pulled = free.with_frequency(2.0)
    asked = SI.initial[None], free.off[None]
    (alone,), (near,) = free.trajectories(*asked), pulled.trajectories(*asked)
    apart = [np.sqrt(np.mean((points[0] - still.points)[:, 5:] ** 2)) for points in (alone, near)]
    assert apart[1] < 0.8 * apart[0]
    assert free.trajectories(*asked, frequency=2.0)[0] == pytest.approx(near, abs=1e-6)
    assert pulled.trajectories(*asked, frequency=0.0)[0] == pytest.approx(alone, abs=1e-6)


def test_observers_side_by_side_find_what_each_finds_alone(still):
    """One observer has a heavy garment's take. The other has two: a lighter one's, and the same."""
    heavy = dataclasses.replace(
        still, garment=msgspec.structs.replace(still.garment, mass_kg=4 * still.garment.mass_kg)
    )
    asked = [(one, SI.initial[None], one.off[None]) for one in (observer_of(heavy), observer_of(still, heavy))]
    together = trajectories_together(asked)
    assert [len(points) for points in together] == [1, 2]
    for (observer, *words), points in zip(asked, together, strict=True):
        for one, other in zip(points, observer.trajectories(*words), strict=True):
            assert one == pytest.approx(other, abs=1e-6)
    assert np.abs(together[1][0] - together[1][1]).max() > 1e-3


def test_an_observer_keeps_its_mesh_for_other_takes_and_its_pull_on_another_mesh(still):
    fine = observer_of(still).with_frequency(2.0)
    coarse = fine.at_resolution(Resolution(spacing=0.1))
    both = coarse.of([still, still])
    for one in (coarse, both):
        assert (one.resolution, one.frequency) == (Resolution(spacing=0.1), 2.0)
        assert len(one.mesh.rest) < len(fine.mesh.rest)
    assert both.recordings == [still, still]


def test_the_columns_of_an_observers_effects_follow_each_other_in_a_row_of_amplitudes(still):
    observer = Observer([still], SI, LIBRARY, frequency=0.0)
    numbers = np.arange(len(observer.off))
    columns = {name: numbers[where].tolist() for name, where in observer.columns.items()}
    assert [len(columns[effect.name]) for effect in LIBRARY] == [len(effect.components) for effect in LIBRARY]
    assert np.concatenate([columns[effect.name] for effect in LIBRARY]).tolist() == numbers.tolist()


def test_each_take_is_simulated_with_its_own_garments_density(still):
    """Of two takes the second is of a garment twice as heavy."""
    heavy = dataclasses.replace(
        still, garment=msgspec.structs.replace(still.garment, mass_kg=2 * still.garment.mass_kg)
    )
    observer = observer_of(still, heavy)
    simulators, materials, _ = observer.asked(SI.initial[None], observer.off[None])
    assert [one.recording for one in simulators] == [still, heavy]
    assert materials[1][0, DENSITY] == pytest.approx(2 * materials[0][0, DENSITY])

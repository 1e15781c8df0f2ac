"""Residuals of the held edge as evidence on the boundary and on the measurement."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.gap.closure import block_errors
from fit.gap.findings import notes
from fit.gap.floor import Floor
from fit.gap.gates import predictability_gate
from fit.methods import SI
from fit.observer.edge import (
    KEPT_NOISE,
    NUMBERS_A_FRAME,
    EdgeErrors,
    EdgeResiduals,
    edge_errors,
    is_edge_explained,
    is_favoured_by_edge,
    is_seen_on_edge,
)
from fit.observer.residuals import BLOCK_SECONDS, Observer
from fit.recordings.camera import Edge
from fit.recordings.noise import held_noise
from fit.recordings.recording import MARKER_OFFSET, SILHOUETTE_OFFSET, prepare
from fit.recordings.smoothing import steady_spline
from formats.rig import Calibration, Sensor
from tests.fit.scenes import hung, sheet, swing, take_of

RATE, NOISE = 30.0, 1e-3
TIME = np.arange(0, 4, 1 / RATE)


def a_recording(grid=5, *, change=None, noise=NOISE, held_noise=0.0, seed=0):
    """A flat sheet that moves with its hanger, or whose points are changed, (frames, points, 3)."""
    garment, path = sheet(grid=grid), swing(TIME, sideways=0.02)
    points = hung(garment, TIME) + path[:, None]
    rng = np.random.default_rng(seed)
    take = take_of(garment, TIME, path, points if change is None else change(points), sd=noise)
    take = dataclasses.replace(take, points=take.points + noise * rng.normal(size=points.shape))
    return prepare(dataclasses.replace(take, held=take.held + held_noise * rng.normal(size=take.held.shape))), points


def numbers_of(recording, points):
    dynamic, static = EdgeResiduals(recording).of(points[None])
    return dynamic[0].reshape(-1, NUMBERS_A_FRAME), static[0]


def test_a_steady_spline_keeps_the_share_of_white_noise_that_the_edge_counts_on():
    noise = np.random.default_rng(0).normal(size=(3000, 20))
    time = np.arange(len(noise)) / RATE
    for cut_off in (3.0, 5.0):
        left = steady_spline(time, noise, cut_off)(time).var()
        assert left == pytest.approx(KEPT_NOISE * cut_off / RATE, rel=0.05)


@pytest.mark.parametrize("grid", [pytest.param(None, marks=pytest.mark.slow), 5])
@pytest.mark.parametrize("held_noise", [pytest.param(0.0, marks=pytest.mark.slow), 1e-3])
def test_the_numbers_of_an_edge_that_is_where_it_should_be_are_standard_normal(grid, held_noise):
    """The path is as uncertain as its noise makes it, on which the simulated edge lies."""
    found = []
    for seed in range(10):
        recording, points = a_recording(grid, held_noise=held_noise, seed=seed)
        measured = recording.held(recording.time).reshape(-1, 2, 3).mean(1)
        true = swing(TIME, sideways=0.02)
        dynamic, static = numbers_of(recording, points + (measured - true)[:, None])
        found.append((dynamic**2).mean(0))
        assert (np.abs(static) < 1.5).all()  # white noise is nothing beside a marker's own offset
    assert np.mean(found) == pytest.approx(1.0, rel=0.15)


def test_a_shift_or_stretch_of_the_edge_shows_and_a_rotation_does_not():
    """3 mm of swing to the right, an edge that is 2 % too long, a roll of 0.05 rad about its middle."""
    wave = np.sin(2 * np.pi * TIME)[:, None]

    def moved(points):
        return points + 0.003 * wave[..., None] * [1.0, 0.0, 0.0]

    def longer(points):
        return points * [1.02, 1.0, 1.0]

    def rolled(points):
        turned = points.copy()
        turned[..., 2] += 0.05 * wave * hung(sheet(grid=5), TIME)[..., 0]
        return turned

    found = {}
    for change in (moved, longer, rolled):
        recording, points = a_recording(change=change, noise=1e-5)
        dynamic, static = numbers_of(recording, points)
        edge = EdgeResiduals(recording)
        found[change] = (dynamic * edge.sd).std(0), static * edge.static_sd
        assert (dynamic * edge.sd).mean(0) == pytest.approx(0.0, abs=1e-9)
    assert found[moved][0][0] == pytest.approx(0.003 / np.sqrt(2), rel=0.02)
    assert found[moved][0][1:] == pytest.approx(0.0, abs=5e-5)
    arm = 0.4 * np.sqrt(1 / 8)  # rms of five even places along 0.4 m
    assert found[longer][1][3] == pytest.approx(0.02 * arm, rel=0.02)
    assert found[rolled][0] == pytest.approx(0.0, abs=5e-5)


def test_points_that_are_missing_on_one_side_are_not_mistaken_for_a_moved_edge():
    def longer(points):
        points = points * [1.02, 1.0, 1.0]
        points[::2, :2] = np.nan
        points[5, 1:5] = points[7, 2:5] = np.nan  # one point of the edge is left, or two side by side
        points[9, 1:4] = np.nan  # the two outermost are enough
        return points

    recording, points = a_recording(change=longer, noise=1e-6)
    edge = EdgeResiduals(recording)
    assert sorted(set(range(len(TIME))) - set(edge.frame)) == [5, 7]
    _, static = edge.of(points[None])
    assert static[0, :3] * edge.static_sd[:3] == pytest.approx(0.0, abs=1e-4)
    assert static[0, 3] * edge.static_sd[3] == pytest.approx(0.02 * 0.4 * np.sqrt(1 / 8), rel=0.05)


def test_a_constant_offset_counts_as_a_markers_own():
    """Of five markers glued 1 mm beside their positions on average, the middle is known to 0.45 mm."""
    recording, _ = a_recording(noise=1e-6)
    assert EdgeResiduals(recording).static_sd[:3] == pytest.approx(MARKER_OFFSET / np.sqrt(5), rel=0.01)


def test_a_silhouettes_corners_may_be_further_beside_the_cloth_than_markers_on_it():
    garment, path = sheet(grid=5), swing(TIME)
    take = take_of(garment, TIME, path, hung(garment, TIME) + path[:, None], sd=1e-5)
    camera = Sensor(width=640, height=480, fx=575.0, fy=575.0, cx=320.0, cy=240.0)
    tracked = dataclasses.replace(take, rig=msgspec.structs.replace(take.rig, sensor=camera))
    marked, seen = prepare(take), prepare(tracked)
    assert (marked.offset_sd, seen.offset_sd) == (MARKER_OFFSET, SILHOUETTE_OFFSET) == (0.001, 0.002)
    assert EdgeResiduals(seen).static_sd == pytest.approx(2 * EdgeResiduals(marked).static_sd, rel=0.01)
    layouts = [Observer([one], SI, (), frequency=0.0).layout for one in (marked, seen)]
    still = [layout.sd[(layout.frame < 0) & ~layout.is_edge] for layout in layouts]
    assert len(still[0])
    assert still[1] == pytest.approx(2 * still[0], rel=0.05)


def test_an_edge_that_was_taken_from_its_own_row_is_off_from_it_by_no_markers_offset():
    """A millimetre of such an edge over the root of five, whatever the offsets of silhouettes are."""
    recording, _ = a_recording(noise=1e-6)
    silhouette = dataclasses.replace(recording, offset_sd=SILHOUETTE_OFFSET)
    camera = dataclasses.replace(recording.camera, edge=Edge(0.0, 0.0, 0.4))
    for one, off in ((silhouette, 0.002), (dataclasses.replace(silhouette, camera=camera), 0.001)):
        assert EdgeResiduals(one).static_sd[:3] == pytest.approx(off / np.sqrt(5), rel=0.01)


def test_a_calibration_that_knows_the_held_ends_badly_lets_the_edge_be_off_by_as_much():
    """Ends known to 2 mm over the axes: the middle to 1.41, the length to 2.83, times 0.354 at five positions."""
    recording, _ = a_recording(noise=1e-6)
    time = recording.time
    take = take_of(recording.garment, time, swing(time), hung(recording.garment, time))
    calibration = Calibration(held_sd_m=((0.001, 0.002, 0.0), (0.002, 0.003, np.sqrt(6e-6))))
    known = prepare(dataclasses.replace(take, rig=msgspec.structs.replace(take.rig, calibration=calibration)))
    assert known.held_error == pytest.approx(0.002)
    own = MARKER_OFFSET / np.sqrt(5)
    expected = np.hypot([0.002 / np.sqrt(2)] * 3 + [0.002 * np.sqrt(2) * np.sqrt(1 / 8)], own)
    assert EdgeResiduals(known).static_sd == pytest.approx(expected, rel=0.02)
    assert prepare(take).held_error == 0.0


def test_the_edge_is_evidence_beside_the_judged_points_and_never_an_error_of_theirs():
    recording, _ = a_recording()
    observers = [Observer([recording], SI, effects, frequency=0.0) for effects in ((), LIBRARY)]
    alone, beside = (o.residuals(SI.initial[None], o.off[None])[0] for o in observers)
    count = len(alone)
    assert len(beside) == count + NUMBERS_A_FRAME * (len(TIME) + 1)
    assert beside[:count] == pytest.approx(alone)
    simulated = observers[1].trajectories(SI.initial[None], observers[1].off[None])
    assert observers[1].residuals_of(simulated)[0] == pytest.approx(beside)
    aside = beside.copy()
    aside[count:] += 100.0
    assert observers[1].in_mm(aside) == observers[1].in_mm(beside) == pytest.approx(observers[0].in_mm(alone))
    layout = observers[1].layout
    assert (
        layout.block[count:-NUMBERS_A_FRAME] == np.repeat((TIME / BLOCK_SECONDS).astype(int), NUMBERS_A_FRAME)
    ).all()
    assert layout.block[-NUMBERS_A_FRAME:].min() > layout.block[:-NUMBERS_A_FRAME].max()
    errors = block_errors(observers[1], beside)
    moving, still = beside[count:-NUMBERS_A_FRAME], beside[-NUMBERS_A_FRAME:]
    assert (errors.edge.moving, errors.edge.count) == (pytest.approx((moving**2).sum()), len(moving))
    assert errors.edge.resting == pytest.approx((still**2).sum())
    limits = [predictability_gate(o, SI.initial, o.off).limit for o in observers]
    assert limits[0] == pytest.approx(limits[1])


def test_the_means_of_each_takes_edge_are_a_block_of_their_own():
    """Four means a take: the first number after all other blocks for the first take, the next one for the second."""
    recording, _ = a_recording()
    layout = Observer([recording, recording], SI, LIBRARY, frequency=0.0).layout
    is_mean = layout.is_edge & (layout.frame < 0)
    free = layout.block[~is_mean].max() + 1
    assert layout.block[is_mean].tolist() == [free] * NUMBERS_A_FRAME + [free + 1] * NUMBERS_A_FRAME
    assert layout.take[is_mean].tolist() == [0] * NUMBERS_A_FRAME + [1] * NUMBERS_A_FRAME
    assert set(layout.frame[is_mean]) == set(layout.point[layout.is_edge]) == set(layout.axis[layout.is_edge]) == {-1}


def test_an_edges_frames_count_among_their_takes_half_seconds():
    """Eight half-seconds a take."""
    recording, _ = a_recording()
    layout = Observer([recording, recording], SI, LIBRARY, frequency=0.0).layout
    block = np.repeat((TIME / BLOCK_SECONDS).astype(int), NUMBERS_A_FRAME)
    assert layout.block[layout.is_edge & (layout.frame >= 0)].tolist() == [*block, *(8 + block)]


def test_an_edges_frames_after_a_takes_last_judged_frame_count_in_the_half_second_of_that_frame():
    """Points are judged for 0.4 s of 4 s: one half-second a take."""
    recording, _ = a_recording()
    valid = recording.valid & (~recording.judged | (TIME < 0.41)[:, None])
    short = dataclasses.replace(recording, valid=valid)
    layout = Observer([short, short], SI, LIBRARY, frequency=0.0).layout
    moving = layout.is_edge & (layout.frame >= 0)
    assert layout.block[moving].tolist() == [0] * NUMBERS_A_FRAME * len(TIME) + [1] * NUMBERS_A_FRAME * len(TIME)


def test_the_outline_of_a_skirt_gives_no_evidence_of_how_its_edge_is_held():
    recording, _ = a_recording()
    skirt = dataclasses.replace(recording, garment=msgspec.structs.replace(recording.garment, kind="skirt_panel"))
    swatch, outline = (Observer([r], SI, LIBRARY, frequency=0.0) for r in (recording, skirt))
    assert outline.layout.is_judged.all()
    assert not swatch.layout.is_judged.all()
    floor = Floor(1.0, 0.0, 1.0, 1.0)
    said = [" ".join(notes(1, 1, one, floor, is_predictable=True)) for one in (swatch, outline)]
    assert ["silhouette" in one for one in said] == [False, True]


def resting(squares):
    return EdgeErrors(resting=squares)


def test_an_edges_error_counts_beyond_its_noise():
    """60 of what varies and 25 of what is constant are certain; noise makes 1.15 times the count and four."""
    found = EdgeErrors(moving=120.0, count=40, resting=50.0)
    assert found.shown == pytest.approx(2.0 + 2.0)
    assert found.beyond_noise == pytest.approx((120 - 46) / 60 + (50 - 4) / 25)
    assert EdgeErrors(moving=45.0, count=40, resting=3.9).beyond_noise == 0.0
    assert EdgeErrors().shown == EdgeErrors().beyond_noise == EdgeErrors().mm == EdgeErrors().count == 0


def test_an_effect_is_seen_on_the_edge_where_it_removes_a_certain_error_and_half_of_what_is_beyond_noise():
    """Of 50, 25.1 make a certain error; of 100, 96 are beyond noise, and 48 of them may be left."""
    assert is_seen_on_edge(resting(50.0), resting(24.9))
    assert not is_seen_on_edge(resting(50.0), resting(25.1))
    assert is_seen_on_edge(resting(100.0), resting(51.9))
    assert not is_seen_on_edge(resting(100.0), resting(52.1))
    assert is_seen_on_edge(resting(100.0), resting(51.9), by_law=48.0 / 25)
    assert not is_seen_on_edge(resting(100.0), resting(51.9), by_law=48.2 / 25)
    assert not is_seen_on_edge(resting(50.0), resting(25.1), by_law=0.5)
    assert not is_seen_on_edge(resting(50.0), resting(25.0))  # just a certain error: no more than that
    assert is_seen_on_edge(resting(104.0), resting(54.0))  # 100 beyond noise, and just half of them


def test_the_edge_shows_an_effect_by_a_certain_error_and_a_twentieth_of_what_a_law_may_leave():
    """Without either effect 25 times 25: a twentieth of that less the other's is 1.25 certain errors, or 31.25."""
    other = resting(10.0)
    assert is_favoured_by_edge(resting(35.1), other, other)
    assert not is_favoured_by_edge(resting(34.9), other, other)
    assert not is_favoured_by_edge(resting(50.0), resting(25.0), resting(25.0))  # just a certain error
    assert is_favoured_by_edge(resting(41.3), other, resting(635.0))
    assert not is_favoured_by_edge(resting(41.2), other, resting(635.0))


def test_an_edge_is_explained_where_no_certain_error_is_left_or_what_laws_may_leave():
    assert is_edge_explained(resting(28.9))
    assert is_edge_explained(resting(29.0))  # just a certain error beyond noise
    assert not is_edge_explained(resting(29.1))
    assert not is_edge_explained(resting(29.1), by_law=0.5)
    assert is_edge_explained(resting(53.9), by_law=2.0)
    assert not is_edge_explained(resting(54.1), by_law=2.0)


def test_errors_of_edges_are_gathered_over_takes():
    """Two frames 1 mm beside a mean of 4 mm, and one of another take 3 mm beside 1: sqrt((8 25 + 4 16) / 3) mm."""
    take = np.repeat([0, 1, 0, 1], [8, 4, 4, 4])
    frame = np.concatenate([np.repeat([0, 1, 0], 4), np.full(8, -1)])
    whitened = np.repeat([1.0, 3.0, 2.0, 1.0], [8, 4, 4, 4])
    sd = np.repeat([1e-3, 1e-3, 2e-3, 1e-3], [8, 4, 4, 4])
    found = edge_errors(take, frame, whitened, sd)
    assert (found.moving, found.count, found.resting) == (pytest.approx(8 + 36), 12, pytest.approx((16 + 4) / 2))
    assert found.mm == pytest.approx(np.sqrt((8 * 25 + 4 * 16) / 3))
    assert edge_errors(take[:0], frame[:0], whitened[:0], sd[:0]) == EdgeErrors()


def test_an_edge_of_a_single_frame_has_an_error_too():
    """1 mm beside a mean of 4 mm in each of four numbers: sqrt(4 25) mm."""
    take, frame = np.zeros(8, int), np.repeat([0, -1], 4)
    found = edge_errors(take, frame, np.repeat([1.0, 2.0], 4), np.repeat([1e-3, 2e-3], 4))
    assert (found.count, found.mm) == (4, pytest.approx(10.0))


def test_points_above_each_other_on_an_edge_tell_no_stretch():
    recording, points = a_recording()
    line = [msgspec.structs.replace(p, at_m=(0.0, p.at_m[1])) for p in recording.garment.points]
    thin = dataclasses.replace(recording, garment=msgspec.structs.replace(recording.garment, points=tuple(line)))
    edge = EdgeResiduals(thin)
    assert [len(a) for a in (edge.frame, edge.sd, edge.static_sd)] == [0, 0, 0]
    assert [part.shape for part in edge.of(points[None])] == [(1, 0), (1, 0)]


def test_an_edge_may_lie_anywhere_on_its_garment():
    recording, points = a_recording()
    aside = [msgspec.structs.replace(p, at_m=(p.at_m[0] + 0.3, p.at_m[1])) for p in recording.garment.points]
    moved = dataclasses.replace(recording, garment=msgspec.structs.replace(recording.garment, points=tuple(aside)))
    for one, other in zip(numbers_of(recording, points), numbers_of(moved, points), strict=True):
        assert other == pytest.approx(one)


def test_a_take_without_an_edge_has_no_numbers_of_it():
    recording, points = a_recording()
    edge = EdgeResiduals(dataclasses.replace(recording, judged=np.ones(25, bool)))
    assert [part.shape for part in edge.of(points[None])] == [(1, 0), (1, 0)]
    assert len(edge.frame) == len(edge.sd) == len(edge.static_sd) == 0


def test_an_edges_numbers_are_as_uncertain_as_their_points_and_the_paths_spline_leave_them():
    """Of 0.05 m a point the middle of five has 0.05 / sqrt(5); the path (5 pi / 9) f_c / n of its variance, halved.

    Of n frames the mean is known to 1 / sqrt(n) of that beside the markers' own offsets.
    """
    recording, _ = a_recording(noise=1e-6, held_noise=2e-3)
    path = np.mean(held_noise(recording) ** 2) * 5 * np.pi / 9 * recording.held_cut_off / RATE / 2
    assert path > 1e-7
    for sd in (1e-6, 0.05):
        edge = EdgeResiduals(dataclasses.replace(recording, point_sd=np.full(25, sd)))
        each = sd**2 / 5 + path
        assert edge.sd[:, :3] == pytest.approx(np.sqrt(each), rel=1e-3)
        assert edge.static_sd[:3] == pytest.approx(np.sqrt(MARKER_OFFSET**2 / 5 + each / len(TIME)), rel=1e-3)


def test_a_row_that_is_off_makes_the_edges_numbers_less_certain_by_as_much():
    """3 mm that all points of a silhouette's row share, beside noise of 1 mm: a hypotenuse, in each of four numbers."""
    recording, _ = a_recording()
    off = dataclasses.replace(recording, camera=dataclasses.replace(recording.camera, row_off=0.003))
    before, after = EdgeResiduals(recording).sd, EdgeResiduals(off).sd
    assert after == pytest.approx(np.hypot(before, 0.003))


@pytest.mark.parametrize("is_turned", [False, True])
def test_an_edge_is_as_uncertain_as_its_own_points_wherever_the_garment_lists_them(is_turned):
    """Five points of 4 mm, before or after twenty of 1 mm: the middle is known to 4 mm / sqrt(5)."""
    garment, path = sheet(grid=5), swing(TIME)
    take = take_of(garment, TIME, path, hung(garment, TIME) + path[:, None])
    take.points_sd[:, :5] = 4e-3
    if is_turned:
        garment = msgspec.structs.replace(garment, points=garment.points[::-1])
        take = dataclasses.replace(
            take, garment=garment, points=take.points[:, ::-1], points_sd=take.points_sd[:, ::-1]
        )
    sd = EdgeResiduals(prepare(take)).sd
    assert sd[:, :3] == pytest.approx(4e-3 / np.sqrt(5), rel=0.01)
    assert sd[:, 3] == pytest.approx(4e-3 / np.sqrt(5), rel=0.01)  # the slope times the points' rms distance

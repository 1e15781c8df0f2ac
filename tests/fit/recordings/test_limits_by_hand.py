"""Limits and intervals of recordings by hand: delays, edges, gaps in what is seen, and defaults."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace

from fit.errors import FitError, ImpossiblePathError, MismatchError
from fit.recordings.camera import (
    NARROWEST_ROW,
    Camera,
    CameraSteps,
    Seen,
    edge_shown,
    examined,
    is_still,
    retimed,
    steadied,
    straightened,
)
from fit.recordings.hanger_path import check_path, hanger_axes
from fit.recordings.held_edge import HeldEdge
from fit.recordings.intact import FRAME_FIELDS, naming_damage
from fit.recordings.ready import ready
from fit.recordings.recording import MARKER_OFFSET, Recording, prepare
from fit.recordings.timing import _Scan, find_timing, in_order, uneven_intervals, why_foreign
from tests.fit.recordings.silhouettes import path as hanger_of
from tests.fit.recordings.silhouettes import silhouette_sheet, swung, uneven
from tests.fit.recordings.test_estimates_by_hand import a_scan, ends_of
from tests.fit.recordings.test_held_edge import edge
from tests.fit.recordings.test_timing_by_hand import A_TIMING, scan_of
from tests.fit.scenes import hung, sheet, swing, take_of
from tests.formats.damage import a_report

HALF = np.array([0.15, 0.0, 0.0])


# --- delays ---------------------------------------------------------------------------------------


def test_the_intervals_of_a_delay_lie_evenly_about_it_and_its_shifts_are_latency_and_share():
    time = uneven()
    step = uneven_intervals(time)
    held = hanger_of(time)
    fine = np.linspace(time[0], time[-1], 4000)
    true = time - 0.1 - 0.8 * step
    row = np.stack([np.interp(true, fine, axis) for axis in hanger_of(fine).T], 1)
    row += 1e-3 * np.random.default_rng(0).normal(size=row.shape)

    def path(instants):
        middle = np.stack([np.interp(instants, time, axis) for axis in held.T], 1)
        return np.concatenate([middle - HALF, middle + HALF], 1)

    found = find_timing(time, row, path)
    for value, (low, high) in ((found.latency, found.latency_interval), (found.share, found.share_interval)):
        assert low < value < high
        assert low + high == pytest.approx(2 * value)
    assert found.shifts == pytest.approx(found.latency + found.share * step)


@pytest.mark.parametrize("late", [-0.2, 0.2])
def test_the_scan_reaches_as_far_ahead_as_behind(late):
    """0.2 s of reach are ten steps of the grid to either side."""
    scan = a_scan()
    moved = dataclasses.replace(scan, row=scan.path(scan.time - late)[:, :3] + [0.2, 0.0, 0.0])
    assert moved.best(0.2, np.zeros(1)) == (pytest.approx(late), 0.0)
    assert abs(moved.best(0.18, np.zeros(1))[0]) == pytest.approx(0.18)


def test_shares_are_scanned_near_the_best_latency_alone():
    """Over the two steps of the grid to either side, however many frames fit in one batch."""
    time = np.arange(0, 6, 0.1) ** 1.05
    step = uneven_intervals(time) + 0.05 * np.sin(np.arange(len(time)))
    path = a_scan().path
    row = path(time - 0.1 - 0.4 * step)[:, :3] + [0.2, 0.0, 0.0]
    scan = _Scan(time, row, step, path, np.ones(len(time), bool))
    latency, share = scan.best(0.3, np.array([-0.4, 0.0, 0.4, 0.8]))
    assert (latency, share) == (pytest.approx(0.1), 0.4)
    latencies, shares = np.array([0.1, 0.1, 0.0]), np.array([0.4, 0.0, 0.4])
    found = scan.whitened(latencies, shares)
    for one, late, of in zip(found, latencies, shares, strict=True):
        left = scan.residual(late, of)
        assert one == pytest.approx(np.sqrt((left**2).sum(1).mean()), abs=1e-12)
    refined, of, sd = scan.mended(0.11, 0.35, is_uneven=True)
    assert (refined, of) == (pytest.approx(0.1, abs=1e-6), pytest.approx(0.4, abs=1e-5))
    assert (sd < 1e-4).all()


def test_half_swings_that_count_nowhere_are_left_out_of_the_jackknife():
    """Frames between 2 and 3 s are outliers: ten of twelve half seconds are left out in turn."""
    scan = a_scan(noise=0.002)
    hidden = (scan.time > 1.99) & (scan.time < 2.99)
    scan = dataclasses.replace(scan, used=~hidden)
    latency, _, sd = scan.mended(0.0, 0.0, is_uneven=False)
    across = (scan.row[:, 1] - scan.path(scan.time - latency)[:, 1])[~hidden]
    speed = 2 * np.pi * 0.8 * 0.1 * np.cos(2 * np.pi * 0.8 * (scan.time[~hidden] - latency))
    block = np.floor(scan.time[~hidden] / 0.5 + 1e-9)
    design = np.stack([speed, np.ones(len(speed))], 1)
    without = [np.linalg.lstsq(design[block != b], across[block != b], rcond=None)[0][0] for b in np.unique(block)]
    assert len(without) == scan.blocks == 10
    assert sd[0] == pytest.approx(
        np.sqrt(9 / 10 * ((without - np.mean(without)) ** 2).sum()), rel=0.004
    )  # 11 / 12: 0.009


def test_a_scale_is_that_of_the_travel_whatever_the_latency_lacks():
    """3 % farther than the hanger and 10 ms late: over 4.8 swings the two are not at right angles."""
    scan = a_scan()
    row = ends_of(1.03 * 0.1 * np.sin(2 * np.pi * 0.8 * (scan.time - 0.01)))[:, :3] + [0.2, 0.0, 0.0]
    found = dataclasses.replace(scan, row=row).with_scale(A_TIMING)
    low, high = found.scale_interval
    assert found.scale == pytest.approx(0.03, abs=2e-3)
    assert low + high == pytest.approx(2 * found.scale)
    assert high - low < 1e-3


def test_points_of_another_clock_are_refused_with_figures_that_differ():
    """Of 70 %, 69.96 % are told with their tenths, and a best shift beyond the scan has its sign."""
    below = dataclasses.replace(A_TIMING, explained=0.6996)
    assert why_foreign(below).endswith("explain 70 % of the held row's motion (best: 69.9 %)")
    assert "(best: 31 %)" in why_foreign(dataclasses.replace(A_TIMING, explained=0.312))
    assert "(best: 0 %)" in why_foreign(dataclasses.replace(A_TIMING, explained=-2.0))
    ahead = why_foreign(dataclasses.replace(A_TIMING, explained=0.93, latency=-0.49))
    assert "most of the held row's motion, 93 %, at a shift of -0.49 s, and none beyond" in ahead


@pytest.mark.parametrize(("spread", "has_share"), [(0.09, False), (0.11, True)])
def test_intervals_uneven_by_a_tenth_have_a_share(spread, has_share):
    """Every second interval is the median, and the others are longer and shorter by d: a deviation of d / sqrt(2)."""
    steps = 0.1 * (1 + spread * np.sqrt(2) * np.tile([0.0, 1.0, 0.0, -1.0], 20))
    time = np.concatenate([[0.0], np.cumsum(steps)])
    path = a_scan().path
    row = path(time - 0.1)[:, :3] + [0.2, 0.0, 0.0]
    assert (find_timing(time, row, path, is_per_frame=False).share_interval is not None) == has_share


def test_outliers_are_measured_by_the_median_distance_and_not_by_their_own():
    """Distances of 0.1 six times, of 0.35 and of 1.2 twice: the mean of 0.37 would keep 0.35."""
    time = np.arange(10) * 0.1
    scan = scan_of(time, np.array([*3 * (0.1, -0.1), 0.35, -0.35, 1.2, -1.2]))
    assert scan.without_outliers(0.0, 0.0).used.tolist() == [*6 * [True], *4 * [False]]


def test_the_hangers_axes_are_square_right_handed_and_stand_along_and_below_the_bar():
    ends = np.random.default_rng(0).normal(size=(20, 6))
    axes, bar = hanger_axes(ends), ends[:, 3:] - ends[:, :3]
    np.testing.assert_allclose(np.swapaxes(axes, 1, 2) @ axes, np.tile(np.eye(3), (20, 1, 1)), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(np.ones(20))
    assert (axes[:, :, 0] * bar).sum(1) == pytest.approx(np.linalg.norm(bar, axis=1))
    assert (axes[:, 2, 1] < 0).all()


def test_a_jump_is_told_with_the_fastest_speed_and_the_instant_before_it():
    times = np.arange(60) / 30
    path = np.zeros((60, 6))
    path[30:, 1] = 1.0
    with pytest.raises(ImpossiblePathError, match=r"the hanger jumps at 0\.97 s \(30 m/s\)"):
        check_path("a", times, path)


def test_frames_in_order_are_four_milliseconds_apart_and_those_between_go():
    assert in_order(np.array([0.0, 0.0039, 0.004, 0.0081, 0.006, 0.0121])).tolist() == [
        True, False, True, True, False, True,
    ]  # fmt: skip


# --- the camera -----------------------------------------------------------------------------------


def flat(frames=30, down=0.0, width=0.3, **options):
    """A silhouette's sheet at rest below ends this far apart [m], its points so far below their places [m]."""
    garment = silhouette_sheet(**options)
    places = np.array([p.at_m for p in garment.points])
    points = np.stack([places[:, 0] - places[:, 0].mean(), 0 * places[:, 0], places[:, 1] - places[:, 1].max()], 1)
    points = np.tile(points - [0.0, 0.0, down], (frames, 1, 1))
    ends = np.concatenate([[-width / 2, 0.0, 0.0], [width / 2, 0.0, 0.0]])
    return Seen(np.arange(frames) / 30, points), lambda instants: np.tile(ends, (len(instants), 1)), garment


@pytest.mark.parametrize(
    ("share", "is_used"),
    [(0.99 * NARROWEST_ROW, False), (1.01 * NARROWEST_ROW, True), (1.0, True), (0.99 / NARROWEST_ROW, True),
     (1.01 / NARROWEST_ROW, False)],
)  # fmt: skip
def test_an_edge_is_moved_only_where_the_hangers_ends_are_about_as_far_apart_as_its_own(share, is_used):
    seen, path, garment = flat(down=0.004, width=0.3 * share)
    found = edge_shown(seen, path, garment)
    assert (found is not None) == is_used
    if is_used:
        assert (found.down, found.out, found.width) == (pytest.approx(0.004), 0.0, pytest.approx(0.3))
        ends = found.of(path(np.zeros(1)))[0]
        assert ends == pytest.approx([-0.15, 0.0, -0.004, 0.15, 0.0, -0.004])
        assert np.isnan(found.of(np.full((1, 6), np.nan))).all()


@pytest.mark.parametrize(("lowered", "is_on_edge"), [(0.01, True), (0.03, False)])
def test_a_row_within_a_fiftieth_of_the_grids_height_lies_on_the_edge(lowered, is_on_edge):
    """Its error across the cloth is measured, of 2 mm here, and its rest moves the edge; a lower row's are not."""
    seen, path, garment = flat()
    places = [replace(p, at_m=(p.at_m[0], p.at_m[1] * (1 - lowered) - 0.3 * lowered)) for p in garment.points]
    garment = replace(garment, points=places)
    points = seen.points + (0.002 * (-1.0) ** np.arange(30))[:, None, None] * [0.0, 1.0, 0.0]
    seen = dataclasses.replace(seen, points=points)
    assert examined(seen, path, garment).row_off == pytest.approx(0.002 if is_on_edge else 0.0)
    assert (edge_shown(seen, path, garment) is not None) == is_on_edge
    if not is_on_edge:
        assert steadied(seen, path, garment) is seen


@pytest.mark.parametrize(("late", "is_late"), [(0.07, False), (0.09, True)])
def test_material_points_are_moved_in_time_beyond_eighty_milliseconds(late, is_late):
    time = np.arange(0, 8, 1 / 30)
    take = swung(silhouette_sheet("material"), time, time - late, noise=0.001)
    on_edge = np.arange(64) < 8

    def path(instants):
        middle = np.stack([np.interp(instants, time, axis) for axis in hanger_of(time).T], 1)
        return np.concatenate([middle - HALF, middle + HALF], 1)

    found = retimed(time, take.points, path, take.garment, on_edge)
    assert found.camera.is_retimed == is_late
    assert found.camera.timing.latency == pytest.approx(late, abs=0.005)
    if is_late:
        first = int(np.ceil(30 * found.camera.timing.latency))
        assert found.time == pytest.approx(time[first:] - found.camera.timing.latency)
        np.testing.assert_array_equal(found.points, take.points[first:])
    assert retimed(time, take.points, path, take.garment, np.arange(64) < 1).camera.timing is None


def test_frames_beyond_four_degrees_lose_their_points_and_are_counted_among_those_with_a_grid():
    time = np.arange(6) / 30
    garment = silhouette_sheet()
    take = swung(garment, time, 0 * time, angle=np.array([0.0, 3.9, 4.1, -3.9, -4.1, 0.0]))
    points = np.where((np.arange(6) == 5)[:, None, None], np.nan, take.points)
    found = straightened(Seen(time, points), garment)
    assert np.isfinite(found.points[:, 0, 0]).tolist() == [True, True, False, True, False, False]
    assert (found.camera.skewed, found.camera.frames) == (2, 5)


@pytest.mark.parametrize("step", [field.name for field in dataclasses.fields(CameraSteps)])
def test_every_correction_is_made_unless_it_is_left_out(step):
    assert getattr(CameraSteps(), step) is True
    time = np.arange(0, 12, 1 / 9)
    take = swung(silhouette_sheet(), time, time - 0.15, angle=np.where(np.arange(len(time)) % 9, 0.0, 6.0), noise=2e-3)
    moves = (np.abs(time - time[-1] / 2) < time[-1] / 2 - 1.5)[:, None, None]
    off = 0.02 * moves * np.random.default_rng(0).normal(size=(len(time), 1, 1)) * [0.0, 1.0, 0.0]
    take = dataclasses.replace(take, points=take.points + off)
    whole, without = prepare(take).camera, prepare(take, CameraSteps(**{step: False})).camera
    shown = {
        "stamps": lambda camera: camera.timing, "skew": lambda camera: camera.skewed or None,
        "edge": lambda camera: camera.edge, "frames": lambda camera: camera.offsets,
        "places": lambda camera: camera.is_placed or None,
    }[step]  # fmt: skip
    assert shown(without) is None
    assert shown(whole) is not None


def test_a_hanger_is_at_rest_by_the_speed_of_both_ends_together():
    """One end alone at s is s / sqrt(2) of both."""
    time = np.arange(5) / 30
    for speed, rests in ((0.041, True), (0.044, False)):
        assert is_still(time, lambda t, s=speed: np.outer(t, [0, 0, 0, 0, s, 0])).tolist() == [rests] * 5


# --- the held edge --------------------------------------------------------------------------------


def test_a_rotation_stays_what_it_was_where_the_edge_is_first_and_last_seen():
    seen = edge(noise=1e-3)
    seen.points[:, :, 2] += 0.02 * np.sin(2 * np.pi * 0.5 * seen.time)[:, None] * seen.across
    seen.points[:30] = seen.points[-40:] = np.nan
    course, _ = seen.turn()
    inside = course(seen.time[[30, -41]])
    assert course(seen.time[[0, -1]]) == pytest.approx(inside)
    assert course(seen.time[[10, -20]]) == pytest.approx(inside)
    assert np.abs(course(seen.time[[31, -42]]) - inside)[:, 1].min() > 1e-5


def test_an_edge_of_one_seen_point_in_a_frame_measures_no_step():
    """Nineteen sightings of one side are too few; the hardest jerk is at 1 s."""
    few = edge(slip=0.05, at=3.0, noise=0.0)
    few.points[:, :3] = np.nan
    few.points[:81], few.points[100:] = np.nan, np.nan
    assert HeldEdge(few.time, few.points, few.across, few.held).slip_at() == pytest.approx(1.05, abs=0.1)


# --- what goes wrong, and defaults ----------------------------------------------------------------


def still_take(**changes):
    time = np.arange(0, 2, 1 / 30)
    garment = sheet(grid=5)
    return dataclasses.replace(
        take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None]), **changes
    )


def test_a_refused_take_that_is_damaged_says_so_when_takes_are_made_ready():
    """Five frames are too few, and ten bytes of damage may be the cause."""
    take = still_take()
    cut = {name: values[:5] for name in FRAME_FIELDS if (values := getattr(take, name)) is not None}
    report = a_report(damaged_blocks=1)
    with pytest.raises(FitError, match=r"has 1 damaged block, which may be the cause; copy the file again"):
        ready([dataclasses.replace(take, **cut, report=report)], [])
    with pytest.raises(FitError, match=r"record a longer take$"):
        ready([dataclasses.replace(take, **cut)], [])
    with pytest.raises(FitError, match="damaged block"):
        ready([take], [dataclasses.replace(take, **cut, take_id="other", report=report)])


def test_a_take_whose_points_belong_to_another_garment_is_refused_when_it_is_made_ready():
    take = still_take()
    wide = dataclasses.replace(take, points=take.points * [1.6, 1.0, 1.0])
    with pytest.raises(MismatchError):
        ready([wide], [])


@pytest.mark.parametrize("where", ["--spacing", "sheet"])
def test_an_error_about_an_option_or_the_garment_is_not_blamed_on_damage(where):
    take = still_take(report=a_report(damaged_blocks=1))
    with pytest.raises(FitError) as told, naming_damage([take]):
        raise FitError("is too small", where=where, advice="choose another")
    assert str(told.value) == f"{where}: is too small; choose another"


def test_a_recording_of_arrays_alone_has_no_faults_of_a_camera_and_no_gaps():
    whole = prepare(still_take())
    needed = [one.name for one in dataclasses.fields(Recording)
              if one.default is dataclasses.MISSING and one.default_factory is dataclasses.MISSING]  # fmt: skip
    bare = Recording(**{name: getattr(whole, name) for name in needed})
    assert bare.camera == Camera()
    assert (bare.camera.timing, bare.camera.is_placed, bare.camera.is_retimed, bare.camera.row_off) == (
        None, False, False, 0.0
    )  # fmt: skip
    assert (bare.windows, bare.raw_points, bare.held_time, bare.bodies, bare.gaps) == (None, None, None, (), ())
    assert (bare.held_error, bare.offset_sd, bare.impossible, bare.begin) == (0.0, MARKER_OFFSET, 0.0, 0.0)
    assert (bare.is_calibrated, bare.is_imported, bare.viewpoint) == (True, False, (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(bare.seen_points, bare.points)


def test_ends_that_are_far_apart_in_three_frames_leave_the_edge_moved():
    """Three of 30 frames with an end 10 m away; the median distance is that of the cloth."""
    seen, path, garment = flat(down=0.004)

    def held(instants):
        ends = path(instants)
        ends[np.isin(np.round(30 * instants), (3, 9, 17)), 3] += 10.0
        return ends

    found = edge_shown(seen, held, garment)
    assert found is not None
    assert found.down == pytest.approx(0.004)

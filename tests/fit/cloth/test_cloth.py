"""The cloth solver against closed-form solutions of its equations."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest
from scipy.optimize import curve_fit

from benchmarks.clamps import Clamp, clamps
from fit.cloth import material as mat
from fit.cloth.effect import amplitudes_of, columns_of
from fit.cloth.mesh import build_mesh
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.effects import LIBRARY
from fit.effects.air_drag import AirDrag
from fit.effects.hem import Hem
from fit.errors import DriveError, FitError
from fit.recordings.recording import prepare, world_from_sensor
from formats.nature import AIR_DENSITY
from formats.swatch import swatch
from tests.fit.scenes import hung, material, sheet, simulate_take, swing, take_of

GRAVITY = 9.80665


def test_bending_energy_of_a_rolled_sheet_is_half_b_over_radius_squared_per_area():
    """A 0.4 m sheet rolled to a radius of 0.5 m: 1/2 B / R^2 = 2 B per area, away from the free edges."""
    mesh = build_mesh(sheet(width=0.4, height=0.4), 0.02)
    radius = 0.5
    rolled = np.stack(
        [radius * np.sin(mesh.rest[:, 0] / radius), mesh.rest[:, 1], radius * np.cos(mesh.rest[:, 0] / radius)], 1
    )
    bent = mesh.bends.stencils.apply(rolled)
    energy = 0.5 * (bent**2).sum()
    # Free edges bend freely: the outermost nodes, 1/12 of an element on either side of seven, carry no energy.
    assert energy == pytest.approx((1 - 2 / 12 / 7) * 0.5 / radius**2 * 0.16, rel=0.002)


def test_a_flat_sheet_does_not_resist_bending_forces_or_translation():
    mesh = build_mesh(sheet(), 0.05)
    flat = np.stack([mesh.rest[:, 0] + 3.0, mesh.rest[:, 1], 2.0 * mesh.rest[:, 0]], 1)
    assert np.abs(mesh.bends.stencils.apply(flat)).max() < 1e-9
    across = mesh.fibres.stencils.apply(flat)[mesh.shear_across]
    assert np.abs(np.einsum("sk,skc->sc", mesh.bends.twist_weights, across)).max() < 1e-9


FLARED = ((-0.2, 0.0), (0.2, 0.0), (0.3, -0.45), (-0.25, -0.4))


@pytest.mark.parametrize("outline", [None, FLARED], ids=["rectangle", "flared"])
def test_samples_of_a_linear_field_are_its_slopes_and_stand_for_the_whole_area(outline):
    """x = (2 X + 3 Y, X, Y): d/dX = (2, 1, 0) across and d/dY = (3, 0, 1) down, also where the grid is askew."""
    garment = msgspec.structs.replace(sheet(), outline_m=outline) if outline else sheet()
    mesh = build_mesh(garment, 0.06)
    field = np.column_stack([mesh.rest @ [2.0, 3.0], mesh.rest])
    slopes = mesh.fibres.stencils.apply(field)
    across, down = slopes[: mesh.fibres_across], slopes[mesh.fibres_across :]
    assert across == pytest.approx(np.tile([2.0, 1.0, 0.0], (len(across), 1)), abs=1e-9)
    assert down == pytest.approx(np.tile([3.0, 0.0, 1.0], (len(down), 1)), abs=1e-9)
    tied = np.einsum("sk,skc->sc", mesh.shear_weights[:, :4], slopes[mesh.shear_across])
    assert tied == pytest.approx(np.tile([2.0, 1.0, 0.0], (len(tied), 1)), abs=1e-9)
    x, y = np.array(garment.outline_m).T
    area = 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))
    parts = mesh.fibres.area[: mesh.fibres_across], mesh.fibres.area[mesh.fibres_across :], mesh.shear_area
    for whole in (mesh.area, *(part.sum() for part in parts)):
        assert whole == pytest.approx(area)


def test_areas_and_hem_add_up_to_the_garment():
    mesh = build_mesh(sheet(width=0.4, height=0.45), 0.05)
    assert mesh.node_area.sum() == pytest.approx(0.18)
    assert mesh.hem_length.sum() == pytest.approx(0.4)


def ring_down(spacing):
    """Frequency [Hz] of the first swing of a drag-free hanging sheet, from a fit to its bottom edge."""
    garment = sheet(height=0.45)
    time = np.arange(0, 8, 1 / 30)
    nudge = swing(time, amplitude=0.008, hz=0.9, stop=2.0)
    take = simulate_take(
        garment, time, nudge, material(garment, velocity_damping=0.0), resolution=Resolution(spacing=spacing)
    )
    late = time > 2.6

    def wave(t, a, b, omega, decay):
        return np.exp(-decay * t) * (a * np.cos(omega * t) + b * np.sin(omega * t))

    found, _ = curve_fit(wave, time[late], take.points[late, 2, 1], p0=[0.03, 0.0, 2 * np.pi * 0.9, 0.0])
    return found[2] / (2 * np.pi)


def test_a_hanging_sheet_swings_at_the_frequency_of_a_hanging_chain():
    """First zero of J0 over 2: omega = 1.2024 sqrt(g / L); bending adds a thousandth."""
    theory = 1.2024 * np.sqrt(GRAVITY / 0.45) / (2 * np.pi)
    assert ring_down(0.05) == pytest.approx(theory, rel=0.002)


@pytest.mark.slow
def test_a_finer_mesh_comes_closer_to_a_finer_one_still():
    fine = ring_down(0.03)
    assert abs(ring_down(0.05) - fine) < abs(ring_down(0.15) - fine) / 2


def hanging(garment, **changes):
    time = np.arange(0, 2, 1 / 30)
    return simulate_take(garment, time, np.zeros((len(time), 3)), material(garment, **changes)), time


def test_a_hanging_sheet_stretches_by_half_its_weight_over_its_stiffness():
    """Strain at height z is rho g (L - z) / k; the bottom sinks by rho g L^2 / (2 k) = 4.97 mm for k = 40 N/m."""
    garment = sheet(width=0.4, height=0.45, mass=0.036)
    take, _ = hanging(garment, stretch_stiffness=40.0, velocity_damping=5.0)
    sunk = -take.points[-1, 2, 2] - 0.45
    linear = 0.2 * GRAVITY * 0.45**2 / (2 * 40.0)
    # St. Venant-Kirchhoff stiffens: S (1 + e) = load, so 3 e^2 / 2 less at a largest strain of 2 %.
    assert sunk == pytest.approx(linear, rel=0.04)


@pytest.mark.slow
def test_a_falling_sheet_with_drag_ends_at_its_terminal_speed():
    """rho g = 1/2 rho_air c v^2: a flat sheet of 0.2 kg/m^2 with c = 1.2 falls at 1.648 m/s."""
    terminal = np.sqrt(2 * 0.2 * GRAVITY / (AIR_DENSITY * 1.2))
    assert terminal == pytest.approx(1.648, abs=1e-3)
    garment = sheet()
    time = np.arange(0, 3, 1 / 30)
    # Held at the top and pulled steadily through the air at the terminal speed, drag equals weight: 45 degrees.
    ramp = np.clip(time - 0.2, 0, None)
    displacement = np.stack([0 * time, terminal * (ramp - 0.4 * np.tanh(ramp / 0.4)), 0 * time], 1)
    take = simulate_take(
        garment, time, displacement, material(garment, velocity_damping=1e-9), effects=LIBRARY,
        amplitudes=amplitudes_of(LIBRARY, air_drag=1.2)[None],
    )  # fmt: skip
    # Normal drag on a sheet that leans by a: rho g sin a = 1/2 rho_air c (v cos a)^2, so sin a = cos^2 a, a = 38.2 deg.
    across = take.points[-1, 2] - take.points[-1, 1]
    lean = np.degrees(np.arctan2(-across[1], -across[2]))
    assert lean == pytest.approx(38.17, abs=2.0)


def dropped(time, **changes):
    """A level sheet that nothing holds: frames, nodes, positions."""
    garment = sheet()
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3))))
    level = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    simulator = Simulator(recording, (AirDrag(),), support=clamps(start=level))
    row = material(garment, velocity_damping=0.0, **changes)
    return simulator.run(row, np.array([[1.2]]), shapes=True).shapes[0]


@pytest.mark.slow
def test_a_level_sheet_that_nothing_holds_falls_by_the_law_of_quadratic_drag():
    """z = -(v^2 / g) ln cosh(g t / v) with the terminal speed v of 1.648 m/s; it stays flat and level."""
    time = np.arange(0, 1, 1 / 30)
    places = dropped(time)
    speed = np.sqrt(2 * 0.2 * GRAVITY / (AIR_DENSITY * 1.2))
    expected = -(speed**2) / GRAVITY * np.log(np.cosh(GRAVITY * time / speed))
    # The first half step of leapfrog from rest: g dt / 2 too slow, up to 1e-3 s.
    assert places[:, :, 2].mean(1) == pytest.approx(expected, abs=2e-3)
    assert np.ptp(places[:, :, 2], axis=1).max() < 1e-5


def test_effects_on_a_hanger_are_refused_where_there_is_none():
    garment = sheet()
    time = np.arange(0, 1, 1 / 30)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3))))
    with pytest.raises(FitError, match="moves a hanger's ends"):
        Simulator(recording, LIBRARY, support=clamps(start=np.eye(3).ravel()))


def test_a_clamp_beside_the_cloth_is_refused():
    garment = sheet()
    recording = prepare(take_of(garment, np.arange(30) / 30, np.zeros((30, 3))))
    beside = Clamp(lambda places: places[:, 1] > 1.0, lambda instants: np.zeros((len(instants), 9)))
    with pytest.raises(FitError, match="clamp 1 of 1: it holds no node"):
        Simulator(recording, support=clamps(beside, start=np.eye(3).ravel()))


@pytest.mark.parametrize("stretch_stiffness", [1e4, 300.0])
def test_a_sideways_weight_shears_and_bends_the_sheet_as_a_beam(stretch_stiffness):
    """q = 0.2 g sin 0.1: q L^2 / 2 G, 0.661 mm for G = 30 N/m, and q L^4 / 8 E w^2 x 12, 0.251 mm for E = 300 N/m.

    Half-way there are 3/4 and 17/48 of them. Beam theory leaves out how cross-sections warp: 5 %.
    """
    garment, time = sheet(), np.arange(20) / 60
    recording = prepare(take_of(garment, time, np.zeros((20, 3)), hung(garment, time)))
    row = material(garment, tilt_x=0.1, shear_stiffness=30.0, stretch_stiffness=stretch_stiffness)
    moved = Simulator(recording, resolution=Resolution(spacing=0.1)).run(row).points[0, -1] - hung(garment, time)[-1]
    sheared = 0.2 * GRAVITY * np.sin(0.1) * 0.45**2 / 60
    bent = sheared * 60 * 0.45**2 * 12 / 0.4**2 / (8 * stretch_stiffness)
    expected = [sheared + bent] * 2 + [0.75 * sheared + 17 / 48 * bent]
    assert moved[2:, 0] == pytest.approx(np.array(expected), rel=0.06)


@pytest.mark.parametrize("velocity_damping", [0.02, 8.0])
def test_cloth_that_is_shown_swung_aside_hangs_straight_down_when_time_begins(velocity_damping):
    """Points 60 mm aside at the bottom of 0.45 m; nothing moves: its bottom hangs below its top.

    omega_1 = 1.2024 sqrt(9.80665 / 0.45) = 5.61 /s; after 1.28 s (1 + 7.19) e^-7.19 = 0.6 % of 60 mm is left, 0.37 mm;
    the sheet's own damping is less. Its weight stretches it by 36 g / 0.18 m2 x g x 0.45^2 / (2 x 300) = 0.662 mm.
    """
    garment, time = sheet(), np.arange(30) / 60
    points = hung(garment, time)
    points[..., 1] += 0.06 * (points[..., 2] / 0.45) ** 2
    recording = prepare(take_of(garment, time, np.zeros((30, 3)), points))
    first = Simulator(recording).run(material(garment, velocity_damping=velocity_damping)).points[0, 0]
    assert np.abs(first[2:4, 1]).max() < 0.5e-3
    assert first[2:4, 2] == pytest.approx(-0.45 - 0.2 * GRAVITY * 0.45**2 / 600, abs=2e-5)


@pytest.mark.parametrize("side", [-1.0, pytest.param(1.0, marks=pytest.mark.slow)])
def test_slack_cloth_held_at_two_corners_begins_in_the_folds_that_its_markers_show(side):
    """Corners 8 % closer than the cloth is wide: it hangs in a fold, and just as well in the mirrored one.

    A recording of either begins within 2 mm of its markers; the two rests are centimetres apart.
    """
    garment, time = swatch(0.05), np.arange(30) / 60
    take = take_of(garment, time, np.zeros((30, 3)), 0.92 * hung(garment, time))
    take = dataclasses.replace(take, held=take.held * [0.92, 1.0, 1.0])

    def first(points):
        recording = prepare(dataclasses.replace(take, points=np.repeat(points[None], 30, 0)))
        return Simulator(recording).run(material(garment)).points[0, 0]

    flat = hung(garment, time)[0] * [0.92, 1.0, 1.0]
    stirred = flat + np.outer(0.02 * np.sin(9 * flat[:, 0] + 1) * flat[:, 2], [0.0, 1.0, 0.0])
    # Under 4 jitters, settling once leaves 0.6 to 16 mm to go, twice 0.01 to 2.2 mm, three times 0.035 mm at most.
    fold = first(first(first(stirred))) * [1.0, side, 1.0]
    assert np.linalg.norm(fold - fold * [1.0, -1.0, 1.0], axis=1).mean() > 0.02
    assert np.linalg.norm(first(fold) - fold, axis=1).mean() < 0.002


@pytest.mark.parametrize(("side", "expected"), [("top", np.exp(-1.0)), ("left", np.exp(1.0))])
def test_cloth_that_juts_out_along_its_warp_sags_by_the_warps_bending_stiffness(side, expected):
    """0.1 m jut out level: rho g L^4 / (8 B) = 12 mm at 2 mN m. With a log ratio of 1 against -1, B is e times as large
    along the warp, which runs down from the top, and as much smaller across."""
    garment = sheet(width=0.2, height=0.2)
    level = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    held = {"top": lambda places: places[:, 1] > -0.1 - 1e-9, "left": lambda places: places[:, 0] < 1e-9}
    clamp = Clamp(held[side], lambda instants: np.repeat(level[None], len(instants), 0))
    recording = prepare(take_of(garment, np.arange(24) / 30, np.zeros((24, 3))))
    simulator = Simulator(recording, support=clamps(clamp, start=level), resolution=Resolution(spacing=0.034))
    rows = [
        material(garment, areal_density=0.2, bending_stiffness=2e-3, bending_ratio=ratio, velocity_damping=40.0)
        for ratio in (1.0, -1.0)
    ]
    shapes = simulator.run(np.concatenate(rows), shapes=True).shapes
    free = np.argmin(simulator.mesh.rest[:, 1]) if side == "top" else np.argmax(simulator.mesh.rest[:, 0])
    sag = -shapes[:, -1, free, 2]
    # 5 %: the last of the settling, and that a corner sags a little more than the middle.
    assert sag[0] / sag[1] == pytest.approx(expected, rel=0.05)
    assert sag.mean() == pytest.approx(0.012 * np.cosh(0.5), rel=0.1)


def test_a_seed_of_jitter_moves_a_simulation_by_more_than_nothing_and_less_than_a_tenth_of_a_millimetre(monkeypatch):
    garment, time = sheet(), np.arange(24) / 30
    simulator = Simulator(prepare(take_of(garment, time, swing(time, start=0.1), hung(garment, time))))
    found = []
    for seed in ("", "1", "2", "1"):
        monkeypatch.setenv("HANGTIME_JITTER", seed)
        found.append(simulator.run(material(garment)).points[0])
    plain, first, second, again = found
    assert np.array_equal(first, again)
    for one, other in ((plain, first), (plain, second), (first, second)):
        assert 0.0 < np.abs(one - other).max() < 1e-4


def test_a_batch_without_candidates_is_accepted():
    garment, time = sheet(), np.arange(0, 1, 1 / 30)
    simulator = Simulator(prepare(take_of(garment, time, swing(time), hung(garment, time))))
    assert simulator.run(np.zeros((0, len(mat.MATERIAL_NAMES)))).points.shape == (0, 30, 5, 3)


def test_more_mass_with_everything_in_proportion_changes_nothing():
    """Mass is degenerate: density, stiffnesses and damping forces times 1.5 give the same motion."""
    garment = sheet()
    time = np.arange(0, 3, 1 / 30)
    recording = prepare(take_of(garment, time, swing(time, amplitude=0.03), hung(garment, time)))
    row = material(garment)
    heavier = row.copy()
    heavier[0, [mat.DENSITY, mat.STRETCH, mat.SHEAR, mat.BENDING]] *= 1.5
    both = Simulator(recording).run(np.concatenate([row, heavier])).points
    # Single precision; the take is short and gentle so that rounding has no time to grow.
    assert np.abs(both[0] - both[1]).max() < 1e-4


def test_every_effect_is_exactly_off_at_zero_and_changes_something_at_its_typical_size():
    """A twisted swing with a grid of points, which every effect can be seen in."""
    garment = sheet(grid=5)
    time = np.arange(0, 1.5, 1 / 30)
    twisted = swing(time, sideways=0.05)
    points = hung(garment, time) + twisted[:, None]
    points[:, :5, 1] += 0.03 * np.sin(3 * time)[:, None] * np.linspace(-1, 1, 5)
    recording = prepare(take_of(garment, time, twisted, points))
    row = material(garment)
    columns = columns_of(LIBRARY)
    plain = Simulator(recording, LIBRARY).run(row, np.zeros((1, columns[-1].stop))).points[0]
    # This sheet never touches itself: `tests/fit/cloth/test_contact_in_motion.py` has one that does. Its frames come
    # evenly, and its grid keeps its lengths: `tests/fit/effects/test_measurement_effects.py` has others.
    camera = ("sliding_points", "frame_timing")
    seen = [
        (effect, where) for effect, where in zip(LIBRARY, columns, strict=True)
        if not effect.touches and effect.name not in camera
    ]  # fmt: skip
    amplitudes = np.zeros((len(seen), columns[-1].stop))
    for k, (effect, where) in enumerate(seen):
        amplitudes[k, where] = effect.typical
    moved = Simulator(recording, LIBRARY).run(np.repeat(row, len(seen), 0), amplitudes).points
    for (effect, _), points in zip(seen, moved, strict=True):
        assert np.isfinite(points).all(), effect.name
        assert np.abs(points - plain).max() > 1e-3, effect.name
    for effect in LIBRARY:
        assert effect.low <= 0.0 < effect.typical <= effect.high, effect.name
    without = Simulator(recording).run(row).points[0]
    # Two kernels, so rounding may differ; physics may not.
    assert np.abs(without - plain).max() < 1e-3


def test_hem_moves_mass_to_the_bottom_edge_and_keeps_the_weight():
    """0.01 kg/m on a 0.4 m hem is 4 g of the 36 g."""
    mesh = build_mesh(sheet(), 0.05)
    mass = Hem().node_mass(0.2 * mesh.node_area, mesh, np.array([0.01]))
    assert mass.sum() == pytest.approx(0.036)
    bottom = mesh.hem_length > 0
    assert mass[bottom].sum() == pytest.approx(0.004 + (0.032 / 0.036) * 0.2 * mesh.node_area[bottom].sum())


def test_time_offset_delays_the_cloth():
    """The points of a take whose points come 1/30 s late are those of the frame before."""
    garment = sheet()
    time = np.arange(0, 3, 1 / 30)
    recording = prepare(take_of(garment, time, swing(time), hung(garment, time)))
    row = material(garment, velocity_damping=2.0)
    amplitudes = np.stack([amplitudes_of(LIBRARY), amplitudes_of(LIBRARY, time_offset=1 / 30)])
    run = Simulator(recording, LIBRARY).run(np.repeat(row, 2, 0), amplitudes).points
    assert np.abs(run[1][30:] - run[0][29:-1]).max() < 2e-3


def test_gravity_along_the_sensors_y_becomes_down():
    rotation = world_from_sensor((0.0, 1.0, 0.0))
    assert rotation @ [0, 1, 0] == pytest.approx([0, 0, -1])
    assert rotation @ [0, 0, 1] == pytest.approx([0, 1, 0])
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_a_hanger_that_is_lost_for_a_second_leaves_a_gap_in_which_nothing_is_judged():
    """Lost from frame 40 to 74: the path is known up to frame 39, and again from frame 75 on."""
    garment, time = sheet(), np.arange(0, 4, 1 / 30)
    take = take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None])
    valid = take.held_valid.copy()
    valid[40:75] = False
    recording = prepare(dataclasses.replace(take, held_valid=valid))
    assert recording.gaps == (pytest.approx((39 / 30, 75 / 30)),)
    assert recording.valid[:39].all()
    assert not recording.valid[40:75].any()


def test_a_take_counts_from_the_first_to_the_last_sight_of_the_hanger():
    """Fetched for a second, and put away for another: neither is simulated, and neither is a gap."""
    garment, time = sheet(), np.arange(0, 4, 1 / 30)
    take = take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None])
    valid = take.held_valid.copy()
    valid[:30, 0], valid[95:] = False, False
    recording = prepare(dataclasses.replace(take, held_valid=valid))
    assert recording.time == pytest.approx(time[30:95] - time[30])
    assert len(recording.points) == len(recording.time)
    whole = prepare(take)
    assert recording.points == pytest.approx(whole.points[30:95], nan_ok=True)
    assert recording.held(recording.time[5:-5]) == pytest.approx(whole.held(time[35:90]), abs=5e-4)


def test_points_that_are_hardly_ever_seen_exert_no_pull():
    """Five frames determine no curve; the point is not taken to be at the origin of the world."""
    garment, time = sheet(), np.arange(0, 3, 1 / 30)
    away = swing(time) + np.array([0.0, 2.0, 0.0])
    take = take_of(garment, time, away, hung(garment, time) + away[:, None])
    valid = take.points_valid.copy()
    valid[5:, -1] = False
    recording = prepare(dataclasses.replace(take, points_valid=valid))
    _, trust = recording.targets(np.linspace(0, 3, 200))
    assert not trust[:, -1].any()
    assert trust[:, :-1].all()


def test_a_hanger_that_jumps_is_refused():
    garment = sheet()
    time = np.arange(0, 4, 1 / 30)
    displacement = swing(time)
    displacement[50] += 1.0
    with pytest.raises(DriveError, match="jumps"):
        prepare(take_of(garment, time, displacement))


def test_a_take_of_ten_frames_is_refused():
    garment = sheet()
    time = np.arange(10) / 30
    with pytest.raises(FitError, match="10 frames"):
        prepare(take_of(garment, time, np.zeros((10, 3))))

"""The generator against closed-form mechanics: pendulum, stretch, plate, energy, drag."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.blind.engine import SAMPLES_A_SECOND, Cloth, Engine
from fit.blind.sheet import make_sheet, membrane_rate
from fit.errors import FitError

GRAVITY = 9.80665


def bar(width, displacement):
    """Ends of a level held edge, (1, samples, 6), that follow a displacement (samples, 3)."""
    ends = np.concatenate([displacement, displacement], 1)[None].copy()
    ends[..., 0] -= width / 2
    ends[..., 3] += width / 2
    return ends


def nudged(duration, size=0.002, axis=1):
    """A small smooth step of the bar within 0.3 s, then rest."""
    time = np.linspace(0, duration, round(duration * SAMPLES_A_SECOND) + 1)
    s = np.clip(time / 0.3, 0, 1)
    moved = np.zeros((len(time), 3))
    moved[:, axis] = size * s**3 * (10 - 15 * s + 6 * s**2)
    return moved


def bent_energy(sheet, height):
    """Bending energy over B of a sheet with these heights of its nodes, small slopes."""
    s = (sheet.hinge_cotangents * height[sheet.hinges]).sum(1)
    return float((s**2 / sheet.hinge_area).sum() / 2)


@pytest.mark.slow
def test_a_hanging_sheet_swings_at_the_first_zero_of_the_bessel_function():
    """f = 1.2024 sqrt(g / L) / 2 pi: 1.0705 Hz for 0.3130 m; bending is negligible at 1e-7 N m."""
    length = 0.3130
    engine = Engine(Cloth(width=0.1, height=length, bending=1e-7, damping=0.0))
    motion = engine.run(bar(0.1, nudged(4.3)), 4.3, np.array([[0.0, -length]]), settle=1.0)
    swing = motion.points[0, round(0.3 * SAMPLES_A_SECOND) :, 0, 1] - 0.002
    swing = swing - swing.mean()
    # Higher modes ride on the first one: a least-squares sinusoid, not zero crossings.
    time = np.arange(len(swing)) / SAMPLES_A_SECOND
    trial = np.linspace(0.9, 1.25, 701)
    left = []
    for f in trial:
        columns = np.stack([np.cos(2 * np.pi * f * time), np.sin(2 * np.pi * f * time), np.ones_like(time)], 1)
        left.append(np.linalg.lstsq(columns, swing, rcond=None)[1][0])
    assert trial[int(np.argmin(left))] == pytest.approx(1.2024 * np.sqrt(GRAVITY / length) / (2 * np.pi), rel=0.02)


def test_a_hanging_sheet_stretches_under_its_own_weight():
    """rho g L^2 / 2 k = 0.2 x 9.80665 x 0.09 / 400 = 0.4413 mm; Poisson's contraction at the clamp takes a little."""
    engine = Engine(Cloth(width=0.15, height=0.3, stretch=200.0, shear=10.0), side=0.05)
    motion = engine.run(bar(0.15, np.zeros((41, 3))), 0.2, np.array([[0.0, -0.3]]))
    assert -motion.points[0, -1, 0, 2] - 0.3 == pytest.approx(0.4413e-3, rel=0.03)


@pytest.mark.parametrize("direction", [0, 1])
def test_a_sheet_bent_to_a_cylinder_has_the_plate_energy(direction):
    """B kappa^2 A / 2 = 0.5 per B for kappa = 1 and 1 m^2; the border's edges see only what lies inside them."""
    sheet = make_sheet(1.0, 1.0, 0.04)
    assert bent_energy(sheet, sheet.rest[:, direction] ** 2 / 2) == pytest.approx(0.5, rel=0.05)


def test_a_cantilever_sags_by_q_l4_over_8_b():
    """Load 1 Pa, length 1 m, B 1 N m: the tip sinks by 1/8 m; the clamp is two rows, so the length is one row less."""
    sheet = make_sheet(0.5, 1.0, 0.04)
    rows, row = np.unique(np.round(sheet.rest[:, 1], 9), return_inverse=True)
    rows, row = rows[::-1], len(rows) - 1 - row
    curvature = np.zeros((len(sheet.hinges), len(rows)))
    for k in range(4):
        np.add.at(curvature, (np.arange(len(sheet.hinges)), row[sheet.hinges[:, k]]), sheet.hinge_cotangents[:, k])
    stiffness = curvature.T @ (curvature / sheet.hinge_area[:, None]) / 0.5
    load = np.bincount(row, sheet.node_area) / 0.5
    sag = np.linalg.solve(stiffness[2:, 2:], load[2:])[-1]
    free = 1.0 - 0.5 * (1.0 / (len(rows) - 1))  # the clamped row's hinge bends over half a row
    assert sag == pytest.approx(free**4 / 8, rel=0.03)


@pytest.mark.slow
def test_energy_neither_grows_nor_leaks():
    """Without damping, kinetic plus potential energy of a swinging sheet stays within 2 % of the swing's energy."""
    cloth = Cloth(width=0.2, height=0.3, damping=0.0)
    engine = Engine(cloth)
    moved = nudged(3.0, size=0.05)
    motion = engine.run(bar(0.2, moved), 3.0, np.array([[0.0, -0.3]]), shapes=True)
    after = motion.shapes[0, round(0.35 * SAMPLES_A_SECOND) :]
    kinetic = 0.5 * (engine.node_mass[:, None] * after[..., 3:] ** 2).sum((1, 2))
    height = GRAVITY * (engine.node_mass * after[..., 2]).sum(1)
    u, w = deformation(engine.sheet, after[..., :3])
    normal = np.linalg.norm(np.cross(u, w), axis=-1)
    mu, lam = cloth.shear, engine.lam
    density = mu / 2 * ((u**2).sum(-1) + (w**2).sum(-1) - 2 * normal) + (lam + mu) / 2 * (normal - 1) ** 2
    density += engine.fibres[1] / 2 * (np.linalg.norm(u, axis=-1) - 1) ** 2
    density += engine.fibres[0] / 2 * (np.linalg.norm(w, axis=-1) - 1) ** 2
    hinge = (engine.sheet.hinge_cotangents[..., None] * after[:, engine.sheet.hinges, :3]).sum(2)
    bend = engine.hinge_bending * (hinge**2).sum(-1) / 2 / engine.sheet.hinge_area
    total = kinetic + height + (density * engine.sheet.area).sum(1) + bend.sum(1)
    assert np.ptp(total) < 0.02 * kinetic.max()


def deformation(sheet, places):
    """Columns of the deformation gradient of every triangle."""
    corners = places[:, sheet.triangles]
    q, r = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    b = sheet.inverse
    return b[:, 0, None] * q + b[:, 2, None] * r, b[:, 1, None] * q + b[:, 3, None] * r


def test_drag_lets_the_sheet_hang_back_at_the_angle_of_balance():
    """Pulled at 1 m/s face-on: 1/2 1.2041 c u^2 = 0.6021 Pa at c = 1 on a plate square to the flow, weight 1.9613 Pa.

    At the angle a the flow meets the sheet at 90 degrees - a:  C_N(a) q cos a = w sin a  gives a = 17.9 degrees,
    with C_N = 0.505 / (0.222 + 0.283 / cos a); skin friction of 2 % lifts it by less than half a degree.
    """
    a = np.linspace(0, 0.6, 6001)
    push = 0.5 * 1.2041 * np.cos(a) * 0.505 / (0.222 + 0.283 / np.cos(a)) / np.cos(a)
    angle = a[np.argmin(np.abs(push - 0.2 * GRAVITY * np.sin(a)))]
    duration = 5.0
    time = np.linspace(0, duration, 1001)
    s = np.clip(time / 1.5, 0, 1)
    speed = s**2 * (3 - 2 * s)
    moved = np.zeros((1001, 3))
    moved[:, 1] = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time))])
    engine = Engine(Cloth(width=0.15, height=0.3, drag=1.0, damping=0.0, bending=1e-4), side=0.05)
    motion = engine.run(bar(0.15, moved), duration, np.array([[0.0, -0.3]]), settle=0.5)
    last = motion.points[0, -2 * SAMPLES_A_SECOND :, 0] - moved[:, [0, 1, 2]][-2 * SAMPLES_A_SECOND :]
    seen = np.arctan2(-last[:, 1], -last[:, 2]).mean()
    assert seen == pytest.approx(angle, rel=0.06)


def test_a_weight_on_a_string_pulls_its_corner_down():
    """10 g on one corner of 6 g of cloth: the corner sinks by more than a tenth of a millimetre."""
    places = np.array([[0.075, -0.2]])
    low, high = (
        Engine(Cloth(width=0.15, height=0.2, bob=bob, damping=2.0), side=0.05)
        .run(bar(0.15, np.zeros((201, 3))), 1.0, places)
        .points[0, -1, 0, 2]
        for bob in (0.01, 0.0)
    )
    assert high - low > 1e-4


def test_effects_that_are_off_change_nothing_and_effects_that_are_on_do():
    moved = nudged(0.15, size=0.05)
    places = np.array([[0.075, -0.2], [0.0, -0.1]])

    def bottom(**changes):
        return Engine(Cloth(width=0.15, height=0.2, **changes), side=0.05).run(bar(0.15, moved), 0.15, places).points

    plain = bottom()
    assert np.array_equal(plain, bottom(gust_phase=1.0, corner=-1, wake_time=0.2, bob_length=0.1))
    for changes in (
        {"stretch_ratio": 1.0}, {"bending_ratio": 1.0}, {"stiffening": 60.0}, {"stretch_time": 1e-3},
        {"bend_viscosity": 3e-6}, {"friction": 5e-4}, {"curl": (10.0, 0.0)}, {"curl": (0.0, 10.0)}, {"hem": 0.02},
        {"mass_slope": (0.5, 0.0)}, {"mass_slope": (0.0, 0.5)}, {"drag": 1.2}, {"lift": 2.0}, {"wind": (0.0, 0.3, 0.0)},
        {"added_mass": 0.1}, {"wake": 1.0}, {"bob": 0.005}, {"thread": 1.0}, {"magnet": 0.05},
        {"gravity_tilt": (0.03, 0.0)},
    ):  # fmt: skip
        apart = np.abs(bottom(**changes) - plain).max()
        assert 1e-7 < apart < 0.3, (changes, apart)


def test_the_bound_of_the_step_holds_for_a_rod_of_triangles():
    """An element's bound lies above the exact highest frequency, and at most a few times above it."""
    sheet = make_sheet(0.1, 0.1, 0.025)
    bound = membrane_rate(sheet, 1.0, 0.0, 0.0)
    assert (2 / 0.025) ** 2 < bound < 40 * (2 / 0.025) ** 2


def test_the_bound_of_a_single_triangle_is_its_stiffest_shape():
    """Legs of 1 m: strains along x have slopes -1 and 1, a square of 2, and each corner a third of the mass."""
    triangle = SimpleNamespace(area=np.array([0.5]), inverse=np.eye(2).reshape(1, 4))
    assert membrane_rate(triangle, 2.0, 0.0, 0.0) == pytest.approx(3 * 2 * 2.0)
    assert membrane_rate(triangle, 0.0, 0.0, 2.0) == pytest.approx(3 * 4 * 2.0)


def test_impossible_sheets_are_refused():
    with pytest.raises(FitError, match="does not fit the sheet"):
        Engine(Cloth(width=0.2, height=0.2), side=0.2)
    with pytest.raises(FitError, match="too much for a stretch"):
        Engine(Cloth(width=0.2, height=0.2, shear=80.0, stretch=100.0))


@pytest.mark.slow
def test_a_sheet_carried_along_with_the_draught_feels_only_less_drag():
    """At 1 m/s with a draught of 1 m/s no air passes: what is left is minus the still air's drag, 0.6 Pa forwards.

    Such a sheet leans forwards as far as one under drag alone leans back.
    """
    duration, time = 4.0, np.linspace(0, 4.0, 801)
    s = np.clip(time / 1.5, 0, 1)
    moved = np.zeros((801, 3))
    moved[:, 1] = np.cumsum(s**2 * (3 - 2 * s)) * (time[1] - time[0])

    def lean(**air):
        cloth = Cloth(width=0.15, height=0.3, damping=3.0, bending=1e-4, **air)
        motion = Engine(cloth, side=0.05).run(bar(0.15, moved), duration, np.array([[0.0, -0.3]]), settle=0.5)
        return (motion.points[0, -SAMPLES_A_SECOND:, 0, 1] - moved[-SAMPLES_A_SECOND:, 1]).mean()

    plain = lean()
    assert lean(drag=1.2, wind=(0.0, 1.0, 0.0)) - plain == pytest.approx(0.0, abs=0.02)
    assert lean(wind=(0.0, 1.0, 0.0)) - plain > 0.03
    assert lean(drag=1.2) - plain < -0.03


def test_every_hinge_has_the_same_front():
    """The third node lies left of the way from the first to the second, whatever the edge's direction."""
    sheet = make_sheet(0.3, 0.3, 0.03)
    along, third = (sheet.rest[sheet.hinges[:, k]] - sheet.rest[sheet.hinges[:, 0]] for k in (1, 2))
    assert (along[:, 0] * third[:, 1] - along[:, 1] * third[:, 0] > 0).all()


@pytest.mark.slow
def test_cloth_curled_about_the_vertical_brings_both_bottom_corners_to_the_same_side():
    """4 1/m on 0.2 m, stiff: a chord of 0.2 m stands 4 x 0.1^2 / 2 = 20 mm proud in the middle, less where it hangs."""
    engine = Engine(Cloth(width=0.2, height=0.2, curl=(0.0, 4.0), bending=2e-3, damping=4.0), side=0.025)
    motion = engine.run(bar(0.2, nudged(2.0, size=0.0)), 2.0, np.array([[-0.1, -0.2], [0.0, -0.2], [0.1, -0.2]]))
    left, middle, right = motion.points[0, -1][:, 1]
    assert left - middle == pytest.approx(right - middle, rel=0.15)
    assert abs(left - middle) > 0.005


def test_takes_side_by_side_are_what_each_is_alone():
    """Nine takes of other motions fill a group of eight and one more."""
    cloth = Cloth(
        width=0.2, height=0.2, drag=1.2, wind=(0.2, 0.3, 0.0), wake=0.5, added_mass=0.02, friction=1e-5,
        curl=(2.0, 1.0), bob=0.003, thread=0.2, magnet=0.02,
    )  # fmt: skip
    engine, places = Engine(cloth, side=0.05), np.array([[-0.1, -0.2], [0.1, -0.2]])
    ends = np.concatenate([bar(0.2, nudged(0.6, size=0.01 * k)) for k in range(9)])
    ends[4:] += [0.02, 0.0, 0.1, 0.02, 0.0, 0.1]
    together = engine.run(ends, 0.6, places, settle=0.2, shapes=True)
    for k in (0, 5, 8):
        alone = engine.run(ends[k : k + 1], 0.6, places, settle=0.2, shapes=True)
        assert np.array_equal(together.points[k], alone.points[0])
        assert np.array_equal(together.shapes[k], alone.shapes[0])
    assert np.ptp(together.points[:4, -1, 0, 1]) > 0.005

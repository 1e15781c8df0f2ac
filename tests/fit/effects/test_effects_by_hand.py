"""Laws of effects, computed by hand at amplitudes and instants that separate the parts of each law."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.cloth import material as mat
from fit.cloth.mesh import build_mesh
from fit.effects import LIBRARY, find_effects, library_without
from fit.effects.hanger_compliance import respond
from fit.errors import FitError
from formats.nature import AIR_DENSITY
from tests.fit.effects.test_effects import effect, face_force
from tests.fit.scenes import sheet


def test_drag_brings_the_lift_that_leaning_plates_have_at_small_angles():
    """Duchemin's 2 c sin a / (1 + sin^2 a) less c sin^2 a of the drag alone is 2 c of a lift that goes with sin a."""
    angle = 1e-6
    more = 2 * np.sin(angle) / (1 + np.sin(angle) ** 2) - np.sin(angle) ** 2
    assert dict(effect("air_drag").brings)["air_lift"] == pytest.approx(
        more / (np.sin(angle) * np.cos(angle)), rel=1e-5
    )


def test_a_draught_pushes_a_face_that_moves_by_the_difference_to_still_air():
    """At 1 m/s against and with 0.3 m/s of wind: |u| u of 0.7 and 1.3 m/s less the 1 of drag in still air."""
    for speed, push in ((1.0, 1.0 - 0.49), (-1.0, 1.69 - 1.0)):
        force = face_force("draught", (0.0, 0.3), (0, speed, 0), (0, 1, 0), 0.01)
        assert force == pytest.approx([0, 0.5 * AIR_DENSITY * 1.2 * 0.01 * push, 0], rel=1e-4)


def test_a_draught_presses_on_a_leaning_face_by_all_three_parts_of_its_velocity():
    """A face of normal (0, 0.6, 0.8) that moves at (0.2, 0, 1) m/s: Duchemin's pressure in wind less that in still
    air."""
    normal, moving = np.array([0.0, 0.6, 0.8]), np.array([0.2, 0.0, 1.0])

    def pressure(velocity):
        across, speed = velocity @ normal, np.linalg.norm(velocity)
        return 0.5 * AIR_DENSITY * 1.2 * 0.01 * speed * across * 2 * speed**2 / (speed**2 + across**2)

    push = pressure(moving - [0.3, -0.4, 0.0]) - pressure(moving)
    assert face_force("draught", (0.3, -0.4), tuple(moving), tuple(normal), 0.01) == pytest.approx(
        -push * normal, rel=1e-4
    )


def test_mass_moves_within_the_weighed_garment():
    """A hem of 0.02 kg/m along 0.4 m is 8 of 32 g, which the rest lacks; a slope beyond what nodes can lose as well."""
    mesh = build_mesh(sheet(width=0.4, height=0.4), 0.067)
    mass = 0.2 * mesh.node_area
    hemmed = effect("hem").node_mass(mass, mesh, np.array([0.02]))
    assert (mass.sum(), hemmed.sum()) == pytest.approx((0.032, 0.032))
    bottom = np.isclose(mesh.rest[:, 1], mesh.rest[:, 1].min())
    assert hemmed[~bottom] == pytest.approx(0.75 * mass[~bottom])
    assert (hemmed - 0.75 * mass)[bottom].sum() == pytest.approx(0.02 * 0.4)
    steep = effect("mass_distribution").node_mass(mass, mesh, np.array([0.8, 0.8]))
    assert steep.sum() == pytest.approx(0.032)
    assert steep.min() > 0.0


def test_a_clock_that_gains_shows_weaker_forces_and_longer_times():
    """At a rate of 0.98 of its own: forces 0.98^2, damping rates 0.98, damping times 1 / 0.98."""
    row = np.arange(1.0, 1.0 + len(mat.MATERIAL_NAMES))
    shown = effect("clock_drift").material(row, np.array([0.02]))
    factors = dict.fromkeys(range(len(row)), 1.0)
    factors |= dict.fromkeys((mat.STRETCH, mat.SHEAR, mat.BENDING), 0.98**2) | {mat.VELOCITY: 0.98}
    factors |= dict.fromkeys((mat.MEMBRANE_TIME, mat.BENDING_TIME, mat.VISCOSITY), 1 / 0.98)
    expected = row * [factors[k] for k in range(len(row))]
    expected[mat.GRAVITY_LOG] += np.log(0.98**2)
    assert shown == pytest.approx(expected)


def test_a_slip_is_half_complete_at_its_instant_and_takes_a_tenth_of_a_second():
    """A smooth step s^2 (3 - 2 s) of either end: at 25 ms before and after the instant 10 / 64 and 54 / 64 of it."""
    recording = SimpleNamespace(slip_at=1.0)
    path = effect("clip_slip").drive(lambda t: np.zeros((len(t), 6)), recording, np.array([0.008, 0.004]))
    lowered = -path(1.0 + np.array([-0.06, -0.05, -0.025, 0.0, 0.025, 0.05, 1.0]))[:, [2, 5]]
    shares = np.array([0.0, 0.0, 10 / 64, 0.5, 54 / 64, 1.0, 1.0])
    assert lowered == pytest.approx(shares[:, None] * [0.008, 0.004], abs=1e-12)


def test_mass_and_thickness_reach_the_cloth_as_they_are():
    assert effect("bending_hysteresis").friction_moment(np.array([2e-4])) == 2e-4
    assert effect("self_contact").contact_thickness(np.array([0.004])) == 0.004
    assert effect("self_contact").no_size == 1e-9


def test_slack_moves_both_ends_inwards_along_a_bar_that_leans():
    """8 mm of slack, 4 mm each along (0.6, 0.8)."""
    bar = np.array([[-0.3, -0.4, 1.0, 0.3, 0.4, 1.0]])
    ends = effect("clip_slack").drive(lambda at: bar, None, np.array([0.008]))(np.zeros(1))
    along = np.array([0.0024, 0.0032, 0.0])
    assert ends - bar == pytest.approx(np.concatenate([along, -along])[None])


def test_yaw_turns_a_leaning_bar_about_the_vertical_before_it_rolls():
    """A bar along y with a yaw of 0.3 rad of twice the root mean square ends 0.6 rad further; heights stay."""
    recording = SimpleNamespace(edge_turn=lambda at: np.tile([2.0, 0.0], (len(at), 1)), turn_rms=np.array([1.0, 1.0]))
    bar = np.array([[0.0, -0.2, 1.01, 0.0, 0.2, 0.99]])
    ends = effect("hanger_rotation").drive(lambda at: bar, recording, np.array([0.3, 0.0]))(np.zeros(1)).reshape(2, 3)
    turned = 0.2 * np.array([-np.sin(0.6), np.cos(0.6)])
    assert ends == pytest.approx(np.array([[*-turned, 1.01], [*turned, 0.99]]))


def test_a_rod_rings_with_a_tenth_of_critical_damping():
    """The overshoot after a step is e^(-pi z / sqrt(1 - z^2)), 73 % of the deflection for z of 0.1."""
    bent = respond(np.tile([0.0, -1.0, 0.0], (400, 1)), 1e-3, 20.0)[:, 1]
    share = np.exp(-np.pi * 0.1 / np.sqrt(1 - 0.01))
    assert bent.max() == pytest.approx((1 + share) / 20.0**2, rel=1e-3)


def test_added_mass_is_a_bell_along_each_side():
    """Half-way out across and in the middle down: sqrt(1 - 0.25) of it, times the area, of a cloth of any shape."""
    rest = np.array([(-0.2, 0.0), (0.2, 0.0), (0.2, -0.8), (-0.2, -0.8), (0.1, -0.4), (0.0, -0.6), (0.0, -0.4)])
    mesh = SimpleNamespace(rest=rest, node_area=np.full(7, 0.01))
    added = effect("added_mass").added_mass(mesh, np.array([0.2]))
    assert added == pytest.approx(0.002 * np.array([0, 0, 0, 0, np.sqrt(0.75), np.sqrt(0.75), 1.0]))


def test_drag_and_lift_on_a_leaning_face_act_along_its_normal_alone():
    """u_n = 1.2 and 0.9 m/s along: 1/2 rho c A |u_n| u_n and 1/2 rho c A |u_n| |u_t| against the normal motion."""
    normal, along = np.array([0.6, 0.8, 0.0]), np.array([0.8, -0.6, 0.0])
    for sign in (1, -1):
        velocity = sign * 1.2 * normal + 0.9 * along
        drag = face_force("air_drag", (1.5,), velocity, normal, 0.02)
        assert drag == pytest.approx(-sign * 0.5 * AIR_DENSITY * 1.5 * 0.02 * 1.44 * normal, rel=1e-4)
        lift = face_force("air_lift", (2.0,), velocity, normal, 0.02)
        assert lift == pytest.approx(-sign * 0.5 * AIR_DENSITY * 2.0 * 0.02 * 1.2 * 0.9 * normal, rel=1e-4)


def test_a_library_without_some_effects_holds_the_others_and_one_without_all_is_refused():
    names = [one.name for one in LIBRARY]
    assert [one.name for one in library_without(["hem", "air_drag"])] == [
        name for name in names if name not in ("hem", "air_drag")
    ]
    with pytest.raises(FitError, match="no effect is left"):
        library_without(names)
    with pytest.raises(FitError, match="there is no effect named 'wind'"):
        find_effects(["hem", "wind"])

"""Every effect except those of the measurement (`test_measurement_effects.py`), against hand calculation."""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import dataclasses
import sys

import numpy as np
import pytest

from fit import runtime
from fit.cloth import material as mat
from fit.cloth.bends import COLUMN_BEND, ROW_BEND, TWIST
from fit.cloth.effect import amplitudes_of, size_of
from fit.cloth.mesh import build_mesh
from fit.effects import LIBRARY, find_effects
from fit.effects.hanger_compliance import respond
from fit.recordings.recording import prepare, prepare_together
from formats.nature import AIR_DENSITY
from tests.fit.scenes import hung, material, sheet, simulate_take, swing, take_of

GRAVITY = 9.80665
FRAME = 1 / 30


def effect(name):
    return find_effects([name])[0]


def face_force(name, amplitude, velocity, normal, area):
    """Force of an effect on one face, in Taichi."""
    runtime.start()
    import taichi as ti

    function = effect(name).face_force
    a = (*amplitude, 0.0, 0.0)[:3]

    @ti.kernel
    def evaluate(out: ti.types.ndarray(dtype=ti.f32, ndim=1)):
        for _ in range(1):
            f0, f1, f2 = function(
                a[0], a[1], a[2], velocity[0], velocity[1], velocity[2], normal[0], normal[1], normal[2], area
            )
            out[0], out[1], out[2] = f0, f1, f2

    found = np.zeros(3, np.float32)
    evaluate(found)
    return found


def resting(name, amplitude, *, height=0.45, mass=0.036, grid=None, **changes):
    """Points of a sheet at rest with an effect, last frame."""
    garment = sheet(width=0.4, height=height, mass=mass, grid=grid)
    time = np.arange(0, 3, FRAME)
    row = material(garment, velocity_damping=4.0, **changes)
    chosen = amplitudes_of(LIBRARY, **{name: amplitude})[None] if name else None
    return simulate_take(garment, time, np.zeros((len(time), 3)), row, effects=LIBRARY, amplitudes=chosen).points[-1]


def driven(name, amplitude, path=None, seconds=4.0, points=None):
    """The path of the held ends with an effect, and without, at a hundred instants."""
    garment = sheet(grid=5)
    time = np.arange(0, seconds, FRAME)
    displacement = np.zeros((len(time), 3)) if path is None else path(time)
    take = take_of(
        garment, time, displacement, hung(garment, time) + displacement[:, None] if points is None else points
    )
    recording = prepare(take)
    instants = np.linspace(0, seconds - 0.1, 100)
    changed = effect(name).drive(recording.held, recording, np.atleast_1d(amplitude).astype(float))
    return instants, recording.held(instants).reshape(-1, 2, 3), changed(instants).reshape(-1, 2, 3)


def observed(name, amplitude, points):
    """What an effect makes of points, (frames, points, 3)."""
    garment = sheet(grid=5)
    time = np.arange(len(points)) * FRAME
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time)))
    return effect(name).observe(points, recording, np.atleast_1d(amplitude).astype(float))


def test_the_spread_of_drag_laws_covers_a_drag_that_goes_with_the_speed():
    turn = np.linspace(0, 2 * np.pi, 4001)[:-1]

    def left_of_linear(*speeds):
        """Relative deviation of the best quadratic law from a linear one over swings of these largest speeds."""
        speed = np.concatenate([largest * np.cos(turn) for largest in speeds])
        quadratic = speed * np.abs(speed)
        cosine = (speed @ quadratic) / np.sqrt((speed @ speed) * (quadratic @ quadratic))
        return np.sqrt(1 - cosine**2)

    assert left_of_linear(1.0) == pytest.approx(np.sqrt(1 - 512 / (54 * np.pi**2)), abs=1e-6)
    covered = 3 * effect("air_drag").law_spread
    assert 0.28 < left_of_linear(1.0, 3.0) < covered < 0.35


def test_air_drag_on_a_face_at_two_metres_a_second():
    """1/2 x 1.204 x 1.2 x 0.01 m^2 x (2 m/s)^2 = 0.0289 N against the motion."""
    force = face_force("air_drag", (1.2,), (0.5, 2.0, 0.0), (0.0, 1.0, 0.0), 0.01)
    assert force == pytest.approx([0, -0.5 * AIR_DENSITY * 1.2 * 0.01 * 4, 0], abs=1e-7)


def test_air_lift_needs_motion_along_the_sheet():
    """1/2 x 1.204 x 2 x 0.01 x 3 m/s along x 1 m/s across = 0.0361 N; none without motion along."""
    assert face_force("air_lift", (2.0,), (0, 1, 3), (0, 1, 0), 0.01)[1] == pytest.approx(-0.03612, rel=1e-4)
    assert face_force("air_lift", (2.0,), (0, 1, 0), (0, 1, 0), 0.01)[1] == 0.0


def test_a_draught_of_30_cm_a_second_pushes_a_resting_face():
    """1/2 x 1.204 x 1.2 x 0.01 x 0.09 = 0.65 mN with the wind."""
    force = face_force("draught", (0.0, 0.3), (0, 0, 0), (0, 1, 0), 0.01)
    assert force == pytest.approx([0, 0.5 * AIR_DENSITY * 1.2 * 0.01 * 0.09, 0], rel=1e-5)


def test_a_draught_pushes_more_on_a_sheet_that_slides_along_itself():
    """u = (2, -0.3, 0): 1/2 x 1.204 x 1.2 x 0.01 x sqrt(4.09) x 0.3 x 2 x 4.09 / (4.09 + 0.09) = 8.58 mN, 13 x."""
    force = face_force("draught", (0.0, 0.3), (2, 0, 0), (0, 1, 0), 0.01)
    assert force == pytest.approx([0, 8.577e-3, 0], rel=1e-3)


def test_added_mass_is_full_in_the_middle_and_nothing_at_the_edge():
    mesh = build_mesh(sheet(width=0.4, height=0.4), 0.067)  # two elements a side: a node in the middle
    added = effect("added_mass").added_mass(mesh, np.array([0.2]))
    middle = int(np.argmin(np.linalg.norm(mesh.rest - mesh.rest.mean(0), axis=1)))
    assert added[middle] == pytest.approx(0.2 * mesh.node_area[middle])
    assert added[0] == 0.0
    # A node of the elements lies at 0.2764 and 0.7236 of the way out: sqrt(1 - 0.0764) sqrt(1 - 0.5236) = 0.6633.
    place = np.array([0.2 * 0.2764, -0.2 - 0.2 * 0.7236])
    between = int(np.argmin(np.linalg.norm(mesh.rest - place, axis=1)))
    assert added[between] == pytest.approx(0.6633 * 0.2 * mesh.node_area[between], rel=1e-3)


@pytest.mark.slow
def test_added_mass_slows_the_swing_as_more_inertia_at_the_same_weight_does():
    """Evenly spread, rho of it would lower the frequency by sqrt(2); a bell of that height by less."""
    garment = sheet(height=0.45)
    time = np.arange(0, 10, FRAME)
    nudge = swing(time, amplitude=0.005, hz=0.9, stop=1.5)

    def frequency(amplitude):
        take = simulate_take(
            garment, time, nudge, material(garment, velocity_damping=0.2), effects=LIBRARY,
            amplitudes=amplitudes_of(LIBRARY, added_mass=amplitude)[None],
        )  # fmt: skip
        ringing = take.points[60:, 4, 1]
        spectrum = np.abs(np.fft.rfft(ringing * np.hanning(len(ringing)), 4096))
        return np.fft.rfftfreq(4096, FRAME)[int(np.argmax(spectrum))]

    assert 1.1 < frequency(0.0) / frequency(0.2) < np.sqrt(2.0)


def test_uneven_mass_keeps_the_weight_and_tilts_it():
    """Slope 0.5 downwards: at the bottom 1.5 times, at the top half the mean density; across alike, on the right."""
    mesh = build_mesh(sheet(), 0.05)
    mass = effect("mass_distribution").node_mass(0.2 * mesh.node_area, mesh, np.array([0.0, 0.5]))
    assert mass.sum() == pytest.approx(0.036)
    density = mass / mesh.node_area
    assert density[np.argmin(mesh.rest[:, 1])] == pytest.approx(0.3, rel=0.01)
    assert density[np.argmax(mesh.rest[:, 1])] == pytest.approx(0.1, rel=0.01)
    across = effect("mass_distribution").node_mass(0.2 * mesh.node_area, mesh, np.array([0.5, 0.0])) / mesh.node_area
    assert across[np.argmax(mesh.rest[:, 0])] == pytest.approx(0.3, rel=0.01)


def test_effects_on_the_material_change_its_numbers():
    row = material(sheet(), shear_stiffness=30.0, bending_stiffness=2e-5, bending_damping_time=1e-3)[0]
    assert effect("shear_stiffness").material(row, np.array([12.0]))[mat.SHEAR] == pytest.approx(42.0)
    viscous = effect("bending_viscosity").material(row, np.array([2e-8]))
    assert viscous[mat.BENDING_TIME] == pytest.approx(2e-3)
    assert effect("stretch_viscosity").material(row, np.array([1e-3]))[mat.VISCOSITY] == pytest.approx(1e-3)
    tilted = effect("gravity_tilt").material(row, np.array([0.05, -0.03]))
    assert tilted[[mat.TILT_X, mat.TILT_Y]] == pytest.approx([0.05, -0.03])
    uneven = effect("anisotropy").material(row, np.array([0.7, -0.3]))
    assert uneven[[mat.STRETCH_RATIO, mat.BENDING_RATIO]] == pytest.approx([0.7, -0.3])
    assert effect("strain_stiffening").material(row, np.array([40.0]))[mat.STIFFENING] == pytest.approx(40.0)


def test_a_stiffer_warp_stretches_less_under_its_own_weight():
    """Warp e^(0.7/2) = 1.419 times stiffer: the bottom sinks by 1/1.419 of before."""
    before = -resting(None, 0, stretch_stiffness=100.0)[2, 2] - 0.45
    after = -resting("anisotropy", (0.7, 0.0), stretch_stiffness=100.0)[2, 2] - 0.45
    assert after / before == pytest.approx(np.exp(-0.35), rel=0.01)


def test_strain_stiffening_follows_its_law():
    """k (E + a E^2) = rho g z with k = 40 N/m and a = 40: the sink is the integral of E over the height."""
    z = np.linspace(0, 0.45, 2001)
    load = 0.2 * GRAVITY * z / 40.0
    strain = (-1 + np.sqrt(1 + 4 * 40 * load)) / (2 * 40)
    sink = -resting("strain_stiffening", 40.0, stretch_stiffness=40.0)[2, 2] - 0.45
    # St. Venant-Kirchhoff's own stiffening, 3/2 of a strain of 1.6 %, comes on top.
    assert sink == pytest.approx(np.trapezoid(strain, z), rel=0.04)


def test_a_sheet_hangs_along_tilted_gravity():
    """0.05 rad: the bottom of 0.45 m stands 22.5 mm aside."""
    assert resting("gravity_tilt", (0.0, 0.05))[4, 1] == pytest.approx(0.45 / 2 * np.sin(0.05), rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("curvature", [1.0, -1.0])
def test_a_stiff_sheet_takes_its_rest_curvature(curvature):
    """Second differences of a column 0.05 m apart: 1 /m, bent one way or the other."""
    column = resting("rest_curvature", (curvature, 0.0), grid=10, bending_stiffness=1.0, shear_stiffness=300.0,
                     bending_damping_time=1e-4).reshape(10, 10, 3)[:, 5, 1]  # fmt: skip
    bent = np.diff(column, 2) / 0.05**2
    assert np.abs(bent) == pytest.approx(np.ones(8), rel=0.035)
    assert (np.sign(bent) == -np.sign(curvature)).all()


def test_a_curl_about_the_horizontal_bends_columns_one_about_the_vertical_rows_and_neither_twists():
    mesh = build_mesh(sheet(), 0.06)
    found = effect("rest_curvature").rest_curvature(mesh, np.array([3.0, -5.0]))
    for kind, curvature in ((COLUMN_BEND, 3.0), (ROW_BEND, -5.0), (TWIST, 0.0)):
        assert (mesh.bends.kind == kind).sum() > 10
        assert (found[mesh.bends.kind == kind] == curvature).all()


@pytest.mark.slow
def test_friction_in_bending_keeps_a_curl_that_gravity_alone_would_open():
    """2e-3 N against a weight of 0.2 x 9.81 x 0.45 N/m: millimetres stay after a flick, where nothing stays without."""
    garment = sheet(height=0.45, grid=5)
    time = np.arange(0, 5, FRAME)
    flick = swing(time, amplitude=0.08, hz=1.6, start=0.3, stop=1.2)
    curl = []
    for amplitude in (0.0, 2e-3):
        take = simulate_take(
            garment, time, flick, material(garment, velocity_damping=4.0), effects=LIBRARY,
            amplitudes=amplitudes_of(LIBRARY, bending_hysteresis=amplitude)[None],
        )  # fmt: skip
        curl.append(float(np.abs(take.points[-1, :, 1]).max()))
    assert curl[0] < 2e-4
    assert 4e-4 < curl[1] < 0.02


def test_a_bending_rod_lags_by_compliance_times_acceleration():
    """2 m/s^2 on 1e-3 s^2 is 2 mm against the acceleration, once the ringing has died."""
    bent = respond(np.tile([0.0, 2.0, 0.0], (3000, 1)), 1e-3, 1 / np.sqrt(1e-3))
    assert bent[-1] == pytest.approx([0, -2e-3, 0], abs=2e-6)


def test_a_hanger_that_bends_is_driven_behind_its_acceleration():
    """A swing of 50 mm at 0.8 Hz has 1.26 m/s^2; far below resonance a compliance of 1e-4 s^2 adds 0.13 mm to it."""
    instants, before, after = driven("hanger_compliance", 1e-4, lambda t: swing(t, amplitude=0.05, hz=0.8))
    late = instants > 2
    assert np.abs((after - before)[late, :, 1]).max() == pytest.approx(1e-4 * 0.05 * (2 * np.pi * 0.8) ** 2, rel=0.1)


def test_a_rod_bends_by_the_step_response_from_2_ms_after_the_start_of_a_steady_acceleration():
    """-a / w^2 (1 - e^(-z w t) (cos w' t + z w / w' sin w' t)), z = 0.1: no second difference is known before 2 ms."""
    time = np.arange(0, 1, FRAME)
    recording = prepare(take_of(sheet(), time, np.zeros((30, 3)), hung(sheet(), time)))

    def path(at):
        return np.tile(np.stack([0 * at, at**2, 0 * at], 1), 2)

    at, turns, share = np.arange(5, 200) * 1e-3, 1 / np.sqrt(1e-3), 0.1
    bent = effect("hanger_compliance").drive(path, recording, np.array([1e-3]))(at) - path(at)
    since, damped = at - 2e-3, turns * np.sqrt(1 - share**2)
    ringing = np.cos(damped * since) + share * turns / damped * np.sin(damped * since)
    expected = -2.0 * 1e-3 * (1 - np.exp(-share * turns * since) * ringing)
    assert bent[:, 1] == pytest.approx(expected, abs=1e-9)
    assert bent[:, 4] == pytest.approx(expected, abs=1e-9)


def test_a_hanger_that_bends_does_not_bend_along_itself():
    def heave(t):
        return np.stack([0 * t, 0 * t, 0.05 * np.sin(2 * np.pi * 0.8 * t)], 1)

    _, before, after = driven("hanger_compliance", 1e-3, heave)
    assert np.abs(after - before).max() < 1e-9


def test_a_rotation_seen_in_the_edge_is_put_back_with_its_root_mean_square():
    """A yaw of 0.05 sin: rms 0.0354; ends at +-0.2 m move by up to 10 mm."""
    garment = sheet(grid=5)
    time = np.arange(0, 4, FRAME)
    yaw = 0.05 * np.sin(2 * np.pi * 0.5 * time)
    points = hung(garment, time)
    points[..., 1] = yaw[:, None] * points[..., 0]
    instants, before, after = driven("hanger_rotation", (0.05 / np.sqrt(2), 0.0), points=points)
    expected = 0.2 * np.sin(0.05 * np.sin(2 * np.pi * 0.5 * instants))
    assert (after - before)[:, 1, 1] == pytest.approx(expected, abs=3e-4)
    assert (after - before)[:, 0, 1] == pytest.approx(-expected, abs=3e-4)


def test_takes_that_turn_less_than_those_fitted_to_are_turned_by_less():
    """Of rolls of 0.04 sin for 4 s and 0.02 for 2 s the rms is 0.0245; a still take's noise is not blown up."""
    garment = sheet(grid=5)

    def rolling(size, seconds=4.0):
        time = np.arange(0, seconds, FRAME)
        points = hung(garment, time)
        points[..., 2] += size * np.sin(np.pi * time)[:, None] * points[..., 0]
        return take_of(garment, time, np.zeros((len(time), 3)), points)

    training, held_out = prepare_together([rolling(0.04), rolling(0.02, 2.0)], [rolling(0.01), rolling(0.0)])
    assert training[0].turn_rms[1] == pytest.approx(np.sqrt((2 * 0.04**2 + 0.02**2) / 6), rel=0.02)
    for recording, size in zip([*training, *held_out], (0.04, 0.02, 0.01, 0.0), strict=True):
        amplitude = np.array([0.0, recording.turn_rms[1]])
        ends = effect("hanger_rotation").drive(recording.held, recording, amplitude)(np.array([0.5]))
        assert ends[0, 5] - ends[0, 2] == pytest.approx(0.4 * size, abs=2e-4)


def test_a_bar_rolls_in_the_upright_plane_through_itself_however_it_stands():
    """0.05 rad of roll at +-0.2 m: 10 mm up and down, whether the bar lies along x, along y or between."""
    garment, time = sheet(grid=5), np.arange(0, 2, FRAME)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time)))
    recording = dataclasses.replace(
        recording, edge_turn=lambda t: np.tile([0.0, 1.0], (len(t), 1)), turn_rms=np.ones(2)
    )
    for angle in np.radians([0, 45, 90, 180]):
        arm = 0.2 * np.array([np.cos(angle), np.sin(angle), 0.0])

        def bar(t, arm=arm):
            return np.tile(np.concatenate([-arm, arm]), (len(t), 1))

        ends = effect("hanger_rotation").drive(bar, recording, np.array([0.0, 0.05]))(np.zeros(1)).reshape(2, 3)
        assert ends[:, 2] == pytest.approx([-0.2 * np.sin(0.05), 0.2 * np.sin(0.05)])
        assert ends[:, :2] == pytest.approx(np.cos(0.05) * np.array([-arm[:2], arm[:2]]))


def test_an_effect_that_neither_drives_nor_observes_moves_no_held_edge():
    moving = {e.name for e in LIBRARY if e.moves_edge}
    assert {"clip_slack", "time_offset", "corner_erosion"} <= moving
    assert not moving & {"gravity_tilt", "air_drag", "hem"}


def test_an_attachment_offset_moves_both_ends_in_the_hangers_frame():
    """5 mm along the bar, 10 mm down, 3 mm out (x cross down is +y)."""
    _, before, after = driven("attachment_offset", (0.005, 0.010, 0.003))
    assert (after - before)[0] == pytest.approx(np.tile([0.005, 0.003, -0.010], (2, 1)), abs=1e-9)


def test_a_slip_stays_after_the_hardest_jerk():
    instants, before, after = driven(
        "clip_slip", (0.008, 0.0), lambda t: swing(t, amplitude=0.05, hz=1.0, start=0.5, stop=2.0)
    )
    lowered = (before - after)[:, :, 2]
    assert lowered[0] == pytest.approx([0, 0])
    assert lowered[-1] == pytest.approx([0.008, 0])
    assert 0.5 < instants[np.argmax(lowered[:, 0] > 0.004)] < 2.3


def test_local_effects_say_where_they_act():
    slip, erosion = effect("clip_slip"), effect("corner_erosion")
    assert slip.regions(np.array([0.001, 0.008])) == ("top right",)
    assert slip.regions(np.array([0.006, 0.008])) == ("top right", "top left")
    assert erosion.regions(np.array([0.008, 0.002])) == ("bottom left", "bottom right")
    assert erosion.regions(np.array([0.001, 0.009])) == ()
    assert erosion.regions(np.array([-0.005, 0.005])) == ("bottom left", "bottom right")  # not eroded more than they
    assert effect("hem").regions(np.array([0.01])) == ("bottom left", "bottom centre", "bottom right")
    assert effect("air_drag").regions(np.array([1.0])) == ()


def test_slack_brings_the_ends_nearer():
    _, before, after = driven("clip_slack", 0.01)
    gap = np.linalg.norm(after[:, 1] - after[:, 0], axis=1)
    assert gap == pytest.approx(np.linalg.norm(before[:, 1] - before[:, 0], axis=1) - 0.01)


@pytest.mark.parametrize("chosen", LIBRARY, ids=lambda e: e.name)
def test_an_effects_module_says_equation_sign_belief_and_source_in_this_order(chosen):
    """The reference of the effects is made of these texts; an equation stands in an indented block."""
    lines = sys.modules[type(chosen).__module__].__doc__.splitlines()
    places = [
        next(k for k, line in enumerate(lines) if line.startswith("    ") and "=" in line),
        next(k for k, line in enumerate(lines) if line.startswith("The amplitude is ")),
        next(k for k, line in enumerate(lines) if line.startswith("Believe it ")),
        next(k for k, line in enumerate(lines) if line.startswith("Source: ")),
    ]
    assert places == sorted(places)
    assert all(lines[k - 1] == "" for k in places)


def test_the_size_of_a_vector_is_its_length():
    assert size_of(np.array([3.0, 4.0])) == 5.0
    assert size_of(np.array([-2.0])) == -2.0

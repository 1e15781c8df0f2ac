"""Relaxing stretch viscosity: decay of a bounce, stable step, and cost."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import curve_fit

from benchmarks.clamps import Clamp, clamps, steps_of
from benchmarks.validation_clamped import UPRIGHT, still
from fit.cloth import material as mat
from fit.cloth.material import RELAXATION_TIME
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.effects.stretch_viscosity import StretchViscosity
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, material, sheet, swing, take_of

HEIGHT, STIFFNESS, DENSITY = 0.45, 300.0, 0.2  # m, N/m, kg/m^2


def bounce(amplitude, **changes):
    """Heights [m] of the bottom edge of a sheet that hangs from a hinge and is let go unstretched, and their times."""
    garment = sheet(height=HEIGHT)
    time = np.arange(0, 0.6, 1 / 480)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3))))
    support = clamps(Clamp(lambda places: places[:, 1] > -1e-9, still(UPRIGHT)), start=UPRIGHT)
    simulator = Simulator(recording, (StretchViscosity(),), support=support)
    row = material(
        garment, stretch_stiffness=STIFFNESS, bending_stiffness=1e-9, bending_damping_time=0.0,
        velocity_damping=0.0, **{"membrane_damping_time": 0.0} | changes,
    )  # fmt: skip
    shapes = simulator.run(row, np.array([[amplitude]]), shapes=True).shapes[0]
    return time, shapes[:, simulator.mesh.rest[:, 1] < -HEIGHT + 1e-6, 2].mean(1)


def ring(time, height):
    """Angular frequency and decay [1/s] of a bounce, once its overtones have died."""
    late = time > 0.05

    def wave(t, a, b, omega, decay, rest):
        return np.exp(-decay * t) * (a * np.cos(omega * t) + b * np.sin(omega * t)) + rest

    start = [2e-3, 0.0, bounce_frequency(), 5.0, height[-1]]
    found, _ = curve_fit(wave, time[late], height[late], p0=start)
    return found[2], found[3]


def bounce_frequency():
    """First longitudinal mode of a strip held at its top: omega = pi / (2 L) sqrt(k / rho)."""
    return np.pi / (2 * HEIGHT) * np.sqrt(STIFFNESS / DENSITY)


def expected(tau, theta=RELAXATION_TIME):
    """The same from the closed form: (s^2 + w^2) (1 + theta s) + w^2 tau s = 0."""
    square = bounce_frequency() ** 2
    roots = np.roots([theta, 1.0, square * (tau + theta), square])
    root = roots[np.abs(roots.imag).argmax()]
    return abs(root.imag), -root.real


@pytest.mark.parametrize("tau", [pytest.param(3e-4, marks=pytest.mark.slow), 1e-3])
def test_a_bounce_decays_and_rings_by_the_closed_form(tau):
    """At 21 Hz and 1 ms: 8.4 1/s, where Kelvin-Voigt has w^2 tau / 2 = 9.1; at 0.3 ms 2.5 and 2.7."""
    omega, decay = expected(tau)
    assert decay == pytest.approx(bounce_frequency() ** 2 * tau / 2, rel=0.1)
    rung, died = ring(*bounce(tau))
    # The sheet hangs stretched by 0.15 % on average: St. Venant-Kirchhoff is stiffer then by 3/2 of it and more.
    assert rung == pytest.approx(omega, rel=0.01)
    assert died == pytest.approx(decay, rel=0.03)


def test_as_the_relaxation_goes_to_nothing_the_closed_form_is_kelvin_voigts():
    omega, decay = expected(1e-3, theta=1e-9)
    square = bounce_frequency() ** 2
    assert decay == pytest.approx(square * 1e-3 / 2, rel=1e-4)
    assert omega == pytest.approx(np.sqrt(square - decay**2), rel=1e-4)


def radius(omega, tau, theta, dt):
    """Spectral radius of a step of one oscillator: x, v, z and the strain of the step before."""
    kept = np.exp(-dt / theta)
    gain = tau * (1 - kept) / dt
    lag = np.array([gain, 0.0, kept, -gain])  # z of this step from (x, v, z, x before)
    speed = np.array([-dt * omega**2, 1.0, 0.0, 0.0]) - dt * omega**2 * lag
    step = np.stack([np.array([1.0, 0.0, 0.0, 0.0]) + dt * speed, speed, lag, np.array([1.0, 0.0, 0.0, 0.0])])
    return np.abs(np.linalg.eigvals(step)).max()


@pytest.mark.parametrize("theta", [1e-9, 1e-4, RELAXATION_TIME, 1.0])
@pytest.mark.parametrize("tau", [1e-5, 1e-3, 1e-2])
def test_the_stable_step_is_where_the_module_says(tau, theta):
    """dt^2 w^2 (1 + (2 tau / dt) tanh(dt / (2 theta))) = 4, found by bisection; and 2 / (w sqrt(1 + tau / theta))
    is on its safe side."""
    omega = 3000.0
    low, high = 0.0, 2.0 / omega
    for _ in range(60):
        dt = (low + high) / 2
        fits = dt**2 * omega**2 * (1 + 2 * tau / dt * np.tanh(dt / (2 * theta))) < 4
        low, high = (dt, high) if fits else (low, dt)
    assert radius(omega, tau, theta, 0.999 * low) <= 1 + 1e-9
    assert radius(omega, tau, theta, 1.001 * low) > 1 + 1e-5
    assert 2 / (omega * np.sqrt(1 + tau / theta)) <= low * (1 + 1e-9)
    zeta = omega * tau / 2
    if theta == 1e-9:  # Kelvin-Voigt, as in fit.cloth.stability
        assert low == pytest.approx(2 / omega * (np.sqrt(1 + zeta**2) - zeta), rel=1e-3)


def swung(amplitudes, **changes):
    """A hard swing of a stiff sheet, candidate by candidate the amplitude and its points; and the simulator."""
    garment = sheet()
    time = np.arange(0, 2.5, 1 / 30)
    recording = prepare(take_of(garment, time, swing(time, amplitude=0.1), hung(garment, time)))
    simulator = Simulator(recording, (StretchViscosity(),), resolution=Resolution(spacing=0.07))
    row = material(garment, **changes)
    rows = np.repeat(row, len(amplitudes), axis=0)
    return simulator, row, simulator.run(rows, np.array(amplitudes)[:, None]).points


@pytest.mark.slow
def test_the_strongest_viscosity_needs_half_a_step_and_stays_stable():
    """sqrt(1 + 3 / 2) = 1.6 times shorter at 3 ms, at most 2 with steps in half octaves; Kelvin-Voigt 8."""
    simulator, row, points = swung([0.0, 3e-3], stretch_stiffness=1000.0, velocity_damping=0.1)
    assert np.isfinite(points).all()
    viscous, damped = row.copy(), row.copy()
    viscous[0, mat.VISCOSITY], damped[0, mat.MEMBRANE_TIME] = 3e-3, 3e-3
    plain, relaxed, kelvin_voigt = (steps_of(simulator, rows)[0] for rows in (row, viscous, damped))
    assert plain / relaxed <= 2.0 + 1e-9
    assert plain / kelvin_voigt > 7.9


@pytest.mark.slow
def test_next_to_no_viscosity_changes_next_to_nothing():
    """Two kernels, so rounding may differ; physics may not."""
    _, _, points = swung([0.0, 1e-9], velocity_damping=2.0)
    assert np.abs(points[1] - points[0]).max() < 1e-4


@pytest.mark.slow
def test_viscous_candidates_beside_others_are_what_each_is_alone():
    together = swung([0.0, 1e-3, 2e-3, 0.0, 1e-3])[2]
    for k, amplitude in enumerate([0.0, 1e-3, 2e-3]):
        assert np.array_equal(together[k], swung([amplitude])[2][0])
    assert np.array_equal(together[4], together[1])

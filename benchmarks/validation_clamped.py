"""Cases of `validation.py` with clamped or free cloth; each returns a relative error.

shear frame      all four sides of a square turned by phi, threads keep their length: W = G/2 sin^2 phi per area, so
                 the torque on the frame is A G sin phi cos phi
bias extension   a sample cut at 45 degrees, three times as long as wide, whose threads keep their length: with
                 D = L - W and lengthened by d = D (cos(g/2) + sin(g/2) - 1), the middle, A_C = L W - 3/2 W^2, shears
                 by g and a border of A_B = W^2 by g/2; the force is dE/dd, E = G/2 (A_C sin^2 g + A_B sin^2 (g/2))
                 Source: J. Cao et al., Composites A 39 (2008) 1037, section 4
load             k/2 l (l^2 - 1) = F + rho g z for the stretch l(z); F [N/m] at the lower clamp
cantilever       B theta'' = -rho g s cos theta, s from the free end, theta below the horizontal: theta'(0) = 0,
                 theta(L) = 0, solved here by collocation. Bending length c = (B / rho g)^(1/3), and by
                 c = L (cos(a/2) / (8 tan a))^(1/3) from the angle a of the line to the tip, 1.9 % above it at L = 2 c
                 Source: F. T. Peirce, J. Text. Inst. 21 (1930) T377; W. G. Bickley, Phil. Mag. 17 (1934) 603
falling sheet    rho g = 1/2 rho_air c_d v^2
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from benchmarks.clamps import Clamp, clamps
from fit.cloth.model import Resolution, Rollouts
from fit.cloth.simulator import Simulator
from fit.cloth.support import Supporting
from fit.effects.air_drag import AirDrag
from fit.recordings.recording import Curve, prepare
from formats.arrays import Booleans, Floats
from formats.garment import Garment
from formats.nature import AIR_DENSITY, GRAVITY
from tests.fit.scenes import material, sheet, take_of

Held = Callable[[Floats], Booleans]
DENSITY = 0.2  # kg/m^2
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # frame of a sheet in the plane of x and z
LEVEL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])  # and of one that lies
STIFF = {
    "bending_stiffness": 1e-9, "bending_damping_time": 0.0, "membrane_damping_time": 0.0,
    "stretch_stiffness": 2000.0, "shear_stiffness": 100.0,
}  # fmt: skip
FRAME = 1 / 30
ANGLE = 0.2  # rad of the shear frame
BIAS_ANGLE = 0.3  # rad of shear
BIAS_STRETCH = 2000.0  # N/m along the threads, 2000 times the shear stiffness
BIAS_DAMPINGS = tuple(np.linspace(16.0, 24.0, 8))  # 1/s: the same rest state, with different ringing before it
LOAD, SOFT = 6.0, 60.0  # N/m at the lower clamp, and the sheet's stretch stiffness
OVERHANG = 0.6  # m
SHORT, LONG = 2.0, 3.0  # overhangs over the bending length: Peirce's c = L / 2, and a tip that hangs at 60 degrees
DRAG = 1.2


def still(frame: Floats) -> Curve:
    """Return a clamp at rest."""
    return lambda instants: np.tile(frame, (len(instants), 1))


def gone(instants: Floats) -> Floats:
    """Return the completed share, 0 to 1, of a movement of one second."""
    share = np.clip(instants, 0, 1)
    return np.asarray(share**3 * (10 - 15 * share + 6 * share**2))


def bench(
    garment: Garment, support: Supporting, resolution: Resolution, seconds: float, *, drag: float = 0.0,
    dampings: Sequence[float] = (20.0,), **changes: float,
) -> tuple[Rollouts, Simulator]:  # fmt: skip
    """Simulate one sheet on a bench, at each velocity damping [1/s]; shapes and last forces are kept."""
    time = np.arange(0, seconds, FRAME)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3))))
    simulator = Simulator(recording, (AirDrag(),) if drag else (), resolution=resolution, support=support)
    rows = np.concatenate([material(garment, **{**STIFF, "velocity_damping": c, **changes}) for c in dampings])
    return simulator.run(rows, np.full((len(rows), 1), drag) if drag else None, shapes=True), simulator


def square(width: float, height: float) -> Garment:
    """A sheet of the density of all these."""
    return sheet(width=width, height=height, mass=DENSITY * width * height)


def shear_frame_error(resolution: Resolution) -> float:
    """Return the error of the torque on a shear frame at 0.2 rad, with card, which stays flat in it."""
    side, shear = 0.4, 100.0

    def on_rim(places: Floats) -> Booleans:
        x, y = places.T
        return (np.abs(x) > side / 2 - 1e-9) | (y > -1e-9) | (y < 1e-9 - side)

    def turned(instants: Floats) -> Floats:
        frame = np.tile(UPRIGHT, (len(instants), 1))
        angle = ANGLE * gone(instants)
        frame[:, 6], frame[:, 8] = np.sin(angle), np.cos(angle)
        return frame

    support = clamps(Clamp(on_rim, turned), start=UPRIGHT, gravity=0.0)
    # Soft cloth would buckle out of its plane, by a rounding error, and give 5.5 % less torque than flat cloth.
    stiff = {"shear_stiffness": shear, "bending_stiffness": 0.1}
    done, simulator = bench(square(side, side), support, resolution, 2.0, **stiff)
    held = simulator.support.nodes
    ways = simulator.mesh.rest[held, 1:] * np.array([np.cos(ANGLE), -np.sin(ANGLE)])  # d place / d angle, along x, z
    assert done.forces is not None
    torque = -float((done.forces[0, held][:, [0, 2]] * ways).sum())
    return torque / (side**2 * shear * np.sin(ANGLE) * np.cos(ANGLE)) - 1


def bias_extension_error(resolution: Resolution, stretch: float = BIAS_STRETCH) -> float:
    """Of the force that pulls a sample cut on the bias until its middle has sheared by 0.3 rad; its threads' `stretch`.

    Threads that give make the sample softer, by about as much as the root of shear over stretch stiffness. Such stiff
    threads never stop ringing, which shakes the force by a per cent: the mean of both clamps and of `BIAS_DAMPINGS`.
    """
    width, length, shear = 0.6, 1.8, 1.0
    half = BIAS_ANGLE / 2
    drawn = (length - width) * (np.cos(half) + np.sin(half) - 1)
    middle, border = length * width - 1.5 * width**2, width**2
    energy_slope = middle * np.sin(2 * half) * np.cos(2 * half) + border * np.sin(half) * np.cos(half) / 2
    expected = shear * energy_slope / ((length - width) / 2 * (np.cos(half) - np.sin(half)))
    support, is_lowest = drawn_down(length, drawn, gravity=0.0)
    on_bias = msgspec.structs.replace(square(width, length), format="hangtime-garment/2", grain_degrees=45.0)
    done, simulator = bench(
        on_bias, support, resolution, 1.6, dampings=BIAS_DAMPINGS, shear_stiffness=shear, stretch_stiffness=stretch
    )
    assert done.forces is not None
    at_clamps = np.where(is_lowest(simulator.mesh.rest), 0.5, -0.5)[simulator.support.nodes]
    return float((done.forces[:, simulator.support.nodes, 2] @ at_clamps).mean()) / expected - 1


def drawn_down(height: float, way: float, gravity: float = GRAVITY) -> tuple[Supporting, Held]:
    """Return clamps at the upper and lower edge, the lower one drawn down [m] in a second, and its held nodes."""

    def lowered(instants: Floats) -> Floats:
        frame = np.tile(UPRIGHT, (len(instants), 1))
        frame[:, 2] = -way * gone(instants)
        return frame

    def is_lowest(places: Floats) -> Booleans:
        return np.asarray(places[:, 1] < 1e-9 - height)

    upper = Clamp(lambda places: places[:, 1] > -1e-9, still(UPRIGHT))
    return clamps(upper, Clamp(is_lowest, lowered), start=UPRIGHT, gravity=gravity), is_lowest


def stretched(tension: Floats, stiffness: float) -> Floats:
    """Stretch under a tension per width [N/m]."""
    return np.array([brentq(lambda s, t=t: stiffness / 2 * s * (s**2 - 1) - t, 1, 3) for t in tension])


def load_error(resolution: Resolution) -> float:
    """Return the error of the force at the lower clamp of a sheet with weight."""
    width, height = 0.4, 0.45
    depths = np.linspace(0, height, 501)
    sunk = float(np.trapezoid(stretched(LOAD + DENSITY * GRAVITY * depths, SOFT) - 1, depths))
    support, is_lowest = drawn_down(height, sunk)
    done, simulator = bench(square(width, height), support, resolution, 3.0, stretch_stiffness=SOFT)
    lowest = is_lowest(simulator.mesh.rest)
    assert done.forces is not None
    weight = DENSITY * simulator.mesh.node_area[lowest].sum() * GRAVITY
    return (float(done.forces[0, lowest, 2].sum()) - weight) / (LOAD * width) - 1


def elastica(length: float, bending_length: float) -> tuple[float, float]:
    """Return reach and drop [m] of the tip of a heavy strip that is clamped horizontally."""
    s = np.linspace(0, length, 60)

    def slope(at: Floats, y: Floats) -> Floats:  # angle, its slope, reach and drop on the way from the tip
        return np.stack([y[1], -at * np.cos(y[0]) / bending_length**3, -np.cos(y[0]), -np.sin(y[0])])

    near = 1 / np.sqrt(length / bending_length**3 + 1 / length**2)  # of the clamp, where a long strip bends down
    angle = 1.5 * (1 - np.exp((s - length) / near))
    guess = np.stack([angle, -1.5 / near * np.exp((s - length) / near), 0.5 * (length - s), 0.5 * (length - s)])
    found = solve_bvp(
        slope, lambda tip, clamp: np.array([tip[1], clamp[0], clamp[2], clamp[3]]), s, guess, tol=1e-8, max_nodes=20000
    )
    assert found.success, found.message
    return float(found.y[2, 0]), float(found.y[3, 0])


def overhanging(resolution: Resolution, bending_length: float) -> tuple[float, float]:
    """Return reach and drop [m] of the tip of the simulated strip; the clamp holds one element."""
    elements = round(OVERHANG / (3 * resolution.spacing))
    strip = OVERHANG / elements
    garment = square(0.2, OVERHANG + strip)
    lying = LEVEL * np.array([1.0] * 6 + [1.0, -1.0, 1.0])  # the free end ahead
    support = clamps(Clamp(lambda p: p[:, 1] > -strip - 1e-9, still(lying)), start=lying)
    stiffness = DENSITY * GRAVITY * bending_length**3
    done, simulator = bench(
        garment, support, Resolution(spacing=strip / 3, step_share=resolution.step_share), 5.0,
        bending_stiffness=stiffness, dampings=(10.0,),
    )  # fmt: skip
    assert done.shapes is not None
    tip = done.shapes[0, -1][simulator.mesh.rest[:, 1] < 1e-9 - OVERHANG - strip].mean(0)
    return float(tip[1]) - strip, -float(tip[2])


def peirce_error(resolution: Resolution) -> float:
    """Return the error of the bending length by Peirce's formula at an overhang of twice the bending length."""
    true = OVERHANG / SHORT
    reach, drop = overhanging(resolution, true)
    angle = np.arctan2(drop, reach)
    return float(OVERHANG * np.cbrt(np.cos(angle / 2) / (8 * np.tan(angle)))) / true - 1


def elastica_error(resolution: Resolution) -> float:
    """Return the error of the tip's position, over its drop, at an overhang of three times the bending length."""
    expected = np.array(elastica(OVERHANG, OVERHANG / LONG))
    return float(np.linalg.norm(np.array(overhanging(resolution, OVERHANG / LONG)) - expected) / expected[1])


def falling_error(resolution: Resolution) -> float:
    """Return the error of the terminal speed of a free horizontal sheet."""
    done, _ = bench(square(0.4, 0.45), clamps(start=LEVEL), resolution, 2.0, drag=DRAG, dampings=(0.0,))
    assert done.shapes is not None
    height = done.shapes[0, :, :, 2].mean(1)
    speed = (height[-7] - height[-1]) / (6 * FRAME)
    return float(speed) / np.sqrt(2 * DENSITY * GRAVITY / (AIR_DENSITY * DRAG)) - 1

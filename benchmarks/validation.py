"""Compare the cloth with closed forms, each at three meshes and three steps, and at a coarse mesh for information.

Run: python benchmarks/validation.py. Unless said otherwise, a sheet of 0.4 m x 0.45 m and 0.2 kg/m^2 hangs from a bar.
The bar is as far from the origin as in front of a sensor. References:

    swing      zeros of J0: omega_k = j_k / 2 sqrt(g / L), a hanging chain (H. Lamb, "Higher Mechanics", 1920)
    bending    omega of (T w')' - B w'''' + rho omega^2 w = 0, T = rho g z, hinged above, free below; solved here by
               Chebyshev collocation; very stiff sheets swing as a rigid plate, omega^2 = 3 g / (2 L). The second mode
               is compared: of card it goes with B^0.30, the first with B^0.004, limp and rigid being 2 % apart
    its damping  B (1 + tau d/dt) in place of B: to first order the mode decays at tau/2 of what B adds to omega^2, so
               at tau omega^2 (d ln omega / d ln B) per second
    stretch    k/2 l (l^2 - 1) = rho g (L - z) for the stretch l(z)   St. Venant-Kirchhoff under its own weight
    energy     no damping: all of it, 10 s later (`validation_energy.py`); damping c: the first swing decays at c / 2
    trajectory the tracked points of a swung swatch against a mesh of twice as many elements at half the step

Shear frame, bias extension, load, cantilever and falling sheet: `validation_clamped.py`.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq, curve_fit
from scipy.special import jn_zeros

from formats.arrays import Floats

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.validation_clamped import (
    bias_extension_error,
    elastica_error,
    falling_error,
    load_error,
    peirce_error,
    shear_frame_error,
)
from benchmarks.validation_energy import DENSITY, LENGTH, WIDTH, energy_drift
from fit.cloth.model import Resolution
from formats.nature import GRAVITY
from tests.fit.scenes import material, sheet, simulate_take, swing

SPACINGS = (0.05, 0.033, 0.025)  # m: the default of fits, and finer; three, four to five and six elements down
COARSE = 0.1  # m, two elements down: for information, since fits use it on request only
STEPS = (1.0, 0.5, 0.25)  # of the stable one
FRAME = 1 / 60
AWAY = np.array([0.0, 1.5, 0.0])  # m from the origin
CARD = 0.01  # N m, bending stiffness of card
LIMP = {"bending_stiffness": 1e-9, "bending_damping_time": 0.0, "membrane_damping_time": 0.0}


@dataclass(frozen=True)
class Case:
    """Name, allowed relative error, and the error [1] at a resolution."""

    name: str
    allowed: float
    error: Callable[[Resolution], float]


def bottom(resolution: Resolution, displacement: Floats, time: Floats, **changes: float) -> Floats:
    """Return the motion of the bottom's middle across the sheet, from `AWAY`, and down [m], (frames, 2)."""
    garment = sheet(width=WIDTH, height=LENGTH, mass=DENSITY * WIDTH * LENGTH)
    chosen = {**LIMP, "stretch_stiffness": 2000.0, "shear_stiffness": 100.0, "velocity_damping": 0.0, **changes}
    take = simulate_take(garment, time, displacement + AWAY, material(garment, **chosen), resolution=resolution)
    return np.asarray((take.points - AWAY)[:, 2][:, [1, 2]])


def limp_modes(count: int) -> Floats:
    """Return the lowest angular frequencies [1/s] of a sheet without bending stiffness, ascending."""
    return np.asarray(jn_zeros(0, count) / 2 * np.sqrt(GRAVITY / LENGTH))


def ring(
    resolution: Resolution, mode: int = 1, *, modes: Floats | None = None, seconds: float = 8.0,
    amplitude: float = 0.004, **changes: float,
) -> tuple[float, float]:  # fmt: skip
    """Return angular frequency [1/s] and decay [1/s] of a mode, from 1, after an excitation near its frequency.

    modes: frequencies to expect [1/s], ascending; those of a limp sheet where none are given
    """
    expected = limp_modes(4) if modes is None else modes
    guess = float(expected[mode - 1])
    hertz = guess / (2 * np.pi)
    stop = 0.5 + 2.0 / hertz
    time = np.arange(0, seconds + stop + 0.4, FRAME)
    moved = bottom(resolution, swing(time, amplitude=amplitude, hz=hertz, start=0.3, stop=stop), time, **changes)
    late = time > stop + 0.35
    others = [float(w) for w in expected if abs(w - guess) > 0.3 * guess][:2]
    return fitted(time[late], moved[late, 0], guess, others)


def fitted(time: Floats, moved: Floats, guess: float, others: Sequence[float]) -> tuple[float, float]:
    """Return frequency and decay of the strongest mode near `guess`, fitted together with two others."""

    def waves(t: Floats, *p: float) -> Floats:
        total = np.full_like(t, p[0])
        for k in range(3):
            a, b, omega, decay = p[1 + 4 * k : 5 + 4 * k]
            total = total + np.exp(-decay * (t - t[0])) * (a * np.cos(omega * t) + b * np.sin(omega * t))
        return total

    start = [0.0]
    size = float(np.ptp(moved)) / 4
    for w in (guess, *others):
        start += [size, size, w, 0.05]
    found, _ = curve_fit(waves, time, moved, p0=start, maxfev=20000)
    return float(found[3]), float(found[4])


def swing_error(mode: int, resolution: Resolution) -> float:
    """Return the error of the first or second swing of a limp sheet, small enough to be linear."""
    return ring(resolution, mode, seconds=5.0, amplitude=0.0005)[0] / limp_modes(mode)[-1] - 1


@functools.cache
def bending_modes(stiffness: float, nodes: int = 40) -> Floats:
    """Return the four lowest angular frequencies [1/s] of a hanging sheet with bending stiffness, by collocation."""
    from scipy.linalg import eig

    k = np.arange(nodes + 1)
    x = np.cos(np.pi * k / nodes)
    c = np.where((k == 0) | (k == nodes), 2.0, 1.0) * (-1.0) ** k
    gap = x[:, None] - x[None]
    slope = np.outer(c, 1 / c) / (gap + np.eye(nodes + 1))
    slope -= np.diag(slope.sum(1))
    slope *= 2 / LENGTH  # z from 0, the free bottom (last), to L, the hinge (first)
    z = (x + 1) * LENGTH / 2
    second = slope @ slope
    operator = -(slope @ np.diag(DENSITY * GRAVITY * z) @ slope) + stiffness * second @ second
    mass = DENSITY * np.eye(nodes + 1)
    for row, condition in ((0, np.eye(nodes + 1)[0]), (1, second[0]), (-1, second[-1]), (-2, (second @ slope)[-1])):
        operator[row], mass[row] = condition, 0.0
    values = eig(operator, mass, right=False)
    real = values.real[np.isfinite(values) & (np.abs(values.imag) < 1e-3) & (values.real > 1.0)]
    return np.asarray(np.sqrt(np.sort(real)[:4]))


def ring_card(resolution: Resolution, damping_time: float = 0.0) -> tuple[float, float]:
    """Return frequency and decay [1/s] of the second swing of a sheet as stiff as card."""
    changes = {"bending_stiffness": CARD, "shear_stiffness": 300.0, "bending_damping_time": damping_time}
    return ring(resolution, 2, modes=bending_modes(CARD), seconds=3.0, amplitude=0.0005, **changes)


def bending_error(resolution: Resolution) -> float:
    """Return the error of the frequency of the second swing of card."""
    return float(ring_card(resolution)[0] / bending_modes(CARD)[1] - 1)


def bending_damping_error(resolution: Resolution) -> float:
    """Return the error of the decay of card's second swing at a bending damping time of 5 ms."""
    damping_time, apart = 0.005, 0.01
    less, same, more = (bending_modes(CARD * np.exp(s))[1] for s in (-apart, 0.0, apart))
    theory = damping_time * same**2 * np.log(more / less) / (2 * apart)
    return float(ring_card(resolution, damping_time)[1] / theory - 1)


def stretch_error(resolution: Resolution) -> float:
    """Return the error of the elongation under the sheet's weight at 40 N/m."""
    stiffness = 40.0
    heights = np.linspace(0, LENGTH, 2001)
    stretched = [brentq(lambda s, h=h: stiffness / 2 * s * (s**2 - 1) - DENSITY * GRAVITY * h, 1, 2) for h in heights]
    theory = float(np.trapezoid(np.array(stretched) - 1, heights))
    time = np.arange(0, 3, FRAME)
    moved = bottom(resolution, np.zeros((len(time), 3)), time, stretch_stiffness=stiffness, velocity_damping=6.0)
    return (-moved[-1, 1] - LENGTH) / theory - 1


def damping_error(resolution: Resolution) -> float:
    """Return the error of the decay of the first swing at a damping of 0.6 1/s."""
    return ring(resolution, seconds=6.0, velocity_damping=0.6)[1] / 0.3 - 1


def part(displacement: Floats, time: Floats, one: Resolution, other: Resolution) -> Floats:
    """Return the two resolutions' difference per frame over the motion's size, (frames,); bottom corners and middle."""
    garment = sheet(width=WIDTH, height=LENGTH, mass=DENSITY * WIDTH * LENGTH)
    row = material(garment, velocity_damping=1.0, bending_stiffness=5e-5)
    moved = displacement + AWAY
    first, second = (simulate_take(garment, time, moved, row, resolution=r).points for r in (one, other))
    own = second - moved[:, None]
    motion = np.sqrt(((own - own.mean(0)) ** 2).sum(2)[:, 2:].mean())
    return np.asarray(np.sqrt(((first - second) ** 2).sum(2)[:, 2:].mean(1)) / motion)


def trajectory_error(resolution: Resolution) -> float:
    """Return the difference of tracked points, swung for 4 s, to a mesh twice as fine at half the step."""
    time = np.arange(0, 4, 1 / 30)
    moved = swing(time, amplitude=0.06, hz=0.8, sideways=0.02, stop=2.5)
    finer = Resolution(spacing=resolution.spacing / 2, step_share=resolution.step_share / 2)
    return float(np.sqrt((part(moved, time, resolution, finer) ** 2).mean()))


def horizon() -> float:
    """Return the time [s] for which a hard swing, whose corners flutter, agrees within 3 % on 25 and 17 mm meshes."""
    time = np.arange(0, 4, 1 / 30)
    moved = swing(time, amplitude=0.1, hz=0.8, sideways=0.03, stop=2.5)
    apart = part(moved, time, Resolution(spacing=0.025), Resolution(spacing=0.0167))
    late = np.flatnonzero(apart > 0.03)
    return float(time[late[0]] if len(late) else time[-1])


CASES = (
    Case("first swing", 0.01, lambda r: swing_error(1, r)),
    Case("second swing", 0.01, lambda r: swing_error(2, r)),
    Case("second swing with bending 0.01 N m", 0.03, bending_error),
    Case("its decay at a bending damping time of 5 ms", 0.05, bending_damping_error),
    Case("stretch under its own weight", 0.01, stretch_error),
    Case("force of a load beside its own weight", 0.01, load_error),
    Case("torque on a shear frame", 0.02, shear_frame_error),
    Case("force of a bias extension", 0.05, bias_extension_error),
    Case("cantilever: Peirce's bending length", 0.03, peirce_error),
    Case("heavy elastica: place of the tip", 0.03, elastica_error),
    Case("terminal speed of a falling sheet", 0.01, falling_error),
    Case("energy over 10 s, no damping", 0.01, energy_drift),
    Case("decay at 0.6 1/s", 0.05, damping_error),
    Case("swung swatch, mesh doubled and step halved", 0.03, trajectory_error),
)


def main() -> None:
    """Print relative errors in percent: three meshes at the stable step, more steps on the first, the coarse mesh."""
    columns = [f"{1e3 * h:.0f} mm" for h in SPACINGS] + [f"step x{s:g}" for s in STEPS[1:]]
    columns.append(f"({1e3 * COARSE:.0f} mm)")
    print(f"{'':44s} allowed " + "".join(f"{c:>10s}" for c in columns))
    for case in CASES:
        errors = [case.error(Resolution(spacing=h)) for h in SPACINGS]
        errors += [case.error(Resolution(spacing=SPACINGS[0], step_share=s)) for s in STEPS[1:]]
        errors.append(case.error(Resolution(spacing=COARSE)))
        print(f"{case.name:44s} {100 * case.allowed:5.0f} % " + "".join(f"{100 * e:9.2f}%" for e in errors), flush=True)
    print(f"hard swing of 0.1 m, 0.03 m sideways: predictable within 3 % for {horizon():.1f} s")


if __name__ == "__main__":
    main()

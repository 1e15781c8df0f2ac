"""The project's own generator of swung-cloth motion, in double precision, independent of the fitter's simulator.

The generator differs from the simulator on purpose. It has equilateral triangles twice as fine and cotangent hinges.
Its ground is neo-Hookean with Poisson coupling and two fibre families. Its steps are velocity Verlet, and its air law
depends on the angle (`fit.blind.kernel`, `fit.blind.sheet`).

Stable step with the highest frequency omega and the highest damping rate d:  dt < 4 / (sqrt(d^2 + 4 omega^2) + d).
Source: T. Belytschko, W. K. Liu, B. Moran, "Nonlinear Finite Elements for Continua and Structures", section 6.2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fit import runtime
from fit.blind.sheet import Sheet, bending_rate, make_sheet, membrane_rate, place_on
from fit.errors import BlowUpError, FitError
from formats.arrays import Floats
from formats.nature import GRAVITY

TRIANGLE_SIDE = 0.016  # m, mean edge of its triangles: two thirds of the fitter's finest
SAMPLES_A_SECOND = 200  # samples per second: swung cloth moves below 10 Hz
FLAT_SAFETY = 0.7  # of the linear limit, as the bound holds for the flat sheet
# s that the sheet hangs still before a take. Our choice: of a critically damped swing 1.7 % are left. At half 20 % are
# left; at twice 0.03 %, for 2 s more of simulation.
HANGING_TIME = 2.0
HANGING_DAMPING = 6.0  # 1/s during that time: critical for the slowest swing
POISSON = 0.3  # of the ground; our choice: a usual ratio of solids. Half and double were not tried
MOST_GROUND = 0.9  # of the stretch stiffness: the rest belongs to the fibres
HEM_WIDTH = 0.02  # m: width of the hem
HEM_BENDING = 3.0  # times the bending stiffness of the cloth; our choice: a hem folded twice has three sliding layers
MAGNET_AT = 0.65  # of the height below the held edge; our choice: at twice there is no cloth, half was not tried
MAGNET_REACH = 0.05  # m: decay length of the magnet's pull
LIGHTEST_NODE = 0.1  # of its mass: least mass of a node under an uneven distribution
POLES = ("thread_x", "thread_y", "thread_z", "magnet_x", "magnet_y", "magnet_z")  # m, of each take its own


@dataclass(frozen=True, kw_only=True)
class Cloth:
    """Parameters of a sheet and of all forces on it; a size of 0 switches a force off exactly.

    - `width`, `height` [m]
    - `density` [kg/m^2]
    - `stretch`, `shear` [N/m]
    - `bending` [N m]
    - `damping` [1/s], linear
    - `stretch_ratio`, `bending_ratio`: logarithms of warp over weft
    - `stiffening` [1]
    - `stretch_time` [s]
    - `bend_viscosity` [N m s]
    - `friction` [N]
    - `curl` [1/m]: rest curvature about the horizontal and about the vertical
    - `hem` [kg/m]
    - `mass_slope` [1]: relative growth of the density across and down
    - `gravity_tilt` [rad]: about the vertical, in x and y
    - `drag`, `lift` [1]
    - `wind` [m/s], (3,)
    - `gust_phase` [rad]
    - `added_mass` [kg/m^2]
    - `wake` [N s/m^3], `wake_time` [s]: force with memory
    - `bob` [kg], `bob_length` [m]: weight on a string at a corner
    - `thread` [N/m]: from a corner to the room
    - `magnet` [N]: behind the lower middle
    - `corner`: -1 left, 1 right
    """

    width: float
    height: float
    # Our choice: the plain fabric of `fit.cloth.material`.
    density: float = 0.2
    stretch: float = 300.0  # as above
    shear: float = 30.0  # as above
    bending: float = 1.4e-5  # as above
    damping: float = 0.5  # as above
    stretch_ratio: float = 0.0
    bending_ratio: float = 0.0
    stiffening: float = 0.0
    stretch_time: float = 0.0
    bend_viscosity: float = 0.0
    friction: float = 0.0
    curl: tuple[float, float] = (0.0, 0.0)
    hem: float = 0.0
    mass_slope: tuple[float, float] = (0.0, 0.0)
    gravity_tilt: tuple[float, float] = (0.0, 0.0)
    drag: float = 0.0
    lift: float = 0.0
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust_phase: float = 0.0
    added_mass: float = 0.0
    wake: float = 0.0
    wake_time: float = 0.4  # our choice: somewhat less than half a swing
    bob: float = 0.0
    bob_length: float = 0.06  # our choice: a pendulum of 2 Hz, faster than the cloth
    thread: float = 0.0
    magnet: float = 0.0
    corner: int = 1

    @property
    def mass(self) -> float:
        """Weighed mass of the cloth [kg], with the hem and without foreign objects."""
        return self.density * self.width * self.height + self.hem * self.width


@dataclass(frozen=True)
class Motion:
    """Motion of a batch of takes: time [s], (samples,); points [m], (takes, samples, points, 3), world frame, z up.

    shapes, (takes, samples, nodes, 6): positions [m] and velocities [m/s], or None.
    """

    time: Floats
    points: Floats
    shapes: Floats | None
    steps: int


class Engine:
    """Simulate one cloth, held along its top edge, in several takes."""

    def __init__(
        self, cloth: Cloth, *, side: float = TRIANGLE_SIDE, step_share: float = 1.0,
        mesh: Callable[[float, float, float], Sheet] = make_sheet,
    ) -> None:  # fmt: skip
        if not 0 < side <= min(cloth.width, cloth.height) / 2:
            raise FitError(
                f"{side} m does not fit the sheet", where="--side", advice="choose less than half its smaller side"
            )
        self.cloth, self.step_share = cloth, step_share
        self.sheet = mesh(cloth.width, cloth.height, side)
        self.node_mass = _node_mass(cloth, self.sheet)
        self.hinge_bending, self.hinge_curl = _hinge_rows(cloth, self.sheet)
        ground = 2 * (1 + POISSON) * cloth.shear
        if ground > MOST_GROUND * cloth.stretch:
            highest = MOST_GROUND * cloth.stretch / (2 * (1 + POISSON))
            raise FitError(
                f"{cloth.shear:g} N/m is too much for a stretch stiffness of {cloth.stretch:g} N/m", where="shear",
                advice=f"choose {highest:.3g} N/m or less",
            )  # fmt: skip
        fibre = cloth.stretch - ground
        self.fibres = fibre * np.exp(cloth.stretch_ratio / 2), fibre * np.exp(-cloth.stretch_ratio / 2)
        self.lam = 2 * POISSON / (1 - POISSON) * cloth.shear

    @property
    def stable_step(self) -> float:
        """The largest step [s] that the linear bound allows, times a margin."""
        cloth, sheet = self.cloth, self.sheet
        lightest = float((self.node_mass / sheet.node_area).min())
        fibre = max(self.fibres) * (1 + 0.1 * cloth.stiffening)
        omega2 = membrane_rate(sheet, fibre + self.lam + 2 * cloth.shear, self.lam, cloth.shear) / lightest
        hinge = bending_rate(sheet) / lightest
        omega2 += hinge * (float(self.hinge_bending.max()) + cloth.friction / 4.0)
        rate = membrane_rate(sheet, fibre * cloth.stretch_time, 0.0, 0.0) / lightest + hinge * cloth.bend_viscosity
        return float(FLAT_SAFETY * 4 / (np.sqrt(rate**2 + 4 * omega2) + rate))

    def run(
        self, ends: Floats, duration: float, places: Floats, *, settle: float = HANGING_TIME, shapes: bool = False
    ) -> Motion:
        """Run the simulator over the whole motion of the hanger.

        - `ends` [m], (takes, n, 6): left and right end of the held edge, evenly spaced over `duration` [s], world frame
        - `places` [m], (points, 2): positions of the points on the flat sheet.

        Raises:
            BlowUpError: a simulation did not stay finite.
        """
        runtime.start()
        from fit.blind import kernel

        sheet, takes, nodes = self.sheet, len(ends), len(self.sheet.rest)
        every = int(np.ceil(1 / (SAMPLES_A_SECOND * self.step_share * self.stable_step)))
        dt = 1 / (SAMPLES_A_SECOND * every)
        samples = round(duration * SAMPLES_A_SECOND) + 1
        steps = (samples - 1) * every
        path = resample(ends, duration, np.linspace(0.0, steps * dt, steps + 1))
        x = runtime.jittered(hung(path[:, 0], sheet))
        numbers = self.numbers()
        bob = np.zeros((takes, 2, 3))
        bob[:, 0] = x[:, int(numbers["bob_node"])] - [0.0, 0.0, self.cloth.bob_length]
        carried, weights = place_on(sheet, np.asarray(places, float))
        groups = -(-takes // kernel.TAKE_LANES)
        seen = _rows(groups, samples, 3 * len(carried))
        kept = _rows(groups, samples, 6 * nodes) if shapes else _rows(1, 1, 6)
        with runtime.vectors_kept():
            kernel.rollout(
                x=_in_lanes(x.reshape(takes, -1)), v=_rows(groups * 3 * nodes), f=_rows(groups * 3 * nodes),
                acceleration=_rows(groups * 3 * nodes), normal=_rows(groups * 3 * nodes),
                wake=_rows(groups * len(sheet.area)), slip=_rows(groups * 3 * len(sheet.hinges)),
                bob=_in_lanes(bob.reshape(takes, -1)), triangles=sheet.triangles.ravel(),
                inverse=sheet.inverse.ravel(), area=sheet.area, hinges=sheet.hinges.ravel(),
                cotangents=sheet.hinge_cotangents.ravel(), hinge_area=sheet.hinge_area, bending=self.hinge_bending,
                curl=self.hinge_curl, mass=self.node_mass, air_mass=_air_mass(sheet), spot=magnet_spot(sheet),
                held=sheet.held, fraction=held_fraction(sheet),
                path=_in_lanes(path.reshape(takes, -1)).reshape(-1, 6, kernel.TAKE_LANES),
                poles=_in_lanes(self.poles(x)).reshape(groups, -1, kernel.TAKE_LANES),
                p=np.array([numbers[name] for name in kernel.NUMBER_NAMES]), dt=dt, settle_steps=round(settle / dt),
                settle_damping=HANGING_DAMPING, every=every, point_nodes=carried, point_weights=weights, seen=seen,
                shapes=kept, keep_shapes=int(shapes),
            )  # fmt: skip
        points = _from_lanes(seen, takes).reshape(takes, samples, -1, 3)
        states = _from_lanes(kept, takes).reshape(takes, samples, nodes, 6) if shapes else None
        if not (np.abs(points) < 100.0).all():  # metres: far outside any room
            raise BlowUpError(
                "the generator's cloth flew apart", where=f"step {dt:.2e} s", advice="make the case with another seed"
            )
        return Motion(np.arange(samples) / SAMPLES_A_SECOND, points, states, steps + round(settle / dt))

    def numbers(self) -> dict[str, float]:
        """Return the physical parameters [SI] common to all takes."""
        cloth = self.cloth
        across, away = np.sin(cloth.gravity_tilt)
        down = -np.sqrt(1 - across**2 - away**2)
        known = {
            "gravity_x": GRAVITY * across, "gravity_y": GRAVITY * away, "gravity_z": GRAVITY * down,
            "damping": cloth.damping, "mu": cloth.shear, "lam": self.lam, "fibre_warp": self.fibres[0],
            "fibre_weft": self.fibres[1], "stiffening": cloth.stiffening, "stretch_time": cloth.stretch_time,
            "bend_viscosity": cloth.bend_viscosity, "friction": cloth.friction, "drag": cloth.drag,
            "lift": cloth.lift, "wind_x": cloth.wind[0], "wind_y": cloth.wind[1], "wind_z": cloth.wind[2],
            "gust_phase": cloth.gust_phase, "wake": cloth.wake, "wake_time": cloth.wake_time,
            "added_mass": cloth.added_mass, "bob_mass": cloth.bob, "bob_length": cloth.bob_length,
            "bob_node": self._corner, "thread": cloth.thread, "thread_node": self._corner,
            "thread_length": float(np.linalg.norm(self._tie)), "magnet": cloth.magnet, "magnet_reach": MAGNET_REACH,
        }  # fmt: skip
        return {name: float(value) for name, value in known.items()}

    def poles(self, x: Floats) -> Floats:
        """Return `POLES` [m], (takes, 6), from the nodes' initial positions, (takes, nodes, 3)."""
        magnet = self.sheet.node_at(0.0, -MAGNET_AT * self.sheet.height)
        return np.hstack([x[:, self._corner] + self._tie, x[:, magnet] + [0.0, 0.06, 0.0]])

    @property
    def _corner(self) -> int:
        return self.sheet.node_at(self.cloth.corner * self.sheet.width / 2, -self.sheet.height)

    @property
    def _tie(self) -> Floats:
        """Return the vector from the corner to its thread's fixed end [m], (3,)."""
        return np.array([0.25 * self.cloth.corner, 0.1, -0.15])


def _node_mass(cloth: Cloth, sheet: Sheet) -> Floats:
    """Return nodal masses [kg], (nodes,): a quarter-sine slope with a linear slope's first moment, and the hem."""
    xi, eta = 2 * sheet.rest[:, 0] / sheet.width, -2 * sheet.rest[:, 1] / sheet.height - 1
    same_moment = np.pi**2 / 12
    slope = cloth.mass_slope[0] * np.sin(np.pi * xi / 2) + cloth.mass_slope[1] * np.sin(np.pi * eta / 2)
    mass = sheet.node_area * np.maximum(1 + same_moment * slope, LIGHTEST_NODE)
    return np.asarray(mass * cloth.density * sheet.width * sheet.height / mass.sum() + cloth.hem * sheet.bottom_length)


def _hinge_rows(cloth: Cloth, sheet: Sheet) -> tuple[Floats, Floats]:
    """Bending stiffness [N m] and resting hinge curvature [1/m], (hinges,).

    Curvature down the sheet loads only the level edges, with 3 kappa. Curvature across the sheet loads the level edges
    with -kappa and the slanting ones with 2 kappa. So B_warp = B_level and B_weft = (B_level + 8 B_slanting) / 9.
    """
    steep = sheet.hinge_across[:, 1] ** 2
    warp, weft = cloth.bending * np.exp(cloth.bending_ratio / 2), cloth.bending * np.exp(-cloth.bending_ratio / 2)
    slanting = max((9 * weft - warp) / 8, 0.1 * weft)
    stiffness = np.where(steep > 0.7, warp, slanting)
    if cloth.hem > 0:
        middle = sheet.rest[sheet.hinges[:, :2]].mean(1)[:, 1]
        stiffness = np.where(middle < HEM_WIDTH - sheet.height, HEM_BENDING * stiffness, stiffness)
    curl = cloth.curl[0] * (4 * steep - 1) + cloth.curl[1] * (4 * sheet.hinge_across[:, 0] ** 2 - 1)
    # more curled at the bottom, as cloth comes off a roll; its mean over the sheet is the amplitude
    place = -sheet.rest[sheet.hinges[:, :2]].mean(1)[:, 1] / sheet.height
    return stiffness, np.asarray(curl * (0.6 + 0.8 * place))


def _air_mass(sheet: Sheet) -> Floats:
    """Return area [m^2] times the share of carried air, (nodes,): 1 in the middle, falling to zero at the edges."""
    xi, eta = 2 * sheet.rest[:, 0] / sheet.width, -2 * sheet.rest[:, 1] / sheet.height - 1
    return np.asarray(sheet.node_area * (np.clip(1 - xi**2, 0, 1) * np.clip(1 - eta**2, 0, 1)) ** 0.6)


def magnet_spot(sheet: Sheet) -> Floats:
    """Return the nodes' shares of the magnet's pull, (nodes,)."""
    spot = np.exp(-((sheet.rest - MAGNET_AT * np.array([0.0, -sheet.height])) ** 2).sum(1) / MAGNET_REACH**2)
    spot[spot < 0.01] = 0.0
    return np.asarray(spot / spot.sum())


def held_fraction(sheet: Sheet) -> Floats:
    """Return the positions of the held nodes along the held edge, (held,), from 0 to 1."""
    return np.asarray(sheet.rest[sheet.held, 0] / sheet.width + 0.5)


def hung(ends: Floats, sheet: Sheet) -> Floats:
    """The flat sheet below the held edge's ends, (takes, 6) -> (takes, nodes, 3)."""
    left, right = ends[:, None, :3], ends[:, None, 3:]
    share = (sheet.rest[:, 0] / sheet.width + 0.5)[None, :, None]
    places = (1 - share) * left + share * right
    places[..., 2] += sheet.rest[:, 1]
    return np.ascontiguousarray(places)


def resample(ends: Floats, duration: float, instants: Floats) -> Floats:
    """Return a smooth path of the ends at every step, (takes, steps, 6)."""
    from scipy.interpolate import CubicSpline

    given = np.linspace(0.0, duration, ends.shape[1])
    return np.ascontiguousarray(np.swapaxes(CubicSpline(given, np.swapaxes(ends, 0, 1))(instants), 0, 1))


def _rows(*shape: int) -> Floats:
    """Return rows of zeros, one vector of takes each."""
    from fit.blind.kernel import TAKE_LANES

    return runtime.aligned_zeros((*shape, TAKE_LANES), np.float64)


def _in_lanes(values: Floats) -> Floats:
    """Reorder (takes, n) to (groups x n, lanes); the last take fills the remaining lanes."""
    from fit.blind.kernel import TAKE_LANES

    groups = -(-len(values) // TAKE_LANES)
    chosen = values[np.minimum(np.arange(groups * TAKE_LANES), len(values) - 1)].reshape(groups, TAKE_LANES, -1)
    placed = _rows(groups * values.shape[1])
    placed[...] = np.swapaxes(chosen, 1, 2).reshape(placed.shape)
    return placed


def _from_lanes(values: Floats, takes: int) -> Floats:
    """Reorder (groups, samples, n, lanes) to (takes, samples, n)."""
    moved = np.moveaxis(values, -1, 1)
    return np.ascontiguousarray(moved.reshape(-1, *moved.shape[2:])[:takes])

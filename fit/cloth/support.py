"""Support of the cloth by a hanger, and its initial shape and settling.

Held nodes follow handles, vectors that move:
    x_h(t) = sum_k s_hk handle_k(t)
A hanger has two handles, the ends of the held edge, with s = (1 - s_h, s_h). Other supports have other handles, such as
the clamps of `benchmarks/clamps.py`.

Before the take the cloth settles. It hangs at the hanger's first pose, for a fifth of the time under a pull to the
points' first positions, then freely. Damping at the rate c < 2 omega stills a swing at omega as e^(-c t / 2). Damping
with c far larger than omega stills it as e^(-omega^2 t / c). Critical damping leaves the smallest remainder of the
slowest swing,
    c = 2 omega_1,  omega_1 = 1.2024 sqrt(g / L),  remainder (1 + omega_1 t) e^(-omega_1 t),
for a sheet of length L (2 x 1.2024 is the first zero of J0: D. Bernoulli, 1733). The remainder is 0.6 % at 0.45 m in
1.28 s. Cloth with more damping of its own keeps that damping. Source of critical damping on the way to a static
solution: A. S. Day, "An introduction to dynamic relaxation", The Engineer 219 (1965). `benchmarks/settling.py` measures
the remainder.

Cloth that hangs from a whole edge has one equilibrium, which settling finds. Cloth held at two corners is slack between
them. It hangs in folds, to one side or the other, so that several equilibria exist. So this cloth starts at the tracked
points' first positions. The polyharmonic spline through the points' displacements u_k moves the flat cloth there,
    u(X) = a + B X + sum_k w_k |X - X_k|^3,   sum_k w_k = 0, sum_k w_k X_k = 0
and the cloth settles from this start.

Source: J. Duchon, "Splines minimizing rotation-invariant semi-norms in Sobolev spaces" (1977).

Elements whose nodes are all held do not bend. So the curvature at their rim belongs to the free side's share of the
node alone. The shares m of both sides give M = m_1 kappa_1 + m_2 kappa_2 + kink with kappa_1 = 0. The energy is then
B/2 M^2 / m_2, and B/2 M^2 / (m_1 + m_2) for two free sides. With the latter, a clamp would be soft over a twelfth of an
element.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fit.cloth.mesh import ClothMesh
from fit.recordings.recording import LONGEST_BRIDGE, Curve, Recording
from formats.arrays import Floats, Indices
from formats.nature import GRAVITY

ON_LINE = 1e-3  # m, a marker's accuracy: points nearer to a line do not determine the cloth beside the line
# s that cloth hangs at the first hanger pose before the take begins. Our choice: 0.6 % of a swing of 0.45 m remain, by
# the equation above. At half 13 % remain; twice costs a fifth of the time of a take of 6 s.
SETTLE_TIME = 1.6
FIRST_SWING = 1.2024  # of a hanging sheet, over sqrt(g / L): half the first zero of J0


@dataclass(frozen=True)
class Support:
    """Held nodes and their handles, start, settling and gravity.

    - `nodes`, (held,)
    - `shares`, (held, handles): weights of the handles in each held node's position
    - `path`: (n,) instants [s] -> (n, 3 handles) [m], world frame
    - `start`: handles at the beginning, (candidates, 3 handles) -> positions of the nodes [m], (candidates, nodes, 3)
    - `settle_time` [s]: time at the first pose before the take begins, with the damping `settle_damping` [1/s]
    - `gravity` [m/s^2], along -z
    """

    nodes: Indices
    shares: Floats
    path: Curve
    start: Curve
    settle_time: float = SETTLE_TIME
    settle_damping: float = 0.0
    gravity: float = GRAVITY

    @property
    def handles(self) -> int:
        """Number of vectors that the held nodes follow."""
        return self.shares.shape[1]


Supporting = Callable[[ClothMesh], Support]


def hanger(recording: Recording) -> Supporting:
    """Return the support of a recording's cloth: the held edge or its two ends, on the tracked path."""

    def support(mesh: ClothMesh) -> Support:
        moved = _seen_folds(recording, mesh)
        length = float(np.ptp(mesh.rest[:, 1]))
        return Support(
            nodes=mesh.held_nodes,
            shares=np.stack([1 - mesh.held_fraction, mesh.held_fraction], 1),
            path=recording.held,
            start=lambda ends: _hanging_flat(mesh, ends) + moved,
            settle_damping=float(2 * FIRST_SWING * np.sqrt(GRAVITY / length)),
        )

    return support


def clamped(mesh: ClothMesh, support: Support) -> ClothMesh:
    """Return the mesh with the bends at the rims of held elements counted on their free sides only."""
    is_held = np.zeros(len(mesh.rest), bool)
    is_held[support.nodes] = True
    inside = is_held[mesh.cells].all(1)
    if not inside.any():
        return mesh
    shares = mesh.cell_area[inside].ravel()
    held_area = np.bincount(mesh.cells[inside].ravel(), shares, len(mesh.rest))
    free = 1 - held_area / mesh.node_area
    bends, plain = mesh.bends, len(mesh.bends.stencils)
    kept = np.where(free > 1e-6, free, 1.0)[bends.centre[:plain]]
    area = bends.area.copy()
    area[:plain] *= kept
    stencils = replace(bends.stencils, weights=bends.stencils.weights / np.sqrt(kept[bends.stencils.rows()])[:, None])
    return replace(mesh, bends=replace(bends, stencils=stencils, area=area))


def _seen_folds(recording: Recording, mesh: ClothMesh) -> Floats:
    """Return the initial displacements from flat hanging [m], (nodes, 3), of cloth held at its corners; else 0."""
    is_seen = recording.valid[recording.time <= LONGEST_BRIDGE].any(0) & recording.has_curve
    places = np.array([point.at_m for point in recording.garment.points])[is_seen]
    if recording.garment.held != "corners" or np.linalg.matrix_rank(places - places[:1], tol=ON_LINE) < 2:
        return np.zeros((len(mesh.rest), 3))
    from scipy.interpolate import RBFInterpolator

    first = np.zeros(1)
    seen = np.concatenate([curve(first)[:, :3] for curve in recording.target_curves])[is_seen]
    flat = mesh.points.apply(_hanging_flat(mesh, recording.held(first))[0])[is_seen]
    return np.asarray(RBFInterpolator(places, seen - flat, kernel="cubic", degree=1)(mesh.rest))


def _hanging_flat(mesh: ClothMesh, ends: Floats) -> Floats:
    """Return flat cloth hanging straight down from the held ends, (candidates, nodes, 3); ends (candidates, 6)."""
    left, right = ends[:, :3], ends[:, 3:]
    held = mesh.rest[mesh.held_nodes]
    along = (mesh.rest[:, 0] - held[0, 0]) / (held[-1, 0] - held[0, 0])
    below = held[:, 1].max() - mesh.rest[:, 1]
    shape = (1 - along)[None, :, None] * left[:, None] + along[None, :, None] * right[:, None]
    shape[:, :, 2] -= below
    bar = right - left
    behind = np.stack([-bar[:, 1], bar[:, 0]], 1) / np.maximum(np.linalg.norm(bar[:, :2], axis=1, keepdims=True), 1e-9)
    shape[:, :, :2] += mesh.bulge[None, :, None] * behind[:, None]
    return shape

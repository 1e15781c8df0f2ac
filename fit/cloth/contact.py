"""Contact of the cloth with itself and with simple bodies: contact law and contact surface.

Nodes stand 30 to 50 mm apart, and cloth is a millimetre thick. Spheres round nodes would let layers through or keep
them a node's distance apart. So contact acts between sample points and facets of the surface. Every element is divided
into `division` by `division` quads. The quads' corners are the samples y_s = sum_n N_sn x_n, with the element's own
shape functions N. Sample i has the area A_i and the velocity w_i. It meets the mean plane of quad q with corners y_a
y_b / y_c y_d:

    c = mean of y_k,  t_1 = (y_b - y_a + y_d - y_c)/2,  t_2 = (y_c - y_a + y_d - y_b)/2,  n = t_1 x t_2 / |t_1 x t_2|
    gap g = n.(y_i - c),  y_i - c - g n = xi_1 t_1 + xi_2 t_2,  psi = s(xi_1) s(xi_2),  s(xi) = clip(3/2 - 2 |xi|, 0, 1)

The window s falls from 1 to 0 about the quad's edge. So the windows psi of neighbouring quads add up to 1. At the
cloth's edge s falls a quarter of a side farther out. The corners have the weights h_k = 1/4 +- xi_1 / 2 +- xi_2 / 2.
The point below the sample is sum_k h_k y_k, and dg = n.(dy_i - sum_k h_k dy_k) exactly.

A pressure p acts on the sample along n sign(g), and -h_k p on the corners. This pressure is the gradient of an energy,
and has neither resultant nor torque. The gradient of psi is left out; it sums to zero if neighbouring planes agree.
Nodes get N' times the samples' forces, the transpose of the map that carries the motion.

The law acts on the overlap delta = max(0, d - |g|), with the distance d between layers (`thickness`):

    p = max(0, k delta - c r d|g|/dt),  t = -min(c, mu p / |u_t|) u_t,  k = rho omega^2 / 2,  c = zeta rho omega

with r = clip(4 delta / d, 0, 1), the velocity u_t of one layer along the other, and the coefficient of friction mu. The
force is A_i psi (p n + t) / 2. The other layer's samples contribute the other half. The mass per area rho scales k and
c. Two layers have the reduced mass rho / 2 and bounce at omega with damping zeta, for any cloth. So
    a layer of weight rho g rests by 2 g / omega^2 = 20 um within d, and
    it takes a speed of omega d, 5 m/s for d = 5 mm, to drive one layer through another.
So no memory of the layers' sides is needed, and d may be as small as the speeds allow. Friction creeps: below the
sliding limit it is a dashpot, which a layer's weight drives at g / (zeta omega) = 3 cm/s. A body (`Body`) is at rest or
follows a prescribed motion (`BodyMotion`), without reaction to the cloth. A sample meets its surface with twice k and
c, and with all of its area; w is then its velocity against the body's.

Sources:

- R. Bridson, R. Fedkiw, J. Anderson, "Robust treatment of collisions, contact and friction for cloth animation"
  (SIGGRAPH 2002), sections 5 to 7. From there: points against planes of faces, thickness, repulsion scaled by mass,
  bounded friction.
- M. Li et al., "Incremental potential contact" (SIGGRAPH 2020), section 4: contact from a potential of distances;
  Coulomb friction smoothed about rest
- M. Li et al., "Convergent IPC" (2023): contact as an integral over the surface, weighted by area
- P. Wriggers, "Computational Contact Mechanics" (2006), section 5.3: penalty stiffness

Contact of edge against edge is not seen if no sample is within d of the other layer. So layers may overlap by the
distance of the curved surface from a quad's plane. This distance is kappa l^2 / 8, 1 mm for quads of l = 25 mm bent by
15 1/m. Pieces nearer along the cloth than `NEAREST_ALONG` quads do not meet, because bending keeps them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.cloth import spectral
from fit.cloth.elements import CORNERS, Stencils, bilinear_slopes, joined_stencils
from fit.cloth.mesh import ClothMesh
from fit.errors import FitError
from fit.recordings.bodies import Body, BodyMotion
from formats.arrays import Booleans, Floats, Indices, Integers

# 1/s, of two layers against each other; our choice: 5 m/s drive a layer through 5 mm. At half 2.5 m/s do, which a swing
# of 0.25 m to each side reaches at 1.6 Hz. Steps are 0.58 times as long as without contact; at half 0.77, at twice 0.36
# times (measured on a sheet of median fabric).
CONTACT_OMEGA = 1000.0
# Of the critical; our choice: no fabric's bounce was measured. By the law above, layers 5 mm thick that meet at
# 2 m/s part at 0.61 of that speed. At half of the damping they part at 0.77 of the speed, at twice at 0.42.
CONTACT_DAMPING = 0.3
FEWEST_QUADS = 4  # quads along an element, one more than its order: fewer would need a shorter step
# Mean quad diagonals along the cloth: nearer pieces are never in contact. Our choice: bending keeps pieces within 113
# mm apart, for quads of 40 mm (above). At half, the quads beside a quad could touch it; at twice, a fold of 0.2 m could
# pass through itself.
NEAREST_ALONG = 2.0
# Of a quad's sides: distance from its centre within which it meets samples. Our choice: neighbouring windows add up to
# 1 for any distance from 0.5 to 1. At 0.5 a sliding sample feels steps; at 1 it meets four quads everywhere.
WINDOW = 0.75
WINDOW_BORDER = 0.25  # of its sides: wider window of a quad at the cloth's border, so that it is 1 up to the border
# Factor by which a quad may grow without missing a contact. Our choice: by 0.2 kg/m^2, 0.45 m and three times gravity
# the softest base model (30 N/m) is stretched by 9 %. A larger factor lists more pairs.
STRETCHED = 1.15
LAYERS = 2  # layers that one layer touches at most, one on each side


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Bodies and layers that the cloth may touch.

    - `thickness` [m]: distance at which layers of the cloth are kept apart, 0: they pass through each other
    - `friction` [1]: coefficient of friction between layers and against bodies
    - `bodies`
    - `motion` of the bodies; None: they stand still
    - `clearance` [m]: distance from their surface at which the cloth is kept
    - `spacing` [m]: of the samples, at most; a body that is thinner slips through between them
    """

    thickness: float = 0.0
    friction: float = 0.0
    bodies: tuple[Body, ...] = ()
    clearance: float = 0.002  # our choice: the thickness of a thick fabric (KES)
    spacing: float = 0.04  # our choice: within the 30 to 50 mm between nodes
    motion: BodyMotion | None = None

    def __post_init__(self) -> None:
        """Raise FitError for numbers that no contact can have."""
        for name, value, high in (
            ("thickness", self.thickness, 0.05), ("friction", self.friction, 2.0), ("clearance", self.clearance, 0.05),
        ):  # fmt: skip
            if not 0.0 <= value <= high:
                raise FitError(f"cannot be {value}", where=f"contact {name}", advice=f"choose 0 to {high}")
        if self.bodies and not self.clearance > 0:
            raise FitError(
                "bodies need a clearance above 0", where="contact clearance",
                advice="choose 0.002 m: two millimetres cannot be seen",
            )  # fmt: skip
        if not 0.005 <= self.spacing <= 0.1:
            raise FitError(f"cannot be {self.spacing} m", where="contact spacing", advice="choose 0.005 to 0.1 m")
        if self.motion is not None and self.motion.poses.shape[1] != len(self.bodies):
            raise FitError(
                f"{len(self.bodies)} bodies move on {self.motion.poses.shape[1]} paths", where="contact motion",
                advice="give each body a path",
            )  # fmt: skip
        for body in self.bodies:
            if body.thickness < self.spacing:
                raise FitError(
                    f"a body {body.thickness:.3f} m thick slips through between samples {self.spacing:.3f} m apart",
                    where="contact spacing",
                    advice=f"set it to {body.thickness:.3f} or less, or round the body by a larger radius",
                )


def touching(bodies: tuple[Body, ...]) -> Contact:
    """Return contact with bodies alone, sampled finely enough for the thinnest body."""
    return Contact(bodies=bodies, spacing=min([Contact.spacing, *(body.thickness for body in bodies)]))


@dataclass(frozen=True)
class Surface:
    """The surface of the cloth on which contact acts.

    - `samples`: stencils of values, all of 16 nodes
    - `area` [m^2], (samples,)
    - `quads`, (quads, 4): samples a b / c d
    - `windows`, (quads, 4): where in units of its sides a quad's window ends, towards c d, a b, b d and a c
    - `reach` [m], (quads,): distance from its centre within which a quad meets samples
    - `may_meet`, (samples, quads): whether a sample and a quad are far enough apart along the cloth
    - `carried`: largest displacement of a sample while each node moves by 1 at most
    - `rate`: largest eigenvalue of contact at unit stiffness and density, all samples bound to fixed positions
    """

    samples: Stencils
    area: Floats
    quads: Indices
    windows: Floats
    reach: Floats
    may_meet: Booleans
    carried: float
    rate: float

    def words(self) -> Indices:
        """Return `may_meet` as bits, rows of whole words, the first quad lowest."""
        rows = np.zeros((len(self.may_meet), -(-len(self.quads) // 32) * 32), bool)
        rows[:, : len(self.quads)] = self.may_meet
        return np.packbits(rows, axis=1, bitorder="little").view("<i4").ravel()


def divided(mesh: ClothMesh, spacing: float) -> tuple[Stencils, Indices]:
    """Return samples about `spacing` [m] apart or less, and the quads between them, (quads, 4): a b / c d."""
    corners = mesh.rest[mesh.cells[:, CORNERS]]
    sides = np.linalg.norm(corners[:, [1, 3, 2, 0]] - corners[:, [0, 1, 3, 2]], axis=2)
    division = max(FEWEST_QUADS, int(np.ceil(float(sides.mean()) / spacing - 1e-9)))
    samples, index = _samples(mesh, np.linspace(-1.0, 1.0, division + 1))
    return samples, _quads(index)


def surface_of(mesh: ClothMesh, spacing: float) -> Surface:
    """Return the surface of a mesh with samples about `spacing` [m] apart or less."""
    corners = mesh.rest[mesh.cells[:, CORNERS]]
    sides = np.linalg.norm(corners[:, [1, 3, 2, 0]] - corners[:, [0, 1, 3, 2]], axis=2)
    division = max(FEWEST_QUADS, int(np.ceil(float(sides.mean()) / spacing - 1e-9)))
    local = np.linspace(-1.0, 1.0, division + 1)
    samples, index = _samples(mesh, local)
    area = np.bincount(index.ravel(), _areas(corners, local).ravel(), len(samples)).astype(float)
    quads = _quads(index).astype(np.int64)
    places = samples.apply(mesh.rest)
    diagonal = np.maximum(
        *(np.linalg.norm(places[quads[:, p]] - places[quads[:, q]], axis=1) for p, q in ((0, 3), (1, 2)))
    )
    windows = np.asarray(WINDOW + WINDOW_BORDER * _at_border(quads), float)
    return Surface(
        samples=samples,
        area=area,
        quads=quads.astype(np.int32),
        windows=windows,
        reach=STRETCHED * windows.max(1) * diagonal,
        may_meet=_far_apart(
            places, quads, _held_together(mesh, samples, places), NEAREST_ALONG * float(diagonal.mean())
        ),
        carried=float(np.bincount(samples.rows(), np.abs(samples.weights[:, 0])).max()),
        rate=_largest_rate(samples, area, mesh.node_area),
    )


def _quads(index: Integers) -> Indices:
    """Return the quads between samples that stand in rows, (cells, n, n)."""
    a, b, c, d = (i.ravel() for i in (index[:, :-1, :-1], index[:, :-1, 1:], index[:, 1:, :-1], index[:, 1:, 1:]))
    return np.stack([a, b, c, d], 1).astype(np.int32)


def _samples(mesh: ClothMesh, local: Floats) -> tuple[Stencils, Integers]:
    """Return the samples at coordinates in [-1, 1] along and across each element, and their indices, (cells, n, n)."""
    along = spectral.values(local)
    weights = np.einsum("ra,cb->rcab", along, along).reshape(len(local) ** 2, -1)
    weights[np.abs(weights) < 1e-12] = 0.0
    known: dict[tuple[float, ...], int] = {}
    nodes: list[Indices] = []
    kept: list[Floats] = []
    index = np.zeros((len(mesh.cells), len(local), len(local)), int)
    for cell, of in enumerate(mesh.cells):
        for place, row in enumerate(weights):
            used = np.flatnonzero(row)
            order = used[np.argsort(of[used])]
            # One sample on a side that two elements, or front and back, share: the same nodes with the same weights.
            key = (*of[order].tolist(), *np.round(row[order], 9).tolist())
            if key not in known:
                known[key] = len(nodes)
                nodes.append(of)
                kept.append(row)
            index[cell].flat[place] = known[key]
    return joined_stencils([n.astype(np.int64) for n in nodes], [row[:, None] for row in kept]), index


def _areas(corners: Floats, local: Floats) -> Floats:
    """Return the area of each sample of each element [m^2], (cells, n, n), by weights that integrate cubics.

    Among such weights, those nearest to the trapezium rule are chosen. A uniform pressure then acts on every node in
    proportion to its mass. Level cloth that meets a level floor stays level.
    """
    rule = np.full(len(local), 2.0 / (len(local) - 1))
    rule[[0, -1]] /= 2
    along = spectral.values(local).T
    rule += np.linalg.pinv(along) @ (spectral.LOBATTO_WEIGHTS - along @ rule)
    places = np.stack([np.tile(local, len(local)), np.repeat(local, len(local))], 1)
    jacobian = 0.5 * np.einsum("sac,pcb->psab", bilinear_slopes((places + 1) / 2), corners)
    size = np.abs(np.linalg.det(jacobian)).reshape(len(corners), len(local), len(local))
    return np.asarray(size * rule[:, None] * rule)


def _at_border(quads: Integers) -> Booleans:
    """Return which sides of each quad are on the border, (quads, 4): c d, a b, b d and a c."""
    sides = np.sort(quads[:, [[2, 3], [0, 1], [1, 3], [0, 2]]].reshape(-1, 2), axis=1)
    _, of, shared = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(shared[of.ravel()] == 1).reshape(-1, 4)


def _held_together(mesh: ClothMesh, samples: Stencils, places: Floats) -> Integers:
    """Return the pairs of front and back samples that a hanger holds at the same position, (n, 2)."""
    is_held = np.zeros(len(mesh.rest), bool)
    is_held[mesh.held_nodes] = True
    free = np.bincount(samples.rows(), (samples.weights[:, 0] != 0) & ~is_held[samples.nodes], len(places))
    held = np.flatnonzero(free == 0)
    same = np.linalg.norm(places[held][:, None] - places[held][None], axis=2) < 1e-6
    return np.asarray(held[np.argwhere(np.triu(same, 1))]).reshape(-1, 2)


def _far_apart(places: Floats, quads: Integers, joined: Integers, nearest: float) -> Booleans:
    """Return which samples and quads are far apart along the cloth, across seams and `joined` too, (samples, quads)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    ways = np.concatenate([quads[:, [p, q]] for p, q in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))] + [joined])
    ways = np.unique(np.sort(ways, axis=1), axis=0)
    # The graph would ignore an edge of zero length.
    length = np.maximum(np.linalg.norm(places[ways[:, 0]] - places[ways[:, 1]], axis=1), 1e-9)
    count = len(places)
    graph = coo_array((length, (ways[:, 0], ways[:, 1])), shape=(count, count)).tocsr()
    apart = dijkstra(graph, directed=False, limit=nearest)
    return np.asarray(np.isinf(apart[:, quads]).all(2))


def _largest_rate(samples: Stencils, area: Floats, node_area: Floats) -> float:
    """Return the largest eigenvalue of N' A N against the lumped masses at unit density."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import eigsh

    scaled = samples.weights[:, 0] * np.sqrt(area)[samples.rows()] / np.sqrt(node_area)[samples.nodes]
    matrix = coo_array((scaled, (samples.rows(), samples.nodes)), shape=(len(samples), len(node_area))).tocsr()
    start = np.random.default_rng(0).standard_normal(len(node_area))
    return float(eigsh((matrix.T @ matrix).tocsc(), 1, which="LA", v0=start, return_eigenvectors=False, tol=1e-3)[0])


def contact_rate(surface: Surface, *, is_layered: bool, has_bodies: bool) -> float:
    """Return an upper bound of the omega^2 that contact adds [1/s^2], for any mass of the cloth.

    A pair has the energy A k delta^2 / 4, and delta^2 = (a - b)^2 <= 2 a^2 + 2 b^2. So all pairs together have at most
    LAYERS k times the sum of A_s y_s^2. With k = rho omega^2 / 2 the eigenvalue is LAYERS omega^2 `Surface.rate`.
    Bodies add omega^2 `Surface.rate`.
    """
    return CONTACT_OMEGA**2 * surface.rate * (LAYERS * is_layered + has_bodies)

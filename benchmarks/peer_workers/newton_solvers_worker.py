"""Newton's solvers as a cloth simulator in a separate process, which runs the jobs of `benchmarks/peers.py`.

A job names its `solver`, semi-implicit, xpbd or vbd, and the `iterations` of the last two. Semi-implicit has the model
of the blind check (`fit/blind/foreign/workers/newton_worker.py`), and so has VBD, whose triangles add mu to lambda
themselves. XPBD knows no triangles. Springs of mu along both diagonals of every cell resist a shear of gamma with mu
gamma^2 / 2 per area, as the ground does. The springs along the lines have the rest of its stretch.

An edge of length e between triangles of height a has the bending energy K theta^2 / 2 in all. In the blind check's
worker K = k_e e^2 a. VBD uses k_e e theta^2 / 2. XPBD's gradients lack 1 / (e a), so XPBD takes k_e e a theta^2 / 2.

Two steps, damping and the held nodes' path included, are recorded as a graph and replayed: no Python runs in between.
XPBD and VBD use the held nodes' positions at the end of a step, the semi-implicit solver those at its beginning.
Source: Newton 1.8, `SolverSemiImplicit`, `SolverXPBD` and `SolverVBD`; Warp 1.19, `ScopedCapture`.
"""

import sys
import time
from pathlib import Path

import numpy as np
import warp as wp
from answering import answer_jobs

sys.path.append(str(Path(__file__).parents[2] / "fit/blind/foreign/workers"))

import newton
from newton_worker import build, hinges_of, lines_of, springs_of

SOLVERS = newton.solvers


def semi_implicit(job, numbers):
    """Return the blind check's model and its solver."""
    model = build(job, numbers)
    return model, SOLVERS.SolverSemiImplicit(model, enable_tri_contact=False)


def vbd(job, numbers):
    """Return a model of triangles and springs, coloured, and its solver."""
    builder, triangles = particles_of(job, numbers), job["triangles"]
    count = len(triangles)
    builder.add_triangles(
        *triangles.T.tolist(), tri_ke=[numbers["mu"]] * count, tri_ka=[numbers["lam"]] * count, tri_kd=[0.0] * count,
        tri_drag=[0.0] * count, tri_lift=[0.0] * count,
    )  # fmt: skip
    add_edges(builder, job, numbers, lambda whole, length, height: whole / length)
    for one, other, value in springs_of(job["rest"], numbers):
        builder.add_spring(one, other, value, 0.0, 0.0)
    builder.color()
    model = finished(builder)
    return model, SOLVERS.SolverVBD(model, iterations=int(job["iterations"]))


def xpbd(job, numbers):
    """Return a model of springs and its solver."""
    builder, rest = particles_of(job, numbers), job["rest"]
    add_edges(builder, job, numbers, lambda whole, length, height: whole / (length * height))
    ground = numbers["lam"] + numbers["mu"]  # of lambda + 2 mu, the diagonals carry mu
    lines = {**numbers, **{name: numbers[name] + ground for name in ("fibre_warp", "fibre_weft")}}
    node = lines_of(rest)
    diagonals = np.concatenate([
        np.stack([node[:-1, :-1], node[1:, 1:]], -1).reshape(-1, 2),
        np.stack([node[:-1, 1:], node[1:, :-1]], -1).reshape(-1, 2),
    ])  # fmt: skip
    for one, other, value in [*springs_of(rest, lines), *((int(i), int(j), numbers["mu"]) for i, j in diagonals)]:
        builder.add_spring(one, other, value, 0.0, 0.0)
    model = finished(builder)
    return model, SOLVERS.SolverXPBD(model, iterations=int(job["iterations"]))


def particles_of(job, numbers):
    """Return a builder with the sheet's nodes, flat; held ones have no mass."""
    rest, mass = job["rest"], job["mass"].copy()
    mass[job["held"]] = 0.0
    builder = newton.ModelBuilder(gravity=tuple(numbers[f"gravity_{axis}"] for axis in "xyz"))
    places = [wp.vec3(x, 0.0, z) for x, z in rest]
    builder.add_particles(places, [wp.vec3(0.0)] * len(rest), mass.tolist(), [0.0] * len(rest))
    return builder


def add_edges(builder, job, numbers, own):
    """Add the bending of every inner edge, own(K, e, a) of the solver's own number."""
    rest = job["rest"]
    hinges, theirs = hinges_of(rest, job["triangles"], numbers)
    along, across = rest[hinges[:, 1]] - rest[hinges[:, 0]], rest[hinges[:, 2]] - rest[hinges[:, 0]]
    length = np.linalg.norm(along, axis=1)
    height = np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]) / length
    bending = own(theirs * length**2 * height, length, height)
    none = [0.0] * len(hinges)
    builder.add_edges(*hinges[:, [2, 3, 0, 1]].T.tolist(), rest=none, edge_ke=bending.tolist(), edge_kd=none)


def finished(builder):
    """Return the model, without contacts between particles."""
    model = builder.finalize()
    model.particle_max_velocity = 100.0
    model.particle_grid, model.particle_max_radius = None, 0.0
    return model


@wp.kernel
def begin_step(
    step: wp.array[int],
    ahead: int,
    every: int,
    path: wp.array2d[wp.vec3],
    row: wp.array[int],
    mass: wp.array[float],
    damping: wp.array[float],
    q: wp.array[wp.vec3],
    v: wp.array[wp.vec3],
    f: wp.array[wp.vec3],
    seen: wp.array2d[wp.vec3],
):
    """Store a node's position at every sample, damp its velocity, and move it along its path if it is held."""
    node = wp.tid()
    now = step[0]
    if now >= 0 and now % every == 0:
        seen[now // every, node] = q[node]
    f[node] = -damping[0] * mass[node] * v[node]
    if row[node] >= 0:
        q[node] = path[wp.clamp(now + ahead, 0, path.shape[0] - 1), row[node]]
        v[node] = wp.vec3(0.0)


@wp.kernel
def end_step(step: wp.array[int]):
    """Count a step."""
    step[0] = step[0] + 1


def simulate(job):
    """Swing the sheet of the first take."""
    numbers = dict(zip(job["names"].tolist(), job["numbers"][0].tolist(), strict=True))
    name = str(job["solver"])
    model, solver = {"semi-implicit": semi_implicit, "xpbd": xpbd, "vbd": vbd}[name](job, numbers)
    dt, every, ends, share = float(job["dt"]), int(job["every"]), job["path"][0], job["fraction"][:, None]
    settle, steps = 2 * (int(job["settle_steps"]) // 2), len(ends) - 1
    nodes, row = len(job["rest"]), np.full(len(job["rest"]), -1)
    row[job["held"]] = np.arange(len(job["held"]))
    path = wp.array((1 - share) * ends[:, None, :3] + share * ends[:, None, 3:], dtype=wp.vec3)
    rows, seen = wp.array(row, dtype=int), wp.zeros((steps // every + 1, nodes), dtype=wp.vec3)
    step, damping = wp.array([-settle], dtype=int), wp.array([float(job["settle_damping"])], dtype=float)
    states, control = [model.state(), model.state()], model.control()
    states[0].particle_q.assign(job["start"][0])

    def advance():
        for old, new in (states, states[::-1]):
            wp.launch(begin_step, nodes, inputs=[
                step, int(name != "semi-implicit"), every, path, rows, model.particle_mass, damping,
                old.particle_q, old.particle_qd, old.particle_f, seen,
            ])  # fmt: skip
            solver.step(old, new, control, None, dt)
            wp.launch(end_step, 1, inputs=[step])

    advance()  # compiled, with memory allocated
    states[0].particle_q.assign(job["start"][0])
    states[0].particle_qd.zero_()
    step.fill_(-settle)
    with wp.ScopedCapture() as capture:
        advance()
    for _ in range(settle // 2):
        wp.capture_launch(capture.graph)
    damping.fill_(numbers["damping"])
    began = time.process_time()
    for _ in range(steps // 2 + 1):
        wp.capture_launch(capture.graph)
    return {"nodes": seen.numpy()[None], "seconds": np.array([time.process_time() - began])}


if __name__ == "__main__":
    wp.config.quiet = True
    wp.set_device("cpu")
    answer_jobs(newton.__version__, simulate)

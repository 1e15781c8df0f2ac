"""Worker process that simulates jobs of `fit.blind.foreign.jobs` with Newton's semi-implicit solver.

Newton's triangles have W = mu/2 |F|^2 + k/2 (J - 1 - mu/k)^2 per rest area, so k = lambda + mu gives the job's ground.
Newton's springs along the grid's lines are the two fibre families. Each spring stands for the strip of cloth on either
side, k w / h.

An edge of length e between triangles of height a bends with E = k_e e^2 a theta^2 / 2, because Newton's gradients lack
the triangles' heights. Bending stiffness B across a grid spacing h needs k_e = B / (h e a). Diagonal edges resist
twist only. Their k_e = B / (e dx dy) gives a plate's B kappa_xy^2 per area.

Air drag is Newton's own, k A |n . v| v at each of three corners, so k = rho C / 6. Steps are symplectic Euler in single
precision on the CPU. Held nodes are put on their path before every step.
Source: Newton 1.8, `SolverSemiImplicit`, and its documentation, "Solvers".
"""

import time

import newton
import numpy as np
import warp as wp
from every_take import answer_takes
from outside_forces import BLIND_AIR, OutsideForces

wp.config.quiet = True
wp.set_device("cpu")


def build(job, numbers):
    """Return the model of a sheet that lies flat where the take starts."""
    rest, triangles = job["rest"], job["triangles"]
    flat = np.column_stack([rest[:, 0], 0 * rest[:, 0], rest[:, 1]])
    builder = newton.ModelBuilder(gravity=(numbers["gravity_x"], numbers["gravity_y"], numbers["gravity_z"]))
    mass = job["mass"].copy()
    mass[job["held"]] = 0.0
    builder.add_particles(
        pos=[wp.vec3(*place) for place in flat], vel=[wp.vec3(0.0)] * len(flat), mass=mass.tolist(),
        radius=[0.0] * len(flat),
    )  # fmt: skip
    faces = len(triangles)
    builder.add_triangles(
        *triangles.T.tolist(), tri_ke=[numbers["mu"]] * faces, tri_ka=[numbers["lam"] + numbers["mu"]] * faces,
        tri_kd=[0.0] * faces, tri_drag=[BLIND_AIR * numbers["drag"] / 6] * faces, tri_lift=[0.0] * faces,
    )  # fmt: skip
    hinges, stiffness = hinges_of(rest, triangles, numbers)
    builder.add_edges(
        *hinges[:, [2, 3, 0, 1]].T.tolist(), rest=[0.0] * len(hinges), edge_ke=stiffness.tolist(),
        edge_kd=[0.0] * len(hinges),
    )  # fmt: skip
    for one, other, value in springs_of(rest, numbers):
        builder.add_spring(one, other, value, value * numbers["stretch_time"], 0.0)
    model = builder.finalize()
    model.particle_max_velocity = 100.0
    model.particle_grid, model.particle_max_radius = None, 0.0  # no contacts between particles
    return model


def lines_of(rest):
    """Return the grid of node indices, (rows, columns)."""
    columns = int(np.isclose(rest[:, 1], rest[0, 1]).sum())
    return np.arange(len(rest)).reshape(-1, columns)


def springs_of(rest, numbers):
    """Yield nodes and stiffness [N/m] of every fibre spring; a spring along the sheet's edge has half a strip."""
    node = lines_of(rest)
    rows, columns = node.shape
    dx, dy = rest[1, 0] - rest[0, 0], rest[0, 1] - rest[columns, 1]
    for r in range(rows):
        strip = dy * (0.5 if r in {0, rows - 1} else 1.0)
        for c in range(columns - 1):
            yield int(node[r, c]), int(node[r, c + 1]), numbers["fibre_weft"] * strip / dx
    for c in range(columns):
        strip = dx * (0.5 if c in {0, columns - 1} else 1.0)
        for r in range(rows - 1):
            yield int(node[r, c]), int(node[r + 1, c]), numbers["fibre_warp"] * strip / dy


def hinges_of(rest, triangles, numbers):
    """Return inner edges with their opposite nodes, (hinges, 4), and Newton's stiffness of each, (hinges,)."""
    seen, hinges = {}, []
    for i, j, k in triangles.tolist():
        for one, other, opposite in ((i, j, k), (j, k, i), (k, i, j)):
            if (other, one) in seen:
                hinges.append((other, one, seen.pop((other, one)), opposite))
            else:
                seen[one, other] = opposite
    hinges = np.array(hinges)
    along = rest[hinges[:, 1]] - rest[hinges[:, 0]]
    length = np.linalg.norm(along, axis=1)
    is_level, is_upright = np.abs(along[:, 1]) < 1e-9, np.abs(along[:, 0]) < 1e-9
    columns = lines_of(rest).shape[1]
    dx, dy = rest[1, 0] - rest[0, 0], rest[0, 1] - rest[columns, 1]
    twist = np.sqrt(numbers["bending_warp"] * numbers["bending_weft"]) / (dx * dy)
    bending = np.where(is_level, numbers["bending_warp"] / dy**2, np.where(is_upright, numbers["bending_weft"] / dx**2,
                                                                         twist)) / length  # fmt: skip
    middle = rest[hinges[:, :2], 1].mean(1)
    bending *= np.where(middle < numbers["hem_from"], numbers["hem_bending"], 1.0)
    return hinges, bending


def swing(model, job, take, numbers):
    """Return the nodes of one take, (samples, nodes, 3), and the processor time [s] without settling."""
    held, path = job["held"], job["path"][take]
    dt, every, settle = float(job["dt"]), int(job["every"]), int(job["settle_steps"])
    fraction = job["fraction"][:, None]
    ends = (1 - fraction) * path[:, None, :3] + fraction * path[:, None, 3:]
    speeds = np.diff(ends, axis=0, append=ends[-1:]) / dt
    solver = newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False)
    states, control = [model.state(), model.state()], model.control()
    places, velocities, pushes = (
        [getattr(state, name).numpy() for state in states] for name in ("particle_q", "particle_qd", "particle_f")
    )
    places[0][:] = job["start"][take]
    outside = OutsideForces({**numbers, "drag": 0.0}, job["triangles"], job["spot"], job["start"][take], dt)
    slowed = numbers["damping"] * job["mass"][:, None]
    settling = slowed + float(job["settle_damping"]) * job["mass"][:, None]
    seen = np.empty(((len(path) - 1) // every + 1, len(job["rest"]), 3), np.float32)
    now = 0
    for step in range(-settle, len(path)):
        here = max(step, 0)
        if step == 0:
            began = time.process_time()
        q, v, push = places[now], velocities[now], pushes[now]
        q[held], v[held] = ends[here], speeds[here] if step >= 0 else 0.0
        if step >= 0 and step % every == 0:
            seen[step // every] = q
        push[:] = -(slowed if step >= 0 else settling) * v
        if outside.are_there:
            push += outside.at(here * dt, q.astype(float), v.astype(float))
        solver.step(states[now], states[1 - now], control, None, dt)
        now = 1 - now
    return seen, time.process_time() - began


if __name__ == "__main__":
    answer_takes(newton.__version__, build, swing)

"""Run in Newton's own Python: clamp an exported strip at its top two rows, let it sag sideways; print JSON.

newton_cantilever.py FILE.usda PRESET.json SOLVER

The mesh is what Newton's loader read of the USD file. For SolverVBD the loader's own materials are corrected as the
preset says; the other two solvers are given the preset's numbers.
"""

import json
import sys

import newton
import numpy as np
import warp as wp
from newton.solvers import SolverSemiImplicit, SolverStyle3D, SolverVBD, style3d
from newton_strip import GRAVITY, loaded

STEPS = {"SolverStyle3D": 5e-3, "SolverVBD": 2e-4, "SolverSemiImplicit": 5e-5}  # s
SECONDS = {"SolverStyle3D": 1.0, "SolverVBD": 0.3, "SolverSemiImplicit": 0.4}  # s: until the sag stays
SETTLING = {"SolverStyle3D": 20.0, "SolverVBD": 80.0, "SolverSemiImplicit": 80.0}  # 1/s of velocity


def by_edge(builder, factor):
    """Scale each edge's bending by a function of its length [m]."""
    for k, length in enumerate(builder.edge_rest_length):
        stiffness, damping = builder.edge_bending_properties[k]
        builder.edge_bending_properties[k] = (stiffness * factor(length), damping)


def main():
    """Clamp the strip and let it sag."""
    path, preset, name = sys.argv[1:]
    wp.config.quiet = True
    wp.set_device("cpu")
    with open(preset) as file:
        record = json.load(file)
    numbers, spacing = record[name], record["grid_spacing_m"]
    read, _, _ = loaded(path)
    places, corners = np.array(read.particle_q, float), np.array(read.tri_indices).ravel().tolist()
    mass = np.array(read.particle_mass)
    where = {
        "pos": wp.vec3(0.0), "rot": wp.quat_identity(), "vel": wp.vec3(0.0),
        "vertices": [wp.vec3(*p) for p in places], "indices": corners, "density": numbers["density"],
    }  # fmt: skip
    builder = newton.ModelBuilder(gravity=(0.0, -GRAVITY, 0.0))
    if name == "SolverStyle3D":
        SolverStyle3D.register_custom_attributes(builder)
        style3d.add_cloth_mesh(
            builder, **where, tri_aniso_ke=wp.vec3(*numbers["tri_aniso_ke"]),
            edge_aniso_ke=wp.vec3(*numbers["edge_aniso_ke"]), panel_verts=[wp.vec2(x, z) for x, _, z in places],
            panel_indices=corners,
        )  # fmt: skip
    elif name == "SolverVBD":
        factor = record["ModelBuilder.add_usd"]["tri_ke_factor"]
        builder.add_cloth_mesh(
            **where, scale=1.0, tri_ke=read.tri_materials[0][0] * factor, tri_ka=0.0, tri_kd=0.0,
            edge_ke=max(e[0] for e in read.edge_bending_properties), edge_kd=0.0,
        )  # fmt: skip
        by_edge(builder, lambda length: 4 / 3 / length)
        builder.color(include_bending=True)
    else:
        builder.add_cloth_mesh(
            **where, scale=1.0, tri_ke=numbers["tri_ke"], tri_ka=numbers["tri_ka"], tri_kd=0.0, edge_ke=1.0,
            edge_kd=0.0,
        )  # fmt: skip
        edges = numbers["edge_ke_by_edge"]
        by_edge(builder, lambda length: edges["straight" if length < 1.2 * spacing else "diagonal"])
    for k in np.flatnonzero(places[:, 2] > -1.01 * spacing):
        builder.particle_mass[k] = 0.0
    bottom = np.flatnonzero(places[:, 2] < places[:, 2].min() + 1e-6)
    model = builder.finalize()
    model.particle_max_velocity, model.particle_grid, model.particle_max_radius = 100.0, None, 0.0
    contacts = None
    if name == "SolverStyle3D":
        solver = SolverStyle3D(model, config=SolverStyle3D.Config(iterations=10, linear_iterations=10))
        contacts = newton.CollisionPipeline(model).contacts()
    elif name == "SolverVBD":
        solver = SolverVBD(model, iterations=20, particle_enable_self_contact=False, particle_enable_tile_solve=False)
    else:
        solver = SolverSemiImplicit(model, enable_tri_contact=False)
    states, control, dt = [model.state(), model.state()], model.control(), STEPS[name]
    for _ in range(round(SECONDS[name] / dt)):
        now, then = states
        now.clear_forces()
        now.particle_f.assign(-SETTLING[name] * mass[:, None] * now.particle_qd.numpy())
        solver.step(now, then, control, contacts, dt)
        states = [then, now]
    sag = -float(states[0].particle_q.numpy()[bottom, 1].mean())
    print(json.dumps({"sag": sag, "version": newton.__version__}))


if __name__ == "__main__":
    main()

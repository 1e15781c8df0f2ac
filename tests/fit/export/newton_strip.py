"""Run in Newton's own Python: load an exported USD file, hang its strip, let it settle and swing; print JSON.

newton_strip.py FILE.usda PRESET.json SOLVER

What Newton's own loader read is what is simulated: points, triangles, masses and the material's numbers. Style3D, which
the loader does not fill, is given the same mesh with the loader's own record of the material.
"""

import json
import sys
import warnings

import newton
import numpy as np
import warp as wp
from hanging_chain import AMPLITUDE, SETTLE, SETTLING, SWING, first_mode, frequency
from newton.solvers import SolverSemiImplicit, SolverStyle3D, SolverVBD, style3d

GRAVITY = 9.80665  # m/s^2
STEPS = {"SolverStyle3D": 5e-3, "SolverVBD": 1e-3, "SolverSemiImplicit": 1e-4}  # s


def loaded(path):
    """Return Newton's builder of the file, and its record of the cloth's material."""
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = builder.add_usd(path, return_deformable_results=True)
    (attributes,) = found["path_cloth_attrs"].values()
    return builder, attributes["material"], [str(w.message) for w in said]


def main():
    """Hang and swing the strip."""
    path, preset, name = sys.argv[1:]
    wp.config.quiet = True
    wp.set_device("cpu")
    builder, material, said = loaded(path)
    places = np.array(builder.particle_q, float)
    triangles = np.array(builder.tri_indices)
    mass = np.array(builder.particle_mass)
    out = {
        "particles": len(places), "triangles": len(triangles), "mass": float(mass.sum()),
        "tri_ke": float(builder.tri_materials[0][0]),
        "edge_ke": float(max(e[0] for e in builder.edge_bending_properties)),
        "material": {k: float(v) for k, v in material.items()}, "said": said,
    }  # fmt: skip
    with open(preset) as file:
        numbers = json.load(file)[name]
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
    vertices, corners = [wp.vec3(*p) for p in places], triangles.ravel().tolist()
    where = {
        "pos": wp.vec3(0.0),
        "rot": wp.quat_identity(),
        "vel": wp.vec3(0.0),
        "vertices": vertices,
        "indices": corners,
    }
    if name == "SolverStyle3D":
        SolverStyle3D.register_custom_attributes(builder)
        style3d.add_cloth_mesh(
            builder, **where, density=numbers["density"],
            tri_aniso_ke=wp.vec3(*numbers["tri_aniso_ke"]), edge_aniso_ke=wp.vec3(*numbers["edge_aniso_ke"]),
            panel_verts=[wp.vec2(x, z) for x, _, z in places], panel_indices=corners,
        )  # fmt: skip
    else:
        builder.add_cloth_mesh(
            **where, scale=1.0, density=numbers["density"], tri_ke=numbers["tri_ke"], tri_ka=numbers["tri_ka"],
            tri_kd=0.0, edge_ke=numbers["edge_ke"], edge_kd=0.0,
        )  # fmt: skip
    held = np.flatnonzero(places[:, 2] > -1e-6)
    bottom = np.flatnonzero(places[:, 2] < places[:, 2].min() + 1e-6)
    for k in held:
        builder.particle_mass[k] = 0.0
    if name == "SolverVBD":
        builder.color(include_bending=True)
    model = builder.finalize()
    model.particle_max_velocity, model.particle_grid, model.particle_max_radius = 100.0, None, 0.0
    if name == "SolverStyle3D":
        solver = SolverStyle3D(model, config=SolverStyle3D.Config(iterations=10, linear_iterations=10))
        contacts = newton.CollisionPipeline(model).contacts()
    elif name == "SolverVBD":
        solver = SolverVBD(model, iterations=20, particle_enable_self_contact=False, particle_enable_tile_solve=False)
        contacts = None
    else:
        solver, contacts = SolverSemiImplicit(model, enable_tri_contact=False), None
    states, control, dt = [model.state(), model.state()], model.control(), STEPS[name]
    length = -places[:, 2].min()
    mode = first_mode(np.clip((places[:, 2] + length) / length, 0, 1))
    track, settle = [], round(SETTLE / dt)
    for step in range(settle + round(SWING / dt)):
        now, then = states
        now.clear_forces()
        if step < settle:
            now.particle_f.assign(-SETTLING * mass[:, None] * now.particle_qd.numpy())
        if step == settle:
            out["stretch"] = float(-now.particle_q.numpy()[bottom, 2].mean() - length)
            out["drift"] = float(np.abs(now.particle_q.numpy()[:, :2] - places[:, :2]).max())
            speed = now.particle_qd.numpy()
            speed[:, 1] = AMPLITUDE * mode
            now.particle_qd.assign(speed)
        if step >= settle:
            track.append(now.particle_q.numpy()[bottom, 1].mean())
        solver.step(now, then, control, contacts, dt)
        states = [then, now]
    out["hertz"] = frequency(np.array(track), dt)
    out["version"] = newton.__version__
    print(json.dumps(out))


if __name__ == "__main__":
    main()

"""Worker process that simulates jobs of `fit.blind.foreign.jobs` with a MuJoCo flex.

Every node is a body with three slides along the world's axes; a two-dimensional flex spans them. MuJoCo's elasticity is
a St. Venant-Kirchhoff membrane of constant-strain triangles and a quadratic bending of edge flaps. Of a triangle of
area A with rest edges e_i, d_i = |x_i|^2 - |e_i|^2 = 2 e_i . E e_i holds the Green strain E, so that

    W = A/2 E : C : E = 1/2 d . (A T^-T C T^-1) d,      rows of T = (2 e_x^2, 2 e_y^2, 4 e_x e_y)

and MuJoCo keeps twice that matrix per triangle, as its own numbers for an isotropic sheet show. C here is the job's
ground (mu, lambda) and two fibre families: MuJoCo's own isotropic material would shear harder than cloth does.
Bending: MuJoCo's D = E t^3 / 12 at Poisson's ratio 0; on this grid level edges bend down the sheet, upright ones
across it.
Integrator: Euler, which is MuJoCo's semi-implicit (symplectic) one, with implicit linear damping at the slides. Held
nodes are put on their path before every step.
Source: MuJoCo documentation, "Computation", "Numerical integration", and "Modeling", "Deformable objects".
"""

import time

import mujoco
import numpy as np
from every_take import answer_takes
from outside_forces import OutsideForces

THICKNESS = 1e-3  # m, of which only E t^3 matters here
TRIANGLE_EDGES = ((1, 2), (2, 0), (0, 1))  # MuJoCo's order of edges within a triangle
SLIDES = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))


def build(job, numbers):
    """Return the model of a sheet that hangs flat below the origin; `fit.blind.foreign.jobs` lists the job's arrays."""
    rest, triangles = job["rest"], job["triangles"]
    young = 12 * numbers["bending_warp"] / THICKNESS**3
    bodies = "".join(
        f'<body name="n{k}" pos="{x:.9f} 0 {y:.9f}"><inertial pos="0 0 0" mass="{mass:.12g}" '
        f'diaginertia="1e-6 1e-6 1e-6"/>{SLIDES}</body>'
        for k, ((x, y), mass) in enumerate(zip(rest, job["mass"], strict=True))
    )
    names = " ".join(f"n{k}" for k in range(len(rest)))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{float(job["dt"])!r}" integrator="Euler"><flag contact="disable" '
        f'constraint="disable" autoreset="disable"/></option><size memory="500M"/>'
        f"<worldbody>{bodies}</worldbody><deformable>"
        f'<flex name="sheet" dim="2" radius="0.001" body="{names}" element="{" ".join(map(str, triangles.ravel()))}">'
        f'<contact selfcollide="none" contype="0" conaffinity="0"/><elasticity young="{young!r}" poisson="0" '
        f'thickness="{THICKNESS}" damping="{numbers["stretch_time"]!r}" elastic2d="both"/></flex></deformable></mujoco>'
    )
    model.opt.gravity[:] = [numbers["gravity_x"], numbers["gravity_y"], numbers["gravity_z"]]
    model.flex_stiffness[:] = membrane(rest[triangles], numbers).ravel()
    scale = model.flex_bending.reshape(model.nflexedge, -1)
    scale *= bending_scale(rest[model.flex_edge], numbers)[:, None]
    return model


def membrane(corners, numbers):
    """Return the 21 numbers that MuJoCo stores per triangle, (faces, 21), from its corners [m], (faces, 3, 2).

    The first six are the upper half of the symmetric matrix over the triangle's three edges; the others stay 0.
    """
    mu, lam = numbers["mu"], numbers["lam"]
    c = np.array([
        [lam + 2 * mu + numbers["fibre_weft"], lam, 0.0], [lam, lam + 2 * mu + numbers["fibre_warp"], 0.0],
        [0.0, 0.0, 4 * mu],
    ])  # fmt: skip
    e = np.stack([corners[:, b] - corners[:, a] for a, b in TRIANGLE_EDGES], 1)
    area = 0.5 * np.abs(e[:, 0, 0] * e[:, 1, 1] - e[:, 0, 1] * e[:, 1, 0])
    t = np.linalg.inv(np.stack([2 * e[..., 0] ** 2, 2 * e[..., 1] ** 2, 4 * e[..., 0] * e[..., 1]], 2))
    metric = 2 * area[:, None, None] * np.einsum("fki,kl,flj->fij", t, c, t)
    rows = np.zeros((len(corners), 21))
    rows[:, :6] = metric[:, *np.triu_indices(3)]
    return rows


def bending_scale(ends, numbers):
    """Return each edge's bending stiffness over that of the warp, (edges,), from its ends [m], (edges, 2, 2)."""
    is_upright = np.abs(ends[:, 1, 1] - ends[:, 0, 1]) > np.abs(ends[:, 1, 0] - ends[:, 0, 0])
    scale = np.where(is_upright, numbers["bending_weft"] / numbers["bending_warp"], 1.0)
    return np.where(ends[:, :, 1].mean(1) < numbers["hem_from"], numbers["hem_bending"], 1.0) * scale


def swing(model, job, take, numbers):
    """Return the nodes of one take [m], (samples, nodes, 3), and the processor time [s] without settling."""
    rest, held, path = job["rest"], job["held"], job["path"][take]
    dt, every, settle = float(job["dt"]), int(job["every"]), int(job["settle_steps"])
    fraction = job["fraction"][:, None]
    home = np.column_stack([rest[:, 0], 0 * rest[:, 0], rest[:, 1]])
    data = mujoco.MjData(model)
    q, v, push = (part.reshape(-1, 3) for part in (data.qpos, data.qvel, data.qfrc_applied))
    x = job["start"][take].copy()
    q[:] = x - home
    outside = OutsideForces(numbers, job["triangles"], job["spot"], x, dt)
    ends = (1 - fraction) * path[:, None, :3] + fraction * path[:, None, 3:]
    speeds = np.diff(ends, axis=0, append=ends[-1:]) / dt
    free_damping = np.repeat(job["mass"], 3) * numbers["damping"]
    model.dof_damping[:] = free_damping + np.repeat(job["mass"], 3) * float(job["settle_damping"])
    seen = np.empty(((len(path) - 1) // every + 1, len(rest), 3), np.float32)
    for step in range(-settle, len(path)):
        here = max(step, 0)
        if step == 0:
            began = time.process_time()
            model.dof_damping[:] = free_damping
        q[held], v[held] = ends[here] - home[held], speeds[here] if step >= 0 else 0.0
        if step >= 0 and step % every == 0:
            seen[step // every] = q + home
        if outside.are_there:
            push[:] = outside.at(here * dt, q + home, v)
        mujoco.mj_step(model, data)
    return seen, time.process_time() - began


if __name__ == "__main__":
    answer_takes(mujoco.__version__, build, swing)

"""Presets for other simulators: Newton's cloth solvers as JSON, and a sheet of MuJoCo's flex as XML.

The energies of Newton 1.8 per rest area come from its source code; a strip in `tests/fit/export` verifies them:

    SolverStyle3D       k_u (|F_u| - 1)^2 / 2 + k_v (|F_v| - 1)^2 / 2 + k_s (f_u . f_v)^2 / 2, f = F / |F|
                        which is our membrane: tri_aniso_ke = (weft, warp, shear)
    SolverVBD           stable neo-Hookean with Lame's mu and lambda; at lambda = 0 the tension of a strip is 2 mu per
                        strain and the shear mu: tri_ke = stretch / 2, tri_ka = 0. Shear cannot be chosen
    SolverSemiImplicit  mu and k = lambda + mu: tri_ke = tri_ka = stretch / 2

Bending on edges of length L between triangles of areas A0 and A1, heights a, that meet at the angle theta:

    Style3D             3 k L^2 theta^2 / (2 (A0 + A1))
    VBD                 k L theta^2 / 2
    SemiImplicit        k L^2 a theta^2 / 2

An even grid of spacing h has diagonals that alternate (`fit.export.sheet.strip`). Its edges have the energies K_s
theta^2 / 2 and, along diagonals, K_d theta^2 / 2. Bent to a cylinder of curvature kappa its nodes move out of the
cylinder, in turns to either side, until the energy is least. This energy per area is D kappa^2 / 2 with

    D = K_s (K_s + 2 K_d) / (2 (K_s + K_d))             for a cylinder along the grid
    D = (K_s K_d / (K_s + K_d) + K_d) / 2               along its diagonals

Both are the fabric's B where K_s = K_d = 4 B / 3. Hence

    Style3D             k = 4 B / 9 along the grid, 5 B / 24 for its third number
    VBD                 k = 4 B / (3 L)
    SemiImplicit        k = 4 B / (3 L^2 a)

Style3D takes cos^12 and sin^12 of the edge's angle as shares of the first two numbers, and four times (sin cos)^2 of
the third. One number for all edges gives K_d = sqrt(2) K_s in VBD and SemiImplicit. Then K_s = 2 B / (3 - sqrt 2) is
right along the grid, and cylinders along diagonals are 26 % too stiff. `benchmarks/export.py` bends a clamped strip.
SolverVBD starts each step from free fall, and too few iterations leave a part of this fall.

MuJoCo's flex is isotropic: membrane E t and bending E t^3 / 12 at Poisson's ratio 0. Its edges have Style3D's energy at
k = B / 3, so that K_d = 2 K_s and D = 5 B / 6. The file asks for 6 B / 5. Membrane and bending are then right with t =
sqrt(12 x 6 B / (5 k)) and E = k / t. These are no thickness and no modulus of the fabric. Its shear is then k / 2.
MuJoCo 4.0 refuses damping at the slides of a flex's nodes in a file, so that linear damping is one line to add after
loading. Neither engine has quadratic drag of cloth along its normal as a material: it stays a number beside.
"""

from __future__ import annotations

import json
import re
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from fit.export.about import caution_lines, origin_lines, provenance, quantity_record
from fit.export.fabric import Fabric, Quantity
from fit.export.sheet import SWATCH_SPACING, Sheet
from formats.fit_records import FitResult
from formats.nature import AIR_DENSITY, GRAVITY

SLIDES = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
EDGE_SHARE = 4 / 3  # of B: every edge of an even grid, K_s = K_d
ONE_NUMBER_SHARE = 2 / (3 - np.sqrt(2))  # of B: K_s where K_d = sqrt(2) K_s
FLEX_SHARE = 6 / 5  # of B: where K_d = 2 K_s
FEWEST_STEPS_A_PERIOD = 4.0  # steps per period of the fastest node, for MuJoCo's semi-implicit Euler
BY_EDGE = (
    "edge_ke is right for bends along the grid, and a quarter too stiff along its diagonals. edge_ke_by_edge, set in "
    "ModelBuilder.edge_bending_properties, is right along both."
)


def newton_preset(result: FitResult, fabric: Fabric, spacing: float = SWATCH_SPACING) -> bytes:
    """Return the parameters of Newton's solvers as JSON; those of edges are for a square grid of this spacing [m]."""
    stretch, bending = fabric.mean_of_ways("stretch"), fabric.mean_of_ways("bending")
    density = fabric["areal_density"].value
    ways = [fabric["stretch_weft"].value, fabric["stretch_warp"].value, fabric["shear"].value]
    bends = [fabric["bending_weft"].value * 4 / 9, fabric["bending_warp"].value * 4 / 9, bending * 5 / 24]
    one, straight, diagonal = ONE_NUMBER_SHARE * bending, EDGE_SHARE * bending, EDGE_SHARE * bending / np.sqrt(2)
    damping = fabric["bending_damping_time"].value
    drag = AIR_DENSITY * fabric.get("drag_coefficient") / 6
    record: dict[str, Any] = {
        "format": "hangtime-newton/1",
        "provenance": provenance(result),
        "cautions": caution_lines(result, fabric),
        "fabric": {q.name: quantity_record(q) for q in fabric.quantities},
        "grid_spacing_m": spacing,
        "SolverStyle3D": {
            "call": "newton.solvers.style3d.add_cloth_mesh",
            "density": density, "tri_aniso_ke": ways, "edge_aniso_ke": bends,
            "note": "Panel x is the weft, panel y the warp. Nothing else of Newton keeps shear and warp apart. Bending "
            "is right on an even grid whose diagonals alternate.",
        },
        "SolverVBD": {
            "call": "ModelBuilder.add_cloth_mesh",
            "density": density, "tri_ke": stretch / 2, "tri_ka": 0.0, "tri_kd": 0.0,
            "edge_ke": one / spacing, "edge_kd": one / spacing * damping,
            "edge_ke_by_edge": {"straight": straight / spacing, "diagonal": diagonal / spacing},
            "note": "Shear is half of the stretch stiffness, whatever the fabric's is. " + BY_EDGE + " Few iterations "
            "let cloth sag: with steps of 1 ms, 20 of them nearly doubled the sag of a clamped strip. Halve the step "
            "until the sag stays.",
        },
        "SolverSemiImplicit": {
            "call": "ModelBuilder.add_cloth_mesh",
            "density": density, "tri_ke": stretch / 2, "tri_ka": stretch / 2, "tri_kd": 0.0, "tri_drag": drag,
            "edge_ke": one / spacing**3, "edge_kd": one / spacing**3 * damping,
            "edge_ke_by_edge": {"straight": straight / spacing**3, "diagonal": diagonal / spacing**3},
            "note": "Shear is half of the stretch stiffness. Its drag acts at three corners: air density x drag / 6. "
            + BY_EDGE,
        },
        "ModelBuilder.add_usd": {
            "note": "Newton 1.8 takes the USD file's stretch as tri_ke and its bending as edge_ke. A strip is then "
            "twice as stiff in SolverVBD, and bends too easily. Multiply tri_ke by tri_ke_factor. Multiply each "
            "edge_ke by 4 / 3 over its length, or all by edge_ke_factor.",
            "tri_ke_factor": 0.5, "edge_ke_factor": ONE_NUMBER_SHARE / spacing,
        },
        "velocity_damping": {
            "value_per_s": fabric["velocity_damping"].value,
            "note": "Add a force -value x mass x velocity to particle_f; no solver has it as a material.",
        },
    }  # fmt: skip
    return json.dumps(record, indent=2).encode() + b"\n"


def mujoco_flex(result: FitResult, fabric: Fabric, sheet: Sheet) -> bytes:
    """Return a MuJoCo flex as MJCF: a sheet that hangs from its held edge."""
    stretch, bending = fabric.mean_of_ways("stretch"), fabric.mean_of_ways("bending")
    thickness = float(np.sqrt(12 * FLEX_SHARE * bending / stretch))
    masses = fabric["areal_density"].value * sheet.node_areas
    held = set(sheet.held.tolist())
    bodies = []
    for k, (place, mass) in enumerate(zip(sheet.start.tolist(), masses.tolist(), strict=True)):
        inertial = f'<inertial pos="0 0 0" mass="{mass:.9g}" diaginertia="1e-9 1e-9 1e-9"/>'
        where = " ".join(f"{x:.9g}" for x in place)
        bodies.append(f'    <body name="n{k}" pos="{where}">{inertial}{"" if k in held else SLIDES}</body>')
    words = [
        *origin_lines(result), *caution_lines(result, fabric),
        "MuJoCo's flex is isotropic: its shear stiffness is half of the stretch stiffness, not the fabric's.",
        "thickness and young are chosen so that membrane and bending are right; neither value is a measurement.",
        "Linear damping is no part of the file, since MuJoCo refuses it at a flex's nodes. After loading, in Python: "
        "rate = model.numeric('hangtime_velocity_damping').data[0]; "
        "model.dof_damping[:] = rate * model.body_mass[model.dof_bodyid].",
        "Quadratic air drag, if any, is no part of the flex.",
    ]  # fmt: skip
    numbers = "\n".join(f'    <numeric name="hangtime_{q.name}" data="{_numbers(q)}"/>' for q in fabric.quantities)
    comment = re.sub("-(?=-)", "- ", "\n".join(f"  {line}" for line in words))  # XML 1.0, section 2.5: no --
    names = " ".join(f"n{k}" for k in range(len(sheet.rest)))
    elements = " ".join(map(str, sheet.triangles.ravel().tolist()))
    text = f"""<mujoco model={quoteattr(sheet.name)}>
  <!--
{comment}
  hangtime_NAME holds a value and, where it has one, its 90 % interval.
  -->
  <option timestep="{_timestep(fabric, sheet):.3g}" integrator="Euler" gravity="0 0 {-GRAVITY}"/>
  <size memory="500M"/>
  <custom>
    <text name="hangtime_provenance" data={quoteattr(json.dumps(provenance(result)))}/>
    <text name="hangtime_not_identified" data={quoteattr(" ".join(q.name for q in fabric.not_identified) or "none")}/>
{numbers}
  </custom>
  <worldbody>
{chr(10).join(bodies)}
  </worldbody>
  <deformable>
    <flex name="cloth" dim="2" radius="{thickness / 2:.6g}" body="{names}" element="{elements}">
      <contact selfcollide="none" contype="0" conaffinity="0"/>
      <elasticity young="{stretch / thickness:.9g}" poisson="0" thickness="{thickness:.9g}" damping="{
        fabric["stretch_damping_time"].value:.6g}" elastic2d="both"/>
    </flex>
  </deformable>
</mujoco>
"""
    return text.encode()


def _numbers(quantity: Quantity) -> str:
    ends = [] if quantity.low is None or quantity.high is None else [quantity.low, quantity.high]
    return " ".join(f"{value:.9g}" for value in (quantity.value, *ends))


def _timestep(fabric: Fabric, sheet: Sheet) -> float:
    """Return a stable time step [s] of the explicit integrator, from the fastest wave across the finest triangle."""
    a, b, c = (sheet.rest[sheet.triangles[:, k]] for k in range(3))
    shortest = min(float(np.linalg.norm(p - q, axis=1).min()) for p, q in ((a, b), (b, c), (c, a)))
    density = fabric["areal_density"].value
    wave = np.sqrt(4 * fabric.mean_of_ways("stretch") / density) / shortest
    bend = np.sqrt(16 * fabric.mean_of_ways("bending") / density) / shortest**2
    return float(min(2e-3, 1 / (FEWEST_STEPS_A_PERIOD / 2 * np.hypot(wave, bend))))

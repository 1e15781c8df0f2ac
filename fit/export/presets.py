"""Presets for other simulators: Newton's cloth solvers as JSON, and a sheet of MuJoCo's flex as XML.

Of Newton 1.8, with its energies per rest area read from the source and the strip of `tests/fit/export` as the proof:

    SolverStyle3D       k_u (|F_u| - 1)^2 / 2 + k_v (|F_v| - 1)^2 / 2 + k_s (f_u . f_v)^2 / 2, f = F / |F|
                        which is our membrane: tri_aniso_ke = (weft, warp, shear)
    SolverVBD           stable neo-Hookean with Lame's mu and lambda; at lambda = 0 the tension of a strip is 2 mu per
                        strain and the shear mu: tri_ke = stretch / 2, tri_ka = 0. Shear cannot be chosen
    SolverSemiImplicit  mu and k = lambda + mu: tri_ke = tri_ka = stretch / 2

Bending on edges of length L between triangles of areas A0 and A1, heights a, that meet at the angle theta. Cloth that
bends to a cylinder of curvature kappa has the energy B kappa^2 / 2 per area. An even grid bent along one side has theta
= kappa L and L^2 = A0 + A1. On equilateral triangles the three directions of edges have the same sum for every
direction of the bend. Hence

    Style3D             3 k L^2 theta^2 / (2 (A0 + A1)):  k = B / 3
    VBD                 k L theta^2 / 2:                  k = B L / (A0 + A1),  B / h on a grid of spacing h
    SemiImplicit        as k L^2 a theta^2 / 2:           k = B / ((A0 + A1) a),  B / h^3

Cells of a real mesh do not stay plane: a bend is shared with the diagonals, which makes the mesh softer. Of a strip
0.1 m long, clamped at one end on a grid of 1 cm, the tip sags by 7.9 mm in SolverSemiImplicit. With plane cells it
would sag by 6.5 mm, so that the bending comes out a fifth too soft. SolverStyle3D had sagged by 7.1 mm after 2 s and
went on. SolverVBD sagged by 11.6 mm, which nothing here explains: its bending is not verified.

MuJoCo's flex is isotropic: membrane E t and bending E t^3 / 12 at Poisson's ratio 0. Both are right with t = sqrt(12 B
/ k) and E = k / t. These are no thickness and no modulus of the fabric. Its shear is then k / 2. MuJoCo 4.0 refuses
damping at the slides of a flex's nodes in a file, so that linear damping is one line to add after loading. Neither
engine has quadratic drag of cloth along its normal as a material: it stays a number beside.
"""

from __future__ import annotations

import json
import re
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from fit.cloth.support import GRAVITY
from fit.effects.air_drag import AIR_DENSITY
from fit.export.about import caution_lines, origin_lines, provenance, quantity_record
from fit.export.fabric import Fabric, Quantity
from fit.export.sheet import SWATCH_SPACING, Sheet
from formats.fit_records import FitResult

SLIDES = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
FEWEST_STEPS = 4.0  # steps a period of the fastest node, for MuJoCo's semi-implicit Euler


def newton_preset(result: FitResult, fabric: Fabric, spacing: float = SWATCH_SPACING) -> bytes:
    """Return the numbers of Newton's solvers as JSON; those of edges are for a square grid of this spacing [m]."""
    stretch, bending = fabric.mean_of_ways("stretch"), fabric.mean_of_ways("bending")
    density = fabric["areal_density"].value
    ways = [fabric["stretch_weft"].value, fabric["stretch_warp"].value, fabric["shear"].value]
    bends = [fabric["bending_weft"].value / 3, fabric["bending_warp"].value / 3, bending / 3]
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
            "of a triangle mesh comes out about a fifth too soft.",
        },
        "SolverVBD": {
            "call": "ModelBuilder.add_cloth_mesh",
            "density": density, "tri_ke": stretch / 2, "tri_ka": 0.0, "tri_kd": 0.0,
            "edge_ke": bending / spacing, "edge_kd": bending / spacing * damping,
            "note": "Shear is half of the stretch stiffness, whatever the fabric's is. A clamped strip sagged by 1.8 "
            "times what it should: the bending is not verified.",
        },
        "SolverSemiImplicit": {
            "call": "ModelBuilder.add_cloth_mesh",
            "density": density, "tri_ke": stretch / 2, "tri_ka": stretch / 2, "tri_kd": 0.0, "tri_drag": drag,
            "edge_ke": bending / spacing**3, "edge_kd": bending / spacing**3 * damping,
            "note": "Shear is half of the stretch stiffness. Its drag acts at three corners: air density x drag / 6.",
        },
        "ModelBuilder.add_usd": {
            "note": "Newton 1.8 takes the USD file's stretch as tri_ke and its bending as edge_ke. A strip is then "
            "twice as stiff in SolverVBD, and bends too easily: multiply tri_ke by tri_ke_factor, and each edge_ke by "
            "its length over the area of its two triangles.",
            "tri_ke_factor": 0.5, "edge_ke_factor": 1 / spacing,
        },
        "velocity_damping": {
            "value_per_s": fabric["velocity_damping"].value,
            "note": "Add a force -value x mass x velocity to particle_f; no solver has it as a material.",
        },
    }  # fmt: skip
    return json.dumps(record, indent=2).encode() + b"\n"


def mujoco_flex(result: FitResult, fabric: Fabric, sheet: Sheet) -> bytes:
    """Return a sheet of MuJoCo's flex as MJCF that hangs from its held edge."""
    stretch, bending = fabric.mean_of_ways("stretch"), fabric.mean_of_ways("bending")
    thickness = float(np.sqrt(12 * bending / stretch))
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
        "thickness and young are chosen so that membrane and bending are right; they are no measurements.",
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
    """Return a step [s] that the explicit integrator is stable at: of the fastest wave across the finest triangle."""
    a, b, c = (sheet.rest[sheet.triangles[:, k]] for k in range(3))
    shortest = min(float(np.linalg.norm(p - q, axis=1).min()) for p, q in ((a, b), (b, c), (c, a)))
    density = fabric["areal_density"].value
    wave = np.sqrt(4 * fabric.mean_of_ways("stretch") / density) / shortest
    bend = np.sqrt(16 * fabric.mean_of_ways("bending") / density) / shortest**2
    return float(min(2e-3, 1 / (FEWEST_STEPS / 2 * np.hypot(wave, bend))))

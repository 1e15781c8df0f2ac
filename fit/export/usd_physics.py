"""Export of a fabric as a USD deformable by AOUSD's proposed schema, with further quantities under `hangtime:`.

The proposal (OpenUSD-proposals #111, "Deformable Body Physics in USD") has one stretch and one shear stiffness
[force/distance] and one bending stiffness [force x distance]. For a plate of thickness h they are E h / (1 - nu^2), G h
and E h^3 / (12 (1 - nu^2)). At nu = 0 these are the membrane and the bending stiffness of `fit.cloth.material`, one to
one. Warp and weft share one number there, their geometric mean. Density is per volume, so the weight needs a thickness.
Density x thickness is the fabric's mass per area, for any thickness.

The proposal leaves out warp and weft apart, damping, drag and intervals. It also leaves out the certainty and origin of
each number. All these are under `hangtime:`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.export.about import caution_lines, origin_lines
from fit.export.fabric import Fabric, Quantity
from fit.export.sheet import Sheet, upright
from fit.export.usd_stage import ROOT, define_cloth, new_stage, usd_bytes
from formats.fit_records import FitResult

THICKNESS = 1e-3  # m: the proposal's own fallback, as motion does not identify a thickness
MATERIAL = f"{ROOT}/fabric"


def usd_physics(result: FitResult, fabric: Fabric, sheet: Sheet, thickness: float = THICKNESS) -> bytes:
    """Return a `.usda` file of a sheet of this fabric, z up, metres, kilograms.

    Raises:
        ModuleNotFoundError: usd-core is not installed.
    """
    from pxr import UsdPhysics, UsdShade

    stage = new_stage(result)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.GetDefaultPrim().AddAppliedSchema("PhysicsDeformableBodyAPI")
    cloth = _cloth(stage, sheet, thickness)
    material = _material(stage, fabric, thickness)
    UsdShade.MaterialBindingAPI.Apply(cloth).Bind(material, UsdShade.Tokens.weakerThanDescendants, "physics")
    words = [
        *origin_lines(result),
        f"The thickness, {1e3 * thickness:.2g} mm, is assumed; density x thickness is the mass per area.",
        *caution_lines(result, fabric),
    ]
    stage.GetRootLayer().documentation = "\n".join(words)
    stage.GetRootLayer().comment = "Stretch, shear and bending follow AOUSD's proposal 111; the rest is hangtime's."
    return usd_bytes(stage, ".usda")


def _cloth(stage: Any, sheet: Sheet, thickness: float) -> Any:
    """Define the mesh with its flat rest shape, and return its prim."""
    from pxr import Sdf, Vt

    mesh = define_cloth(stage, sheet.triangles)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(sheet.start.astype(np.float32)))
    mesh.CreateExtentAttr(
        Vt.Vec3fArray.FromNumpy(np.stack([sheet.start.min(0), sheet.start.max(0)]).astype(np.float32))
    )
    prim = mesh.GetPrim()
    prim.AddAppliedSchema("PhysicsSurfaceDeformableSimAPI")
    flat, corners = upright(sheet.rest).astype(np.float32), sheet.triangles.astype(np.int32)
    types = Sdf.ValueTypeNames
    for name, kind, value in (
        ("physics:restShapePoints", types.Point3fArray, Vt.Vec3fArray.FromNumpy(flat)),
        ("physics:restTriVertexIndices", types.Int3Array, Vt.Vec3iArray.FromNumpy(corners)),
        ("physics:thicknesses", types.FloatArray, Vt.FloatArray([thickness])),
        ("physics:thicknesses:elementType", types.Token, "constant"),
        ("hangtime:heldPoints", types.IntArray, Vt.IntArray.FromNumpy(sheet.held.astype(np.int32))),
    ):
        prim.CreateAttribute(name, kind).Set(value)
    return prim


def _material(stage: Any, fabric: Fabric, thickness: float) -> Any:
    """Define the material: the proposal's attributes, and every quantity under `hangtime:`."""
    from pxr import Sdf, UsdShade

    material = UsdShade.Material.Define(stage, MATERIAL)
    prim = material.GetPrim()
    prim.AddAppliedSchema("PhysicsSurfaceDeformableMaterialAPI")
    stretch, bending = fabric.mean_of_ways("stretch"), fabric.mean_of_ways("bending")
    for name, value in (
        ("density", fabric["areal_density"].value / thickness),
        ("poissonsRatio", 0.0),
        ("surfaceStretchStiffness", stretch),
        ("surfaceShearStiffness", fabric["shear"].value),
        ("surfaceBendStiffness", bending),
    ):
        prim.CreateAttribute(f"physics:{name}", Sdf.ValueTypeNames.Float).Set(value)
    for quantity in fabric.quantities:
        _own(prim, quantity)
    return material


def _own(prim: Any, quantity: Quantity) -> None:
    from pxr import Gf, Sdf

    name = f"hangtime:{quantity.name}"
    types = Sdf.ValueTypeNames
    attribute = prim.CreateAttribute(name, types.Double)
    attribute.Set(quantity.value)
    attribute.SetDocumentation(f"{quantity.meaning} [{quantity.unit}]")
    prim.CreateAttribute(f"{name}:unit", types.Token).Set(quantity.unit)
    prim.CreateAttribute(f"{name}:status", types.Token).Set(quantity.status)
    prim.CreateAttribute(f"{name}:isIdentified", types.Bool).Set(quantity.is_known)
    if quantity.low is not None and quantity.high is not None:
        prim.CreateAttribute(f"{name}:interval90", types.Double2).Set(Gf.Vec2d(quantity.low, quantity.high))

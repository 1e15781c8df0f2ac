"""A fabric as a deformable in USD: the schema that AOUSD proposes, with what it leaves out under `hangtime:`.

The proposal (OpenUSD-proposals #111, "Deformable Body Physics in USD") has one stretch and one shear stiffness
[force/distance] and one bending stiffness [force x distance]. For a plate of thickness h they are E h / (1 - nu^2), G h
and E h^3 / (12 (1 - nu^2)). At nu = 0 these are the membrane and the bending stiffness of `fit.cloth.material`, one to
one. Warp and weft share one number there, their geometric mean. Density is per volume, so the weight needs a thickness.
Density x thickness is the fabric's mass per area, for any thickness.

The proposal leaves out warp and weft apart, damping, drag and intervals. It also leaves out the certainty and origin of
each number. All these are under `hangtime:`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from fit.export.about import caution_lines, origin_lines, provenance
from fit.export.fabric import Fabric, Quantity
from fit.export.sheet import Sheet
from formats.fit_records import FitResult

THICKNESS = 1e-3  # m: the proposal's own fallback; no motion tells a thickness
ROOT, CLOTH, MATERIAL = "/Garment", "/Garment/cloth", "/Garment/fabric"


def usd_physics(result: FitResult, fabric: Fabric, sheet: Sheet, thickness: float = THICKNESS) -> bytes:
    """Return a `.usda` file of a sheet of this fabric, z up, metres, kilograms.

    Raises:
        ModuleNotFoundError: usd-core is not installed.
    """
    from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, ROOT).GetPrim()
    stage.SetDefaultPrim(root)
    root.AddAppliedSchema("PhysicsDeformableBodyAPI")
    root.SetCustomDataByKey("hangtime", _plain(provenance(result)))
    _cloth(stage, sheet, thickness)
    material = _material(stage, fabric, thickness)
    cloth = stage.GetPrimAtPath(CLOTH)
    UsdShade.MaterialBindingAPI.Apply(cloth).Bind(material, UsdShade.Tokens.weakerThanDescendants, "physics")
    words = [
        *origin_lines(result),
        f"The thickness, {1e3 * thickness:.2g} mm, is assumed; density x thickness is the mass per area.",
        *caution_lines(result, fabric),
    ]
    stage.GetRootLayer().documentation = "\n".join(words)
    stage.GetRootLayer().comment = "Stretch, shear and bending follow AOUSD's proposal 111; the rest is hangtime's."
    return usd_bytes(stage, ".usda")


def usd_bytes(stage: Any, suffix: str) -> bytes:
    """Return a stage as the bytes of its file."""
    with tempfile.TemporaryDirectory(prefix="hangtime-usd-") as folder:
        path = Path(folder) / f"stage{suffix}"
        if not stage.GetRootLayer().Export(str(path)):
            raise OSError(f"usd-core could not write {path}")
        return path.read_bytes()


def _cloth(stage: Any, sheet: Sheet, thickness: float) -> None:
    """Define the mesh with its flat rest shape."""
    from pxr import Sdf, UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, CLOTH)
    points = Vt.Vec3fArray.FromNumpy(sheet.start.astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateExtentAttr(
        Vt.Vec3fArray.FromNumpy(np.stack([sheet.start.min(0), sheet.start.max(0)]).astype(np.float32))
    )
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(sheet.triangles), 3, np.int32)))
    corners = sheet.triangles.astype(np.int32)
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    prim = mesh.GetPrim()
    prim.AddAppliedSchema("PhysicsSurfaceDeformableSimAPI")
    flat = np.stack([sheet.rest[:, 0], np.zeros(len(sheet.rest)), sheet.rest[:, 1]], 1).astype(np.float32)
    types = Sdf.ValueTypeNames
    for name, kind, value in (
        ("physics:restShapePoints", types.Point3fArray, Vt.Vec3fArray.FromNumpy(flat)),
        ("physics:restTriVertexIndices", types.Int3Array, Vt.Vec3iArray.FromNumpy(corners)),
        ("physics:thicknesses", types.FloatArray, Vt.FloatArray([thickness])),
        ("physics:thicknesses:elementType", types.Token, "constant"),
        ("hangtime:heldPoints", types.IntArray, Vt.IntArray.FromNumpy(sheet.held.astype(np.int32))),
    ):
        prim.CreateAttribute(name, kind).Set(value)


def _material(stage: Any, fabric: Fabric, thickness: float) -> Any:
    """Define the material: the proposal's attributes, and every quantity under `hangtime:`."""
    from pxr import Sdf, UsdShade

    material = UsdShade.Material.Define(stage, MATERIAL)
    prim = material.GetPrim()
    prim.AddAppliedSchema("PhysicsSurfaceDeformableMaterialAPI")
    stretch, bending = mean_of_ways(fabric, "stretch"), mean_of_ways(fabric, "bending")
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
    prim.CreateAttribute(f"{name}:isIdentified", types.Bool).Set(quantity.is_told)
    if quantity.low is not None and quantity.high is not None:
        prim.CreateAttribute(f"{name}:interval90", types.Double2).Set(Gf.Vec2d(quantity.low, quantity.high))


def mean_of_ways(fabric: Fabric, name: str) -> float:
    """Return the geometric mean of warp and weft, for a format that knows one direction."""
    return float(np.sqrt(fabric[f"{name}_warp"].value * fabric[f"{name}_weft"].value))


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Return values that USD takes as custom data: lists of text become one text."""
    return {name: " ".join(map(str, value)) if isinstance(value, list) else value for name, value in values.items()}

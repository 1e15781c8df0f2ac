"""Open exported USD files: z up, metres, one root with its provenance, and one mesh of cloth."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.export.about import flat_provenance
from formats.fit_records import FitResult

ROOT, CLOTH, FIGURE = "/Garment", "/Garment/cloth", "/Garment/figure"


def new_stage(result: FitResult) -> Any:
    """Return a stage with an empty root that says where the fit comes from.

    Raises:
        ModuleNotFoundError: usd-core is not installed.
    """
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, ROOT).GetPrim()
    stage.SetDefaultPrim(root)
    root.SetCustomDataByKey("hangtime", flat_provenance(result))
    return stage


def define_cloth(stage: Any, triangles: NDArray[np.signedinteger]) -> Any:
    """Return the mesh of the cloth with its faces, seen from both sides; its points are the caller's."""
    mesh = define_mesh(stage, CLOTH, triangles)
    mesh.CreateDoubleSidedAttr(True)
    return mesh


def define_mesh(stage: Any, path: str, triangles: NDArray[np.signedinteger]) -> Any:
    """Return a mesh with its faces; its points are the caller's."""
    from pxr import UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(triangles.astype(np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    return mesh


def usd_bytes(stage: Any, suffix: str) -> bytes:
    """Return a stage as the bytes of its file."""
    with tempfile.TemporaryDirectory(prefix="hangtime-usd-") as folder:
        path = Path(folder) / f"stage{suffix}"
        if not stage.GetRootLayer().Export(str(path)):
            raise OSError(f"usd-core could not write {path}")
        return path.read_bytes()

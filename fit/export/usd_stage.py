"""Common parts of exported USD files: z up, metres, a root with provenance, and the mesh of the cloth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.export.about import flat_provenance
from formats.exporters.by_library import bytes_by_library
from formats.fit_records import FitResult

ROOT, CLOTH_PATH, FIGURE = "/Garment", "/Garment/cloth", "/Garment/figure"


def new_stage(result: FitResult) -> Any:
    """Return a stage with an empty root that holds the fit's provenance.

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
    """Define the two-sided mesh of the cloth with its faces; the caller sets its points."""
    mesh = define_mesh(stage, CLOTH_PATH, triangles)
    mesh.CreateDoubleSidedAttr(True)
    return mesh


def define_mesh(stage: Any, path: str, triangles: NDArray[np.signedinteger]) -> Any:
    """Define a mesh with its faces; the caller sets its points."""
    from pxr import UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(triangles.astype(np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    return mesh


def usd_bytes(stage: Any, suffix: str) -> bytes:
    """Return a stage as the bytes of its file.

    Raises:
        OutputError: usd-core cannot write it into the folder for temporary files.
    """
    layer = stage.GetRootLayer()
    return bytes_by_library(lambda path: layer.Export(str(path)), f"stage{suffix}")

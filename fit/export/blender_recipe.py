"""Export of a Blender script that builds the cloth, with settings that approximate the fit.

Blender's settings act per vertex and spring, so that their meaning changes with the mesh. A fit of `kinect-skirt`
determines six of them for a mesh of its own spacing, and they are written unchanged. For any other fit the map of
`fit.methods.kinect_skirt` is inverted:

    Mass = 1,  Struct = k / 10,  Bend = 10^6 B,  Spring = tau / 4e-4,  Air = 100 c

with the stretch stiffness k [N/m], the bending stiffness B [N m], its damping time tau [s] and the linear damping c
[1/s]. `fit.engines.blender` maps the six to Blender's settings, which the script contains.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from fit.engines.blender import AIR_RATE, BLENDER_FPS, PARAMETERS_NEEDED, blender_settings
from fit.errors import FitError
from fit.export.about import caution_lines, origin_lines
from fit.export.fabric import Fabric, why_no_fabric
from fit.export.sheet import Sheet
from formats.fit_records import FitResult

BLENDER_SETTINGS = (
    "mass",
    "tension_stiffness",
    "bending_stiffness",
    "tension_damping",
    "air_damping",
    "shear_stiffness",
)


def blender_script(result: FitResult, fabric: Fabric | None, sheet: Sheet) -> bytes:
    """Return a Python script for Blender: `blender --python FILE`, or its Scripting tab.

    Raises:
        FitError: the fit has neither Blender's settings nor a fabric.
    """
    values = dict(zip(BLENDER_SETTINGS, blender_settings(_six(result, fabric)[None])[0].tolist(), strict=True))
    held, mesh = sheet.held.tolist(), {"points": sheet.start.round(6).tolist(), "faces": sheet.triangles.tolist()}
    cautions = [
        *origin_lines(result),
        "APPROXIMATE: Blender's settings act per vertex and spring. The settings mean nothing on another mesh.",
        *caution_lines(result, fabric),
    ]
    lines = "\n".join(f"# {line}" for line in cautions)
    return SCRIPT.format(
        lines=lines, name=repr(sheet.name), settings=json.dumps(values, indent=4), held=json.dumps(held),
        mesh=json.dumps(mesh), fps=BLENDER_FPS,
    ).encode()  # fmt: skip


def _six(result: FitResult, fabric: Fabric | None) -> Any:
    """Return the method's six parameters, (6,): those of the fit, or the fabric's by the inverse map."""
    found = {p.name: p.fitted for p in result.parameters}
    if set(PARAMETERS_NEEDED) <= found.keys():
        return np.array([found[name] for name in PARAMETERS_NEEDED])
    if fabric is None:
        raise FitError(
            why_no_fabric(result),
            where=result.label,
            advice="fit with si, or with kinect-skirt for Blender's own settings",
        )
    return np.array(
        [
            1.0, fabric.mean_of_ways("stretch") / 10, 1e6 * fabric.mean_of_ways("bending"),
            fabric["bending_damping_time"].value / 4e-4, fabric["velocity_damping"].value / AIR_RATE, 1.0,
        ]
    )  # fmt: skip


SCRIPT = """{lines}

import bpy

NAME = {name}
SETTINGS = {settings}
HELD = {held}  # vertices that stay where they are
MESH = {mesh}

mesh = bpy.data.meshes.new(NAME)
mesh.from_pydata(MESH["points"], [], MESH["faces"])
mesh.update()
cloth = bpy.data.objects.new(NAME, mesh)
bpy.context.scene.collection.objects.link(cloth)
group = cloth.vertex_groups.new(name="held")
group.add(HELD, 1.0, "REPLACE")
modifier = cloth.modifiers.new("Cloth", "CLOTH")
settings = modifier.settings
settings.quality = 10
settings.vertex_group_mass = group.name
settings.mass = SETTINGS["mass"]
settings.tension_stiffness = settings.compression_stiffness = SETTINGS["tension_stiffness"]
settings.tension_damping = settings.compression_damping = settings.shear_damping = SETTINGS["tension_damping"]
settings.shear_stiffness = SETTINGS["shear_stiffness"]
settings.bending_stiffness = SETTINGS["bending_stiffness"]
settings.bending_damping = 0.0
settings.air_damping = SETTINGS["air_damping"]
bpy.context.scene.render.fps = {fps}
for polygon in mesh.polygons:
    polygon.use_smooth = True
print("hangtime: made", NAME, "with", len(mesh.vertices), "vertices; play the animation to see it hang")
"""

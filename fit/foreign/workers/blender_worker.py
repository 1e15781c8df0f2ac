"""Worker process that simulates jobs with Blender's cloth, from files named on its standard input.

`fit.engines.blender` runs this program with any Python that has `bpy`. The program imports nothing of Hangtime. A job
is an .npz file with

    quads (faces, 4), pinned (n,), fps, and path (frames, nodes, 3) [m], z up: frame 0 is the flat cloth, whose lengths
    are its rest lengths; afterwards only the pinned nodes' positions count; settings, (candidates, 6): mass, tension,
    bending, damping, air, shear, as Blender's cloth settings want them; quality, if not QUALITY

The answer is an .npz with `nodes`, (candidates, frames, nodes, 3), NaN for a candidate that Blender lost. Its `seconds`
is the processor time of this process.
"""

import os
import struct
import tempfile
import time

import bpy
import numpy as np
from answering import answer_jobs

QUALITY = 12  # steps a frame, as Blender's own stiffest preset (denim) has it


def point_cache(path, file):
    """Write vertex positions, (frames, nodes, 3), as a PC2 file for the mesh cache modifier."""
    frames, nodes, _ = path.shape
    with open(file, "wb") as out:
        out.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, nodes, 0.0, 1.0, frames))
        out.write(np.ascontiguousarray(path, "<f4").tobytes())


def build(job, cache_file):
    """Return scene and object of a cloth whose pinned nodes follow the cache."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    path = job["path"]
    scene.render.fps = int(job["fps"])
    scene.frame_start, scene.frame_end = 0, len(path) - 1
    mesh = bpy.data.meshes.new("cloth")
    mesh.from_pydata(path[0].tolist(), [], job["quads"].tolist())
    mesh.update()
    cloth = bpy.data.objects.new("cloth", mesh)
    scene.collection.objects.link(cloth)
    cloth.vertex_groups.new(name="pin").add(job["pinned"].tolist(), 1.0, "REPLACE")
    drive = cloth.modifiers.new("drive", "MESH_CACHE")
    drive.cache_format, drive.filepath, drive.forward_axis, drive.up_axis = "PC2", cache_file, "POS_Y", "POS_Z"
    drive.frame_start = 0.0
    modifier = cloth.modifiers.new("cloth", "CLOTH")
    modifier.settings.vertex_group_mass = "pin"
    modifier.collision_settings.use_collision = False
    modifier.collision_settings.use_self_collision = False
    modifier.point_cache.frame_start, modifier.point_cache.frame_end = 0, len(path) - 1
    return scene, cloth, modifier


def simulate(scene, cloth, modifier, row, frames, quality):
    """Return the nodes, (frames, nodes, 3), of one candidate."""
    mass, tension, bending, damping, air, shear = (float(value) for value in row)
    settings = modifier.settings
    settings.quality = quality
    settings.mass, settings.air_damping = mass, air
    settings.tension_stiffness = settings.compression_stiffness = tension
    settings.shear_stiffness, settings.bending_stiffness = shear, bending
    settings.tension_damping = settings.compression_damping = settings.shear_damping = damping
    settings.bending_damping = 0.0
    scene.frame_set(0)
    nodes = np.empty((frames, len(cloth.data.vertices), 3), np.float32)
    for frame in range(frames):
        scene.frame_set(frame)
        evaluated = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get())
        flat = np.empty(nodes.shape[1] * 3, np.float32)
        evaluated.data.vertices.foreach_get("co", flat)
        nodes[frame] = flat.reshape(-1, 3)
    if not np.isfinite(nodes).all() or np.abs(nodes).max() > 100.0:
        nodes[:] = np.nan
    return nodes


def simulate_all(job):
    """Return the nodes of every candidate."""
    with tempfile.TemporaryDirectory() as folder:
        cache_file = os.path.join(folder, "drive.pc2")
        point_cache(job["path"], cache_file)
        found, quality, began = [], int(job.get("quality", QUALITY)), time.process_time()
        for row in job["settings"]:
            scene, cloth, modifier = build(job, cache_file)
            found.append(simulate(scene, cloth, modifier, row, len(job["path"]), quality))
    return {"nodes": np.array(found), "seconds": np.array(time.process_time() - began)}


if __name__ == "__main__":
    answer_jobs(bpy.app.version_string, simulate_all)

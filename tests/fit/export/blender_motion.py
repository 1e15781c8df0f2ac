"""Run in Blender's own Python: open an exported motion, and write the positions of its nodes, frame by frame.

blender_motion.py FILE OUT.npz FRAMES

FILE is .usdc, .glb, .abc or .pc2 (beside its .obj); frames are 1/30 s apart and count from 0.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

FPS = 30


def main():
    """Open the file and look at every frame."""
    path, out, frames = Path(sys.argv[1]).resolve(), sys.argv[2], int(sys.argv[3])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = FPS, 1.0
    if path.suffix == ".usdc":
        bpy.ops.wm.usd_import(filepath=str(path), set_frame_range=True)
    elif path.suffix == ".abc":
        bpy.ops.wm.alembic_import(filepath=str(path))
    elif path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    else:
        bpy.ops.wm.obj_import(filepath=str(path.with_suffix(".obj")), forward_axis="Y", up_axis="Z")
    cloth = next(o for o in bpy.data.objects if o.type == "MESH" and len(o.data.polygons) > 0)
    if path.suffix == ".pc2":
        cache = cloth.modifiers.new("cache", "MESH_CACHE")
        cache.cache_format, cache.filepath = "PC2", str(path)
        cache.frame_start, cache.interpolation = 0.0, "NONE"
        cache.forward_axis, cache.up_axis = "POS_Y", "POS_Z"
    places = []
    for frame in range(frames):
        scene.frame_set(frame)
        seen = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = seen.to_mesh()
        flat = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", flat)
        turn = np.array(seen.matrix_world)
        places.append(flat.reshape(-1, 3) @ turn[:3, :3].T + turn[:3, 3])
        seen.to_mesh_clear()
    np.savez(out, places=np.array(places), version=bpy.app.version_string, fps=scene.render.fps)


if __name__ == "__main__":
    main()

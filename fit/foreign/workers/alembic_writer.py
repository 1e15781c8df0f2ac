"""Script for Blender's Python that writes moving cloth as Alembic.

alembic_writer.py JOB.npz OUT.abc

The job holds positions as `places`, (frames, nodes, 3), triangles, rest, (nodes, 2), and fps.
"""

import sys

import bpy
import numpy as np


def main():
    """Build the mesh, give it a shape key a frame, and export it."""
    with np.load(sys.argv[1]) as job:
        places, triangles, rest, fps = job["places"], job["triangles"], job["rest"], float(job["fps"])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    # Blender counts whole frames a second, over a base.
    scene.render.fps = max(round(fps), 1)
    scene.render.fps_base = scene.render.fps / fps
    scene.frame_start, scene.frame_end = 0, len(places) - 1
    mesh = bpy.data.meshes.new("cloth")
    mesh.from_pydata(places[0].tolist(), [], triangles.tolist())
    layer = mesh.uv_layers.new(name="flat")
    layer.data.foreach_set("uv", rest[triangles.ravel()].astype(np.float32).ravel())
    cloth = bpy.data.objects.new("cloth", mesh)
    scene.collection.objects.link(cloth)

    # A shape key whose value changes tells Blender that the mesh is one that deforms.
    cloth.shape_key_add(name="first")
    for number, frame in enumerate(places[1:], 1):
        key = cloth.shape_key_add(name=f"frame {number}", from_mix=False)
        key.data.foreach_set("co", np.ascontiguousarray(frame, np.float32).ravel())
        for at, value in ((number - 1, 0.0), (number, 1.0), (number + 1, 0.0)):
            key.value = value
            key.keyframe_insert("value", frame=at)
    bpy.ops.wm.alembic_export(filepath=sys.argv[2], start=0, end=len(places) - 1, global_scale=1.0, flatten=True)


if __name__ == "__main__":
    main()

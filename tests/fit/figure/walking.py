"""A walk as a BVH file of another program: y up, centimetres, and a position for every joint."""

from __future__ import annotations

import numpy as np

NAMES = {
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "toe": "ToeBase", "shoulder": "Arm", "elbow": "ForeArm",
    "wrist": "Hand",
}  # fmt: skip


def bvh_of(motion, every=16, units=100.0):
    """The text of a file with a frame every so many instants, metres times `units`, z up turned to y up."""
    tree = [("Hips", None, "pelvis")]
    for side in ("left", "right"):
        for chain in (("hip", "knee", "ankle", "toe"), ("shoulder", "elbow", "wrist")):
            above = "Hips"
            for part in chain:
                name = f"mixamorig:{side.capitalize()}{NAMES[part]}"
                tree.append((name, above, f"{side}_{part}"))
                above = name
    places = {joint: units * motion.joints[joint][::every][:, [0, 2, 1]] * [1, 1, -1] for _, _, joint in tree}
    lines, columns = ["HIERARCHY"], []

    def write(name, deep):
        pad, above = "  " * deep, {n: j for n, _, j in tree}
        joint = above[name]
        parent = next(a for n, a, _ in tree if n == name)
        offset = places[joint][0] - (places[above[parent]][0] if parent else 0)
        lines.append(f"{pad}{'JOINT' if parent else 'ROOT'} {name}")
        lines.extend([f"{pad}{{", f"{pad}  OFFSET {offset[0]:.6f} {offset[1]:.6f} {offset[2]:.6f}"])
        lines.append(f"{pad}  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation")
        moved = places[joint] - (places[above[parent]] if parent else 0)
        columns.append(np.column_stack([moved, np.zeros((len(moved), 3))]))
        children = [n for n, a, _ in tree if a == name]
        for child in children:
            write(child, deep + 1)
        if not children:
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0 0 5", f"{pad}  }}"])
        lines.append(f"{pad}}}")

    write("Hips", 0)
    rows = np.concatenate(columns, 1)
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {every * motion.spacing:.6f}"]
    lines += [" ".join(f"{v:.5f}" for v in row) for row in rows]
    return "\n".join(lines) + "\n"

"""Run in MuJoCo's own Python: clamp an exported flex at its top two rows, let it sag sideways; print JSON.

mujoco_cantilever.py FILE.xml SPACING
"""

import json
import re
import sys

import mujoco
import numpy as np

SETTLING, SECONDS = 80.0, 0.4  # 1/s of velocity; s: until the sag stays


def main():
    """Clamp the strip and let it sag."""
    path, spacing = sys.argv[1], float(sys.argv[2])
    lines = []
    with open(path) as file:
        for line in file:
            found = re.search(r'<body name="n\d+" pos="\S+ \S+ (\S+)"', line)
            is_held = found and float(found[1]) > -1.01 * spacing
            lines.append(re.sub(r"<joint[^>]*/>", "", line) if is_held else line)
    model = mujoco.MjModel.from_xml_string("".join(lines))
    model.opt.gravity[:] = (0.0, model.opt.gravity[2], 0.0)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    height = data.flexvert_xpos[:, 2]
    bottom = np.flatnonzero(height < height.min() + 1e-6)
    model.dof_damping[:] = SETTLING * model.body_mass[model.dof_bodyid]
    for _ in range(round(SECONDS / model.opt.timestep)):
        mujoco.mj_step(model, data)
    print(json.dumps({"sag": -float(data.flexvert_xpos[bottom, 1].mean()), "version": mujoco.__version__}))


if __name__ == "__main__":
    main()

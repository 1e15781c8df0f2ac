"""Run in MuJoCo's own Python: load an exported flex, let its strip settle and swing; print JSON.

mujoco_strip.py FILE.xml
"""

import json
import sys

import mujoco
import numpy as np
from hanging_chain import AMPLITUDE, SETTLE, SETTLING, SWING, first_mode, frequency


def main():
    """Hang and swing the strip."""
    model = mujoco.MjModel.from_xml_path(sys.argv[1])
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    home = data.flexvert_xpos.copy()
    free = np.flatnonzero(home[:, 2] < -1e-6)
    bottom = np.flatnonzero(home[:, 2] < home[:, 2].min() + 1e-6)
    length = -home[:, 2].min()
    mass = model.body_mass[1:]
    slides = model.body_mass[model.dof_bodyid]
    own = model.numeric("hangtime_velocity_damping").data[0] * slides  # as the file's comment says
    mode = first_mode((home[free, 2] + length) / length)
    out = {"mass": float(mass.sum()), "version": mujoco.__version__, "timestep": model.opt.timestep}
    model.dof_damping[:] = own + SETTLING * slides
    for _ in range(round(SETTLE / model.opt.timestep)):
        mujoco.mj_step(model, data)
    model.dof_damping[:] = own
    out["stretch"] = float(-data.flexvert_xpos[bottom, 2].mean() - length)
    out["drift"] = float(np.abs(data.flexvert_xpos - home)[:, :2].max())
    data.qvel.reshape(-1, 3)[:, 1] += AMPLITUDE * mode
    track = []
    for _ in range(round(SWING / model.opt.timestep)):
        mujoco.mj_step(model, data)
        track.append(data.flexvert_xpos[bottom, 1].mean())
    out["hertz"] = frequency(np.array(track), model.opt.timestep)
    print(json.dumps(out))


if __name__ == "__main__":
    main()

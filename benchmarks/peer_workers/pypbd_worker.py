"""PositionBasedDynamics (pypbd) as a cloth simulator in a separate process, for the jobs of `benchmarks/peers.py`.

XPBD distance constraints on every edge and isometric bending, one iteration a substep. Its gravity points along -y and
cannot be set from Python: the scene is turned, (x, y, z) -> (x, z, -y).
"""

import time

import numpy as np
import pypbd
from answering import answer_jobs

TURN = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
XPBD_DISTANCE, XPBD_BENDING = 4, 3  # pypbd's numbers of these constraints


def simulate(job):
    """Swing the sheet of the first take."""
    simulation = pypbd.Simulation.getCurrent()
    if not simulate.is_ready:
        simulation.initDefault()
        simulate.is_ready = True
    else:
        simulation.reset()
        simulation.getModel().cleanup()
    model = simulation.getModel()
    numbers = dict(zip(job["names"].tolist(), job["numbers"][0].tolist(), strict=True))
    sheet = model.addTriangleModel(job["start"][0] @ TURN.T, job["triangles"].astype(np.uint32).ravel(), testMesh=False)
    particles = model.getParticles()
    for k, mass in enumerate(job["mass"]):
        particles.setMass(k, float(mass))
    for k in job["held"]:
        particles.setMass(int(k), 0.0)
    model.addClothConstraints(sheet, XPBD_DISTANCE, numbers["fibre_warp"], 0, 0, 0, 0, 0, False, False)
    model.addBendingConstraints(sheet, XPBD_BENDING, numbers["bending_warp"])
    every, rate = int(job["every"]), float(job["rate"])
    step = simulation.getTimeStep()
    step.setValueUInt(pypbd.TimeStepController.NUM_SUB_STEPS, every)
    step.setValueUInt(pypbd.TimeStepController.MAX_ITERATIONS, 1)
    pypbd.TimeManager.getCurrent().setTimeStepSize(1 / rate)
    pypbd.TimeManager.getCurrent().setTime(0.0)
    path, share = job["path"][0][::every], job["fraction"][:, None]
    settle = round(int(job["settle_steps"]) / every)
    seen = []
    for sample in range(-settle, len(path)):
        if sample == 0:
            began = time.process_time()
        ends = path[max(sample, 0)]
        for k, place in zip(job["held"], ((1 - share) * ends[:3] + share * ends[3:]) @ TURN.T, strict=True):
            particles.setPosition(int(k), place)
        step.step(model)
        if sample >= 0:
            seen.append(np.array([particles.getPosition(k) for k in range(len(job["rest"]))]) @ TURN)
    return {"nodes": np.array(seen)[None], "seconds": np.array([time.process_time() - began])}


simulate.is_ready = False

if __name__ == "__main__":
    answer_jobs("2.2.2", simulate)

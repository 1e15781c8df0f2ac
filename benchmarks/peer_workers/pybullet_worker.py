"""PyBullet's mass-spring soft body as a cloth simulator in a separate process, for the jobs of `benchmarks/peers.py`.

Springs of the job's warp stiffness lie along every edge, and bending springs across. The held edge hangs on anchors of
bodies that are moved at every step. The only damping is the springs'.
"""

import os
import tempfile
import time

import numpy as np
import pybullet
from answering import answer_jobs

SPRING_DAMPING, BENDING_SPRING = 0.02, 0.5  # N s/m and N/m: below, the motion diverges at these steps


def load(job, numbers, folder):
    """Load the sheet; return it with PyBullet's order of its vertices."""
    start, file = job["start"][0], os.path.join(folder, "sheet.obj")
    with open(file, "w") as out:
        out.writelines(f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in start)
        out.writelines(f"f {i + 1} {j + 1} {k + 1}\n" for i, j, k in job["triangles"])
    sheet = pybullet.loadSoftBody(
        file, basePosition=[0, 0, 0], scale=1, mass=float(job["mass"].sum()), useNeoHookean=0, useBendingSprings=1,
        useMassSpring=1, springElasticStiffness=numbers["fibre_warp"], springDampingStiffness=SPRING_DAMPING,
        springDampingAllDirections=0, springBendingStiffness=BENDING_SPRING, useSelfCollision=0, collisionMargin=0.001,
    )  # fmt: skip
    there = vertices(sheet)
    return sheet, np.array([int(np.argmin(((there - place) ** 2).sum(1))) for place in start])


def vertices(sheet):
    """Return the vertices' positions, (n, 3)."""
    return np.array(pybullet.getMeshData(sheet, -1, flags=pybullet.MESH_DATA_SIMULATION_MESH)[1])


def simulate(job):
    """Swing the sheet of the first take."""
    numbers = dict(zip(job["names"].tolist(), job["numbers"][0].tolist(), strict=True))
    pybullet.resetSimulation(pybullet.RESET_USE_DEFORMABLE_WORLD)
    pybullet.setGravity(numbers["gravity_x"], numbers["gravity_y"], numbers["gravity_z"])
    pybullet.setTimeStep(float(job["dt"]))
    path, share, every = job["path"][0], job["fraction"][:, None], int(job["every"])
    with tempfile.TemporaryDirectory() as folder:
        sheet, order = load(job, numbers, folder)
    anchors = []
    for k in job["held"]:
        anchors.append(pybullet.createMultiBody(0, -1, -1, job["start"][0][k].tolist()))
        pybullet.createSoftBodyAnchor(sheet, int(order[k]), anchors[-1], -1)
    seen, cost, began = [], 0.0, time.process_time()
    for step in range(-int(job["settle_steps"]), len(path)):
        if step >= 0 and step % every == 0:
            cost += time.process_time() - began if step else 0.0  # reading positions is not part of a step
            seen.append(vertices(sheet)[order])
            began = time.process_time()
        ends = path[max(step, 0)]
        for anchor, place in zip(anchors, (1 - share) * ends[:3] + share * ends[3:], strict=True):
            pybullet.resetBasePositionAndOrientation(anchor, place.tolist(), [0, 0, 0, 1])
        pybullet.stepSimulation()
    return {"nodes": np.array(seen)[None], "seconds": np.array([cost])}


if __name__ == "__main__":
    pybullet.connect(pybullet.DIRECT)
    answer_jobs(str(pybullet.getAPIVersion()), simulate)

"""Loop of a worker over the takes of a job (`fit.blind.foreign.jobs`). NumPy only."""

import numpy as np
from answering import answer_jobs


def answer_takes(version, build, swing):
    """Answer every job with build(job, numbers) -> model and swing(model, job, take, numbers) -> nodes, seconds."""

    def simulate(job):
        found, seconds = [], []
        for take, row in enumerate(job["numbers"]):
            numbers = dict(zip(job["names"].tolist(), row.tolist(), strict=True))
            nodes, cost = swing(build(job, numbers), job, take, numbers)
            found.append(nodes)
            seconds.append(cost)
        return {"nodes": np.array(found), "seconds": np.array(seconds)}

    answer_jobs(version, simulate)

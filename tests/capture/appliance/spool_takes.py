"""Small synthetic takes for tests of the spool and of sync, written frame by frame by the real writer."""

from __future__ import annotations

import numpy as np

from formats.archive import TakeWriter
from formats.blocks import Frame
from formats.garment import Garment, TrackedPoint
from formats.rig import Rig

OUTLINE = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4))
GARMENT = Garment(
    format="hangtime-garment/1", name="sheet", kind="swatch", mass_kg=0.03, outline_m=OUTLINE, held="edge",
    points=tuple(TrackedPoint(name=f"p{k}", at_m=p) for k, p in enumerate(OUTLINE)),
)  # fmt: skip
RIG = Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0))
CREATED = "2026-11-20T21:15:00+00:00"


def frames(count, *, seed=0, rate=30.0):
    """Frames of a swung sheet, one by one."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        held = np.array([[-0.2, 0.0, 1.5], [0.2, 0.0, 1.5]]) + 0.1 * np.sin(3 * k / rate)
        points = np.array([[x, -y, 1.5] for x, y in OUTLINE]) + rng.normal(0, 0.003, (4, 3))
        yield Frame(
            time=k / rate, markers=held, held=held, held_valid=np.ones(2, bool), held_sd=np.full((2, 3), 0.002),
            points=points, points_valid=np.ones(4, bool), points_sd=np.full((4, 3), 0.003), state=0,
        )  # fmt: skip


def writer_of(running, *, created=CREATED):
    """The archive writer of a running take."""
    return TakeWriter(running.partial, take_id=running.stem, created=created, rig=RIG, garment=GARMENT, source="test")


def record(spool, count=75, *, seed=0, created=CREATED, facts=None):
    """Record a take with a number of frames and keep it."""
    running = spool.begin()
    with writer_of(running, created=created) as writer:
        for frame in frames(count, seed=seed):
            writer.append(frame)
    return spool.keep(running, facts or {"frames": count})

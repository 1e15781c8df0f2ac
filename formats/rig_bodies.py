"""Find where the held edge enters a body of the rig, which neither hanger nor cloth can do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats
from formats.findings import Finding
from formats.rig import Rig, RigBody
from formats.sights import Sights
from formats.take import Take

EDGE_FRACTIONS = np.linspace(0, 1, 11)[:, None]  # fractions of the held edge's length at which the depth is computed


@dataclass(frozen=True)
class Entered:
    """A body that the held edge enters: its number, from 1 on, its kind, and the penetration depth [m]."""

    number: int
    kind: str
    depth: float

    @property
    def words(self) -> str:
        """Return the finding as a sentence without its full stop."""
        return f"the held edge comes {1e3 * self.depth:.0f} mm into the rig's body {self.number}, a {self.kind}"

    @property
    def advice(self) -> str:
        """Return the next step."""
        return "check where it stands: metres in the sensor frame, a plane's normal towards the cloth"


def first_entered(rig: Rig, ends: Floats) -> Entered | None:
    """Return the first body that the line between the held ends enters; ends [m], (n, 2, 3), sensor frame."""
    edge = ends[:, None, 0] * (1 - EDGE_FRACTIONS) + ends[:, None, 1] * EDGE_FRACTIONS
    for number, body in enumerate(rig.near, 1):
        depth = -float(distances_from(body, edge).min(initial=0.0))
        if depth > 0:
            return Entered(number, body.kind, depth)
    return None


def body_findings(take: Take, sights: Sights) -> list[Finding]:
    """Return a finding where a take's held edge enters a body of its rig, else none."""
    entered = first_entered(take.rig, take.held[sights.held])
    if entered is None:
        return []
    return [Finding(name="held_edge_in_body", words=entered.words, advice=entered.advice, is_grave=True)]


def distances_from(body: RigBody, places: Floats) -> Floats:
    """Return distances [m], (...), of positions [m], (..., 3), from a body's surface, negative inside."""
    at = np.array(body.at_m, float)
    if body.normal is not None:
        return np.asarray((places - at) @ np.array(body.normal) / np.linalg.norm(body.normal))
    if body.to_m is not None:
        way = np.array(body.to_m) - at
        at = at + np.clip((places - at) @ way / (way @ way), 0.0, 1.0)[..., None] * way
    return np.asarray(np.linalg.norm(places - at, axis=-1) - (body.radius_m or 0.0))

"""The steps of a least squares search: one batch of sampled candidates, or one descent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from formats.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Step:
    """One batch of sampled candidates or one descent.

    - `is_sampling`: true for a batch of candidates
    - `vector`, (parameters,): the best candidate so far, or the end of a descent
    - `cost`: of `vector`, infinite if a descent's start blew up
    - `vectors`, (candidates, parameters): the candidates of the batch, empty for a descent
    - `simulations`: of all recordings since the search began
    - `distances`: D [m] after each candidate, of the least cost so far; empty unless rollouts are free
    - `slopes_at`, (parameters,): where a descent's last Jacobian was made, at its vector or a short step away; else
      `vector`
    """

    is_sampling: bool
    vector: Floats
    cost: float
    vectors: Floats
    simulations: int
    distances: tuple[float, ...]
    slopes_at: Floats

    def state(self) -> dict[str, Any]:
        """Return the step as plain values for JSON; its keys are those of saved searches."""
        return {
            "is_look": self.is_sampling, "vector": self.vector.tolist(),
            "cost": self.cost if np.isfinite(self.cost) else None, "vectors": self.vectors.tolist(),
            "simulations": self.simulations, "distances": list(self.distances),
            "slopes_at": self.slopes_at.tolist(),
        }  # fmt: skip

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Step:
        """Return a step from its saved state."""
        vector = np.array(state["vector"])
        return cls(
            is_sampling=bool(state["is_look"]), vector=vector,
            cost=np.inf if state["cost"] is None else float(state["cost"]),
            vectors=np.array(state["vectors"]).reshape(-1, len(vector)), simulations=int(state["simulations"]),
            distances=tuple(float(d) for d in state["distances"]), slopes_at=np.array(state["slopes_at"]),
        )  # fmt: skip

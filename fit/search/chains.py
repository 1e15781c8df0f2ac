"""Independent annealing chains that run in parallel and share each batch of simulations.

Annealing finds a different local minimum from each seed. The spread of several chains' results shows how reliable one
result is. Several chains fill the lanes of a batch without speculation. The paper used one chain of the full length.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fit.errors import FitError
from fit.search.annealing import Annealing, AnnealingSettings, SearchBox
from formats.arrays import Floats


class ParallelChains:
    """Several `Annealing` chains with their own random streams behind one `ask` and `tell`."""

    def __init__(
        self,
        starts: Floats,
        box: SearchBox,
        settings: AnnealingSettings,
        generator: np.random.Generator,
        *,
        is_split: bool = False,
    ) -> None:
        """Start one chain at each row of `starts`, (chains, parameters).

        With `is_split` the chains divide the iterations among them. Each chain cools to the same last temperature in
        its part.
        """
        starts = np.atleast_2d(starts)
        own = settings.lasting(max(1, settings.iterations // len(starts))) if is_split else settings
        streams = generator.spawn(len(starts))
        self.chains = [Annealing(start, box, own, stream) for start, stream in zip(starts, streams, strict=True)]
        self._asked: list[tuple[Annealing, int]] = []

    @property
    def is_started(self) -> bool:
        """Return whether the distance of every chain's initial candidate is known."""
        return all(chain.is_started for chain in self.chains)

    @property
    def iteration(self) -> int:
        """Iterations done, summed over all chains."""
        return sum(chain.iteration for chain in self.chains)

    @property
    def is_finished(self) -> bool:
        """Return whether every chain is done."""
        return all(chain.is_finished for chain in self.chains)

    @property
    def winner(self) -> Annealing:
        """The chain with the best distance."""
        return min(self.chains, key=lambda chain: chain.best_distance)

    @property
    def best(self) -> Floats:
        """Best candidate of all chains, (parameters,)."""
        return self.winner.best

    @property
    def best_distance(self) -> float:
        """The distance of the best candidate so far [m]."""
        return self.winner.best_distance

    @property
    def best_history(self) -> Floats:
        """Best distance of all chains so far [m], (iterations + 1,), the starts first.

        A chain with fewer iterations keeps its last best distance.
        """
        length = max(len(chain.steps) for chain in self.chains)
        best = np.full(length, np.inf)
        for chain in self.chains:
            history = chain.best_history
            if len(history):
                padded = np.concatenate([history, np.full(length - len(history), history[-1])])
                best = np.minimum(best, padded)
        return best

    @property
    def evaluations(self) -> int:
        """Candidates evaluated, used by a chain or not."""
        return sum(chain.evaluations for chain in self.chains)

    @property
    def non_finite(self) -> int:
        """Proposals rejected because their distance was not finite."""
        return sum(chain.non_finite for chain in self.chains)

    def ask(self, width: int) -> Floats:
        """Return up to `width` candidates, (candidates, parameters); chains that lag get the spare slots."""
        waiting = sorted((c for c in self.chains if not c.is_finished), key=lambda chain: len(chain.steps))[:width]
        self._asked, batch = [], []
        for rank, chain in enumerate(waiting):
            share = width // len(waiting) + (rank < width % len(waiting))
            candidates = chain.ask(share)
            self._asked.append((chain, len(candidates)))
            batch.append(candidates)
        return np.concatenate(batch) if batch else np.empty((0, len(self.chains[0].current)))

    def tell(self, candidates: Floats, distances: Floats) -> int:
        """Receive the distances [m], (candidates,), of the last `ask`; return the iterations done by all chains."""
        if len(candidates) != sum(count for _, count in self._asked) or len(distances) != len(candidates):
            raise ValueError("tell() wants one distance for each candidate of the last ask()")
        done, first = 0, 0
        for chain, count in self._asked:
            done += chain.tell(candidates[first : first + count], distances[first : first + count])
            first += count
        self._asked = []
        return done

    def state(self) -> dict[str, Any]:
        """Return the state of all chains as plain values for JSON, from which `restore` continues."""
        return {"chains": [chain.state() for chain in self.chains]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state that `state()` returned.

        Raises:
            FitError: the state is of another number of chains, or of other settings.
        """
        if len(state["chains"]) != len(self.chains):
            raise FitError(
                f"the saved search has {len(state['chains'])} chains, not {len(self.chains)}",
                where="annealing",
                advice="start anew or ask for as many chains as were saved",
            )
        for chain, saved in zip(self.chains, state["chains"], strict=True):
            chain.restore(saved)

"""Least squares on the points' residuals: looks at many places, then descents; free, or weakly pulled to the points.

How a run goes, trials, descents and all, is in `fit.identification.trials`; a weak prior, the box's own spread about
the start, holds what the data cannot tell. With a pull (of the observer, `fit.observer.residuals`) each descent goes
under it first and then free.

Ripples leave many small valleys, so one valley's curvature says too little of how far a parameter can be trusted.
Two estimates of its deviation are at hand, the jackknife's in the best valley (`fit.search.intervals`) and that of what
the emulator knows of other places, drawn from

    p(u) ~ E(u)^(-N/2),    N = n / tau

with E the cost that is expected at u (`fit.search.posterior`) and N how many of the n residuals are independent, by the
time tau that they go together (`fit.search.correlation`). Both measure the same uncertainty, so the larger counts: the
jackknife sees ripples that the emulator smooths, the draws see valleys that the jackknife does not. Without
looks the ends of the descents come on top of the jackknife, each with the weight

    w_k = (cost_k / cost)^(-N/2)

and N pieces of the recording that last two seconds, because a ripple goes on for a swing or two: ends that fit much
worse count little. Both are the likelihood of Gaussian errors whose deviation is not known, at its maximum over the
deviation. These rules were set on takes apart from those that published figures rest on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.cloth.effect import Effect
from fit.cloth.model import Resolution
from fit.identification.trials import Observed, ObservedSettings, Progress, Run
from fit.methods import Parameterisation
from fit.observer.residuals import Observer
from fit.recordings.recording import Recording, Windows
from fit.search.intervals import check_blocks
from fit.search.least_squares import BoundedSpace
from fit.search.steps import Step

Floats = NDArray[np.float64]

SHORT_WINDOWS = Windows(free=2.0, caught=0.5)  # a swing or two
CATCHING = 3.0  # Hz of the pull between short windows
LOOKS = 80  # candidates looked at: what more of them find is little
TRIALS = 3  # times at most that one begins: a wrong valley is mostly left by the second, or told by the third

Distances = Callable[[list[Floats]], Floats]


class ObservedSearch:
    """The search on some recordings for the parameters of a method and the amplitudes of some effects."""

    def __init__(
        self,
        recordings: list[Recording],
        method: Parameterisation,
        effects: tuple[Effect, ...],
        space: BoundedSpace,
        resolution: Resolution,
        *,
        windows: Windows | None = None,
        distances: Distances | None = None,
    ) -> None:
        """Prepare it.

        windows: between which alone the pulls of the settings act; distances: what D [m], (candidates,), of simulated
        points, (candidates, frames, points, 3) [m] a take, is; it is asked of free rollouts.
        """
        cut = [dataclasses.replace(recording, windows=windows) for recording in recordings]
        self.free = Observer(cut, method, effects, frequency=0.0, resolution=resolution)
        self.space = space
        self.count = len(method.parameters)
        self._distances = distances

    def run(
        self,
        start: Floats,
        settings: ObservedSettings | None = None,
        progress: Progress = lambda step: None,
        known: Sequence[Step] = (),
    ) -> Observed:
        """Search from the start, (parameters,); `progress` is told of each look and each descent.

        known: the first steps of an interrupted search of the same kind, which are not made again. What was looked at
        is simulated again, which is not counted.

        Raises:
            FitError: the recordings are too short for intervals.
            BlowUpError: the start cannot be simulated.
        """
        check_blocks(self.free.layout.block)
        return Run(self, start, settings or ObservedSettings(), progress, known).run()

    def simulate(self, vectors: Floats, pull: float) -> tuple[Floats, Floats]:
        """Return residuals, (candidates, numbers), not finite where it blew up, and D [m], (candidates,) or nothing."""
        observer = self.free.with_frequency(pull)
        points = observer.trajectories(vectors[:, : self.count], vectors[:, self.count :])
        residuals = observer.sound_residuals_of(points)
        is_free = pull == 0 and self._distances is not None
        return residuals, self._distances(points) if is_free and self._distances else np.zeros(0)


def begin_observed(
    name: str, recordings: list[Recording], method: Parameterisation, effects: tuple[Effect, ...],
    space: BoundedSpace, resolution: Resolution, seed: int, distances: Distances,
) -> tuple[ObservedSearch, ObservedSettings]:  # fmt: skip
    """Return the search of this name, one of `fit.search.choice.OBSERVED`, and how it is run."""
    if name == "short-windows":
        search = ObservedSearch(recordings, method, effects, space, resolution, windows=SHORT_WINDOWS)
        return search, ObservedSettings(pulls=(CATCHING,), seed=seed)
    search = ObservedSearch(recordings, method, effects, space, resolution, distances=distances)
    return search, ObservedSettings(looks=LOOKS, trials=TRIALS, seed=seed)

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

from collections.abc import Sequence

from fit.cloth.effect import Effect
from fit.cloth.model import Resolution
from fit.identification.problem import Distances, ObservedProblem
from fit.identification.trials import Observed, ObservedSettings, Progress, Run
from fit.methods import Parameterisation
from fit.recordings.recording import Recording, Windows
from fit.search.intervals import check_blocks
from fit.search.least_squares import BoundedSpace
from fit.search.steps import Step
from formats.arrays import Floats

SHORT_WINDOWS = Windows(free=2.0, caught=0.5)  # a swing or two
CATCHING = 3.0  # Hz of the pull between short windows
MOST_LOOKS = 80  # candidates looked at: what more of them find is little
TRIALS = 3  # times at most that one begins: a wrong valley is mostly left by the second, or told by the third


class ObservedSearch(ObservedProblem):
    """The search on some recordings for the parameters of a method and the amplitudes of some effects."""

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


def begin_observed(
    name: str, recordings: list[Recording], method: Parameterisation, effects: tuple[Effect, ...],
    space: BoundedSpace, resolution: Resolution, seed: int, distances: Distances,
) -> tuple[ObservedSearch, ObservedSettings]:  # fmt: skip
    """Return the search of this name, one of `fit.search.choice.OBSERVED`, and how it is run."""
    if name == "short-windows":
        search = ObservedSearch(recordings, method, effects, space, resolution, windows=SHORT_WINDOWS)
        return search, ObservedSettings(pulls=(CATCHING,), seed=seed)
    search = ObservedSearch(recordings, method, effects, space, resolution, distances=distances)
    return search, ObservedSettings(looks=MOST_LOOKS, trials=TRIALS, seed=seed)

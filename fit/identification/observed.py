"""Least squares search on the points' residuals: simulate many parameter vectors, then descend from the best.

The simulations are free rollouts, or the observer pulls the cloth weakly to the points.

`fit.identification.trials` runs the trials and descents. A weak prior, the box's own spread about the start, holds
parameters that the data cannot determine. With the observer's pull (`fit.observer.residuals`) each descent runs first
with the pull, then free.

The cost has many local minima, so the curvature of one underestimates a parameter's uncertainty. Rounding alone decides
in which local minimum a search ends. Three estimates of a parameter's deviation exist. One is the jackknife's in the
best local minimum (`fit.search.intervals`). Another is the spread of draws over everything that the emulator knows,
from

    p(u) ~ E(u)^(-N/2)

with E the expected cost at u (`fit.search.posterior`). N is the number of independent residuals
(`fit.search.correlation`), or 2 / s where this is less. Here s is the root mean square of ln(cost / least cost) over
the ends of the trials, or of all descents where that is more. Such ends differ by chance alone, so a difference of s in
the cost is no information on the cloth. Trials stop once two of them agree, so their own scatter is too small by
selection (decision 40). An end of a descent counts up to 5 % of the cost.
The third is the spread of the ends of all descents of all trials, each end with the weight

    w_k = (cost_k / cost)^(-N/2)

All estimates measure the same uncertainty, so the largest counts. The jackknife includes ripples that the emulator
smooths. The draws include local minima that the jackknife ignores. The ends are minima that the emulator may have
smoothed away. Without samples, the spread of the descents' ends is added to the jackknife. Here N counts pieces of the
recording of two seconds, because a ripple lasts for a swing or two. So an end that fits much worse counts little. Both
formulas are the likelihood of Gaussian errors of unknown deviation, at its maximum over the deviation. These rules were
chosen on takes that no published figure uses.
"""

from __future__ import annotations

from collections.abc import Sequence

from fit.identification.problem import Distances, ObservedProblem
from fit.identification.request import Request
from fit.identification.trials import Observed, ObservedSettings, Progress, Run
from fit.recordings.recording import Recording, Windows
from fit.search.intervals import check_blocks
from fit.search.steps import Step
from formats.arrays import Floats

# s. Free for a swing or two. Then caught until a pull of 3 Hz leaves a thousandth of the distance, after 0.49 s
# (notebook, release windows). One fit to the demo's takes ends at 4.3 mm. It ends at 4.6 and 4.1 mm with 1 and 4 s
# free, and at 4.6 and 4.4 mm with 0.25 and 1 s caught.
SHORT_WINDOWS = Windows(free=2.0, caught=0.5)
# Hz of the pull between short windows. Under it cloth is not chaotic (decision 4). Our choice: at half, the pull
# would need twice as long; double was not tried.
CATCHING = 3.0
MOST_SAMPLES = 80  # candidates before the descents: more hardly improve the best one
TRIALS = 3  # at most: a second trial mostly leaves a wrong local minimum, and a third one decides between two


class ObservedSearch(ObservedProblem):
    """Least squares search for the parameters of a method and the amplitudes of effects on some recordings."""

    def run(
        self,
        start: Floats,
        settings: ObservedSettings | None = None,
        progress: Progress = lambda step: None,
        known: Sequence[Step] = (),
    ) -> Observed:
        """Run the search from the start, (parameters,); `progress` receives each batch of samples and each descent.

        `known` holds the finished steps of an interrupted search with the same settings, which are not repeated.
        Sampled candidates are simulated again, and these simulations are not counted.

        Raises:
            FitError: the recordings are too short for intervals.
            BlowUpError: the start cannot be simulated.
        """
        check_blocks(self.free.layout.block)
        return Run(self, start, settings or ObservedSettings(), progress, known).run()


def begin_observed(
    request: Request, recordings: list[Recording], distances: Distances
) -> tuple[ObservedSearch, ObservedSettings]:
    """Return the request's search, one of `fit.search.choice.OBSERVED`, and its settings."""
    method, effects, space, resolution = request.method, request.effects, request.space, request.resolution
    if request.search == "short-windows":
        search = ObservedSearch(recordings, method, effects, space, resolution, windows=SHORT_WINDOWS)
        return search, ObservedSettings(pulls=(CATCHING,), seed=request.seed)
    search = ObservedSearch(recordings, method, effects, space, resolution, distances=distances)
    return search, ObservedSettings(samples=MOST_SAMPLES, trials=TRIALS, seed=request.seed)

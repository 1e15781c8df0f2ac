"""Simulate batches of candidates on one recording, or on several recordings in parallel."""

from __future__ import annotations

from collections.abc import Sequence

from fit.cloth.launch import Progress, launch
from fit.cloth.model import ClothModel, Rollouts
from formats.arrays import Floats


class Simulator(ClothModel):
    """Simulator of one recording for any number of candidates (defined in `fit.cloth.model.ClothModel`)."""

    def run(
        self, materials: Floats, amplitudes: Floats | None = None, *, observer_hz: float = 0.0, shapes: bool = False,
        progress: Progress | None = None,
    ) -> Rollouts:  # fmt: skip
        """Simulate candidates; `shapes` keeps the nodes of every frame and the last forces on them.

        - `materials`, (candidates, parameters)
        - `amplitudes`, (candidates, components of all effects), 0 where None
        - `observer_hz`: natural frequency of the pull towards the measured points, 0 for a free rollout.
        - `progress`: receives the share of finished frames repeatedly; an exception in this callback ends the
          simulation.

        Raises:
            FitError: the shapes of the arguments do not fit together.
        """
        return run_together(
            [self], [materials], [amplitudes], observer_hz=observer_hz, shapes=shapes, progress=progress
        )[0]


def run_together(
    simulators: Sequence[Simulator],
    materials: Sequence[Floats],
    amplitudes: Sequence[Floats | None],
    *,
    observer_hz: float = 0.0,
    shapes: bool = False,
    progress: Progress | None = None,
) -> list[Rollouts]:
    """Simulate candidates on several recordings in parallel; return the result of `Simulator.run` for each recording.

    Recordings of one garment share the processors, so that few candidates keep all of them busy.
    """
    asked = [s.groups(m, a, shapes=shapes) for s, m, a in zip(simulators, materials, amplitudes, strict=True)]
    waiting = [g for _, groups in asked for g in groups]
    while waiting:
        first = waiting[0]
        alike = [g for g in waiting if g.kernel == first.kernel and g.model.is_like(first.model)]
        launch(alike, observer_hz, progress)
        waiting = [g for g in waiting if g not in alike]
    return [s.finish(candidates) for s, (candidates, _) in zip(simulators, asked, strict=True)]

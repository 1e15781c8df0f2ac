"""Takes prepared for simulation once per command, with the digests of their contents."""

from __future__ import annotations

from dataclasses import dataclass

from fit.recordings.geometry import check_geometry
from fit.recordings.intact import naming_damage
from fit.recordings.recording import Recording, prepare_together
from fit.recordings.selection import check_together
from formats.diagnosis_records import Diagnosis
from formats.fit_records import FitResult
from formats.take import Take


@dataclass(frozen=True)
class Ready:
    """Recordings to fit to and held-out recordings, with the digests of the takes' contents."""

    training: list[Recording]
    held_out: list[Recording]
    contents: list[str]
    held_out_contents: list[str]

    def are_of(self, result: FitResult | Diagnosis) -> bool:
        """Return whether a result is of these takes in any order, by digests, or by names if it is old and has none."""
        if not result.take_contents:
            return sorted(result.take_ids) == sorted(recording.take_id for recording in self.training)
        return sorted(result.take_contents) == sorted(self.contents)

    @property
    def judging_order(self) -> list[int]:
        """Places of the held-out takes, by name and content: the order in which they were given does not matter."""
        names = [recording.take_id for recording in self.held_out]
        return sorted(range(len(names)), key=lambda n: (names[n], self.held_out_contents[n]))


def ready(training: list[Take], held_out: list[Take]) -> Ready:
    """Prepare fitted and held-out takes for simulation.

    Raises:
        FitError: no take, takes of different garments, a take that is given twice, or one whose points cannot belong to
        its garment.
    """
    contents = check_together(training, held_out)
    with naming_damage([*training, *held_out]):
        train, test = prepare_together(training, held_out)
        for recording in train + test:
            check_geometry(recording)
    return Ready(train, test, contents[: len(train)], contents[len(train) :])

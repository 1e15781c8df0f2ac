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
    """Recordings to fit to and held-out recordings, with the digests of the takes' contents.

    Both are sorted by name and content. So sums over takes, draws of noise and results do not depend on the order in
    which the takes are given.

    places: of the sorted takes among the given ones, of those to fit to and of the held-out ones
    """

    training: list[Recording]
    held_out: list[Recording]
    contents: list[str]
    held_out_contents: list[str]
    places: tuple[list[int], list[int]]

    def are_of(self, result: FitResult | Diagnosis) -> bool:
        """Return whether a result is of these takes in any order, by digests, or by names if it is old and has none."""
        if not result.take_contents:
            return sorted(result.take_ids) == sorted(recording.take_id for recording in self.training)
        return sorted(result.take_contents) == sorted(self.contents)

    def in_order(self, training: list[Take], held_out: list[Take]) -> tuple[list[Take], list[Take]]:
        """Return the takes as they were given to `ready`, in the order of these recordings."""
        fitted, judged = self.places
        return [training[n] for n in fitted], [held_out[n] for n in judged]


def ready(training: list[Take], held_out: list[Take]) -> Ready:
    """Prepare fitted and held-out takes for simulation.

    Raises:
        FitError: no take, takes of different garments, a take that is given twice, or one whose points cannot belong to
        its garment.
    """
    contents = check_together(training, held_out)
    fitted, judged = contents[: len(training)], contents[len(training) :]
    places = _sorted(training, fitted), _sorted(held_out, judged)
    with naming_damage([*training, *held_out]):
        train, test = prepare_together([training[n] for n in places[0]], [held_out[n] for n in places[1]])
        for recording in train + test:
            check_geometry(recording)
    return Ready(train, test, [fitted[n] for n in places[0]], [judged[n] for n in places[1]], places)


def _sorted(takes: list[Take], contents: list[str]) -> list[int]:
    """Return the places of takes, sorted by name and content."""
    return sorted(range(len(takes)), key=lambda n: (takes[n].take_id, contents[n]))

"""A job that has finished its work and waits for room to store the result, for tests of lost schedulers."""

from __future__ import annotations

from pathlib import Path

from fit.batch import worker
from fit.batch.jobs import Outcome, result_name
from fit.batch.store import Folder, open_store
from fit.errors import UnreachableError


class FullUntilRoom(Folder):
    """A folder that is full until it has a file `room`."""

    def write(self, name: str, content: bytes) -> None:
        """Write the file if there is room."""
        if not (self.root / "room").exists():
            raise UnreachableError("cannot be written", where=name, advice="make room")
        super().write(name, content)


def finish_and_wait(job):
    """Note that the work is done once more, then store its result as soon as there is room."""
    results = open_store(job.results_url)
    if not results.has(result_name(job.key)):
        with (Path(job.results_url) / "made").open("a") as file:
            file.write("made\n")
        worker.write_patiently(FullUntilRoom(results.root), result_name(job.key), b"{}", patience=job.patience)
    return Outcome(key=job.key, state="fitted")

"""Checkpoint of a diagnosis: saves finished fits, so that the same command continues after an interruption.

Each fit is one `.npz`, written whole or not at all. `key.json` beside it names the takes and options, and `spent.json`
the cost of all fits.
"""

from __future__ import annotations

import contextlib
import io
import json
import time as clock
from collections.abc import Callable, Sequence
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from fit.errors import FitError
from fit.gap.fitting import Fitted, Pinned
from fit.provenance import other_than
from formats.arrays import Floats
from formats.results import LARGEST_RESULT
from formats.whole_files import read_bounded, write_whole

Key = dict[str, object]

SPENT = "spent.json"
UNREADABLE = (
    OSError,
    ValueError,
    EOFError,
    MemoryError,
    BadZipFile,
)  # of a file that a power cut left empty or truncated, or that is another one
LARGEST_KEPT = 1 << 30  # bytes; our choice: derivatives by 59 parameters over an hour of 7 points at 30 a second


def kept_as(active: tuple[str, ...]) -> str:
    """Return the name under which a fit with these effects is kept."""
    return "+".join(active)


class Checkpoint:
    """A folder of finished fits; without a folder nothing is saved."""

    def __init__(self, folder: Path | None, key: Key, count: Callable[[], int] = lambda: 0) -> None:
        """Open or create the folder.

        count: simulations run so far by this process

        Raises:
            FitError: it holds the fits of other takes, options or versions, cannot be read, or is a file.
        """
        self.folder, self._count, self._started = folder, count, clock.monotonic()
        self._earlier = (0, 0.0)
        if folder is None:
            return
        with contextlib.suppress(*UNREADABLE):
            simulations, seconds = json.loads(read_bounded(folder / SPENT))
            self._earlier = (int(simulations), float(seconds))
        note = folder / "key.json"
        if note.exists() and not (note.stat().st_size == 0 and next(folder.glob("*.np?"), None) is None):
            try:
                kept = json.loads(read_bounded(note, LARGEST_RESULT))
            except (OSError, ValueError) as error:
                raise FitError("the kept fits cannot be read", where=folder, advice="delete the folder") from error
            if (other := other_than(kept, key)) is not None:
                raise FitError(
                    f"the kept fits are of {other}",
                    where=folder,
                    advice="delete the folder or choose another --out",
                )
        else:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except FileExistsError as error:
                raise FitError("is a file; fits are to be kept there", where=folder, advice="move it away") from error
            write_whole(note, json.dumps(key).encode())

    @property
    def spent(self) -> tuple[int, float]:
        """Simulations and seconds since the diagnosis began, including those of interrupted processes."""
        simulations, seconds = self._earlier
        return simulations + self._count(), seconds + clock.monotonic() - self._started

    def recall(self, names: Sequence[str], make: Callable[[], list[Fitted]]) -> list[Fitted]:
        """Return the saved fits of these names, or compute and save all of them."""
        if self.folder is None:
            return make()
        # Unreadable fits are computed again, at the cost of time only.
        with contextlib.suppress(*UNREADABLE, KeyError):
            return [_read(self.folder / f"{name}.npz") for name in names]
        found = make()
        for name, fitted in zip(names, found, strict=True):
            _write(self.folder / f"{name}.npz", fitted)
        write_whole(self.folder / SPENT, json.dumps(self.spent).encode())
        return found

    def recall_vectors(self, name: str, make: Callable[[], Floats]) -> Floats:
        """Return the saved parameter vectors of this name, (vectors, parameters), or compute and save them."""
        if self.folder is None:
            return make()
        path = self.folder / f"{name}.npy"
        with contextlib.suppress(*UNREADABLE):
            return np.asarray(np.load(_kept_bytes(path)))
        found, content = make(), io.BytesIO()
        np.save(content, found)
        write_whole(path, content.getvalue())
        return found


def _kept_bytes(path: Path) -> io.BytesIO:
    return io.BytesIO(read_bounded(path, LARGEST_KEPT))


def _read(path: Path) -> Fitted:
    with np.load(_kept_bytes(path)) as kept:
        decided = kept["pinned"]
        pinned = Pinned(decided[0], decided[1], float(kept["trust"])) if len(decided) else None
        return Fitted(
            vector=kept["vector"], amplitudes=kept["amplitudes"], active=tuple(str(name) for name in kept["active"]),
            residual=kept["residual"], jacobian=kept["jacobian"], deviation=kept["deviation"],
            is_converged=bool(kept["is_converged"]), pinned=pinned,
        )  # fmt: skip


def _write(path: Path, fitted: Fitted) -> None:
    content, pinned = io.BytesIO(), fitted.pinned
    np.savez(
        content, vector=fitted.vector, amplitudes=fitted.amplitudes, active=np.array(fitted.active),
        residual=fitted.residual, jacobian=fitted.jacobian, deviation=fitted.deviation,
        is_converged=fitted.is_converged,
        pinned=np.array([pinned.amplitudes, pinned.sd] if pinned else []), trust=pinned.trust if pinned else 0.0,
    )  # fmt: skip
    write_whole(path, content.getvalue())

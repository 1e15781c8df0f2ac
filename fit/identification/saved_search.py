"""Checkpoint of a running parameter search, from which the same command continues after an interruption."""

from __future__ import annotations

import json
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fit.errors import FitError
from fit.provenance import other_than
from formats.results import LARGEST_RESULT
from formats.whole_files import read_bounded, write_whole


class SavedSearch:
    """Checkpoint file of a search, with a key that identifies takes and request; without a path nothing is saved."""

    def __init__(self, path: Path | None, key: dict[str, object]) -> None:
        self._path, self._key = path, key
        self._started, self._before = clock.monotonic(), 0.0

    @property
    def seconds(self) -> float:
        """Time spent on the search [s], including the saved time before an interruption."""
        return self._before + clock.monotonic() - self._started

    def read(self) -> dict[str, Any] | None:
        """Return the saved state, or None if no file exists.

        Raises:
            FitError: the file cannot be read, or is of another search.
        """
        if self._path is None or not self._path.exists():
            return None
        try:
            saved = json.loads(read_bounded(self._path, LARGEST_RESULT))
            state, key, before = saved["search"], saved["key"], float(saved.get("seconds", 0.0))
        except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
            raise FitError(
                "the saved search cannot be read", where=self._path, advice="delete it to start anew"
            ) from error
        if (other := other_than(key, self._key)) is not None:
            raise FitError(
                f"the saved search is of {other}", where=self._path, advice="delete it or choose another --out"
            )
        self._before = before
        return state  # type: ignore[no-any-return]

    def save(self, state: dict[str, Any]) -> None:
        """Write the state atomically: the file holds the old state or the new one."""
        if self._path is not None:
            whole = {"key": self._key, "seconds": self.seconds, "search": state}
            write_whole(self._path, json.dumps(whole).encode())

    @contextmanager
    def continuing(self) -> Iterator[None]:
        """Name the checkpoint file in an error that a search raises when it cannot continue."""
        try:
            yield
        except (FitError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise FitError(
                "the saved search cannot be continued here (other settings, libraries or processor)",
                where=self._path,
                advice="delete it to start anew",
            ) from error

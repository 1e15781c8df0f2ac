"""Fixtures of all tests of `hangtime batch`."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from fit.batch.store import Store, open_store
from formats.archive import write_take
from tests.fit.batch.night import STARTED, end
from tests.formats.test_archive import a_take


@pytest.fixture(autouse=True)
def nothing_goes_on() -> Iterator[None]:
    """End the nights that a test started, also those of one that failed: each would work for hours beside the next."""
    yield
    while STARTED:
        end(STARTED.pop())


@pytest.fixture
def night(tmp_path: Path) -> tuple[Store, Store]:
    """A folder with one take, and one for the results."""
    (tmp_path / "takes").mkdir()
    write_take(tmp_path / "takes/a.mcap", a_take(30))
    return open_store(str(tmp_path / "takes")), open_store(str(tmp_path / "out"))

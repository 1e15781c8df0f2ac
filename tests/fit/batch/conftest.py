"""Fixtures of all tests of `hangtime batch`."""

from collections.abc import Iterator

import pytest

from tests.fit.batch.night import STARTED, end


@pytest.fixture(autouse=True)
def nothing_goes_on() -> Iterator[None]:
    """End the nights that a test started, also those of one that failed: each would work for hours beside the next."""
    yield
    while STARTED:
        end(STARTED.pop())

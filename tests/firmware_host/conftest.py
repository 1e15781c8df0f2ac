"""Fixtures of the sensor tests."""

from __future__ import annotations

import pytest

from tests import openni2


@pytest.fixture(scope="session")
def openni() -> None:
    """Skip where the native library is absent."""
    if not openni2.is_available():
        pytest.skip("libopenni2 is not installed (apt-get install libopenni2-0)")

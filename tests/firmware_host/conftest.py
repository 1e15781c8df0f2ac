"""What several tests of the sensors share."""

from __future__ import annotations

import pytest

from firmware_host import openni2_library


@pytest.fixture(scope="session")
def openni() -> None:
    """Skip where the native library is absent."""
    if not openni2_library.is_available():
        pytest.skip("libopenni2 is not installed (apt-get install libopenni2-0)")

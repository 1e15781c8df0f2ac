"""Fixtures of the recording tests."""

from __future__ import annotations

import numpy as np
import pytest

from tests.capture.garment.towel_scenes import hung
from tests.capture.stage import pictures


@pytest.fixture(scope="module")
def good():
    rng = np.random.default_rng(8)
    return [pictures(hung(), rng) for _ in range(3)]

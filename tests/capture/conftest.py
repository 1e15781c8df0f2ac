"""What several tests of recording share."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import typer.testing

from tests.capture.garment.towel_scenes import hung
from tests.capture.stage import pictures


@pytest.fixture(scope="session", autouse=True)
def _one_tree_of_commands():
    """Typer puts the tree together for every command that it runs, which takes a tenth of a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", functools.cache(typer.testing._get_command))
        yield


@pytest.fixture(scope="module")
def good():
    rng = np.random.default_rng(8)
    return [pictures(hung(), rng) for _ in range(3)]

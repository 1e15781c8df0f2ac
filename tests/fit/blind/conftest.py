"""One small set of blind cases for all tests of this room."""

from __future__ import annotations

import shutil

import pytest

from fit.blind.making import make_set
from tests.fit.blind.blind_answers import COARSE, NUMBERS, PLANTED


@pytest.fixture(scope="session")
def made_set(tmp_path_factory):
    """A sealed set of hem and time offset, alone and together."""
    folder = tmp_path_factory.mktemp("made") / "set"
    make_set(folder, NUMBERS, PLANTED, 5, side=COARSE)
    return folder


@pytest.fixture(scope="module")
def a_set(made_set, tmp_path_factory):
    """A copy of it for the tests of one file: an opened set keeps that it was opened."""
    return shutil.copytree(made_set, tmp_path_factory.mktemp("blind") / "set")

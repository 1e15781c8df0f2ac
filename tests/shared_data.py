"""The folder of real recordings outside the repository, which some tests need."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Folders `oni` and `swung-cloth`; CONTRIBUTING.md says how to name another place.
SHARED_DATA = Path(os.environ.get("HANGTIME_SHARED_DATA") or Path(__file__).parents[2] / "shared" / "data")


def c3d_recording(name: str) -> Path:
    """Return the path of a real C3D file; skip the test where it is not here."""
    path = SHARED_DATA / "c3d" / f"{name}.c3d"
    if not path.exists():
        pytest.skip(f"no recording at {path}")
    return path

"""The folder of real recordings outside the repository, which some tests need."""

from __future__ import annotations

import os
from pathlib import Path

# Folders `oni` and `swung-cloth`; CONTRIBUTING.md says how to name another place.
SHARED_DATA = Path(os.environ.get("HANGTIME_SHARED_DATA") or Path(__file__).parents[2] / "shared" / "data")

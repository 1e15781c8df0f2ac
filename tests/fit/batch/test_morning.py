"""Names of takes on a batch's summary page."""

from __future__ import annotations

import pytest

from fit.batch.morning import short_name


@pytest.mark.parametrize(
    ("name", "short"),
    [
        (f"home/2026-11-26/000002-{'0a' * 32}.mcap", "home/2026-11-26/000002"),
        ("swing.mcap", "swing.mcap"),
        (f"a-{'0a' * 31}.mcap", f"a-{'0a' * 31}.mcap"),
    ],
)
def test_a_synced_take_is_shown_without_its_digest(name, short):
    assert short_name(name) == short

"""Names of takes on a batch's summary page, and what its command does without options."""

from __future__ import annotations

import re

import pytest

from fit.batch.morning import short_name
from tests.fit.here import hangtime_here


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


def test_a_batch_fits_as_a_single_fit_does_and_waits_for_ten_minutes_or_not_at_all(tmp_path):
    batch, fit = (" ".join(hangtime_here(one, "--help", folder=tmp_path).stdout.split()) for one in ("batch", "fit"))
    ours, theirs = (re.search(r"--method .*?\[default: (\w[\w-]*)\]", shown)[1] for shown in (batch, fit))
    assert ours == theirs
    assert re.search(r"--patience MINUTES [^\[]*\[default: 10\.0; x>=0\]", batch)

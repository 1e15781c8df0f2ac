"""The take that tests of the archive damage."""

from __future__ import annotations

from dataclasses import replace

import pytest

from formats.archive import write_take
from tests.formats.test_archive import a_scan, a_take


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Five seconds in five blocks, and two scans."""
    take = replace(a_take(), scans=(a_scan(0.4, 1), a_scan(2.6, 2)))
    return write_take(tmp_path_factory.mktemp("sound") / "a.mcap", take).read_bytes()

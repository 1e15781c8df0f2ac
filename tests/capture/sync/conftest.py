"""Fixtures of the sync tests: one server behind one proxy, and folders of takes."""

from __future__ import annotations

import pytest

from tests.capture.appliance.spool_takes import record
from tests.capture.sync.servers import BUCKETS, chain

NUMBERS = iter(range(BUCKETS))


@pytest.fixture(scope="session")
def _chain(tmp_path_factory):
    with chain(tmp_path_factory.mktemp("chain")) as made:
        yield made


@pytest.fixture
def far(_chain):
    """An empty server, its transparent proxy, and its certificate authority."""
    server, proxy, authority = _chain
    server.bucket = f"takes-{next(NUMBERS)}"
    proxy.fault, proxy.done[:] = (lambda method, path: ""), []
    return server, proxy, authority


@pytest.fixture
def spool(tmp_path):
    from capture.appliance.spool import Spool

    with Spool(tmp_path / "spool") as one:
        yield one


@pytest.fixture
def three(spool):
    return [record(spool, 40 + k, seed=k) for k in range(3)]

"""A file far larger than the memory, in place of a state that the device keeps, counts as unreadable."""

from __future__ import annotations

import pytest

from capture.appliance.last_good import _read
from capture.appliance.receipts import read_receipt, receipt_path
from capture.appliance.spool import Spool
from capture.appliance.sync_status import FILE, read_status
from capture.errors import SyncError
from capture.sync.credentials import find_credentials
from capture.sync.server import _certificate
from tests.capture.appliance.spool_takes import record

HUGE = 300 << 30  # bytes; a sparse file of it takes no room on the disk


def made_huge(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.truncate(HUGE)
    path.chmod(0o600)
    return path


def test_states_of_the_spool_and_of_sync(tmp_path):
    with Spool(tmp_path) as spool:
        kept = record(spool, 10)
        made_huge(receipt_path(tmp_path, "take-000001"))
        made_huge(tmp_path / FILE)
        made_huge(kept.path.with_suffix(".json"))
        made_huge(tmp_path / "sequence")
        assert read_receipt(tmp_path, "take-000001") is None
        assert read_status(tmp_path) is None
        assert [take.facts for take in spool.takes()] == [{}]
        assert record(spool, 10).sequence == 2


def test_the_last_good_configuration(tmp_path):
    assert _read(made_huge(tmp_path / "box.last-good.json")) is None


def test_keys_and_the_certificate_of_a_server(tmp_path, monkeypatch):
    with pytest.raises(SyncError, match="keys: is too large for a file of keys"):
        find_credentials(made_huge(tmp_path / "keys"))
    with pytest.raises(SyncError, match="the server's authority cannot be read"):
        _certificate(made_huge(tmp_path / "ca.pem"))
    made_huge(tmp_path / "credentials/store_secret_access_key")
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path / "credentials"))
    with pytest.raises(SyncError, match="a credential cannot be read"):
        find_credentials(None)

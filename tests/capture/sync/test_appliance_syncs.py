"""A take from the button to the server, and its state in `hangtime status`, with the real daemon and sync."""

from __future__ import annotations

import json

import pytest

from formats.archive import verify_take
from tests.capture.appliance.real_daemon import needs_openni
from tests.capture.appliance.virtual_appliance import ROOT, VirtualAppliance, draw_recording
from tests.fit.here import hangtime_here

pytestmark = needs_openni


def hangtime(*words):
    return hangtime_here(*words, folder=ROOT)


@pytest.mark.slow
def test_a_take_of_the_button_is_uploaded_and_status_shows_uploads_and_faults(tmp_path):
    """One take by the button; the server's place is first a file, then a folder; the daemon reports both."""
    recording, server = tmp_path / "swing.oni", tmp_path / "server"
    draw_recording(recording, fps=15, seconds=2.0)
    settings = f'[sync]\nurl = "file://{server}"\ndevice = "box"\n'
    (tmp_path / "box").mkdir()
    with VirtualAppliance(tmp_path / "box", recording, settings) as box:
        box.start()
        box.wait_until(
            lambda status: status["state"] == "armed" and status["pre_roll_s"] >= 1.9, "armed with a pre-roll"
        )
        box.press()
        box.wait_until(lambda status: status["recording"] and status["recording"]["seconds"] >= 3.0, "recording")
        box.press()
        box.wait_until(lambda status: status["takes"] == 1, "kept")

        server.touch()
        failed = hangtime("sync", "now", "--config", box.config)
        assert failed.returncode == 75, failed.stderr
        assert "the server's folder" in failed.stderr
        status = box.wait_until(lambda status: status["faults"], "a fault of sync")
        shown = hangtime("status", "--socket", box.socket)
        assert "the server's folder" in shown.stdout
        assert status["waiting"] == 1

        server.unlink()
        assert hangtime("sync", "now", "--config", box.config).returncode == 0
        status = box.wait_until(lambda status: not status["faults"] and status["waiting"] == 0, "synced")
        shown = hangtime("status", "--socket", box.socket).stdout
        assert "0 takes wait, 1 safe on the server, last sync: today at" in shown
        assert "Last proved: today at" in shown
        assert ", sound." in shown
        assert "the server's folder" not in shown.replace("The server's folder is on the same disk", "")
        assert json.loads(hangtime("sync", "status", "--config", box.config, "--json").stdout)["safe"] == 1
        (take,) = server.rglob("*.mcap")
        assert verify_take(take).is_sound

        # Retention by hand: the take leaves, and the daemon counts it no more.
        box.wait_until(lambda status: status["state"] != "syncing", "no longer syncing")
        pruned = hangtime("takes", "prune", "--config", box.config, "--quota-mb", 0)
        assert "take-000001 is removed from this device; its receipt says where it is" in pruned.stdout
        assert not (box.spool / "take-000001.mcap").exists()
        box.wait_until(lambda status: status["takes"] == 0, "no take any more")

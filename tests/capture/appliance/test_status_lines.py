"""The words of `hangtime status`."""

from __future__ import annotations

from capture.appliance.status import lines


def told(**changes):
    return {
        "says": "armed", "recording": None, "faults": [], "last_take": None, "frames": 2400, "dropped": 1, "gaps": 1,
        "bytes_kept": 0, "free_bytes": 0, "takes": 1, "waiting": 0, "salvaged": 0, "sync": {"says": []},
        "clock": {"utc": "2026-01-01", "source": "NTP", "uncertainty_s": None}, **changes,
    }  # fmt: skip


def test_one_gap_is_one_gap():
    assert any(line.startswith("since the start: 2400 frames, 1 lost in 1 gap; ") for line in lines(told()))
    assert any(", 3 lost in 2 gaps; " in line for line in lines(told(dropped=3, gaps=2)))


def test_a_last_take_that_was_removed_since_is_said_to_be_removed(tmp_path):
    take = tmp_path / "take-000004.mcap"
    take.touch()
    kept = told(last_take={"kept": str(take), "findings": []})
    assert f"last take: {take}" in lines(kept)
    take.unlink()
    assert any(line.startswith("last take: take-000004, removed from this device since") for line in lines(kept))
    assert "last take: not kept" in lines(told(last_take={"kept": None, "findings": []}))

"""Make the takes that readers are checked with. Run: python tests/formats/vectors/make.py (from the checkout)."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[2]))

from formats.archive import read_take, write_take
from tests.formats.test_archive import a_scan, a_take


def a_take_with_everything(frames=70):
    """Seventy frames with gaps, hidden points, a pitch, deviations of every kind, an outlier, two scans and a pause."""
    rng = np.random.default_rng(2)
    take = a_take(frames=frames)
    hidden = ~take.points_valid & (rng.random(take.points_valid.shape) > 0.5)
    quality = rng.random(frames)
    quality[11] = np.nan
    pitch = 0.1 * np.sin(take.time)
    pitch[5] = np.nan
    sd = take.points_sd.copy()
    sd[20:, 1] = 0.05 * rng.random((frames - 20, 3)) + 1e-3
    sd[3, 0], sd[4, 0], sd[5, 0] = np.nan, 0.0, np.inf
    points = take.points.copy()
    points[40, 2] = 900.0, -900.0, 0.0
    valid = take.points_valid.copy()
    valid[40, 2], valid[:3, 3] = True, False
    points[:3, 3] = np.nan
    time = take.time.copy()
    time[50:] += 7.0
    return replace(
        take, points=points, points_valid=valid, points_sd=sd, points_hidden=hidden & ~valid, quality=quality,
        pitch=pitch, pitch_sd=np.where(np.isfinite(pitch), 0.004, np.nan), time=time, markers=take.held + 0.01,
        scans=(a_scan(0.4, 1), a_scan(0.6, 2, size=5, around=12)),
    )  # fmt: skip


def plain(take):
    """What a take holds, as JSON can say it."""
    places = {
        "held": take.held.round(9), "markers": take.markers.round(9), "points": take.points.round(9)
    }  # fmt: skip
    return {
        "take_id": take.take_id, "created": take.created, "source": take.source, "notes": take.notes,
        "rig": msgspec.to_builtins(take.rig), "garment": msgspec.to_builtins(take.garment),
        "frames": [
            {
                "time": float(take.time[k]), "state": int(take.state[k]), "quality": number(take.quality[k]),
                "pitch": number(take.pitch[k]), "pitch_sd": number(take.pitch_sd[k]),
                **{name: [seen(place) for place in values[k]] for name, values in places.items()},
                "held_sd": [number(sd) for sd in take.held_sd[k].ravel()],
                "points_sd": [number(sd) for sd in take.points_sd[k].ravel()],
                "points_hidden": [int(flag) for flag in take.points_hidden[k]],
            }
            for k in range(len(take.time))
        ],
        "scans": [
            {"time": scan.time, "grid": [seen(place) for place in scan.grid.reshape(-1, 3).round(9)],
             "contour": [seen(place) for place in scan.contour.round(9)]}
            for scan in take.scans
        ],
    }  # fmt: skip


def number(value):
    return round(float(value), 12) if math.isfinite(value) else None


def seen(place):
    return [float(part) for part in place] if np.isfinite(place).all() else None


def main():
    write_take(HERE / "version-2.mcap", a_take_with_everything())
    for version in (1, 2):
        content = plain(read_take(HERE / f"version-{version}.mcap"))
        (HERE / f"version-{version}.json").write_text(json.dumps(content) + "\n")


if __name__ == "__main__":
    main()

"""A report's motion of more than a gigabyte is stored thinned within its limit, and is read again."""

from __future__ import annotations

import resource
import zipfile

import numpy as np
import pytest

from fit.report.kept import MOST_BYTES, PLAIN_BYTES, STEP, load_motions, place_beside, save_motions
from fit.report.motion import ReportMotion, Run
from fit.report.origin import Origin

FRAMES, VERTICES = 200_000, 330  # 200 s at 1000 frames a second, of the mesh of a skirt
GROWTH = 2e9  # bytes; our choice: less than the motion itself, 1.58 GB, and what compresses its sixth part


@pytest.mark.slow  # a minute
def test_a_motion_of_one_and_a_half_gigabytes_is_stored_within_its_limit_and_read_again(tmp_path):
    time = np.arange(FRAMES) / 1000
    mesh = np.zeros((FRAMES, VERTICES, 3), np.float32)
    mesh += np.linspace(0, 1, VERTICES, dtype=np.float32)[:, None]
    mesh[..., 1] += 0.1 * np.sin(5 * time, dtype=np.float32)[:, None]
    runs = {name: Run(points=mesh[:, :5], mesh=mesh) for name in ("before", "after")}
    motion = ReportMotion(
        take_id="long", is_held_out=True, time=time, real=mesh[:, :5], point_names=tuple("abcde"), runs=runs
    )
    report, before = tmp_path / "report.html", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    save_motions(report, [motion], Origin(facts=[], takes=[]), "now")
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    with zipfile.ZipFile(place_beside(report)) as archive:
        assert MOST_BYTES / 2 < sum(part.file_size for part in archive.infolist()) <= MOST_BYTES + PLAIN_BYTES
    (kept,), _ = load_motions(report, "now")
    each = round(FRAMES / len(kept.time))
    assert each == 7  # 1.62 GB of positions over 268 MB
    np.testing.assert_array_equal(kept.time, time[::each])
    for name in runs:
        assert np.abs(kept.runs[name].mesh - mesh[::each]).max() <= 0.51 * STEP
    assert grown < GROWTH

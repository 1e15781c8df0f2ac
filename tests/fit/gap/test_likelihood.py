"""The likelihood of a residual, against explicit covariance matrices."""

from __future__ import annotations

import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.gap import likelihood
from fit.gap.correlation import Ringing
from fit.gap.edge_fit import SLOW
from fit.gap.likelihood import SLOW_LASTS, SLOW_SHARE, Likelihood, shapes_of
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, sheet, swing, take_of

SCALES = np.array([3e-4, 1e-3, 5e-3])  # m
RINGING = Ringing(decay=0.4, hertz=0.9, share=1.0)
NOISE = 1.5e-3  # m


@pytest.fixture(scope="module")
def seen():
    """Two short takes of few points, of which some are not seen in some frames."""
    rng, recordings = np.random.default_rng(5), []
    for frames in (24, 21):
        time = np.arange(frames) / 30.0
        garment = sheet(grid=3)
        displacement = swing(time, start=0.0)
        points = hung(garment, time) + displacement[:, None] + rng.normal(0, NOISE, (frames, 9, 3))
        points[rng.random((frames, 9)) < 0.15] = np.nan
        recordings.append(prepare(take_of(garment, time, displacement, points, sd=NOISE)))
    return Observer(recordings, SI, LIBRARY, frequency=0.0)


@pytest.fixture
def exact(seen, monkeypatch):
    """The likelihood with all modes of K, and a stated ringing."""
    monkeypatch.setattr(likelihood, "KEPT_VARIANCE", 1.0 - 1e-12)
    monkeypatch.setattr(likelihood, "FASTEST_MODE", 30.0)
    monkeypatch.setattr(likelihood, "ringing_of", lambda *_: RINGING)
    noise = [np.full(9, 0.8 * NOISE), np.full(9, 1.2 * NOISE)]
    residual = np.zeros(len(seen.layout.take))
    return Likelihood(seen, noise, residual, SCALES), noise


def offsets(time, other):
    return np.exp(-np.abs(time[:, None] - other) / SLOW_LASTS)


def written_out(observer, noise, scale):
    """Covariance of one axis of all judged sightings, take by take, frame by frame, in metres."""
    blocks, points, takes, times = [], [], [], []
    for k, recording in enumerate(observer.recordings):
        frame, point = np.nonzero(recording.counted)
        points.append(point)
        takes.append(np.full(len(frame), k))
        times.append(recording.time[frame])
        blocks.append(noise[k][point])
    point, take, time, sd = (np.concatenate(parts) for parts in (points, takes, times, blocks))
    is_one = (point[:, None] == point) & (take[:, None] == take)
    together = take[:, None] == take
    apart = np.abs(time[:, None] - time)
    shapes = shapes_of(observer.recordings[0])[point]
    own = np.diag(sd**2) + is_one * (SLOW_SHARE * sd) ** 2 * np.exp(-apart / SLOW_LASTS)
    fixed = (point[:, None] == point) * observer.recordings[0].offset_sd ** 2
    rings = np.exp(-apart / RINGING.decay) * np.cos(2 * np.pi * RINGING.hertz * apart)
    return own + fixed + scale**2 / 3 * together * rings * (shapes @ shapes.T), point


def rows_of(observer, fields):
    """Residuals of displacements [m], one field of every take's points, (frames, points, 3)."""
    apart = [recording.points - field for recording, field in zip(observer.recordings, fields, strict=True)]
    return observer.residuals_of([np.nan_to_num(one)[None] for one in apart])[0]


def test_products_are_those_of_the_covariance_written_out(seen, exact):
    found, noise = exact
    rng = np.random.default_rng(1)
    fields = [[rng.normal(0, 2e-3, r.points.shape) for r in seen.recordings] for _ in range(2)]
    rows = np.stack([rows_of(seen, one) for one in fields])
    rows[:, seen.layout.is_edge] = 0.0
    sums = found.of(rows)
    flat = [np.concatenate([f[r.counted] for f, r in zip(one, seen.recordings, strict=True)]) for one in fields]
    volumes = []
    for n, scale in enumerate(SCALES):
        covariance, _ = written_out(seen, noise, scale)
        expected = sum(
            np.array([[one[:, a] @ np.linalg.solve(covariance, other[:, a]) for other in flat] for one in flat])
            for a in range(3)
        )
        assert np.allclose(sums.inner[n], expected, rtol=1e-6)
        volumes.append(3 * np.linalg.slogdet(covariance)[1])
    assert np.allclose(np.diff(sums.log_det), np.diff(volumes), rtol=1e-6)


def test_the_held_edge_has_noise_and_offsets_and_no_discrepancy(seen, exact):
    found, _ = exact
    layout, rng = seen.layout, np.random.default_rng(2)
    row = np.where(layout.is_edge, rng.normal(size=len(layout.take)), 0.0)
    sums = found.of(row[None])
    assert np.allclose(sums.inner, sums.inner[0])
    expected = 0.0
    parts = []
    for k in range(len(seen.recordings)):
        mine = layout.is_edge & (layout.take == k)
        moving, still = np.flatnonzero(mine & (layout.frame >= 0)), np.flatnonzero(mine & (layout.frame < 0))
        sd = layout.sd[moving].reshape(-1, 4)
        values = (row[moving] * layout.sd[moving]).reshape(-1, 4) + row[still] * layout.sd[still]
        time = seen.recordings[k].time[layout.frame[moving].reshape(-1, 4)[:, 0]]
        offset = np.sqrt(layout.sd[still] ** 2 - (sd**2).sum(0) / len(sd) ** 2)
        parts.append((values, np.sqrt(SLOW) * sd, time, offset))
    for number in range(4):
        values = np.concatenate([part[0][:, number] for part in parts])
        fixed = np.concatenate([np.full(len(p[2]), p[3][number]) for p in parts])
        covariance = np.outer(fixed, fixed)
        first = 0
        for _, own, time, _ in parts:
            mine = slice(first, first + len(time))
            slow = np.outer(own[:, number], own[:, number]) * SLOW_SHARE**2 * offsets(time, time)
            covariance[mine, mine] += slow + np.diag(own[:, number] ** 2)
            first += len(time)
        expected += values @ np.linalg.solve(covariance, values)
    assert sums.inner[0, 0, 0] == pytest.approx(expected, rel=1e-6)


def test_shapes_are_zero_at_the_held_edge_and_have_a_mean_square_of_one(seen):
    recording = seen.recordings[0]
    shapes = shapes_of(recording)
    assert np.abs(shapes[~recording.judged]).max() < 1e-12
    assert (shapes[recording.judged] ** 2).sum(1).mean() == pytest.approx(1.0)


def test_the_scale_that_made_a_discrepancy_is_the_likeliest_one(seen, exact):
    found, noise = exact
    rng, scale = np.random.default_rng(3), 2e-3
    found.scales = np.geomspace(2e-4, 2e-2, 13)
    covariance, _ = written_out(seen, noise, scale)
    root = np.linalg.cholesky(covariance)
    best = []
    for _ in range(8):
        drawn = root @ rng.normal(size=(len(root), 3))
        fields, first = [np.zeros(r.points.shape) for r in seen.recordings], 0
        for field, recording in zip(fields, seen.recordings, strict=True):
            count = int(recording.counted.sum())
            field[recording.counted] = drawn[first : first + count]
            first += count
        row = rows_of(seen, fields)
        row[seen.layout.is_edge] = 0.0
        sums = found.of(row[None])
        best.append(found.scales[np.argmax(-0.5 * (sums.inner[:, 0, 0] + sums.log_det))])
    assert np.exp(np.mean(np.log(best))) == pytest.approx(scale, rel=0.3)

"""Synthetic silhouette takes in closed form: a rigid sheet that swings about a clamped edge, with an even grid."""

from __future__ import annotations

import dataclasses

import numpy as np
from msgspec.structs import replace

from tests.fit.scenes import sheet, take_of

GRID = 8


def silhouette_sheet(points_are="silhouette", **options):
    """A swatch of 0.3 m with a grid of 8 x 8 points whose kind the garment states."""
    garment = sheet(width=0.3, height=0.3, mass=0.02, grid=GRID, **options)
    return replace(garment, format="hangtime-garment/2", points_are=points_are)


def path(time):
    """A hanger that stands for 1.5 s, swings through the cloth by 0.12 m at 0.7 Hz, and stands for 1.5 s again."""
    ramp = np.clip((time - 1.5) / 0.6, 0, 1) * np.clip((time[-1] - 1.5 - time) / 0.6, 0, 1)
    ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    away = 0.12 * ramp * np.sin(2 * np.pi * 0.7 * (time - 1.5))
    return np.stack([0 * time, away, 0.02 * ramp * np.sin(2 * np.pi * 0.9 * time)], 1)


def uneven(duration=12.0, rate=9.0, seed=1):
    """Frames that come unevenly, by a third of their interval."""
    steps = (1 + 0.33 * np.random.default_rng(seed).standard_normal(int(duration * rate)).clip(-2, 2)) / rate
    return np.concatenate([[0.0], np.cumsum(steps)])


def swung(garment, time, true, *, seen_length=None, angle=0.0, noise=0.0, seed=0):
    """A take stamped at `time` of what happened at `true`, (frames,) [s]; the hanger's path is on the stamps' clock.

    seen_length, (frames,): share of the cloth down to which the grid is laid evenly; angle [degrees], (frames,): skew
    """
    places = np.array([p.at_m for p in garment.points])
    count = len(time)
    share = np.ones(count) if seen_length is None else seen_length
    down, across = -places[:, 1] * share[:, None], np.tile(places[:, 0], (count, 1))
    across = across + np.tan(np.radians(np.broadcast_to(angle, (count,))))[:, None] * (0.15 - down)
    swing = 0.5 * np.sin(2 * np.pi * 0.9 * true)[:, None]
    base = _at(time, true)
    points = base[:, None] + np.stack([across, down * np.sin(swing), -down * np.cos(swing)], 2)
    points = points + noise * np.random.default_rng(seed).standard_normal(points.shape)
    take = take_of(garment, time, path(time), points, sd=max(noise, 1e-3))
    return dataclasses.replace(take, held_sd=np.full(take.held.shape, 1e-3))


def _at(time, true):
    """Where the hanger was at true instants, of a path that is known over the stamps' whole length."""
    fine = np.linspace(time[0], time[-1], 4000)
    return np.stack([np.interp(true, fine, axis) for axis in path(fine).T], 1)

"""Measure how often honest markers are said to have exchanged labels, and how many exchanges are found.

Run: python benchmarks/exchanges.py [HONEST] [EXCHANGED] [SEED]. Without numbers, it draws three thousand honest takes
and one thousand with an exchange. A garment's grid of markers swings, ripples, folds over, is flicked or turned, or two
panels pass each other. Rate, distance, noise and lost sightings are drawn as well. Each seed draws other takes.

An exchange is of two to four markers, in a frame alone, a few, a stretch, or one end of the file. It is found exactly
where its positions, and no others, count as not seen. Positions under the right names that count as not seen are lost.
Shares have intervals of 95 % by Wilson (`fit.blind.rates`).
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from fit.blind.rates import wilson
from formats.arrays import Floats, Integers
from formats.importers.marker_exchanges import remove_exchanged

MOTIONS = ("swing", "ripple", "fold", "flick", "turn", "panels")
SPANS = ("a frame", "a few", "a stretch", "an end")
FLICK_SPREAD = 0.2  # s, of a hand's slowest flick exp(-(t / spread)^2); our choice: it lasts some 0.4 s


def moved(draw: np.random.Generator, motion: str, time: Floats, at: Floats) -> Floats:
    """Return the places (frames, markers, 3) [m] of markers at `at` (markers, 2) [m] on hanging cloth."""
    across, down = at.T
    clock = time[:, None]

    def wave(least: float, most: float, far: float) -> Floats:
        hertz, along, phase = draw.uniform(least, most), draw.uniform(2.0, 12.0), draw.uniform(0, 2 * np.pi)
        return far * np.sin(2 * np.pi * hertz * clock - along * down - draw.uniform(0, 4) * across + phase)

    places = np.stack(np.broadcast_arrays(across, 0 * clock, 1.5 - down), 2).astype(float)
    grown = down / down.max(initial=0.1)
    places[..., 0] += wave(0.3, 1.0, draw.uniform(0.02, 0.2))
    places[..., 2] += grown * wave(0.3, 2.0, 0.05)
    places[..., 1] += grown * wave(0.4, 1.2, draw.uniform(0.05, 0.4))
    if motion == "ripple":
        places[..., 1] += grown * wave(2.0, 6.0, draw.uniform(0.005, 0.03))
    elif motion == "fold":
        bent = np.clip(wave(0.3, 1.0, 3.0), -3.0, 3.0) * grown
        places[..., 1] += down * np.sin(bent) * 0.7
        places[..., 2] += down * (1 - np.cos(bent)) * 0.7
    elif motion == "flick":
        for _ in range(draw.integers(1, 6)):
            when, fast = draw.uniform(time[0], time[-1]), draw.uniform(0.25, 1.0) * FLICK_SPREAD
            bump = grown * np.exp(-(((clock - when - 0.2 * down) / fast) ** 2))
            places += bump[..., None] * draw.normal(0, 0.15, 3)
    elif motion == "turn":
        angle, middle = np.cumsum(wave(0.3, 1.0, 3.0), 0) * np.diff(time, prepend=time[0])[:, None], across.mean()
        away = places[..., 0] - middle, places[..., 1].copy()
        places[..., 0] = middle + away[0] * np.cos(angle) - away[1] * np.sin(angle)
        places[..., 1] = away[0] * np.sin(angle) + away[1] * np.cos(angle)
    elif motion == "panels":
        second = np.arange(len(at)) % 2 == 1
        places[:, second, 0] += wave(0.4, 1.5, 0.15)[:, second]
        places[:, second, 1] += 0.02
    return places


def drawn(draw: np.random.Generator) -> tuple[Floats, Floats]:
    """Return the times (frames,) [s] of a take, and its places (frames, markers, 3) [m], not a number where lost."""
    rate = float(draw.choice([25, 30, 50, 60, 100, 120, 200, 250]))
    time = np.arange(int(rate * draw.uniform(3.0, 8.0))) / rate
    wide, high = draw.integers(2, 7), draw.integers(3, 8)
    pitch = draw.uniform(0.015, 0.08)
    at = pitch * np.stack(np.meshgrid(np.arange(wide), np.arange(high)), 2).reshape(-1, 2)
    at = at + draw.normal(0, 0.05 * pitch, at.shape)
    places = moved(draw, str(draw.choice(MOTIONS)), time, at)
    places += draw.normal(0, np.exp(draw.uniform(np.log(3e-4), np.log(3e-3))), places.shape)
    lost = draw.random(places.shape[:2]) < draw.choice([0.0, draw.uniform(0, 0.2)])
    for _ in range(draw.integers(0, 4)):
        begin, marker = draw.integers(len(time)), draw.integers(places.shape[1])
        lost[begin : begin + draw.integers(2, 60), marker] = True
    places[lost] = np.nan
    return time, places


def frames_of(draw: np.random.Generator, span: str, count: int) -> Integers:
    """Return the frames of an exchange, fewer than half."""
    if span == "an end":
        long = int(draw.integers(5, count // 2))
        return np.arange(long) if draw.random() < 0.5 else np.arange(count - long, count)
    least, most = {"a frame": (1, 1), "a few": (2, 9), "a stretch": (10, count // 3)}[span]
    long = int(draw.integers(least, most + 1))
    begin = int(draw.integers(3, count - long - 3))
    return np.arange(begin, begin + long)


def told(time: Floats, places: Floats) -> str:
    """Return the warning of exchanges; their positions become not a number in place."""
    return remove_exchanged(time, places, [f"m{k}" for k in range(places.shape[1])], lambda k: f"frame {k + 1}")


def share(count: int, of: int) -> str:
    """Return a share as it is printed, with its interval."""
    low, high = wilson(count, of)
    return f"{count} of {of}, {100 * count / of:.2f} % [{100 * low:.2f} to {100 * high:.2f}]"


def main(honest: int, exchanged: int, seed: int) -> None:
    """Print the shares of false, found, and costly exchanges."""
    false = positions = 0
    for number in range(honest):
        time, places = drawn(np.random.default_rng((seed, 0, number)))
        seen = ~np.isnan(places[..., 0])
        if told(time, places):
            false += 1
            positions += int((seen & np.isnan(places[..., 0])).sum())
            print(f"false: take {number}", flush=True)
    print(f"honest takes with a false exchange: {share(false, honest)}; positions lost in them: {positions}")
    counts = Counter[tuple[str, str]]()
    for number in range(exchanged):
        draw = np.random.default_rng((seed, 1, number))
        time, places = drawn(draw)
        span = SPANS[number % len(SPANS)]
        frames = frames_of(draw, span, len(time))
        markers = draw.choice(places.shape[1], min(int(draw.choice([2, 2, 2, 3, 4])), places.shape[1]), replace=False)
        right, found = places.copy(), places.copy()
        found[np.ix_(frames, markers)] = places[np.ix_(frames, np.roll(markers, 1))]
        right[np.ix_(frames, markers)] = np.nan
        seen = ~np.isnan(found[..., 0])
        said = told(time, found)
        missing, expected = seen & np.isnan(found[..., 0]), seen & np.isnan(right[..., 0])
        counts[span, "all"] += 1
        counts[span, "exact"] += bool((missing == expected).all())
        counts[span, "not found"] += not said
        counts[span, "costly"] += bool((missing & ~expected).any())
    for kind in (*SPANS, "all together"):
        of, exact, unseen, costly = (
            sum(counts[span, what] for span in SPANS if kind in (span, "all together"))
            for what in ("all", "exact", "not found", "costly")
        )
        if of:
            print(
                f"{kind}: exactly found {share(exact, of)}; not found {share(unseen, of)}; "
                f"with right positions lost {share(costly, of)}"
            )


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*(given + [3000, 1000, 0][len(given) :]))

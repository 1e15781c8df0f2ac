"""Sample parameters from the posterior that the emulator approximates, by differential evolution.

    p(u) ~ E(u)^(-N/2),    E: expected cost, prior included

This is the likelihood of Gaussian errors of unknown deviation, at its maximum over the deviation. N is the number of
independent pieces of the recording. The difference of two other walkers moves each walker. Every fifth move takes the
whole difference, so that walkers step between local minima:

    u' = u + gamma (u_a - u_b) + e,    gamma = 2.38 / sqrt(2 p), or 1

Source: C. J. F. ter Braak, "A Markov chain Monte Carlo version of the genetic algorithm differential evolution",
Statistics and Computing 16 (2006). Each half of the walkers moves by the other half, so all walkers of a half move at
once.

Source: D. Foreman-Mackey et al., "emcee: the MCMC hammer", PASP 125 (2013), section 3.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from formats.arrays import Floats

WALKERS, SWEEPS = 64, 300  # walkers, and moves of each; our choice: 12,800 draws remain
FORGOTTEN_SWEEPS = 100  # first steps of `SWEEPS`; our choice: a third, in which walkers leave their starts
# Share of the box, e above; our choice: it keeps walkers off one plane, and widens a deviation of 1 % by 0.5 %.
BOX_JITTER = 1e-3
FIRST_JITTER = 3e-3  # share of the box, about the starts of the walkers; our choice: walkers that coincide cannot move
# Moves: every fifth takes the whole difference; our choice: rarer, and walkers stay longer in a minimum.
WHOLE_EVERY = 5


def draw(cost: Callable[[Floats], Floats], starts: Floats, pieces: float, seed: int) -> Floats:
    """Return posterior draws, (draws, parameters), in shares of the box.

    cost: E, (candidates, parameters) -> (candidates,); starts, (starts, parameters): of the walkers in turn;
    pieces: N.
    """
    random = np.random.default_rng(seed)
    count = starts.shape[1]
    walkers = starts[np.arange(WALKERS) % len(starts)]
    walkers = np.clip(walkers + FIRST_JITTER * random.normal(size=walkers.shape), 0, 1)
    height = -0.5 * pieces * np.log(cost(walkers))
    kept = []
    for step in range(SWEEPS):
        gamma = 2.38 / np.sqrt(2 * count) if step % WHOLE_EVERY else 1.0
        for half in (0, 1):
            moved, still = np.arange(half, WALKERS, 2), np.arange(1 - half, WALKERS, 2)
            apart = walkers[random.choice(still, len(moved))] - walkers[random.choice(still, len(moved))]
            tries = walkers[moved] + gamma * apart + BOX_JITTER * random.normal(size=apart.shape)
            is_inside = ((tries >= 0) & (tries <= 1)).all(1)
            tried = np.where(is_inside, -0.5 * pieces * np.log(cost(np.clip(tries, 0, 1))), -np.inf)
            is_taken = np.log(random.random(len(moved))) < tried - height[moved]
            walkers[moved[is_taken]], height[moved[is_taken]] = tries[is_taken], tried[is_taken]
        if step >= FORGOTTEN_SWEEPS:
            kept.append(walkers.copy())
    return np.concatenate(kept)

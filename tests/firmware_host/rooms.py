"""Surroundings of the synthetic garment: a bare wall, a furnished room, and an arm that reaches in front of it."""

from __future__ import annotations

import numpy as np

from firmware_host.synthetic.surroundings import Panel, Surroundings

WALL_BEHIND = 1.0  # m behind the hanger
ARM_BEFORE, ARM_WIDTH = 0.35, 0.12  # m
SIDE_CLEARANCE = 0.62  # m from the hanger's middle to the nearest object beside it, out of reach of every motion


def plain(distance: float) -> Surroundings:
    """A wall a metre behind the hanger."""
    return Surroundings(wall=distance + WALL_BEHIND)


def cluttered(distance: float, seed: int) -> Surroundings:
    """A furnished room: shelf and boxes 0.45 to 0.9 m behind, chair, lamp pole and cupboard beside, a floor."""
    rng = np.random.default_rng([seed, 5])
    panels = []
    for _ in range(4):  # behind: never nearer than the farthest swing
        left, top = rng.uniform(-0.9, 0.5), rng.uniform(-0.6, 0.3)
        width, height = rng.uniform(0.15, 0.6, 2)
        z = distance + rng.uniform(0.45, 0.9)
        panels.append(Panel(left, left + width, top, top + height, z, rng.uniform(40, 220)))
    for side in (-1.0, 1.0):  # beside: at the garment's own depth
        inner = SIDE_CLEARANCE + rng.uniform(0.0, 0.1)
        width, z = rng.uniform(0.05, 0.5), distance + rng.uniform(-0.25, 0.3)
        low, high = sorted((side * inner, side * (inner + width)))
        panels.append(Panel(low, high, rng.uniform(-0.7, 0.1), 1.2, z, rng.uniform(40, 220)))
    return Surroundings(wall=distance + WALL_BEHIND, has_floor=True, panels=tuple(panels))


def arm(distance: float, level: float, share: float, side: float) -> tuple[Panel, ...]:
    """Return a forearm that reaches in front of the garment and back; share: 0 to 1 of its motion.

    level: height that it hides, y [m] at the garment's distance; side: -1 from the left, 1 from the right.
    """
    z = distance - ARM_BEFORE
    reach = 0.75 - 0.62 * float(np.sin(np.pi * np.clip(share, 0.0, 1.0)))  # m from the middle to the fingertips
    low, high = sorted((side * reach, side * 1.2))
    middle = level * z / distance
    return (Panel(low, high, middle - 0.5 * ARM_WIDTH, middle + 0.5 * ARM_WIDTH, z, 150.0),)

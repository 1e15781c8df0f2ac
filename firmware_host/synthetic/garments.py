"""The garments of the synthetic world beside the demo's skirt: a swatch and a T-shirt, both on the demo's hanger."""

from __future__ import annotations

from firmware_host.synthetic.scene import TOP_WIDTH, demo_garment
from formats.garment import Garment, TrackedPoint

CORNER_NAMES = ("top_left", "top_right", "bottom_right", "bottom_left")

SWATCH_HEIGHT = 0.42  # m; as wide as the hanger holds
# m, right half of the T-shirt. Our choice: a small shirt that the camera sees whole at 1.6 m, by eye.
SLEEVE_TIP, SLEEVE_CUFF, SLEEVE_UNDERARM = (0.36, -0.12), (0.30, -0.22), (0.23, -0.17)
SHIRT_HEIGHT = 0.58  # m; our choice: seen whole with the sleeves, by eye


def swatch() -> Garment:
    """A rectangle of light cloth."""
    half = TOP_WIDTH / 2
    corners = ((-half, 0.0), (half, 0.0), (half, -SWATCH_HEIGHT), (-half, -SWATCH_HEIGHT))
    points = [TrackedPoint(name=n, at_m=p) for n, p in zip(CORNER_NAMES, corners, strict=True)]
    points.append(TrackedPoint(name="centre", at_m=(0.0, -SWATCH_HEIGHT / 2)))
    return Garment(
        format="hangtime-garment/1", name="swatch", kind="swatch", mass_kg=0.03, outline_m=corners, held="edge",
        points=tuple(points),
    )  # fmt: skip


def shirt() -> Garment:
    """The front of a short-sleeved T-shirt, held along its shoulders.

    Its top corners are the tips of the sleeves. The centre is as far from them as from the hem's corners:
    x_tip^2 + (d - 0.12)^2 = x_hem^2 + (h - d)^2 at depth d below the shoulders.
    """
    half, body = TOP_WIDTH / 2, SLEEVE_UNDERARM[0]
    right = ((half, 0.0), SLEEVE_TIP, SLEEVE_CUFF, SLEEVE_UNDERARM, (body, -SHIRT_HEIGHT))
    outline = (*((-half, 0.0),), *right, *((-x, y) for x, y in reversed(right[1:])))
    depth = (body**2 + SHIRT_HEIGHT**2 - SLEEVE_TIP[0] ** 2 - SLEEVE_TIP[1] ** 2) / (2 * (SHIRT_HEIGHT + SLEEVE_TIP[1]))
    corners = ((-SLEEVE_TIP[0], SLEEVE_TIP[1]), SLEEVE_TIP, (body, -SHIRT_HEIGHT), (-body, -SHIRT_HEIGHT))
    points = [TrackedPoint(name=n, at_m=p) for n, p in zip(CORNER_NAMES, corners, strict=True)]
    points.append(TrackedPoint(name="centre", at_m=(0.0, -depth)))
    return Garment(
        format="hangtime-garment/1", name="T-shirt", kind="t-shirt", mass_kg=0.07, outline_m=outline, held="edge",
        points=tuple(points),
    )  # fmt: skip


GARMENTS = {"skirt": demo_garment, "swatch": swatch, "t-shirt": shirt}

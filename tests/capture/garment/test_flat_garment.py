"""The flat garment: its grid, the roles of its points, and where its centre must be."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from capture.errors import UntrackableError
from capture.garment.corners import PanelCorners
from capture.garment.flat_garment import CENTRE_ROLE, _laid_flat, flat_garment
from formats.garment import Garment, TrackedPoint

OUTLINE = np.array([[-0.2, 0.0], [0.2, 0.0], [0.3, -0.5], [-0.3, -0.5]])
NAMES = ("a", "b", "c", "d")


def skirt(centre=None, points=OUTLINE, name="centre", outline=OUTLINE):
    listed = [TrackedPoint(name=n, at_m=tuple(p)) for n, p in zip(NAMES, points, strict=True)]
    if centre is not None:
        listed.insert(1, TrackedPoint(name=name, at_m=centre))
    return Garment(
        format="hangtime-garment/1", name="a skirt", kind="skirt", mass_kg=0.1,
        outline_m=tuple(map(tuple, outline)), held="edge", points=tuple(listed),
    )  # fmt: skip


def of(garment):
    return flat_garment(garment, PanelCorners().flat_corners(np.array(garment.outline_m)))


def test_a_skirts_measures_are_those_of_its_trapeze():
    found = of(skirt())
    side = float(np.hypot(0.1, 0.5))
    assert found.corners == pytest.approx(OUTLINE)
    assert found.roles == [0, 1, 2, 3]
    assert found.sides == pytest.approx(np.array([[side, 0.4], [0.4, side], [side, 0.6], [0.6, side]]))
    assert found.reach == pytest.approx(side)
    assert found.area == pytest.approx(0.25)
    diagonal = float(np.hypot(0.5, 0.5))
    ways = np.array(
        [[0, 0.4, diagonal, side], [0.4, 0, side, diagonal], [diagonal, side, 0, 0.6], [side, diagonal, 0.6, 0]]
    )
    assert found.distances == pytest.approx(ways, rel=0.06, abs=1e-9)
    assert found.from_ends == pytest.approx(ways[:2], rel=0.06, abs=0.04)  # to the nearest node and back


def test_the_grid_has_the_positions_inside_the_outline():
    """Steps of 25 mm from half a step inside; at the depth d the skirt is 0.2 + d / 5 wide to either side."""
    grid = _laid_flat(OUTLINE)
    assert grid.shape == (20, 24, 3)
    inside = np.isfinite(grid[..., 0])
    x, y = np.meshgrid(-0.2875 + 0.025 * np.arange(24), -0.0125 - 0.025 * np.arange(20))
    assert (inside == (np.abs(x) < 0.2 - y / 5)).all()
    assert grid[inside] == pytest.approx(np.stack([x, y, 0 * x], axis=-1)[inside])


def test_a_corner_of_the_outline_at_the_height_of_a_row_of_the_grid_counts_once():
    """Rows are at -12.5 mm and every 25 mm below, of a coat hanger's slopes that end at such a row."""
    for row in (0, 3):
        y = -0.0125 - 0.025 * row
        outline = np.array([[-0.2, 0.0], [0.2, 0.0], [0.3, y], [0.3, -0.5], [-0.3, -0.5], [-0.3, y]])
        grid = _laid_flat(outline)
        x = -0.2875 + 0.025 * np.arange(24)
        assert np.isfinite(grid[row, :, 0]).tolist() == (np.abs(x) < 0.3).tolist()
        assert np.isfinite(grid[-1, :, 0]).all()
        inner = np.array([[-0.2, 0.0], [0.2, 0.0], [0.2, -0.5], [0.0, y], [-0.2, -0.5]])  # its middle is cut out below
        assert np.isfinite(_laid_flat(inner)[row, :, 0]).all()


def test_a_grid_leaves_out_what_the_outline_goes_around():
    """A U: two legs of 0.2 m with 0.1 m between them."""
    outline = np.array([[0, 0], [0.5, 0], [0.5, -0.4], [0.3, -0.4], [0.3, -0.2], [0.2, -0.2], [0.2, -0.4], [0, -0.4]])
    inside = np.isfinite(_laid_flat(outline)[..., 0])
    assert inside[:8].all()
    assert (inside[8:] == np.isin(np.arange(20), np.r_[0:8, 12:20])).all()


def test_points_are_corners_within_a_centimetre():
    aside = OUTLINE[[2, 0, 1, 3]] + [0.0099, 0.0]
    assert of(skirt(points=aside)).roles == [2, 0, 1, 3]
    with pytest.raises(UntrackableError, match="the point 'a' is neither one of the four corners"):
        of(skirt(points=OUTLINE + np.array([0.0101, 0.0])))
    with pytest.raises(UntrackableError, match="'pocket'"):
        of(skirt(centre=(0.0, -0.25), name="pocket"))


def centre_found(centre=(0.17, -0.02)):
    """The position that a refusal names."""
    with pytest.raises(UntrackableError, match=r"'centre' is \d+ mm beside") as refused:
        of(skirt(centre=centre))
    said = str(refused.value)
    return [float(part) for part in said.split("at_m = [")[1].split("]")[0].split(",")], said


def test_a_centre_elsewhere_is_refused_with_the_position_that_is_farthest_from_the_corners():
    """On the axis |p - a| = |p - d|: 0.04 + d^2 = 0.09 + (0.5 - d)^2 at a depth d of 0.3 m."""
    (x, y), said = centre_found()
    assert (x, y) == pytest.approx((0.0, -0.3), abs=0.02)
    off = int(said.split("'centre' is ")[1].split(" mm")[0])
    assert off == pytest.approx(1e3 * np.hypot(0.17 - x, -0.02 - y), abs=1)
    assert of(skirt(centre=(x, y))).roles == [0, CENTRE_ROLE, 1, 2, 3]
    assert of(skirt(centre=(x + 0.007, y), name="center")).roles == [0, CENTRE_ROLE, 1, 2, 3]


def test_a_centre_that_is_nearly_as_far_from_the_corners_is_as_good():
    """Aside by 12 mm it is nearer to two corners: by 0.2 / 0.36 of that, 7 mm; and lower by 12 mm by 10 mm."""
    (x, y), _ = centre_found()
    with pytest.raises(UntrackableError):
        of(skirt(centre=(x + 0.012, y)))
    holed = msgspec.structs.replace(skirt(centre=(x + 0.1, y)), holes_m=(((0.0, -0.1), (0.05, -0.1), (0.0, -0.15)),))
    assert CENTRE_ROLE in of(holed).roles

"""Everything that the synthetic camera draws ends where it truly ends: a pixel shows what its centre's ray meets."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from firmware_host.synthetic import render
from firmware_host.synthetic.pattern import Pattern
from firmware_host.synthetic.render import Renderer
from firmware_host.synthetic.scene import CAMERA
from firmware_host.synthetic.surroundings import Panel, Surroundings, draw_panel
from formats.arrays import Booleans, Floats

Z = 1.6  # m
SHIFTS = 101  # even steps of a pixel: an edge's mean is then known to 1/202 of a pixel
HUNDREDTH = 0.01  # px
UPRIGHT = np.eye(3)
RIGHT, DOWN = 44.3, 31.6  # px, a rectangle's size


def metric(pixels: Floats, z: float = Z) -> Floats:
    """Return points [m], (..., 3), at a depth on the rays of places in the image [px], (..., 2)."""
    x = (pixels - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy] * z
    return np.concatenate([x, np.full((*x.shape[:-1], 1), z)], axis=-1)


def quad_renderer(side: float) -> Renderer:
    """Return a renderer of a square cloth [m] of 2 x 3 cells."""
    down, across = np.meshgrid(np.linspace(0, side, 3), np.linspace(0, side, 4), indexing="ij")
    rest = np.stack([across, -down, np.zeros_like(down)], -1)
    return Renderer(Pattern(rest, np.ones((2, 3), bool), slice(None)))


def bilinear(corners: Floats) -> Floats:
    """Return nodes, (3, 4, k), between corners, (4, k): top left, top right, bottom right, bottom left."""
    down, across = np.linspace(0, 1, 3)[:, None, None], np.linspace(0, 1, 4)[None, :, None]
    top, bottom = (corners[i] + across * (corners[j] - corners[i]) for i, j in ((0, 1), (3, 2)))
    return np.asarray(top + down * (bottom - top))


def corners_of(left: float, top: float) -> Floats:
    return np.array([[left, top], [left + RIGHT, top], [left + RIGHT, top + DOWN], [left, top + DOWN]])


@cache
def small_cloth() -> Renderer:
    return quad_renderer(0.13)


def cloth(left: float, top: float) -> Booleans:
    return small_cloth().cloth(bilinear(metric(corners_of(left, top)))).depth < 2.0


def panel(left: float, top: float) -> Panel:
    low, high = metric(corners_of(left, top))[[0, 2]]
    return Panel(low[0], high[0], low[1], high[1], Z, 90.0)


def panel_in_front(left: float, top: float) -> Booleans:
    depth = np.full((CAMERA.height, CAMERA.width), 2.6)
    draw_panel(panel(left, top), depth, np.zeros((*depth.shape, 3)))
    return depth < 2.0


def plate(left: float, top: float, marker: int | None = 0) -> Booleans:
    depth = np.full((CAMERA.height, CAMERA.width), 2.6)
    low, high = metric(corners_of(left, top))[[0, 2]]
    size = (high - low)[:2]
    render._draw_rectangle(0.5 * (low + high), UPRIGHT, tuple(size), depth, np.zeros((*depth.shape, 3)), marker)
    return depth < 2.0


def bar(left: float, top: float) -> Booleans:
    return plate(left, top, None)


def edges(shows: Booleans) -> Floats:
    """Return left, top, right and bottom rim of the marked pixels [px]."""
    rows, columns = np.flatnonzero(shows.any(1)), np.flatnonzero(shows.any(0))
    return np.array([columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5])


@pytest.mark.parametrize("draw", [cloth, panel_in_front, plate, bar])
def test_a_rectangle_has_its_true_edges_and_its_true_centre(draw: Callable[[float, float], Booleans]) -> None:
    off, centre_off = [], []
    for step in range(SHIFTS):
        left, top = 251.237 + step / SHIFTS, 170.411 + (7 * step % SHIFTS) / SHIFTS
        shows = draw(left, top)
        off.append(edges(shows) - [left, top, left + RIGHT, top + DOWN])
        rows, columns = np.nonzero(shows)
        centre_off.append([columns.mean() - left - 0.5 * RIGHT, rows.mean() - top - 0.5 * DOWN])
        assert np.abs(off[-1]).max() <= 0.5
    np.testing.assert_allclose(np.mean(off, axis=0), 0.0, atol=HUNDREDTH)
    np.testing.assert_allclose(np.mean(centre_off, axis=0), 0.0, atol=HUNDREDTH)


def test_a_panel_behind_the_cloth_is_drawn_like_one_in_front() -> None:
    depth = np.full((CAMERA.height, CAMERA.width), 2.6)
    Surroundings(2.6, panels=(panel(100.7, 90.2),)).draw(depth, np.zeros((*depth.shape, 3)))
    assert np.array_equal(depth < 2.0, panel_in_front(100.7, 90.2))


def test_the_colour_of_a_bar_ends_where_its_depth_ends() -> None:
    """A row's covered shares add up to the bar's width, about its middle."""
    widths, middles = [], []
    for step in range(SHIFTS):
        left, top = 251.237 + step / SHIFTS, 170.411
        colour = np.zeros((CAMERA.height, CAMERA.width, 3))
        low, high = metric(corners_of(left, top))[[0, 2]]
        size = tuple((high - low)[:2])
        depth = np.full((CAMERA.height, CAMERA.width), 2.6)
        render._draw_rectangle(0.5 * (low + high), UPRIGHT, size, depth, colour, None)
        share = colour[185, :, 0] / render.BAR_GREY
        widths.append(share.sum() - RIGHT)
        middles.append((share * np.arange(CAMERA.width)).sum() / share.sum() - left - 0.5 * RIGHT)
    assert np.mean(widths) == pytest.approx(0.0, abs=HUNDREDTH)
    assert np.mean(middles) == pytest.approx(0.0, abs=HUNDREDTH)


def test_a_slanted_quadrilateral_covers_its_area_about_its_centroid() -> None:
    """Edges at all slopes: half a pixel along the rim of 675 pixels would be 338 pixels of 28212."""
    corners = np.array([[203.2, 81.7], [371.9, 112.4], [342.6, 291.3], [188.1, 240.8]])
    nodes = bilinear(metric(corners))
    rows, columns = np.nonzero(quad_renderer(0.45).cloth(nodes).depth < 2.0)
    x, y = corners.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = 0.5 * cross.sum()
    centroid = ((corners + np.roll(corners, -1, axis=0)) * cross[:, None]).sum(0) / (6 * area)
    rim = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).sum()
    assert (len(rows) - area) / rim == pytest.approx(0.0, abs=HUNDREDTH)
    np.testing.assert_allclose([columns.mean(), rows.mean()], centroid, atol=HUNDREDTH)


@pytest.mark.parametrize("degrees", [0, 60, 85])
def test_each_pixel_has_the_depth_of_its_centres_ray(degrees: float) -> None:
    normal = np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])
    middle = np.array([0.01, 0.02, Z])
    across, down = np.cross([0.0, 1.0, 0.0], normal), np.array([0.0, 1.0, 0.0])
    half = 0.2
    corners = middle + half * np.array([-across - down, across - down, across + down, -across + down])
    depth = quad_renderer(2 * half).cloth(bilinear(corners)).depth
    rows, columns = np.nonzero(depth < 2.0)
    assert len(rows) > 500
    rays = metric(np.stack([columns, rows], -1).astype(float), 1.0)
    np.testing.assert_allclose(depth[rows, columns], (middle @ normal) / (rays @ normal), rtol=1e-9)


@pytest.mark.parametrize("z", [0.3, 0.8, 1.6])
def test_cloth_has_no_holes_however_near_it_comes(z: float) -> None:
    """At 0.3 m a piece of 1.3 mm is 2.5 pixels wide."""
    corners = np.array([[203.2, 81.7], [371.9, 112.4], [342.6, 291.3], [188.1, 240.8]])
    shows = quad_renderer(0.1).cloth(bilinear(metric(corners, z))).depth < 2.0
    for row in shows[shows.any(1)]:
        first, last = np.flatnonzero(row)[[0, -1]]
        assert row[first : last + 1].all()


def test_the_cells_that_a_pattern_leaves_out_are_left_out_to_their_edges() -> None:
    """The right-hand third of the lower half is no cloth, as below a T-shirt's sleeve."""
    down, across = np.meshgrid(np.linspace(0, 0.13, 3), np.linspace(0, 0.13, 4), indexing="ij")
    is_cloth = np.ones((2, 3), bool)
    is_cloth[1, 2] = False
    renderer = Renderer(Pattern(np.stack([across, -down, 0 * down], -1), is_cloth, slice(None)))
    off = []
    for step in range(SHIFTS):
        left, top = 251.237 + step / SHIFTS, 170.411 + (7 * step % SHIFTS) / SHIFTS
        shows = renderer.cloth(bilinear(metric(corners_of(left, top)))).depth < 2.0
        below = np.flatnonzero(shows[int(top + DOWN) - 3])
        beside = np.flatnonzero(shows[:, int(left + RIGHT) - 3])
        off.append([below[-1] + 0.5 - left - 2 * RIGHT / 3, beside[-1] + 0.5 - top - DOWN / 2])
    np.testing.assert_allclose(np.mean(off, axis=0), 0.0, atol=HUNDREDTH)

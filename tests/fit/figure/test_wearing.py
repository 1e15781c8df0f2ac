"""A skirt on a figure: its girth, its back and its initial shape."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from fit.cloth.mesh import build_mesh
from fit.errors import FitError
from fit.figure.dressmaking import girth, plain_skirt, sewn_skirt
from fit.figure.gait import walk
from fit.figure.parts import CLEARANCE, TOUCHING_PARTS, figure_in
from fit.figure.wearing import Trouble, around
from tests.fit.scenes import sheet


def a_skirt():
    """0.4 m wide at its top, 0.56 m at its hem, 0.5 m long, front and back."""
    return sewn_skirt(plain_skirt(0.2))[0]


def test_the_girth_is_twice_the_fronts_width_at_every_height():
    assert girth(a_skirt(), np.array([0.0, 0.25, 0.5])) == pytest.approx([0.8, 0.96, 1.12])


def test_a_front_gets_a_back_and_a_sheet_that_is_both_is_taken_apart():
    front = plain_skirt(0.2)
    sewn, share = sewn_skirt(front)
    assert (sewn.mass_kg, share, sewn.seams) == (pytest.approx(2 * front.mass_kg), 1.0, ((1, 2), (3, 0)))
    both, half = sewn_skirt(msgspec.structs.replace(front, layers=2))
    assert (both.mass_kg, half) == (pytest.approx(front.mass_kg), 0.5)
    assert both.areal_density == pytest.approx(0.1)


def test_a_hem_of_several_pieces_is_left_open():
    wide = msgspec.structs.replace(
        plain_skirt(0.2), outline_m=((-0.2, 0), (0.2, 0), (0.25, -0.25), (0.28, -0.5), (0.0, -0.52), (-0.28, -0.5))
    )
    assert sewn_skirt(wide)[0].seams == ((1, 2), (2, 3), (5, 0))


def test_an_outline_that_is_no_skirt_is_refused():
    with pytest.raises(FitError, match="the figure wears skirts and T-shirts, and sheet is a swatch"):
        sewn_skirt(sheet())


def test_the_cloth_begins_round_the_body_hardly_strained():
    """Sides of its drawn pieces are as long as on the flat cloth, to 8 %: a cone is no flat pattern."""
    skirt = a_skirt()
    figure = figure_in(skirt, walk(0.1))
    mesh = build_mesh(skirt, 0.05)
    start = figure.band[0, :3] + around(skirt, mesh, figure.half_side) @ figure.band[0, 3:].reshape(3, 3)
    sides = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]]])
    is_cloth = np.linalg.norm(mesh.rest[sides[:, 0]] - mesh.rest[sides[:, 1]], axis=1)
    length = np.linalg.norm(start[sides[:, 0]] - start[sides[:, 1]], axis=1)
    assert length / is_cloth == pytest.approx(1.0, abs=0.08)
    bodies, _ = figure.only(TOUCHING_PARTS)
    nearest = min(body.distance(start).min() for body in bodies)
    assert nearest == pytest.approx(CLEARANCE, abs=5e-4)
    assert start[mesh.held_nodes, 2] == pytest.approx(figure.band[0, 2])


def test_a_skirt_for_a_doll_fits_no_grown_figure():
    doll = msgspec.structs.replace(plain_skirt(0.2), outline_m=((-0.1, 0), (0.1, 0), (0.12, -0.2), (-0.12, -0.2)))
    with pytest.raises(FitError, match=r"0.40 m round at its top fits no figure 1.70 m tall"):
        figure_in(sewn_skirt(doll)[0], walk(0.1))
    assert figure_in(sewn_skirt(doll)[0], walk(0.1, height=0.9)).half_side < 0.04


def test_the_first_frame_that_fails_is_named():
    deep = np.full((5, 3), -0.01)
    through = np.zeros((5, 3), bool)
    assert Trouble(deep, through).first() is None
    through[3, 1] = True
    assert Trouble(deep, through).first() == (3, 1)
    deep[2, 2] = 0.02
    assert Trouble(deep, through).first() == (2, 2)

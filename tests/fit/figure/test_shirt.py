"""A T-shirt round a figure: its neck, seams and cuffs, and where it begins."""

from __future__ import annotations

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from firmware_host.synthetic.garments import shirt
from fit.cloth.contact import surface_of
from fit.cloth.crossings import crossings
from fit.cloth.mesh import build_mesh
from fit.errors import FitError
from fit.export.worn import sewn as sewn_for_a_figure
from fit.figure.dressing import _push_out, _sized
from fit.figure.dressmaking import girth
from fit.figure.gait import ARM_OUT, LOWERED, walk
from fit.figure.parts import CLEARANCE, figure_in_shirt
from fit.figure.shirt import arms_out, chest_at, cuff_girth, plain_shirt, sewn_shirt
from fit.figure.wearing import BEGINS_APART, SAMPLES_APART, _is_back, _round, held_by
from fit.recordings.bodies import capsule, placed
from tests.fit.scenes import sheet


def test_neck_cuffs_and_hem_of_a_t_shirt_stay_open():
    sewn, share = sewn_shirt(plain_shirt(0.2))
    corners = len(sewn.outline_m)
    open_sides = {(k, (k + 1) % corners) for k in range(corners)} - set(sewn.seams)
    assert open_sides == {(0, 1), (3, 4), (6, 7), (9, 10)}
    assert girth(sewn, np.zeros(1)) == pytest.approx(0.44)
    assert (share, sewn.mass_kg) == (1.0, pytest.approx(2 * plain_shirt(0.2).mass_kg))
    assert cuff_girth(sewn) == pytest.approx(2 * np.hypot(0.084, 0.159))
    assert chest_at(sewn) == pytest.approx(0.235)


def test_a_sheet_that_is_both_layers_gets_a_neck_and_is_taken_apart():
    flat = msgspec.structs.replace(shirt(), layers=2)
    sewn, share = sewn_shirt(flat)
    assert sewn.outline_m[:3] == ((-0.11, 0.0), (0.11, 0.0), (0.2, 0.0))
    assert sewn.outline_m[-1] == (-0.2, 0.0)
    assert (share, sewn.mass_kg, sewn.layers) == (0.5, pytest.approx(flat.mass_kg), 1)


def test_the_first_sides_length_is_a_neck_where_it_is_no_longer():
    plain = plain_shirt(0.2)
    assert sewn_shirt(plain)[0].outline_m == plain.outline_m


@pytest.mark.parametrize(
    ("outline", "reason"),
    [
        (((-0.2, 0), (0.2, 0), (0.25, -0.5), (-0.25, -0.5)), "has no sleeves"),
        (((-0.03, 0), (0.03, 0), *plain_shirt(0.2).outline_m[2:]), "0.06 m wide, which goes over no head"),
    ],
)
def test_what_is_no_t_shirt_is_refused(outline, reason):
    with pytest.raises(FitError, match=reason):
        sewn_shirt(msgspec.structs.replace(plain_shirt(0.2), outline_m=outline))


def test_arms_begin_in_the_sleeves_and_are_lowered():
    sewn = sewn_shirt(plain_shirt(0.2))[0]
    out = arms_out(sewn)
    assert np.degrees(out) == pytest.approx(62.1, abs=0.1)  # the sleeve falls by 89 mm over 168 mm
    motion = walk(4.0, arms_out=out)
    way = motion.joints["left_elbow"] - motion.joints["left_shoulder"]
    aside = np.arcsin(way[:, 0] / np.linalg.norm(way, axis=1))
    assert aside[0] == pytest.approx(out, abs=1e-6)
    assert aside[-1] == pytest.approx(LOWERED * out, abs=1e-6)
    assert walk(0.1).joints["left_elbow"][0] == pytest.approx(
        walk(0.1, arms_out=ARM_OUT).joints["left_elbow"][0], abs=1e-12
    )  # fmt: skip


@pytest.mark.parametrize(
    ("narrower", "reason"),
    [
        ((0.7, 1.0), "m round its (chest|neck) fits no figure 1.70 m tall"),
        ((1.0, 0.45), "with sleeves 0.16 m round fits no figure"),
    ],
)
def test_a_t_shirt_that_is_too_narrow_is_refused(narrower, reason):
    """Of the whole width, or of the cuffs alone."""
    plain = plain_shirt(0.2)
    wide, cuff = narrower
    outline = [(wide * x, y) for x, y in plain.outline_m]
    for tip, end in ((3, 4), (10, 9)):
        outline[end] = tuple(np.array(outline[tip]) + cuff * (np.array(outline[end]) - outline[tip]))
    sewn = sewn_shirt(msgspec.structs.replace(plain, outline_m=tuple(outline)))[0]
    with pytest.raises(FitError, match=reason):
        figure_in_shirt(sewn, walk(0.1, arms_out=arms_out(sewn)))


def test_arms_are_as_thick_as_narrow_sleeves_allow():
    def arm(garment):
        sewn = sewn_shirt(garment)[0]
        figure = figure_in_shirt(sewn, walk(0.1, arms_out=arms_out(sewn)))
        return figure.bodies[figure.names.index("left_upper_arm")].radius, cuff_girth(sewn)

    (usual, _), (thin, cuff) = arm(plain_shirt(0.2)), arm(shirt())
    assert thin < 0.85 * usual
    assert 2 * np.pi * thin < cuff


def test_places_near_a_body_move_to_its_surface_and_others_stay():
    body = capsule((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.1)
    places = np.array([[0.05, 0.0, 0.5], [0.0, 0.104, 0.2], [0.3, 0.0, 0.5]])
    _push_out(places, body, 0.01)
    assert places == pytest.approx(np.array([[0.11, 0.0, 0.5], [0.0, 0.11, 0.2], [0.3, 0.0, 0.5]]), abs=1e-6)
    assert _sized(body, 0.5).distance(np.array([0.1, 0.0, 0.5])) == pytest.approx(0.05)
    assert _sized(body, 0.5).half_size[2] == body.half_size[2]


def test_a_t_shirt_begins_round_the_body_and_hardly_strained():
    """The body's own curves are no flat pattern: a twentieth of the sides is strained by more than a tenth."""
    sewn = sewn_shirt(plain_shirt(0.2))[0]
    figure = figure_in_shirt(sewn, walk(0.1, arms_out=arms_out(sewn)))
    mesh = build_mesh(sewn, 0.06)
    start = held_by(sewn, figure)(mesh).start(np.zeros((1, 9)))[0]
    bodies, motion = figure.only(figure.touching)
    apart = [placed(b, p).distance(start).min() for b, p in zip(bodies, motion.poses[0], strict=True)]
    assert BEGINS_APART > CLEARANCE
    assert min(apart) > 0.9 * BEGINS_APART - 1e-3
    sides = np.unique(np.sort(np.concatenate([mesh.triangles[:, k] for k in ([0, 1], [1, 2], [2, 0])]), 1), axis=0)
    flat = np.linalg.norm(mesh.rest[sides[:, 0]] - mesh.rest[sides[:, 1]], axis=1)
    strain = np.linalg.norm(start[sides[:, 0]] - start[sides[:, 1]], axis=1) / flat - 1
    assert np.quantile(strain, 0.95) < 0.15
    assert abs(np.median(strain)) < 0.03
    # The front is in front of the trunk, the back behind it, and each sleeve on its own arm.
    centre = figure.motion.poses[0, figure.names.index("trunk"), :3]
    chest = (np.abs(mesh.rest[:, 0]) < 0.1) & (np.abs(mesh.rest[:, 1] + 0.3) < 0.1)
    behind = start[chest, 1] > centre[1]
    assert (behind == _is_back(mesh)[chest]).all()
    hand = figure.motion.poses[0, figure.names.index("left_hand"), 0]
    assert np.sign(hand) == np.sign(start[np.argmax(mesh.rest[:, 0]), 0])
    assert crossings(surface_of(mesh, SAMPLES_APART), start) == 0


def test_the_collar_goes_round_the_neck_with_its_own_length():
    sewn = sewn_shirt(plain_shirt(0.2))[0]
    figure = figure_in_shirt(sewn, walk(0.1, arms_out=arms_out(sewn)))
    mesh = SimpleNamespace(
        rest=np.column_stack([np.tile(np.linspace(-0.11, 0.11, 41), 2), np.zeros(82)]),
        cells=np.array([np.arange(41), np.arange(41, 82)]),
    )
    ring = _round(sewn, mesh, figure.half_side)
    front = ring[:41]
    assert np.linalg.norm(np.diff(front, axis=0), axis=1).sum() == pytest.approx(0.22, rel=5e-3)
    neck = figure.bodies[figure.names.index("neck")]
    assert np.linalg.norm(ring[:, :2], axis=1).min() > neck.radius + CLEARANCE
    assert (ring[:41, 1] <= 1e-9).all()
    assert (ring[41:, 1] >= -1e-9).all()


def test_a_swatch_is_still_refused():
    with pytest.raises(FitError, match="the figure wears skirts and T-shirts"):
        sewn_for_a_figure(sheet())

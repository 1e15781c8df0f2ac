"""A T-shirt on a figure: its neck, seams, cuffs and initial shape."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from firmware_host.synthetic.garments import shirt
from fit.cloth.contact import surface_of
from fit.cloth.crossings import crossings
from fit.cloth.mesh import build_mesh
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.errors import FitError
from fit.export.moving import material_rows
from fit.export.new_motion import hung_still
from fit.export.worn import sewn as sewn_for_a_figure
from fit.figure.collar import APART, DIP, collar_nodes, collar_places, half_side
from fit.figure.dressing import _push_out, _sized
from fit.figure.gait import ARM_OUT, LOWERED, walk
from fit.figure.parts import CLEARANCE, figure_in_shirt
from fit.figure.shirt import arms_out, chest_at, collar_girth, cuff_girth, neck_sides, plain_shirt, sewn_shirt
from fit.figure.wearing import BEGINS_APART, SAMPLES_APART, _is_back, held_by, looked_at, wear
from fit.recordings.bodies import capsule, placed
from fit.recordings.held_edge import place_along
from tests.fit.export.exported import a_fit
from tests.fit.scenes import sheet

COARSE = 0.09  # m between nodes: a fifth of the work of films


def test_neck_cuffs_and_hem_of_a_t_shirt_stay_open():
    sewn, share = sewn_shirt(plain_shirt(0.2))
    corners = len(sewn.outline_m)
    open_sides = {(k, (k + 1) % corners) for k in range(corners)} - set(sewn.seams)
    assert open_sides == {(0, 1), (1, 2), (2, 3), (5, 6), (8, 9), (11, 12)}
    # Across half of 0.22 m, and from there 55 mm aside and 59.4 mm up, in front and behind.
    assert collar_girth(sewn) == pytest.approx(2 * (0.11 + 2 * np.hypot(0.055, 0.0594)))
    # Without the necks, of 59.4 mm times the mean of 0.22 and 0.11 m: cloth of 0.2 kg/m^2.
    assert share == 1.0
    assert sewn.mass_kg == pytest.approx(2 * (plain_shirt(0.2).mass_kg - 0.2 * 0.0594 * 0.165))
    assert sewn.areal_density == pytest.approx(0.2)
    assert cuff_girth(sewn) == pytest.approx(2 * np.hypot(0.084, 0.159))
    assert chest_at(sewn) == pytest.approx(0.235)


def test_a_sheet_that_is_both_layers_gets_a_neck_and_is_taken_apart():
    flat = msgspec.structs.replace(shirt(), layers=2)
    sewn, share = sewn_shirt(flat)
    neck = np.array(sewn.outline_m[:5])
    assert neck == pytest.approx(np.array([(-0.11, 0), (-0.055, -0.0594), (0.055, -0.0594), (0.11, 0), (0.2, 0)]))
    assert sewn.outline_m[-1] == (-0.2, 0.0)
    assert (share, sewn.layers) == (0.5, 1)
    assert sewn.areal_density == pytest.approx(flat.areal_density / 2)


def test_the_first_sides_length_is_a_neck_where_it_is_no_longer():
    plain = plain_shirt(0.2)
    corners = sewn_shirt(plain)[0].outline_m
    assert (corners[0], *corners[3:]) == plain.outline_m


@pytest.mark.parametrize(
    ("outline", "reason"),
    [
        (((-0.2, 0), (0.2, 0), (0.25, -0.5), (-0.25, -0.5)), "has no sleeves"),
        (((-0.03, 0), (0.03, 0), *plain_shirt(0.2).outline_m[2:]), "0.06 m wide, which goes over no head"),
    ],
)
def test_an_outline_that_is_no_t_shirt_is_refused(outline, reason):
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


def test_points_near_a_body_move_to_its_surface_and_others_stay():
    body = capsule((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.1)
    places = np.array([[0.05, 0.0, 0.5], [0.0, 0.104, 0.2], [0.3, 0.0, 0.5]])
    _push_out(places, body, 0.01)
    assert places == pytest.approx(np.array([[0.11, 0.0, 0.5], [0.0, 0.11, 0.2], [0.3, 0.0, 0.5]]), abs=1e-6)
    assert _sized(body, 0.5).distance(np.array([0.1, 0.0, 0.5])) == pytest.approx(0.05)
    assert _sized(body, 0.5).half_size[2] == body.half_size[2]


@pytest.fixture(scope="module")
def put_on():
    """A figure that stands, and a coarse T-shirt for it: garment, figure and mesh."""
    sewn = sewn_shirt(plain_shirt(0.2))[0]
    figure = figure_in_shirt(sewn, walk(0.3, arms_out=arms_out(sewn)))
    return sewn, figure, build_mesh(sewn, COARSE)


@pytest.fixture(scope="module")
def support(put_on):
    """What holds the T-shirt; to put it on takes seconds."""
    sewn, figure, mesh = put_on
    return held_by(sewn, figure)(mesh)


@pytest.fixture(scope="module")
def start(support):
    """Where the cloth begins round the figure, before it settles."""
    return support.start(np.zeros((1, 12)))[0]


@pytest.mark.slow
def test_a_t_shirt_begins_round_the_body_and_hardly_strained(put_on, start):
    """The body's own curves are no flat pattern: a twentieth of the sides is strained by more than a tenth."""
    _, figure, mesh = put_on
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


def test_front_and_back_share_the_nodes_on_their_seams_and_no_others(put_on):
    """So seams have no gap, at any time."""
    sewn, _, mesh = put_on
    front, back = np.split(mesh.cells, 2)
    shared = np.intersect1d(front, back)
    sides = [np.array([sewn.outline_m[a], sewn.outline_m[b]]) for a, b in sewn.seams]
    on_seam = np.any([place_along(mesh.rest, side)[1] for side in sides], axis=0)
    assert set(shared) == set(np.flatnonzero(on_seam))
    both = np.concatenate([mesh.rest[np.setdiff1d(front, back)], mesh.rest[np.setdiff1d(back, front)]])
    assert len(np.unique(both.round(6), axis=0)) == len(both) // 2


@pytest.mark.slow
def test_shoulders_and_arms_carry_a_t_shirt_by_contact(put_on, support, start):
    """Cloth that falls freely for 0.3 s is 0.4 m lower."""
    sewn, figure, mesh = put_on
    assert (support.nodes == collar_nodes(sewn, mesh)[0]).all()
    dressed = wear(hung_still(sewn, sewn.name), figure, 0.1, 30)
    simulator = Simulator(
        dressed.recording, (), resolution=Resolution(spacing=COARSE),
        support=lambda _: replace(support, start=lambda _: start[None], settle_time=0.2, settle_damping=1.0),
        contact=dressed.contact,
    )  # fmt: skip
    soft = {"stretch_stiffness": 40.0, "shear_stiffness": 15.0, "bending_damping_time": 2e-4}
    done = simulator.run(material_rows(a_fit(values=soft), 0.2), np.zeros((1, 0)), shapes=True)
    bodies, motion = figure.only(figure.touching)
    trouble = looked_at(simulator.surface, done.shapes[0], dressed.recording.time, bodies, motion)
    assert trouble.first() is None
    assert trouble.depths.max() < 0
    assert crossings(simulator.surface, done.shapes[0, -1].astype(float)) == 0
    carrying = [placed(b, p) for b, p, n in zip(bodies, motion.poses[-1], figure.touching, strict=True)
                if n.endswith(("shoulder", "shoulders", "upper_arm"))]  # fmt: skip
    on_top = (np.abs(mesh.rest[:, 0]) > 0.14) & (
        mesh.rest[:, 1] > -0.05 - (np.abs(mesh.rest[:, 0]) - 0.235).clip(0) / 2
    )
    assert on_top.sum() > 10
    apart = np.min([body.distance(done.shapes[0, -1, on_top].astype(float)) for body in carrying], axis=0)
    assert np.median(apart) < 0.02


def test_the_collar_goes_round_the_neck_with_its_own_length():
    sewn = sewn_shirt(plain_shirt(0.2))[0]
    figure = figure_in_shirt(sewn, walk(0.1, arms_out=arms_out(sewn)))
    neck = figure.bodies[figure.names.index("neck")]
    radius = neck.radius + APART
    assert figure.half_side == pytest.approx(half_side(sewn, radius))
    way = np.linspace(0, collar_girth(sewn) / 2, 401)
    front, back = (collar_places(way, np.full(401, is_back), radius, figure.half_side) for is_back in (False, True))
    assert np.linalg.norm(np.diff(front, axis=0), axis=1).sum() == pytest.approx(collar_girth(sewn) / 2, rel=1e-3)
    assert front[[0, -1]] == pytest.approx(back[[0, -1]], abs=1e-9)
    assert np.linalg.norm(front[:, :2], axis=1).min() > neck.radius + CLEARANCE
    assert front[200] == pytest.approx([0.0, -radius, -DIP], abs=1e-9)
    assert back[200] == pytest.approx([0.0, radius, -DIP], abs=1e-9)


def test_the_collars_nodes_are_those_of_the_neck_in_order(put_on):
    sewn, _, mesh = put_on
    nodes, way = collar_nodes(sewn, mesh)
    left = np.argmin(way)
    assert mesh.rest[nodes[left]] == pytest.approx(neck_sides(sewn)[0, 0])
    middle = np.abs(way - collar_girth(sewn) / 4) < 0.03
    assert mesh.rest[nodes[middle], 1] == pytest.approx(-0.0594)
    assert way.max() == pytest.approx(collar_girth(sewn) / 2)


def test_a_swatch_is_still_refused():
    with pytest.raises(FitError, match="the figure wears skirts and T-shirts"):
        sewn_for_a_figure(sheet())

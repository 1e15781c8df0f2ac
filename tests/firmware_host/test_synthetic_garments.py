"""The synthetic T-shirt and swatch, their surroundings, and their visibility to the camera."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from firmware_host.synthetic.cloth import ClothPhysics, _Cloth, simulate
from firmware_host.synthetic.garments import GARMENTS, shirt
from firmware_host.synthetic.pattern import lay
from firmware_host.synthetic.scene import CAMERA, HANGER
from firmware_host.synthetic.surroundings import Panel, Surroundings
from formats.descriptions import check_garment
from formats.errors import HangtimeError
from tests.firmware_host.rooms import cluttered, plain
from tests.firmware_host.scenes import flat_world


@pytest.mark.parametrize("kind", GARMENTS)
def test_the_cells_cover_the_outline_and_weigh_what_the_garment_weighs(kind) -> None:
    garment = GARMENTS[kind]()
    check_garment(garment, kind)
    cloth = _Cloth(garment, ClothPhysics(), {}, 24, 17)
    # Every corner of these outlines is a node, so the cells cover it exactly.
    assert cloth.cell.sum() == pytest.approx(garment.area_m2, rel=1e-9)
    assert cloth.mass[cloth.is_node].sum() == pytest.approx(garment.mass_kg, rel=1e-9)


@pytest.mark.parametrize("kind", GARMENTS)
def test_a_tracked_point_lies_where_its_weights_put_it(kind) -> None:
    garment = GARMENTS[kind]()
    pattern = lay(garment, 24, 17)
    for point in garment.points:
        at, weights = pattern.material(point.at_m)
        np.testing.assert_allclose(weights @ pattern.rest[at[:, 0], at[:, 1], :2], point.at_m, atol=1e-9)
        assert weights.sum() == pytest.approx(1.0)


def test_the_shirts_centre_is_as_far_from_its_sleeves_as_from_its_hem() -> None:
    garment = shirt()
    *corners, centre = (np.array(p.at_m) for p in garment.points)
    # 0.36^2 + (d - 0.12)^2 = 0.23^2 + (0.58 - d)^2 gives d = 0.2453 / 0.92.
    np.testing.assert_allclose(centre, [0.0, -0.2453 / 0.92], atol=1e-12)
    np.testing.assert_allclose([np.linalg.norm(c - centre) for c in corners], 0.3887, atol=1e-4)


@pytest.mark.slow
def test_a_shirt_hangs_by_its_shoulders_with_its_sleeves_below_them() -> None:
    """The body is as long as on the flat garment: 35 N/m of weight a metre stretch 300 N/m by under 3 %."""
    times = np.arange(0.0, 0.2, 1 / 30)
    ends = np.array([[-0.2, -0.18, 1.6], [0.2, -0.18, 1.6]])
    nodes = simulate(
        shirt(), lambda t: np.broadcast_to(ends, (len(t), 2, 3)), times, physics=ClothPhysics(), effects={},
        rows=12, columns=7,
    )[-1]  # fmt: skip
    pattern = lay(shirt(), 12, 7)
    np.testing.assert_allclose(nodes[0, pattern.held][[0, -1]], ends, atol=1e-12)
    hem = nodes[-1, pattern.held]
    assert np.abs(hem[:, 1] - (0.58 - 0.18)).max() < 0.03 * 0.58
    tips = nodes[0, [0, -1]]
    assert (tips[:, 1] > -0.18 + 0.05).all()
    assert np.isfinite(nodes[pattern.is_node]).all()


def test_an_outline_that_cannot_be_made_is_refused() -> None:
    with pytest.raises(HangtimeError, match="cannot make a skirt with 10 corners"):
        lay(msgspec.structs.replace(shirt(), kind="skirt"), 24, 17)


def test_an_object_in_front_hides_the_points_behind_it_and_no_other() -> None:
    world = replace(flat_world(1), surroundings=plain(1.6))
    assert world.visible(0, world.renderer()).all()
    x, y, _ = world.points[0, 3]
    edges = (v * 1.3 / 1.6 for v in (x - 0.1, x + 0.05, y - 0.05, y + 0.1))
    covered = replace(world, in_front=((Panel(*edges, 1.3, 150.0),),))
    assert covered.visible(0, covered.renderer()).tolist() == [True, True, True, False, True]


def test_a_corner_folded_behind_the_cloth_is_hidden() -> None:
    world = replace(flat_world(1), surroundings=plain(1.6))
    nodes = world.nodes.copy()
    nodes[0, 4, 4] = nodes[0, 2, 2] + [0.0, 0.0, 0.02]  # the lower right corner, 20 mm behind the middle
    points = world.points.copy()
    points[0, 2] = nodes[0, 4, 4]
    folded = replace(world, nodes=nodes, points=points)
    assert folded.visible(0, folded.renderer()).tolist() == [True, True, False, True, True]


def test_a_point_outside_the_picture_is_not_visible() -> None:
    world = replace(flat_world(1), surroundings=plain(1.6))
    world.points[0, 2] = [1.0, 0.3, 1.6]
    assert not world.visible(0, world.renderer())[2]


def test_the_same_swing_at_another_distance_is_drawn_there() -> None:
    world = flat_world(2).at(2.5, seed=4, surroundings=cluttered(2.5, 4))
    assert world.hanger.origin[0, 2] == pytest.approx(2.5)
    depth, _ = world.frame(0, world.renderer())
    x, y, z = world.points[0, 4]
    patch = depth[round(CAMERA.fy * y / z + CAMERA.cy) - 5 :, round(CAMERA.fx * x / z + CAMERA.cx) - 5 :][:11, :11]
    # Quantised by 19 mm at 2.5 m with 10 mm of noise; the mean of 121 pixels, 9 alike, is good to 4 mm.
    assert patch[patch > 0].mean() == pytest.approx(2500, abs=15)
    assert HANGER.marker_distance_m == pytest.approx(np.linalg.norm(np.diff(world.hanger.markers[0], axis=0)))


def test_a_room_has_objects_behind_and_beside_and_a_floor() -> None:
    room = cluttered(1.6, 7)
    behind = [p for p in room.panels if p.left * p.right < 0 or max(abs(p.left), abs(p.right)) < 0.6]
    beside = [p for p in room.panels if min(abs(p.left), abs(p.right)) >= 0.6 and abs(p.z - 1.6) <= 0.3]
    assert behind
    assert len(beside) >= 2
    # The floor 1.1 m below the sensor: seen in the lowest row at 575.8 * 1.1 / 239.5 = 2.64 m.
    far = np.full((480, 640), 4.0)
    Surroundings(4.0, has_floor=True).draw(far, np.zeros((480, 640, 3)))
    assert far[-1, 0] == pytest.approx(575.8 * 1.1 / 239.5, rel=1e-6)

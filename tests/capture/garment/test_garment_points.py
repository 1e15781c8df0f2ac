"""Corners and centre of a skirt, a swatch and a T-shirt: located, reported hidden, or not found."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from capture.errors import UntrackableError
from capture.garment.corners import PanelCorners, ShirtCorners
from capture.garment.flat_garment import flat_garment
from capture.garment.occlusion import folded_away
from capture.garment.tracker import garment_tracker
from firmware_host.synthetic.garments import GARMENTS, shirt, swatch
from firmware_host.synthetic.scene import RIG
from firmware_host.synthetic.surroundings import Panel
from formats.descriptions import load_garment, load_rig
from formats.garment import TrackedPoint
from tests.capture.garment.garment_scenes import hung
from tests.firmware_host.rooms import cluttered

SKIRT_FIRST = ["skirt", *(pytest.param(kind, marks=pytest.mark.slow) for kind in GARMENTS if kind != "skirt")]


def seen(world, tracker=None, time=0.0):
    """Return a new tracker's result for a world's only frame."""
    depth, _ = world.frame(0, world.renderer())
    return (tracker or garment_tracker(world.garment, RIG)).track(depth, world.hanger.held[0], time)


def errors_mm(sight, world):
    return 1e3 * np.linalg.norm(sight.points - world.points[0], axis=1)


@pytest.mark.parametrize(
    ("distance", "most_mm", "kind"),
    [
        *((1.6, 13.0, kind) for kind in GARMENTS),
        (2.5, 35.0, "skirt"),
        *(pytest.param(2.5, 35.0, kind, marks=pytest.mark.slow) for kind in GARMENTS if kind != "skirt"),
        *(pytest.param(1.2, 9.0, kind, marks=pytest.mark.slow) for kind in GARMENTS),
    ],
)
def test_all_five_points_of_a_hanging_garment_are_placed_in_a_furnished_room(kind, distance, most_mm):
    """Of five points, the worst: three sd of a corner, 3, 4.5 and 12 mm at these distances (the depth's part)."""
    world = hung(kind, distance, surroundings=cluttered(distance, 6))
    sight = seen(world)
    assert sight.valid.all()
    assert not sight.hidden.any()
    assert errors_mm(sight, world).max() < most_mm


@pytest.mark.parametrize("kind", ["skirt", pytest.param("t-shirt", marks=pytest.mark.slow)])
def test_the_stated_deviation_is_the_scatter_of_the_noise(kind):
    """6 frames of other noise, 15 coordinates each; the camera's noise repeats over pixels, so within a factor."""
    scores = []
    for seed in range(6):
        world = hung(kind, 1.6, seed=seed)
        sight = seen(world)
        scores.append((sight.points - world.points[0]) / sight.sd)
    assert 0.5 < np.nanstd(scores) < 1.25


@pytest.mark.parametrize("kind", GARMENTS)
def test_a_corner_folded_behind_the_cloth_is_reported_as_hidden_and_not_guessed(kind):
    corner = np.array(GARMENTS[kind]().points[2].at_m)
    # The fold cuts 0.14 m off both sides: the corner comes to lie 0.1 m beyond it, behind the cloth.
    world = hung(kind, 1.6, fold=(corner - [0.14, 0.0], corner + np.array([0.0, 0.14])))
    assert world.visible(0, world.renderer()).tolist() == [True, True, False, True, True]
    sight = seen(world)
    assert sight.hidden.tolist() == [False, False, True, False, False]
    assert np.isnan(sight.points[2]).all()
    assert sight.valid[[0, 1, 3]].all()


@pytest.mark.parametrize("kind", GARMENTS)
def test_a_corner_behind_an_arm_is_reported_as_hidden(kind):
    world = hung(kind, 1.6)
    x, y, _ = world.points[0, 3] * (1.25 / 1.6)
    reaching = Panel(x - 0.6, x + 0.06, y - 0.06, y + 0.06, 1.25, 150.0)
    world = replace(world, in_front=((reaching,),) * 2)
    sight = seen(world)
    assert sight.hidden.tolist() == [False, False, False, True, False]
    assert sight.valid[:3].all()


@pytest.mark.parametrize(("kind", "inwards"), [("skirt", 0.06), ("swatch", 0.045)])
def test_a_corner_behind_an_arm_is_hidden_also_where_the_outline_has_its_corner_away_from_the_arm(kind, inwards):
    """The arm ends 30 mm above the corner: the outline turns there, 14 pixels and more from the arm."""
    world = hung(kind, 1.6)
    x, y, _ = world.points[0, 3] * (1.25 / 1.6)
    reaching = Panel(x - 0.6, x + inwards, y - 0.03, y + 0.06, 1.25, 150.0)
    assert seen(replace(world, in_front=((reaching,),) * 2)).hidden.tolist() == [False, False, False, True, False]


def test_an_object_beside_a_corner_that_covers_nothing_hides_nothing():
    world = hung("skirt", 1.6)
    x, y, _ = world.points[0, 3] * (1.25 / 1.6)
    beside = Panel(x - 0.6, x - 0.02, y - 0.06, y + 0.06, 1.25, 150.0)
    sight = seen(replace(world, in_front=((beside,),) * 2))
    assert sight.valid.all()


@pytest.mark.parametrize(("kind", "corner"), [("swatch", 2), ("skirt", 3), ("t-shirt", 2)])
def test_a_corner_that_the_outline_has_elsewhere_is_found_by_paths_along_the_cloth(kind, corner):
    """A strip of 60 x 16 pixels in touch with the corner: the outline's corner is 0.17 m away, the cloth's is not."""
    world = hung(kind, 1.6)
    depth, _ = world.frame(0, world.renderer())
    x, y, z = world.points[0, corner]
    column, row = round(319.5 + 575.8 * x / z), round(239.5 + 575.8 * y / z)
    outwards = slice(column - 4, column + 60) if x > 0 else slice(column - 60, column + 5)
    depth[row - 16 : row, outwards] = round(1e3 * z)
    sight = garment_tracker(world.garment, RIG).track(depth, world.hanger.held[0], 0.0)
    assert sight.valid[corner]
    apart = sight.points[corner] - world.points[0, corner]
    assert np.linalg.norm(apart) < 0.03
    assert (np.abs(apart) < 3.5 * sight.sd[corner]).all()


def test_furniture_behind_and_beside_is_not_mistaken_for_the_garment():
    for seed in range(4):
        world = hung("skirt", 2.5, surroundings=cluttered(2.5, seed), seed=seed)
        outline = seen(world).outline
        low, high = outline.min(0), outline.max(0)
        # 0.50 m by 0.45 m at 2.5 m are 115 by 104 pixels; ragged edges and the bar's ends add a few.
        assert high[0] - low[0] < 115 + 8
        assert high[1] - low[1] < 104 + 8


@pytest.mark.parametrize("kind", SKIRT_FIRST)
@pytest.mark.parametrize(("distance", "gap", "is_found"), [(1.6, 0.0, False), (1.6, 0.05, False), (2.5, 0.05, False),
                                                           (1.6, 0.1, True), (2.5, 0.15, True)])  # fmt: skip
def test_a_wall_right_behind_is_not_mistaken_for_the_garment(kind, distance, gap, is_found):
    """A wall up to 3 cm and six pixel noises behind is in one piece with it: 6 cm at 1.6 m, 10 to 12 cm at 2.5 m."""
    world = hung(kind, distance)
    depth, _ = world.frame(0, world.renderer())
    depth[(depth == 0) | (depth > 1e3 * (distance + 0.3))] = round(1e3 * (distance + gap))
    sight = garment_tracker(world.garment, RIG).track(depth, world.hanger.held[0], 0.0)
    assert sight.is_found == is_found
    assert sight.valid.tolist() == [is_found] * 5


def test_a_person_in_front_a_moment_long_loses_the_garment_and_nothing_else():
    world = hung("t-shirt", 2.0)
    person = replace(world, in_front=((Panel(-0.5, 0.5, -0.5, 1.0, 1.0, 120.0),),) * 2)
    tracker = garment_tracker(world.garment, RIG)
    assert seen(world, tracker, 0.0).valid.all()
    covered = seen(person, tracker, 0.033)
    assert not covered.is_found
    assert not covered.valid.any()
    assert seen(world, tracker, 0.067).valid.all()


@pytest.mark.parametrize("kind", GARMENTS)
def test_depth_that_is_all_missing_or_all_near_finds_nothing(kind):
    world = hung(kind, 1.6)
    held = world.hanger.held[0]
    tracker = garment_tracker(world.garment, RIG)
    for depth in (np.zeros((480, 640), np.uint16), np.full((480, 640), 420, np.uint16)):
        sight = tracker.track(depth, held, 0.0)
        assert not sight.is_found
        assert np.isnan(sight.points).all()


def test_a_hanger_out_of_the_picture_finds_nothing():
    world = hung("skirt", 1.6)
    depth, _ = world.frame(0, world.renderer())
    tracker = garment_tracker(world.garment, RIG)
    for shift in ([3.0, 0.0, 0.0], [0.0, -2.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 9.0], [0.0, 0.0, -1.55]):
        assert not tracker.track(depth, world.hanger.held[0] + shift, 0.0).is_found
    assert not tracker.track(depth, np.full((2, 3), np.nan), 0.0).is_found


def test_the_garment_file_chooses_where_the_top_corners_are():
    outline = np.array(shirt().outline_m)
    np.testing.assert_allclose(ShirtCorners().flat_corners(outline)[:2], [[-0.36, -0.12], [0.36, -0.12]])
    skirt = GARMENTS["skirt"]()
    outline = np.array(skirt.outline_m)
    np.testing.assert_allclose(PanelCorners().flat_corners(outline)[:2], [[-0.2, 0.0], [0.2, 0.0]])
    # A skirt's leftmost place is a corner of its hem, so its top corners are none of a T-shirt's.
    with pytest.raises(UntrackableError, match="'top_left' is neither one of the four corners"):
        garment_tracker(msgspec.structs.replace(skirt, kind="t-shirt"), RIG)


@pytest.mark.parametrize("kind", ["skirt", "swatch", "t-shirt"])
def test_a_centre_elsewhere_than_where_the_tracker_looks_for_it_is_refused_with_that_position(kind):
    """The skirt's middle at half its height is 25 mm above the position 0.320 m from each corner."""
    garment = GARMENTS[kind]()
    *corners, centre = garment.points
    garment_tracker(garment, RIG)
    for off, is_refused in ((0.007, False), (0.025, True)):
        at = (centre.at_m[0], centre.at_m[1] + off)
        wrong = msgspec.structs.replace(garment, points=(*corners, msgspec.structs.replace(centre, at_m=at)))
        if is_refused:
            with pytest.raises(
                UntrackableError, match=r"the point 'centre' is 2[45] mm beside .* at_m = \[.*\]; enter"
            ):
                garment_tracker(wrong, RIG)
        else:
            garment_tracker(wrong, RIG)


def test_a_centre_is_not_refused_where_another_position_is_as_far_from_the_corners():
    """On this uneven panel two positions are 0.394 m from three of its corners each, 26 mm apart."""
    outline = ((-0.349, 0.0), (0.349, 0.0), (0.339, -0.43), (-0.336, -0.39))
    places = [*zip(("a", "b", "c", "d"), outline, strict=True), ("centre", (0.0, -0.184))]
    points = tuple(TrackedPoint(name=name, at_m=at) for name, at in places)
    garment_tracker(msgspec.structs.replace(GARMENTS["skirt"](), outline_m=outline, points=points), RIG)


def test_the_garment_and_the_rig_in_the_text_on_files_can_be_copied(tmp_path):
    text = (Path(__file__).parents[3] / "docs/reference/file-formats.md").read_text()
    blocks = {
        block.split("/")[0]: block for block in re.findall(r'```toml\nformat = "hangtime-(.*?)```', text, re.DOTALL)
    }
    for name, block in blocks.items():
        (tmp_path / f"{name}.toml").write_text(f'format = "hangtime-{block}')
    garment, rig = load_garment(tmp_path / "garment.toml"), load_rig(tmp_path / "rig.toml")
    assert garment.point_names == GARMENTS["skirt"]().point_names
    *corners, centre = (np.array(point.at_m) for point in garment.points)
    assert [np.linalg.norm(corner - centre) for corner in corners] == pytest.approx([0.3202] * 4, abs=1e-4)
    garment_tracker(garment, rig)


def test_paths_along_the_flat_garment_are_as_long_as_by_hand():
    """A swatch's are straight; from a sleeve's tip to the hem the way turns at the underarm, 0.1393 + 0.41 m."""
    garment = swatch()
    corners = PanelCorners().flat_corners(np.array(garment.outline_m))
    found = flat_garment(garment, corners)
    wanted = np.linalg.norm(corners[:, None] - corners[None], axis=-1)
    np.testing.assert_allclose(found.distances, wanted, rtol=0.028, atol=1e-9)
    assert found.reach == pytest.approx(0.42)
    corners = ShirtCorners().flat_corners(np.array(shirt().outline_m))
    assert flat_garment(shirt(), corners).distances[1, 2] == pytest.approx(0.5493, rel=0.04)


def test_missing_cloth_is_blamed_on_the_corner_that_explains_all_of_it():
    side, diagonal = 0.40, 0.40 * np.sqrt(2)
    flat = np.array(
        [[0, side, diagonal, side], [side, 0, side, diagonal], [diagonal, side, 0, side], [side, diagonal, side, 0]]
    )
    nobody = np.zeros(4, bool)
    short = flat.copy()
    short[2, [0, 1, 3]] = short[[0, 1, 3], 2] = [diagonal - 0.1, side - 0.1, side - 0.1]
    folded, wrong = folded_away(short, flat, nobody)
    assert folded.tolist() == [False, False, True, False]
    assert not wrong.any()
    assert folded_away(flat * 0.985, flat, nobody)[0].tolist() == [False] * 4
    only_diagonal = flat.copy()
    only_diagonal[0, 2] = only_diagonal[2, 0] = diagonal - 0.1
    assert folded_away(only_diagonal, flat, np.array([True, False, False, False]))[0].tolist() == [
        False,
        False,
        True,
        False,
    ]
    far = flat.copy()
    far[3, :3] = far[:3, 3] = 1.4 * flat[3, :3]
    folded, wrong = folded_away(far, flat, nobody)
    assert not folded.any()
    assert wrong.tolist() == [False, False, False, True]

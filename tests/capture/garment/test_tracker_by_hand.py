"""Decisions of the silhouette tracker on given corners and windows."""

from __future__ import annotations

import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from capture.depth.surface import CorrelationMeter, pixel_sd
from capture.errors import UntrackableError
from capture.garment import tracker as module
from capture.garment.corners import HELD_LINE_SD
from capture.garment.folding import TRACES
from capture.garment.plausibility import MotionGate
from capture.garment.sight import frame_quality
from capture.garment.silhouette import Window
from capture.garment.slant import UPRIGHT
from capture.garment.tracker import CELL, REACH_FACTOR, SilhouetteTracker, garment_tracker
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import RIG
from tests.capture.garment.flat_cloth import LEFT, SQUARE, TOP, WHOLE, rectangle, silhouette

FLAT = np.array([[0.0, 0.4, 0.5, 0.3], [0.4, 0.0, 0.3, 0.5], [0.5, 0.3, 0.0, 0.4], [0.3, 0.5, 0.4, 0.0]])
HELD = np.array([[-0.2, 0.0, 1.6], [0.2, 0.0, 1.6]])
PLACES = np.array([[-0.2, 0.0, 1.6], [0.2, 0.0, 1.6], [0.2, 0.3, 1.6], [-0.2, 0.3, 1.6], [0.0, 0.15, 1.6]])
NONE = np.zeros(4, bool)


@pytest.fixture
def tracker():
    """Return a tracker of a panel of 0.4 m by 0.3 m, with a sensor of square pixels."""
    made = SilhouetteTracker(GARMENTS["swatch"](), RIG, CorrelationMeter())
    made.sensor = SQUARE
    made.flat = SimpleNamespace(distances=FLAT, reach=0.5, area=0.12, from_ends=FLAT[:2], roles=[0, 1, 2, 3, 4])
    made.held_corners = [0, 1, None, None]
    return made


def test_kinds_without_a_finder_and_rigs_without_a_sensor_are_refused():
    strange = msgspec.structs.replace(GARMENTS["swatch"](), kind="sock")
    with pytest.raises(UntrackableError, match="'sock' cannot be tracked") as refused:
        garment_tracker(strange, RIG)
    assert "skirt, swatch, t-shirt" in str(refused.value)
    with pytest.raises(UntrackableError, match="no sensor section"):
        garment_tracker(GARMENTS["swatch"](), msgspec.structs.replace(RIG, sensor=None))


@pytest.mark.parametrize("kind", ["skirt", "swatch", "t-shirt"])
def test_corners_of_a_panel_are_held_and_tips_of_sleeves_are_not(kind):
    found = SilhouetteTracker(GARMENTS[kind](), RIG, CorrelationMeter()).held_corners
    assert found == ([None] * 4 if kind == "t-shirt" else [0, 1, None, None])


def test_a_corner_is_off_by_the_second_worst_of_its_distances_beyond_a_fiftieth(tracker):
    """0.5 m seen as 0.53 is 0.02 beyond a tolerance of 0.01; 0.3 m as 0.32 is 0.014 beyond 0.006."""
    along = FLAT.copy()
    along[0, 2] = along[2, 0] = 0.53
    assert tracker._mismatch(PLACES, NONE, along) == pytest.approx(np.zeros(4))  # one distance accuses nobody
    along[0, 3] = along[3, 0] = 0.32
    assert tracker._mismatch(PLACES, NONE, along) == pytest.approx([0.014, 0, 0, 0])
    along[0, 1] = along[1, 0] = 0.37
    assert tracker._mismatch(PLACES, NONE, along) == pytest.approx([0.020, 0, 0, 0])
    assert tracker._mismatch(PLACES, NONE, 1.0199 * FLAT) == pytest.approx(np.zeros(4))


def test_a_corner_that_is_off_has_the_mismatch_of_its_error():
    """Of an error in any direction of the cloth, rms over directions: its part along one axis, 8 of 8 mm."""
    tracker = SilhouetteTracker(GARMENTS["swatch"](), RIG, CorrelationMeter())
    flat = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.4], [0.0, 0.4]])
    distances = np.linalg.norm(flat[:, None] - flat, axis=-1)
    tracker.flat = SimpleNamespace(distances=distances)
    found = []
    for angle in np.linspace(0, 2 * np.pi, 72, endpoint=False):
        moved = flat.copy()
        moved[2] += 0.08 * np.sqrt(2) * np.array([np.cos(angle), np.sin(angle)])
        along = np.linalg.norm(moved[:, None] - moved, axis=-1)
        along += np.sign(along - distances) * 0.02 * distances  # the tolerance used up
        found.append(tracker._mismatch(PLACES, NONE, along))
    assert np.sqrt(np.mean(np.square(found), axis=0)) == pytest.approx([0, 0, 0.08, 0], rel=0.05)


def test_held_points_and_points_without_a_position_have_no_mismatch(tracker):
    along = FLAT.copy()
    along[0, 1:] = along[1:, 0] = FLAT[0, 1:] + 0.03
    assert tracker._mismatch(PLACES, np.array([True, False, False, False]), along) == pytest.approx(np.zeros(4))
    assert tracker._mismatch(PLACES, NONE, along) == pytest.approx([0.022, 0, 0, 0])
    gone = PLACES.copy()
    gone[1:3] = np.nan
    assert tracker._mismatch(gone, NONE, along) == pytest.approx(np.zeros(4))
    along[0, 1:] = along[1:, 0] = np.inf
    assert tracker._mismatch(PLACES, NONE, along) == pytest.approx(np.zeros(4))


def test_a_corner_at_the_held_edges_end_is_held_and_one_elsewhere_is_taken_away(tracker):
    """Three centimetres; how far it is off becomes a part of its deviation (`test_held_scatter.py`)."""
    places, sd = PLACES.copy(), np.full((5, 3), 0.003)
    places[0] += [0.010, 0.0, -0.004]
    places[1] += [0.0, 0.031, 0.0]
    held = tracker._match_held(places, sd, HELD, 0.0)
    assert held.tolist() == [True, False, False, False]
    assert sd[0, 0] == pytest.approx(math.sqrt((3 * 0.003**2 + 0.010**2) / 4))
    assert np.isnan(places[1]).all()
    assert places[2:] == pytest.approx(PLACES[2:])
    assert (sd[1:] == 0.003).all()
    near = PLACES + np.array([0.0, 0.029, 0.0])
    assert tracker._match_held(near, sd, HELD, 1.0).tolist() == [True, True, False, False]
    missing = PLACES.copy()
    missing[0] = np.nan
    assert tracker._match_held(missing, sd, HELD, 2.0).tolist() == [False, True, False, False]


class FixedBelief:
    """A belief with given probabilities."""

    def __init__(self, *values):
        self.values = np.array(values)

    def update(self, found, time):
        return self.values


PIXELS = np.full((5, 2), 100.0)


@pytest.fixture
def hides(tracker, monkeypatch):
    """Return which corners are hidden if some end at a nearer object; record the missing cloth of each query."""
    lost = {}

    def go(*, nearer=(), belief=(0.0,) * 4, along=FLAT, places=PLACES, pixels=PIXELS, dropped=NONE):
        tracker._belief = FixedBelief(*belief)
        lost.clear()

        def ends_at(seen, place, amount):
            n = next(n for n in range(4) if np.allclose(place, PLACES[n]))
            lost[n] = amount
            return n in nearer

        monkeypatch.setattr(tracker, "_ends_at_a_nearer_thing", ends_at)
        return tracker._hidden(None, (480, 640), pixels, places, along, np.array(dropped), 0.0).tolist(), dict(lost)

    return go


def test_a_corner_is_hidden_by_belief_or_at_the_pictures_border(hides):
    assert hides()[0] == [False] * 4
    assert hides(belief=(0.99, 0.0, 0.99, 0.0))[0] == [True, False, True, False]
    at_border = PIXELS.copy()
    at_border[1] = [639.0, 100.0]
    assert hides(pixels=at_border)[0] == [False, True, False, False]
    assert 1 not in hides(pixels=at_border)[1]
    shorter = FLAT - 0.02 * (1 - np.eye(4))  # at the border, a corner says nothing about those behind it
    assert hides(pixels=at_border, nearer=(3,), along=shorter)[0] == [False, True, False, True]
    gone = PLACES.copy()
    gone[1] = np.nan
    assert hides(pixels=at_border, places=gone)[0] == [False] * 4


def test_beside_a_nearer_object_a_corner_is_hidden_that_misses_a_fortieth_of_its_longest_path(hides):
    """0.025 of 0.5 m are 12.5 mm."""
    for missing, is_hidden in ((0.013, True), (0.012, False)):
        along = FLAT.copy()
        along[0, 1] = along[1, 0] = 0.4 - missing
        found, lost = hides(nearer=(0,), along=along)
        assert found == [is_hidden, False, False, False]
        assert lost[0] == pytest.approx(missing)
        assert lost[2] == 0.0
        assert hides(along=along)[0] == [False] * 4
    assert hides(nearer=(0,), dropped=[True, False, False, False])[0] == [True, False, False, False]
    assert hides(nearer=(0,), belief=(0.99, 0, 0, 0))[0] == [False] * 4  # the thing tells that nothing is missing
    longer = FLAT.copy()
    longer[0, 1:], longer[1:, 0] = np.inf, 0.6
    assert hides(nearer=(0,), along=longer)[1][0] == 0.0


def test_a_corner_is_covered_where_the_cloth_next_to_it_ends_at_a_nearer_thing(tracker, monkeypatch):
    """Of corners that are 13, 13, 12 and 13 mm beyond the seen cloth; the last is at nothing."""
    beyond = SimpleNamespace(by_all=np.array([0.013, 0.013, 0.012, 0.013]), places=PLACES[:4])
    asked = []

    def ends_at(seen, place, lost):
        asked.append((place.tolist(), lost))
        return place[1] == 0.0

    monkeypatch.setattr(tracker, "_ends_at_a_nearer_thing", ends_at)
    assert tracker._covered(None, beyond).tolist() == [True, True, False, False]
    assert asked == [(PLACES[n].tolist(), 0.013) for n in (0, 1, 3)]


def test_an_occluder_is_nearer_than_lost_cloth_can_be(tracker, monkeypatch):
    """By a jump of 30 mm and six noises of a pixel, and by the lost cloth."""
    asked = []
    monkeypatch.setattr(module, "is_behind_something", lambda *given: asked.append(given[1:]) or True)
    assert tracker._ends_at_a_nearer_thing(None, PLACES[1], 0.05)
    ((pixel, z, jump),) = asked
    assert pixel == pytest.approx([319.5 + 0.2 * 500 / 1.6, 239.5])
    assert (z, jump) == (1.6, pytest.approx(0.03 + 6.0 * pixel_sd(1.6, 500.0) + 0.05))
    assert not tracker._ends_at_a_nearer_thing(None, np.full(3, np.nan), 0.05)
    assert len(asked) == 1


def test_the_window_is_where_the_garment_can_swing_to(tracker):
    """0.54 m of reach at 1.6 - 0.7 x 0.54 m are 220.9 px beside the ends and below; never nearer than 0.3 m."""
    pixels = REACH_FACTOR * 0.5 * 500 / (1.6 - 0.7 * REACH_FACTOR * 0.5)
    left, right = 319.5 - 62.5, 319.5 + 62.5
    window = tracker._window((480, 640), HELD, 1.6)
    assert window == Window(int(left - pixels), 237, int(right + pixels) + 1, int(239.5 + pixels) + 1)
    near = tracker._window((480, 640), HELD * [1, 1, 0.25], 0.4)
    assert near == Window(0, 237, 640, 480)
    tilted = HELD + np.array([[0.0, -0.1, 0.0], [0.0, 0.0, 0.0]])
    assert tracker._window((480, 640), tilted, 1.6).top == int(239.5 - 31.25) - 2
    assert tracker._window((480, 640), tilted, 1.6).bottom == int(239.5 + pixels) + 1


def test_the_last_window_grows_by_what_the_hem_may_move_for_a_fifth_of_a_second(tracker):
    """3 m/s at 1.6 m: 93.75 px in a tenth of a second, and 4 more."""
    widest = Window(50, 20, 600, 400)
    assert tracker._recent_window(widest, 1.6, 0.0) is None
    tracker._last = (1.0, Window(200, 100, 400, 300))
    assert tracker._recent_window(widest, 1.6, 1.1) == Window(200 - 97, 20, 400 + 97, 300 + 97)
    assert tracker._recent_window(widest, 1.6, 1.0) == Window(196, 20, 404, 304)
    assert tracker._recent_window(widest, 1.6, 1.19) == Window(50, 20, 582, 400)
    assert tracker._recent_window(widest, 1.6, 1.21) is None
    assert tracker._recent_window(Window(500, 20, 600, 400), 1.6, 1.0) is None


@pytest.mark.parametrize(
    ("held", "is_found"),
    [(HELD, True), (HELD * [1, 1, np.nan], False), (HELD * [1, 1, 0.0625], False), (HELD * [1, 1, 0.0626], False)],
)
def test_a_garment_is_sought_below_a_hanger_that_is_somewhere(tracker, held, is_found):
    depth = np.zeros((480, 640), np.uint16)
    depth[242:340, 260:380] = 1600
    assert (tracker._silhouette(depth, held, 0.0) is not None) == is_found


@pytest.mark.parametrize(("rows", "is_found"), [(24, False), (26, True), (150, True), (160, False)])
def test_a_piece_is_the_garment_by_its_area(tracker, rows, is_found):
    """120 columns of 3.2 mm; a quarter of 0.12 m^2 are 24.4 rows, and one and a half times as much 146.5.

    The rows that the sensor fills begin at 242; the silhouette may lose two at its rim.
    """
    depth = np.zeros((480, 640), np.uint16)
    depth[242 : 242 + rows, 260:380] = 1600
    found = tracker._silhouette(depth, HELD, 0.0)
    assert (found is not None) == (is_found and rows < 147)


def test_the_seen_surface_is_the_mean_of_its_cells(tracker):
    """28 mm at 1.6 m are 8.75 px, nine of them a cell; a cell less than two fifths full is none."""
    cloth = silhouette(WHOLE)
    surface, cell = tracker._surface(cloth)
    assert cell == round(CELL * 500 / 1.6) == 9
    assert surface.shape == (160 // 9, 200 // 9, 3)
    row, column = 5, 7
    u, v = LEFT + 7.5 * 9 - 0.5, TOP + 5.5 * 9 - 0.5
    assert surface[row, column] == pytest.approx([1.6 * (u - 319.5) / 500, 1.6 * (v - 239.5) / 500, 1.6], abs=1e-6)
    filled = np.isfinite(surface[..., 2])
    # Columns 18 to 26 hold seven of nine columns of cloth, columns 171 to 179 all nine.
    assert filled[5].tolist() == [False, False, *[True] * 18, False, False]
    assert filled[:, 7].tolist() == [False, False, *[True] * 13, True, False]
    assert surface[filled][:, 2] == pytest.approx(1.6, abs=1e-6)
    near = silhouette(WHOLE, depth=6.0)
    assert tracker._surface(near)[1] == 3


def test_the_centre_is_the_middle_of_its_cell(tracker, monkeypatch):
    monkeypatch.setattr(module, "farthest_place", lambda distances: distances)
    pixel, sd = tracker._centre(silhouette(WHOLE), (4.0, 6.5), 9)
    assert pixel == pytest.approx([LEFT + 7.0 * 9 - 0.5, TOP + 4.5 * 9 - 0.5])
    assert sd == pytest.approx(9 / 8 / math.sqrt(12))
    pixel, sd = tracker._centre(silhouette(WHOLE), None, 9)
    assert np.isnan(pixel).all()
    assert np.isnan(sd)


def test_paths_from_a_corner_without_a_position_are_unknown(tracker):
    surface, _ = tracker._surface(silhouette(rectangle(10, 10, 180, 140)))
    places = np.vstack([surface[2, 3], surface[2, 15], surface[12, 15], np.full((2, 3), np.nan)])
    _, along = tracker._ways_between(surface, places)
    assert np.isnan(along[3]).all()
    assert np.isnan(along[:, 3]).all()
    cell = 9 * 1.6 / 500
    assert along[:3, :3] == pytest.approx(
        cell * np.array([[0, 12, np.hypot(12, 10)], [12, 0, 10], [np.hypot(12, 10), 10, 0]]), rel=0.06
    )


def test_traces_look_at_the_outlines_corner_and_at_the_nearest_cloth(tracker, monkeypatch):
    """Areas by place; without a corner of the outline the nearest place speaks for both."""
    given, asked = {}, []

    def area(seen, at, missing, held, ways, sensor):
        asked.append((missing, ways.tolist()))
        return float(at[0])

    monkeypatch.setattr(module, "peeking_area", area)
    monkeypatch.setattr(module, "rim_slant", lambda seen, pixel, z, sensor: ("slant", pixel.tolist(), z))
    monkeypatch.setattr(
        module, "traces", lambda *args, is_tip: given.update(args=args, is_tip=is_tip) or np.zeros(len(TRACES))
    )
    tracker.finder = SimpleNamespace(tips=(1,))
    beyond = SimpleNamespace(
        by_all=np.array([0.1, 0.2, 0.3, 0.4]), by_ends=np.array([0.01, 0.02, 0.03, 0.04]), places=PLACES[:4].copy(),
        pixels=np.array([[5.0, 0], [6, 0], [7, 0], [np.nan, np.nan]]),
    )  # fmt: skip
    tracker._traces(None, 1, np.array([50.0, 0]), beyond, HELD)
    assert given["args"] == (0.02, 50.0, 6.0, ("slant", [382.0, 239.5], 1.6))
    assert given["is_tip"]
    assert asked == [(0.2, FLAT[:2, 1].tolist())] * 2
    tracker._traces(None, 2, np.full(2, np.nan), beyond, HELD)
    assert given["args"][:3] == (0.03, 7.0, 7.0)
    assert not given["is_tip"]
    beyond.places[3] = np.nan
    del asked[:]
    tracker._traces(None, 3, np.array([50.0, 0]), beyond, HELD)
    assert given["args"] == (0.04, 50.0, 0.0, UPRIGHT)
    assert len(asked) == 1
    tracker._traces(None, 3, np.full(2, np.nan), beyond, HELD)
    assert given["args"][:3] == (0.04, 0.0, 0.0)


def test_points_are_admitted_each_by_its_own_step():
    """Of three points one jumps by 0.5 m and one continues at 1.5 m/s along all axes."""
    gate, period = MotionGate(3), 1 / 30
    sd = np.full((3, 3), 0.002)
    for k in range(4):
        places = np.array([[0.0, 0, 1.6], [0.05 * k, 0.05 * k, 1.6 + 0.05 * k], [0.3, 0.3, 1.6]])
        places[2] += 0.5 * (k == 3)
        valid, found = gate.admit(places, sd, k * period)
    assert valid.tolist() == [True, True, False]
    assert (found == 0.002).all()


def test_a_weak_detection_needs_a_settled_track():
    """The second of two points is weak in every frame; it counts only where its motion was followed before."""
    gate, sd = MotionGate(2), np.full((2, 3), 0.002)
    places = np.tile([0.0, 0.0, 1.6], (2, 1))
    gone = places.copy()
    gone[1] = np.nan
    weak = np.array([False, True])
    frames = [(places, None), (places, weak), (gone, None), (places, weak), (places, None), (places, weak),
              (places, None), (places, weak)]  # fmt: skip
    valid = [gate.admit(p.copy(), sd, k / 30, w)[0].tolist() for k, (p, w) in enumerate(frames)]
    assert [one for one, _ in valid] == [True] * len(frames)
    assert [two for _, two in valid] == [True, True, False, False, True, False, True, False]


def test_the_quality_of_a_frame_is_the_share_of_its_points_times_that_of_its_depth():
    """Of four points one is unseen, one known to 16 mm and two to 8 mm or better: (0.5 + 1 + 1) / 4 x 0.8."""
    sd = np.array([[np.nan, 0, 0], [0, 0, 0.016], [0, 0.008, 0], [0.001, 0, 0]])
    assert frame_quality(np.arange(4) > 0, sd, 0.8) == pytest.approx(0.5)


def test_the_centre_is_as_uncertain_as_the_distances_between_the_corners_are_wrong(tracker, monkeypatch):
    """Each of the twelve distances 9 mm too long: 0.3 x 9 mm x 500 / 1.6 m = 0.844 px, beside 0.5 px of its cell."""
    asked = []

    def place(pixel, sd):
        asked.append(np.asarray(sd).tolist())
        return PLACES[(len(asked) - 1) % 5], np.full(3, 0.002)

    along = FLAT + 0.009 * (1 - np.eye(4))
    monkeypatch.setattr(module, "Placer", lambda *given: SimpleNamespace(place=place))
    monkeypatch.setattr(module, "folded_away", lambda *given: (NONE, NONE))
    monkeypatch.setattr(tracker, "_ways_between", lambda surface, places: (None, along))
    monkeypatch.setattr(tracker, "_hidden", lambda *given: NONE)
    monkeypatch.setattr(tracker, "_centre", lambda *given: (np.array([319.5, 280.0]), 0.5))
    view = SimpleNamespace(pixels=np.full((4, 2), 300.0), sd=np.full((4, 2), 0.4))
    given = []
    tracker.finder = SimpleNamespace(find=lambda *words: given.append(words) or view)
    tracker.flat.sides = np.array([0.4, 0.3, 0.4, 0.3])
    depth = np.zeros((480, 640), np.uint16)
    depth[242:340, 260:380] = 1600
    sight = tracker.track(depth, HELD, 0.0)
    assert len(asked) == 5
    assert asked[4] == pytest.approx([math.hypot(0.5, 0.3 * 0.009 * 500 / 1.6)] * 2)
    # 9 mm are 1, 3 and -1 mm beyond a fiftieth of 0.4, 0.3 and 0.5 m; the second largest adds to free corners.
    assert sight.sd[2:4] == pytest.approx(np.array([[math.hypot(0.002, 0.0004)] * 2 + [math.hypot(0.002, 0.001)]] * 2))
    assert [*sight.sd[:2, 1], sight.sd[4, 0]] == pytest.approx([0.002] * 3)
    tracker.track(depth, HELD * [[1, 1, 0.9875], [1, 1, 1.0125]], 0.0, np.array([[3e-4, 4e-4, 9.0], [6e-4, 8e-4, 9.0]]))
    (_, held, sides, across), other = given
    assert across == HELD_LINE_SD
    assert other[3] == pytest.approx(math.sqrt((3**2 + 4**2 + 6**2 + 8**2) / 4) * 1e-4 * 500 / 1.6)
    assert [*other[2], *asked[9]] == pytest.approx([*sides, *asked[4]])  # a slanted bar is 1.6 m away in the middle
    assert held == pytest.approx(np.array([[257.0, 239.5], [382.0, 239.5]]))  # 0.2 m are 62.5 px at 1.6 m
    assert sides == pytest.approx(tracker.flat.sides * 500 / 1.6)

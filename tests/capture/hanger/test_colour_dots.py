"""Coloured dots: found automatically or from picks; their positions agree with drawn scenes of known truth."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from capture.errors import NoMarkersError, UntrackableError
from capture.hanger.choice import hanger_tracker
from capture.hanger.colour_dots import DotTracker, dot_near
from capture.hanger.fiducial_tracker import MarkerTracker
from capture.recording.session import record
from firmware_host.oni_writer import OniWriter
from formats.archive import read_take
from formats.command import app, gather_commands
from formats.descriptions import dump_description, load_rig
from formats.errors import DescriptionError
from formats.rig import Hanger, Rig
from tests import openni2
from tests.capture.recording.test_conditions import GARMENT
from tests.capture.stage import CAMERA, StageSensor, dot_plate, marker_plate, pictures, plain_plate

DIAMETER = 0.03
HANGER = Hanger(
    marker="dot", marker_size_m=DIAMETER, marker_distance_m=0.3, held_m=((-0.2, 0.09, 0.0), (0.2, 0.09, 0.0))
)
RIG = Rig(format="hangtime-rig/1", name="dots", gravity=(0.0, 1.0, 0.0), hanger=HANGER, sensor=CAMERA)
BESIDE = np.array([[2, -1], [-2, 2]])  # px, of a hand that picks
MOVED = np.array([-0.2, 0.1, -0.1])
RED, GREEN, BLUE, ORANGE = (190, 40, 45), (30, 140, 70), (40, 70, 170), (220, 120, 30)
SIDES = np.array([[-0.15, 0.0, 0.0], [0.15, 0.0, 0.0]])
MIDDLE = np.array([0.05, -0.2, 1.6])


def dots(middle=MIDDLE, colours=(RED, GREEN)):
    return [dot_plate(middle + side, DIAMETER, colour) for side, colour in zip(SIDES, colours, strict=True)]


def swing(k, rate=30.0):
    """0.8 Hz to and fro by 9 cm and sideways by 4 cm: up to 0.5 m/s."""
    return MIDDLE + np.array([0.04, 0.0, 0.09]) * np.sin(2 * np.pi * 0.8 * k / rate)


@cache
def swung(colours, exposure=0.008, frames=12, late=0.0):
    """Return images of swung dots, averaged over an exposure [s], and true centres [m], (frames, 2, 3).

    late [s]: delay of colour after depth
    """
    rng = np.random.default_rng(11)
    shown, truth = [], []
    for k in range(frames):
        instants = [dots(swing(k + 30 * (late + exposure * part)), colours) for part in (-0.5, -0.25, 0.0, 0.25, 0.5)]
        towel = plain_plate(swing(k) + np.array([0, 0.29, 0]), (0.4, 0.4), (60, 70, 150))
        shown.append(pictures([*dots(swing(k), colours), towel], rng, exposures=[[*i, towel] for i in instants]))
        truth.append(swing(k) + SIDES)
    return shown, np.array(truth)


@pytest.mark.parametrize(
    "colours",
    [
        pytest.param((RED, GREEN), id="two colours", marks=pytest.mark.slow),
        pytest.param((ORANGE, ORANGE), id="one colour"),
    ],
)
def test_swung_dots_are_found_by_themselves_and_placed_to_three_millimetres(colours):
    """A dot of 30 mm is 11 px; the depth of its 60 inner pixels has 2 mm of deviation."""
    shown, truth = swung(colours)
    tracker = hanger_tracker(RIG)
    sights = [tracker.track(colour, depth, k / 30) for k, (depth, colour) in enumerate(shown)]
    assert all(sight.is_found for sight in sights)
    off = np.array([sight.positions for sight in sights]) - truth
    assert np.sqrt((off[..., :2] ** 2).mean()) < 1e-3
    assert np.sqrt((off[..., 2] ** 2).mean()) < 3e-3
    # The deviations that the take will carry are of the size of the errors.
    ratio = np.sqrt((off[..., 2] ** 2).mean() / (np.array([s.sd for s in sights])[..., 2] ** 2).mean())
    assert 0.4 < ratio < 1.6


def test_dots_are_placed_at_the_instant_of_the_depth_also_where_colour_is_not():
    """Colour 14 ms late shows dots at 0.2 m/s sideways 2 mm away, root mean square."""
    shown, truth = swung((ORANGE, ORANGE), frames=8, late=0.014)

    def error(late):
        tracker = hanger_tracker(RIG)
        sights = [tracker.track(colour, depth, k / 30, late) for k, (depth, colour) in enumerate(shown)]
        off = (np.array([sight.positions for sight in sights]) - truth)[1:]  # the first frame knows no velocity
        return np.sqrt((off[..., 0] ** 2).mean())

    assert error(0.014) < 6e-4
    assert error(0.0) > 1.2e-3


def test_a_take_is_recorded_with_dots_as_with_fiducials(tmp_path):
    shown, _ = swung((ORANGE, ORANGE))
    record(StageSensor(shown), RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")
    take = read_take(tmp_path / "t.mcap")
    assert take.held_valid.all()
    assert (take.state == 0).all()
    assert take.rig.hanger.marker == "dot"


def view(*plates, seed=12):
    return pictures(list(plates), np.random.default_rng(seed))


def test_two_pairs_are_no_answer_until_one_is_picked_or_its_colours_are_known():
    other = [
        dot_plate(np.array([0.05, 0.2, 1.6]) + side, DIAMETER, c) for side, c in zip(SIDES, (BLUE, ORANGE), strict=True)
    ]
    depth, colour = view(*dots(), *other)
    assert not DotTracker(RIG).track(colour, depth, 0.0).is_found
    truth = MIDDLE + SIDES
    pixels = truth[:, :2] / truth[:, 2:] * CAMERA.fx + [CAMERA.cx, CAMERA.cy]
    picked = DotTracker(RIG, np.rint(pixels) + BESIDE).track(colour, depth, 0.0)
    assert picked.centres == pytest.approx(pixels, abs=0.25)
    known = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, dot_colours=(RED, GREEN)))
    assert DotTracker(known).track(colour, depth, 0.0).centres == pytest.approx(pixels, abs=0.25)
    wrong = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, dot_colours=(GREEN, RED)))
    assert not DotTracker(wrong).track(colour, depth, 0.0).is_found


def test_objects_of_the_same_colour_but_another_size_are_no_dots():
    depth, colour = view(*dots(), plain_plate([-0.3, 0.1, 1.5], (0.3, 0.2), RED), plain_plate(
        [0.3, 0.1, 1.5], (0.012, 0.012), GREEN
    ))  # fmt: skip
    sight = DotTracker(RIG).track(colour, depth, 0.0)
    assert sight.positions == pytest.approx(MIDDLE + SIDES, abs=8e-3)


def test_specks_of_a_dots_colour_above_it_hide_no_dot():
    """Components are numbered from the top: specks of 3 x 3 px come first and are too small."""
    depth, colour = view(*dots())
    for left, tone in zip((4, 14), (RED, GREEN), strict=True):
        colour[2:5, left : left + 3] = tone
    assert DotTracker(RIG).track(colour, depth, 0.0).positions == pytest.approx(MIDDLE + SIDES, abs=8e-3)


def test_a_dot_that_is_partly_covered_is_marked_and_not_guessed():
    """A finger over 45 % of the left dot: its visible part's middle would be 3 mm off."""
    tracker = DotTracker(RIG)
    depth, colour = view(*dots())
    assert tracker.track(colour, depth, 0.0).is_found
    finger = plain_plate(MIDDLE + SIDES[0] + [-0.0165, 0.0, -0.03], (0.03, 0.06), (205, 160, 140))
    depth, colour = view(*dots(), finger)
    assert tracker.track(colour, depth, 1 / 30).valid.tolist() == [False, True]
    depth, colour = view(*dots())
    assert tracker.track(colour, depth, 2 / 30).is_found


def test_of_two_dots_of_one_colour_the_hidden_one_is_not_mistaken_for_the_other():
    """The left dot is covered for a third of a second; half a second later both are placed again."""
    tracker = DotTracker(RIG)
    hand = plain_plate(MIDDLE + SIDES[0] + [0.0, 0.0, -0.05], (0.08, 0.08), (205, 160, 140))
    open_view, covered = view(*dots(colours=(ORANGE, ORANGE))), view(*dots(colours=(ORANGE, ORANGE)), hand)
    found = []
    for k in range(30):
        depth, colour = covered if 5 <= k < 15 else open_view
        found.append(tracker.track(colour, depth, k / 30).valid.tolist())
    assert found[:5] == [[True, True]] * 5
    assert found[5:15] == [[False, True]] * 10
    assert found[15:] == [[True, True]] * 15


def test_a_recording_without_dots_gets_advice_about_dots(tmp_path):
    with pytest.raises(NoMarkersError, match=r"the rig says two dots of 30 mm, 300 mm apart"):
        record(StageSensor([view()[:]] * 3), RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")


def test_after_a_second_out_of_view_dots_are_found_again_the_right_way_round():
    tracker = DotTracker(RIG)
    depth, colour = view(*dots())
    tracker.track(colour, depth, 0.0)
    nothing = view()
    assert not tracker.track(nothing[1], nothing[0], 0.5).valid.any()
    depth, colour = view(*dots(MIDDLE + MOVED))
    sight = tracker.track(colour, depth, 1.0)
    assert sight.positions == pytest.approx(MIDDLE + MOVED + SIDES, abs=8e-3)


def test_the_share_of_mixed_pixels_gives_area_and_centre_by_hand():
    """Six columns of 6 px, of the first one half of each pixel: area 33, and the mean moves to the right."""
    picture = np.full((40, 40, 3), 200, np.uint8)
    picture[10:16, 10:16] = (200, 0, 0)
    picture[10:16, 10] = (200, 100, 100)
    dot = dot_near(picture, np.array([12.0, 12.0]), 12.0, 6.0, np.array([200.0, 0.0, 0.0]))
    assert dot.diameter == pytest.approx(np.sqrt(4 * 33 / np.pi))
    assert dot.centre == pytest.approx([(3 * 10 + 6 * (11 + 12 + 13 + 14 + 15)) / 33, 12.5])


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ((700.0, 20.0), "lies outside the picture; pick within its 640 x 480"),
        ((50.0, 400.0), "there is no dot of 30 mm"),
    ],
)
def test_a_pick_beside_a_dot_is_refused_in_a_sentence(place, sentence):
    depth, colour = view(*dots())
    with pytest.raises(UntrackableError, match=sentence):
        DotTracker(RIG, np.array([place, place])).track(colour, depth, 0.0)


def test_the_rig_file_says_which_markers_a_hanger_has(tmp_path):
    path = tmp_path / "rig.toml"
    rig = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, dot_colours=(RED, GREEN)))
    path.write_text(dump_description(rig))
    assert load_rig(path) == rig
    assert isinstance(hanger_tracker(load_rig(path)), DotTracker)
    fiducials = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, marker="fiducial"))
    assert isinstance(hanger_tracker(fiducials), MarkerTracker)
    with pytest.raises(UntrackableError, match="found automatically"):
        hanger_tracker(fiducials, np.zeros((2, 2)))
    path.write_text(dump_description(rig).replace("190", "290"))
    with pytest.raises(DescriptionError, match="dot_colours must be three numbers from 0 to 255"):
        load_rig(path)


def test_apriltags_are_found_like_aruco_markers():
    tags = msgspec.structs.replace(HANGER, marker="fiducial", dictionary="DICT_APRILTAG_36h11", marker_size_m=0.06)
    plates = [marker_plate(k, MIDDLE + SIDES[k], dictionary="DICT_APRILTAG_36h11") for k in range(2)]
    depth, colour = view(*plates)
    sight = MarkerTracker(msgspec.structs.replace(RIG, hanger=tags)).track(colour, depth, 0.0)
    assert sight.positions == pytest.approx(MIDDLE + SIDES, abs=5e-3)


@pytest.mark.openni
def test_pick_takes_two_pairs_of_numbers_on_the_command_line(tmp_path):
    if not openni2.is_available():
        pytest.skip("libopenni2 is not installed (apt-get install libopenni2-0)")
    shown, truth = swung((ORANGE, ORANGE))
    with OniWriter(tmp_path / "a.oni", CAMERA, depth_codec="NONE") as writer:
        for number, (depth, colour) in enumerate(shown):
            writer.write_depth(1000 + 33_333 * number, depth)
            writer.write_colour(2000 + 33_333 * number, colour)
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    (tmp_path / "garment.toml").write_text(dump_description(GARMENT))
    files = {"sensor": "a.oni", "rig": "rig.toml", "garment": "garment.toml", "out": "a.mcap"}
    pixels = np.rint(truth[0, :, :2] / truth[0, :, 2:] * CAMERA.fx + [CAMERA.cx, CAMERA.cy]).astype(int)
    gather_commands()
    words = [f"--{name}={tmp_path / file}" for name, file in files.items()]
    done = CliRunner().invoke(app, ["record", *words, "--pick", *(f"{x},{y}" for x, y in pixels)])
    assert "the take has 12 frames, and a fit needs 20" in str(done.exception), done.output
    assert "hanger seen in 100 %" in done.stdout
    missed = CliRunner().invoke(app, ["record", *words, "--overwrite", "--pick", "30,400", "600,400"])
    assert "--pick 30,400: there is no dot of 30 mm" in str(missed.exception)

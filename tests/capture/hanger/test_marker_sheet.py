"""The printed page of markers: OpenCV detects the requested ids at the requested size."""

from __future__ import annotations

from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from capture.errors import UntrackableError
from capture.hanger.marker_sheet import PAGE, draw_sheet, write_sheet
from formats.errors import OutputError
from tests.fit.here import hangtime_here

PER_MM = 6  # pixels
SVG = "{http://www.w3.org/2000/svg}"


def drawn(page):
    """The page's rectangles as an image, later ones over earlier ones."""
    image = np.full((round(PAGE[1] * PER_MM), round(PAGE[0] * PER_MM)), 255, np.uint8)

    def paint(element, fill):
        fill = element.get("fill", fill)
        if element.tag == SVG + "rect" and element.get("x") is not None:
            left, top, width, height = (float(element.get(k)) for k in ("x", "y", "width", "height"))
            rows = slice(round(top * PER_MM), round((top + height) * PER_MM))
            image[rows, round(left * PER_MM) : round((left + width) * PER_MM)] = 0 if fill == "#000" else 255
        for inner in element:
            paint(inner, fill)

    paint(ElementTree.fromstring(page), "#000")
    return image


@pytest.mark.parametrize(("dictionary", "ids"), [("DICT_4X4_50", [0, 1]), ("DICT_6X6_250", [7, 200, 31])])
def test_every_marker_is_found_on_the_page_at_its_size(dictionary, ids):
    """60 mm from black edge to black edge, within a pixel of a sixth of a millimetre."""
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary)))
    corners, found, _ = detector.detectMarkers(drawn(draw_sheet(dictionary, ids, 0.06)))
    assert sorted(found.ravel().tolist()) == sorted(ids)
    for corner in corners:
        sides = np.linalg.norm(corner[0] - np.roll(corner[0], 1, axis=0), axis=1) / PER_MM
        assert sides == pytest.approx(np.full(4, 60.0), abs=0.4)


def test_every_line_and_every_background_of_the_page_is_visible_and_named_in_svg():
    """Black lines of a quarter of a millimetre, a white page, white bits, and labels in letters of 3.6 mm."""
    page = ElementTree.fromstring(draw_sheet("DICT_4X4_50", [0, 1], 0.05))
    lines = [(line.get("stroke"), line.get("stroke-width")) for line in page.iter(SVG + "line")]
    assert lines == [("#000", "0.25")] * 6
    assert page[0].attrib == {"width": "100%", "height": "100%", "fill": "#fff"}
    groups = [dict(group.attrib) for group in page.iter(SVG + "g")]
    assert groups == [{"fill": "#fff", "shape-rendering": "crispEdges"}] * 2
    texts = list(page.iter(SVG + "text"))
    assert {(text.get("font-family"), text.get("font-size")) for text in texts} == {("sans-serif", "3.6")}
    assert [text.text for text in texts[:2]] == ["id 0, upright as printed", "id 1, upright as printed"]


def markers_that_fit(size):
    """The largest number of markers of this size [m] that one page holds."""
    for count in range(1, 60):
        try:
            draw_sheet("DICT_4X4_100", list(range(count)), size)
        except UntrackableError:
            return count - 1
    return 59


@pytest.mark.parametrize("size_mm", [*range(26, 125, 3), 60, 91])
def test_a_page_holds_whole_rows_of_markers_between_its_margins_and_is_full(size_mm):
    """Printers leave 15 mm; the scale bars take 8 mm at the right and 12 mm at the bottom, and 12 mm part markers."""
    step = size_mm * (1 + 2 / 6) + 12
    across, down = (1 + int((free - (step - 12)) / step) for free in (210 - 30 - 8, 297 - 30 - 12))
    assert markers_that_fit(size_mm / 1e3) == across * down
    page = ElementTree.fromstring(draw_sheet("DICT_4X4_100", list(range(across * down)), size_mm / 1e3))
    squares = [one for one in page.iter(SVG + "rect") if one.get("x") is not None]
    for edge, extent, last in (("x", "width", 210 - 15 - 8), ("y", "height", 297 - 15 - 12)):
        assert min(float(one.get(edge)) for one in squares) == pytest.approx(15.0)
        assert max(float(one.get(edge)) + float(one.get(extent)) for one in squares) <= last + 1e-3


def test_both_scale_bars_are_a_hundred_millimetres_between_ticks_of_four():
    lines = ElementTree.fromstring(draw_sheet("DICT_4X4_50", [0, 1], 0.05)).iter(SVG + "line")
    lengths = [
        abs(float(x.get("x2")) - float(x.get("x1"))) + abs(float(x.get("y2")) - float(x.get("y1"))) for x in lines
    ]
    assert sorted(lengths) == [4.0, 4.0, 4.0, 4.0, 100.0, 100.0]


def test_both_scale_bars_end_in_the_lower_corners_between_the_margins():
    """Printers leave 15 mm of A4, 210 x 297 mm; a tick of 4 mm reaches 2 mm to either side of its bar."""
    lines = ElementTree.fromstring(draw_sheet("DICT_4X4_50", [0, 1], 0.05)).iter(SVG + "line")
    ends = [tuple(float(line.get(name)) for name in ("x1", "y1", "x2", "y2")) for line in lines]
    assert ends == [
        (15, 282, 115, 282), (15, 280, 15, 284), (115, 280, 115, 284),
        (195, 182, 195, 282), (193, 182, 197, 182), (193, 282, 197, 282),
    ]  # fmt: skip


def test_a_marker_is_a_dashed_quiet_zone_a_black_square_white_bits_and_a_label():
    """Marker 0 of 4 x 4 bits is B5 32 in hexadecimal, row by row. A bit of 60 mm in six is 10 mm; margins are 15 mm."""
    page = list(ElementTree.fromstring(draw_sheet("DICT_4X4_50", [0, 1], 0.06)))
    zone, black, white, label = page[1:5]

    def box(one):
        return [float(one.get(name)) for name in ("x", "y", "width", "height")]

    looks = {name: zone.get(name) for name in ("fill", "stroke", "stroke-width", "stroke-dasharray")}
    assert looks == {"fill": "#fff", "stroke": "#bbb", "stroke-width": "0.2", "stroke-dasharray": "2 2"}
    assert (box(zone), box(black)) == ([15, 15, 80, 80], [25, 25, 60, 60])
    assert black.get("fill") == "#000"
    bits = f"{0xB532:016b}"
    wanted = [[35 + 10 * (k % 4), 35 + 10 * (k // 4), 10, 10] for k in range(16) if bits[k] == "1"]
    assert [box(one) for one in white] == wanted
    assert (label.get("x"), label.get("y")) == ("25.0000", "104.0000")  # 4 mm below the middle of the lower zone
    second = page[6]
    assert box(second) == [25 + 60 + 20 + 12, 25, 60, 60]  # two quiet zones and 12 mm to the right


def test_the_notes_stand_above_the_lower_bar_at_the_margin():
    """The last one is 6 mm above the bar, which is at 282 mm, and the first one 5 mm above that."""
    notes = list(ElementTree.fromstring(draw_sheet("DICT_4X4_50", [0, 1], 0.06)).iter(SVG + "text"))[2:]
    assert [(note.get("x"), note.get("y")) for note in notes] == [("15", "271"), ("15", "276")]
    assert [note.text for note in notes] == [
        "DICT_4X4_50, 60 mm from black edge to black edge.",
        "Print at 100 %, not fitted to the page; both bars must measure 100 mm.",
    ]


def test_a_refused_id_names_the_option_and_the_ids_that_are_there():
    with pytest.raises(UntrackableError) as refused:
        draw_sheet("DICT_4X4_50", [0, 50], 0.05)
    assert str(refused.value) == "--ids: there is no marker 50 in DICT_4X4_50; use ids from 0 to 49"


@pytest.mark.parametrize(
    ("ids", "size", "sentence"),
    [
        ([0, 50], 0.05, "there is no marker 50 in DICT_4X4_50"),
        ([3, 3], 0.05, "the same id is asked for twice"),
        ([0, 1, 2, 3, 4], 0.12, "5 markers of 120 mm do not fit"),
        ([0], 0.0, "--size: 0 m is no size of a marker"),
        ([0], -0.05, "--size: -0.05 m is no size of a marker"),
        ([0], float("nan"), "--size: nan m is no size of a marker"),
        ([0], float("inf"), "--size: inf m is no size of a marker"),
    ],
)
def test_a_page_that_cannot_be_made_says_why(ids, size, sentence):
    with pytest.raises(UntrackableError, match=sentence):
        draw_sheet("DICT_4X4_50", ids, size)


def test_only_svg_is_written(tmp_path):
    with pytest.raises(OutputError, match="written as SVG"):
        write_sheet(tmp_path / "markers.png", "DICT_4X4_50", [0, 1], 0.05)


def test_the_command_draws_the_markers_of_the_dictionary_at_the_size_that_is_asked_for(tmp_path):
    words = ["--dictionary", "DICT_6X6_250", "--ids", "7,200", "--size", "0.08", "--out", "m.svg"]
    assert hangtime_here("markers", "print", *words, folder=tmp_path).returncode == 0
    assert (tmp_path / "m.svg").read_text() == draw_sheet("DICT_6X6_250", [7, 200], 0.08)


@pytest.mark.parametrize(
    ("size", "says"),
    [
        ("0.00006", "(got 6e-05); give metres, as in --size 0.06, or --anyway to accept it"),
        ("60", "(got 60); were millimetres meant? Give metres, as in --size 0.06, or --anyway to accept it"),
    ],
)
def test_the_command_prints_no_marker_that_a_rig_may_not_have(tmp_path, size, says):
    words = ["markers", "print", "--size", size, "--out", "m.svg"]
    done = hangtime_here(*words, folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr == f"hangtime: --size: a hanger's marker has 0.005 to 0.5 m {says}\n"
    assert list(tmp_path.iterdir()) == []
    assert hangtime_here(*words, "--anyway", folder=tmp_path).returncode == (0 if float(size) < 1 else 2)


def test_the_command_writes_the_rigs_markers(tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text(
        'format = "hangtime-rig/1"\nname = "bench"\ngravity = [0.0, 1.0, 0.0]\n\n'
        '[hanger]\ndictionary = "DICT_5X5_100"\n'
        "ids = [4, 9]\nmarker_size_m = 0.04\nmarker_distance_m = 0.3\n"
        "held_m = [[-0.2, 0.05, 0.0], [0.2, 0.05, 0.0]]\n"
    )
    words = ["markers", "print", "--rig", rig, "--out", "m.svg"]
    done = hangtime_here(*words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "2 markers of 40 mm" in done.stdout
    assert "DICT_5X5_100, 40 mm" in (tmp_path / "m.svg").read_text()
    done = hangtime_here(*words, "--ids", "2,3,5", "--overwrite", folder=tmp_path)
    assert "3 markers of 40 mm" in done.stdout
    rig.write_text(rig.read_text().replace("[hanger]", '[hanger]\nmarker = "dot"'))
    done = hangtime_here(*words, folder=tmp_path)
    assert "its hanger has dots, not markers" in done.stderr


@pytest.mark.parametrize(("ids", "words"), [("3", "1 marker of 60 mm"), ("3,4", "2 markers of 60 mm")])
def test_the_command_counts_the_markers_that_it_prints(tmp_path, ids, words):
    assert hangtime_here("markers", "print", "--ids", ids, folder=tmp_path).stdout == f"markers.svg: {words}\n"

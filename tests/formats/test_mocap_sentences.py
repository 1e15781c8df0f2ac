"""Markers that do not fit their garment are refused word for word, and those just within each bound are taken."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.errors import HangtimeError
from formats.importers.marker_tracks import nearest_label, write_marker_csv
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_oddities import GARMENT, hanging

FIRST = GARMENT.point_names[0]
IN_VIEW = "the markers on the two top corners drive the simulation: record with both in view"


def moved(change):
    """The hanging markers at other positions."""
    tracks = hanging()
    return replace(tracks, positions=change(tracks.positions.copy()))


def swung(drop):
    """Cloth that hangs by so much of its flat drop, swung forwards."""

    def change(places):
        down = places[..., 2] - 1.5
        places[..., 1], places[..., 2] = -down * np.sqrt(1 - drop**2), 1.5 + drop * down
        return places

    return moved(change)


def lying():
    """Cloth on a table, gathered towards its middle, so that it hangs along no axis."""

    def change(places):
        down = places[..., 2] - 1.5
        return np.stack([places[..., 0], np.abs(down + 0.25) / 2, 1.5 + 0 * down], -1)

    return moved(change)


def gone(*where):
    def change(places):
        for place in where:
            places[place] = np.nan
        return places

    return moved(change)


def labelled(*labels):
    tracks = hanging()
    copies = len(labels) // len(tracks.labels)
    return replace(tracks, labels=labels, positions=np.tile(tracks.positions, (1, copies, 1)))


def of_subjects(*names):
    return labelled(*(f"{name}:{label}" if name else label for name in names for label in GARMENT.point_names))


def refused(tmp_path, tracks, garment=GARMENT, **options):
    path = write_marker_csv(tmp_path / "a.csv", tracks)
    with pytest.raises(HangtimeError) as error:
        import_marker_take(path, garment, MarkerOptions(**options))
    return str(error.value).removeprefix(f"{tmp_path}/")


def shortened(frames):
    tracks = hanging(frames)
    return replace(tracks, time=np.arange(frames) / 100)


@pytest.mark.parametrize(
    ("tracks", "options", "sentence"),
    [
        (hanging(), {"frames": 19},
         "--frames: a fit needs 20 frames or more, not 19; give 20 or more, or leave it out"),
        (hanging(), {"frames": 31},
         "has 30 frames, --frames asks for 31; give --frames 30 or fewer, or leave it out"),
        (hanging(), {"up": "w"},
         "--up: there is no axis 'w'; choose one of x, y, z, -x, -y, -z"),
        (shortened(19), {},
         "has 19 frames, 20 are needed; record for longer"),
        (shortened(1), {},
         "has 1 frame, 20 are needed; record for longer"),
        (hanging(), {"subject": "A"},
         "has no subject 'A'; leave out --subject: its markers' names have no subject before a colon"),
        (of_subjects("B", "C"), {"subject": "A"},
         "has no subject 'A'; give --subject, one of B, C"),
        (of_subjects("B", "C"), {},
         f"the marker '{FIRST}' comes 2 times; give --subject, one of B, C"),
        (of_subjects("B", "B", "B"), {},
         f"the marker '{FIRST}' comes 3 times; rename one and export again"),
        (labelled("M1", "M2", *GARMENT.point_names[2:]), {},
         f"2 of the garment's 16 markers are not in the file, first '{FIRST}' (the file's first is 'M1'); name the "
         "garment's points as the markers are labelled"),
        (labelled("Row1 Column1", *GARMENT.point_names[1:]), {},
         f"1 of the garment's 16 markers is not in the file, first '{FIRST}' (the file has 'Row1 Column1'); name the "
         "garment's points as the markers are labelled"),
        (replace(hanging(), time=np.arange(30) // 2 / 100), {},
         "its time does not increase from frame to frame, first at frame 2; mend the times, or the "
         "numbers of the frames"),
        (gone((slice(None), 0)), {},
         f"'{FIRST}' was never seen; {IN_VIEW}"),
        (gone((slice(None), 3)), {},
         f"'row1_column4' was never seen; {IN_VIEW}"),
        (gone((slice(None), [0, 3])), {},
         f"'{FIRST}' and 'row1_column4' were never seen; {IN_VIEW}"),
        (gone((slice(15), 0), (slice(15, None), 3)), {},
         f"the two markers on its top corners were never seen together; {IN_VIEW}"),
        (moved(lambda places: places * [1.26, 1, 1]), {},
         f"markers '{FIRST}' and 'row1_column2' are 210 mm apart, on the flat garment 167 mm; check the unit, the "
         "garment's size and the names of the markers"),
        (moved(lambda places: places * 1000), {},
         f"markers '{FIRST}' and 'row1_column2' are 166667 mm apart, on the flat garment 167 mm; are these "
         "millimetres that were taken for metres? Check the unit, the garment's size and the names of the markers"),
        (moved(lambda places: places * 0.59), {},
         "neighbouring markers are 0.59 of their distance on the flat garment apart in the median; check the unit "
         "and the garment's size"),
        (swung(0.32), {},
         "with z up the markers are 107 mm below the held corners in the median, and 333 mm below on the flat garment; "
         "give --up -y, along which they hang"),
        (moved(lambda places: places * [1, -1, -1]), {},
         "with z up the markers are 333 mm above the held corners in the median, and 333 mm below on the flat garment; "
         "give --up -z, along which they hang"),
        (lying(), {},
         "with z up the markers are 0 mm below the held corners in the median, and 333 mm below on the flat garment; "
         "record cloth that hangs from the two top corners"),
    ],
    ids=range(22),
)  # fmt: skip
def test_markers_that_do_not_fit_are_refused(tmp_path, tracks, options, sentence):
    said = refused(tmp_path, tracks, **options)
    assert said == (sentence if sentence.startswith("--") else f"a.csv: {sentence}")


@pytest.mark.parametrize(
    ("tracks", "options"),
    [
        (hanging(), {"frames": 20}), (hanging(), {"frames": 30}), (shortened(20), {}),
        (of_subjects("B", "C"), {"subject": "C"}), (of_subjects("", "C"), {}),
        (moved(lambda places: places * [1.24, 1, 1.24]), {}), (moved(lambda places: places * 0.61), {}),
        (swung(0.35), {}), (gone((slice(29), [0, 3])), {}),
    ],
    ids=range(9),
)  # fmt: skip
def test_markers_that_just_fit_are_taken(tmp_path, tracks, options):
    take = import_marker_take(write_marker_csv(tmp_path / "a.csv", tracks), GARMENT, MarkerOptions(**options))
    assert len(take.time) == options.get("frames", len(tracks.time))
    assert take.notes["markers"] == f"16 of the {len(tracks.labels)} markers in the file"


@pytest.mark.parametrize(("side", "name"), [(0, "left"), (1, "right")])
def test_a_marker_is_on_a_corner_within_two_millimetres(tmp_path, side, name):
    for off, is_on in ((0.0019, True), (0.0021, False)):
        outline = np.array(GARMENT.outline_m)
        outline[side, 1] += off
        outline[1 - side, 1] += 1e-4
        garment = msgspec.structs.replace(GARMENT, outline_m=tuple(map(tuple, outline.tolist())))
        if is_on:
            take = import_marker_take(write_marker_csv(tmp_path / "a.csv", hanging()), garment)
            assert np.array_equal(take.held, take.points[:, [0, 3]])
            continue
        assert refused(tmp_path, hanging(), garment) == (
            f"a.csv: no marker sits on the garment's top {name} corner, the nearest is 2 mm off; let outline_m end at "
            "the outer markers: the two top ones drive the simulation"
        )


@pytest.mark.parametrize(
    ("name", "labels", "near"),
    [
        ("a_1", ("b", "A_1"), "A_1"), ("A:a_1", ("B:a_1",), "B:a_1"), ("a_1", ("B:A-1",), "B:A-1"),
        ("A:a_1", ("a_1",), "a_1"), ("a_1", ("a_2", "aa_1"), ""), ("\u00c4rmel", ("A\u0308RMEL",), "A\u0308RMEL"),
        ("a", (), ""),
    ],
)  # fmt: skip
def test_the_nearest_label_differs_in_case_subject_or_signs_alone(name, labels, near):
    assert nearest_label(labels, name) == near


@pytest.mark.parametrize(("named", "paths"), [(12, "4 of its 16 paths have"), (15, "1 of its 16 paths has")])
@pytest.mark.parametrize("blank", [False, True])
def test_paths_without_a_label_are_counted_where_a_marker_is_missing(tmp_path, named, paths, blank):
    """blank: the file has labels of spaces for them"""
    labels = [*GARMENT.point_names[:named], *[" "] * (16 - named) * blank]
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(1e3 * hanging().positions, labels))
    with pytest.raises(HangtimeError) as error:
        import_marker_take(tmp_path / "a.c3d", GARMENT)
    absent = "4 of the garment's 16 markers are" if named == 12 else "1 of the garment's 16 markers is"
    assert str(error.value) == (
        f"{tmp_path / 'a.c3d'}: {absent} not in the file, first '{GARMENT.point_names[named]}' (the file's first is "
        f"'{FIRST}'); {paths} no label; name the garment's points as the markers are labelled, or label all markers "
        "and export it again"
    )

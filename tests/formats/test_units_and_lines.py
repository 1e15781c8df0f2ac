"""Each unit that a hint knows, with its size; and takes, rigs, garments and results in one line."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from formats.diagnosis_records import Diagnosis, in_percent
from formats.errors import TakeError
from formats.fault_words import state_of_take
from formats.fit_records import ErrorFigure, FitResult
from formats.importers.swung_cloth import _check_places, _is_crossed
from formats.impossible_points import MOST_LEFT_OUT, describe_impossible, impossible_findings, without_impossible
from formats.judged_cloth import HARDLY_EVER
from formats.judgement import judge
from formats.meant_units import number_meant, question_of, step_or_anyway, unit_of
from formats.rig import Calibration, Rig
from formats.sights import sights_of
from formats.take import told_apart
from formats.take_report import TakeReport
from tests.formats.test_archive import a_take
from tests.formats.test_judgement import swung

UNITS = {
    "side_m": "m 1 cm .01 mm .001 in .0254 metres 1 meters 1 inches .0254 centimetres .01 centimeters .01 "
    "millimetres .001 millimeters .001",
    "pause_s": "s 1 sec 1 seconds 1 ms .001 us 1e-6 µs 1e-6 min 60 minutes 60 h 3600 hours 3600 d 86400 days 86400",
    "late_us": "s 1e6 ms 1e3 us 1 µs 1 min 6e7",
    "mass_kg": "kg 1 kilograms 1 g .001 grams .001",
    "free_mb": "MB 1 GB 1000 kB .001",
    "rate_hz": "Hz 1",
    "angle_degrees": "° 1 deg 1 degrees 1",
    "width_px": "px 1 pixels 1",
    "pause_minutes": "min 1 h 60 s 0.0166666666667",
    "after_hours": "h 1 d 24 min 0.0166666666667",
    "keep_days": "d 1 h 0.0416666666667 days 1",
    "size_bytes": "B 1 kB 1e3 MB 1e6 GB 1e9 TB 1e12 bytes 1",
}


@pytest.mark.parametrize("field", UNITS)
def test_every_unit_behind_a_number_has_its_size(field):
    told = UNITS[field].split()
    for unit, size in zip(told[::2], told[1::2], strict=True):
        found = number_meant(f"3 {unit}", f"sensor.{field}[0]" if field == "side_m" else field)
        assert float(found) == pytest.approx(3 * float(size), rel=1e-10), unit
    assert number_meant("3 furlongs", field) == ""


@pytest.mark.parametrize(
    ("text", "number"),
    [("\u22123 mm", "-0.003"), ("+3e2 mm", "0.3"), (" .5 m ", "0.5"), ("1e999", ""), ("7", "7"), ("3  mm x", "")],
)
def test_signs_exponents_and_spaces_are_read(text, number):
    assert number_meant(text, "side_m") == number


def test_a_question_names_the_field_only_where_the_number_is_its_value():
    assert question_of("0.06", "hanger.side_m") == "; was hanger.side_m = 0.06 meant?"
    assert question_of("0.06", "at_m[0]") == question_of("0.06", "") == "; was 0.06 meant?"
    assert question_of("", "side_m") == ""
    assert step_or_anyway("give metres", True) == "give metres, or --anyway to accept it"
    assert step_or_anyway("give metres", False) == "give metres"


@pytest.mark.parametrize(
    ("value", "hint"),
    [
        (0.1, ""), (6.0, ""), (6.1, "; were inches meant?"), (0.09, ""), (50.0, "; were centimetres or inches meant?"),
        (500.0, "; were millimetres meant?"), (200.0, "; were millimetres or centimetres meant?"), (1e6, ""),
    ],
)  # fmt: skip
def test_a_length_far_from_its_range_is_asked_for_its_unit(value, hint):
    """Between 0.1 and 3 m: 6.1 cm are too short and 6.1 inches are 0.155 m; 50 cm and 50 inches fit."""
    assert unit_of(value, 0.1, 3.0) == hint


# --- one line -----------------------------------------------------------------------------------


def test_a_take_is_one_line_and_a_table_with_a_row_for_each_array():
    take = a_take()
    seen = f"{100 * take.points_valid.mean():.0f} %"
    assert (
        repr(take)
        == f"Take('a', length 5.0 s in 150 frames, garment {take.garment.name}, points 4, {seen} seen, state sound)"
    )
    assert "state incomplete" in repr(replace(take, is_complete=False))
    assert "state incomplete" in repr(replace(take, missing=((0.0, 1.0),)))
    for report in (
        TakeReport(is_complete=True, missing_frames=0, earlier_doubts="", damaged_blocks=1),
        TakeReport(is_complete=True, missing_frames=0, earlier_doubts="", unread_blocks=1),
        TakeReport(is_complete=False, missing_frames=3, earlier_doubts=""),
        TakeReport(is_complete=True, missing_frames=0, earlier_doubts=""),
        None,
    ):
        for one in (
            replace(take, report=report),
            replace(take, report=report, is_complete=False, missing=((0.0, 1.0),)),
        ):
            assert repr(one).endswith(f", state {state_of_take(one).state})")
    table = take._repr_html_()
    assert "array of shape (150, 4, 3)" in table
    assert "2026-01-01" in table


def test_a_take_without_frames_or_points_is_a_line_too():
    take = a_take()
    nothing = {
        name: value[:0] for name, value in vars(take).items() if isinstance(value, np.ndarray) and len(value) == 150
    }
    assert "length 0.0 s in 0 frames" in repr(replace(take, **nothing))
    assert "none seen" in repr(replace(take, **nothing))


def test_a_rig_names_the_parts_that_it_states_and_a_garment_its_size():
    rig = Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0))
    assert repr(rig) == "Rig('bench', gravity alone)"
    full = swung().rig
    assert (
        repr(msgspec.structs.replace(full, name="b", calibration=Calibration()))
        == "Rig('b', hanger and sensor and calibration)"
    )
    garment = a_take().garment
    assert repr(garment) == (
        f"Garment({garment.name!r}, {garment.kind}, {1000 * garment.mass_kg:.1f} g, {len(garment.outline_m)} corners, "
        f"4 points, held by its {garment.held})"
    )


def test_results_are_a_line_each():
    """Millimetres of metres; what a line does not say is not made."""
    assert repr(ErrorFigure(mean_m=0.0123, max_m=0.045, per_frame_m=[0.1] * 3, time_s=[0.0] * 3)) == (
        "ErrorFigure(mean 12.3 mm, largest 45.0 mm, 3 frames)"
    )
    fit = SimpleNamespace(garment="", take_ids=["a", "b"], method="m", parameters=[1, 2], created="now")
    fit.label = FitResult.label.fget(fit)
    assert FitResult.__repr__(fit) == "FitResult('fit of a, b', m, 2 parameters, now)"
    fit.garment = "towel"
    assert FitResult.label.fget(fit) == "fit of towel"
    found = SimpleNamespace(take_ids=["a", "b"], verdict="named", named=["air", "friction"], created="now")
    assert Diagnosis.__repr__(found) == "Diagnosis('a, b', verdict named, air and friction, now)"
    found.named = []
    assert Diagnosis.__repr__(found) == "Diagnosis('a, b', verdict named, now)"


def test_takes_of_one_name_are_told_apart_by_their_files():
    one, other = a_take(), replace(a_take(), report=SimpleNamespace(file="b.mcap"))
    assert told_apart([one, other]) == ["a", "b.mcap"]
    assert told_apart([replace(one, take_id="c"), other]) == ["c", "a"]


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.005, "less than 1 %"), (0.0051, "1 %"), (0.5, "50 %"), (0.9949, "99 %"), (0.995, "more than 99 %")],
)
def test_a_probability_is_never_0_or_100_percent(share, said):
    assert in_percent(share) == said


# --- impossible and rare points, and corners ----------------------------------------------------


def with_impossible(count):
    """A swung cloth of which a point is 5 m away in so many frames."""
    take = swung()
    points = take.points.copy()
    frames = np.flatnonzero(sights_of(take).within & take.points_valid.all(1))[:count]
    points[frames, 0] += 5.0
    return replace(take, points=points), frames


def test_a_few_impossible_sightings_are_left_out_and_many_are_a_finding():
    take, frames = with_impossible(3)
    left = without_impossible(take, sights_of(take))
    assert np.flatnonzero((take.points_valid & ~left.points_valid).any(1)).tolist() == frames.tolist()
    assert not left.points_valid[frames, 0].any()
    assert left.points_valid[frames, 1:].all()
    assert impossible_findings(take, sights_of(take)) == []
    sound = swung()
    assert without_impossible(sound, sights_of(sound)) is sound
    many, _ = with_impossible(len(sound.time))
    assert without_impossible(many, sights_of(many)) is many
    (found,) = impossible_findings(many, sights_of(many))
    assert found.name == "points_impossible"
    assert "% of the sightings of points are further" in found.words


def test_a_share_of_impossible_sightings_is_said_with_its_next_step():
    assert describe_impossible(0.0).startswith("No point is further")
    assert describe_impossible(MOST_LEFT_OUT).startswith(f"{100 * MOST_LEFT_OUT:.2g} % of a take's sightings")
    assert describe_impossible(MOST_LEFT_OUT).endswith("each other. These positions are left out.")
    assert f"At most {100 * MOST_LEFT_OUT:.0f} % may be: check the markers'" in describe_impossible(
        1.01 * MOST_LEFT_OUT
    )


@pytest.mark.parametrize("points", [[0], [0, 1]])
def test_points_that_are_hardly_seen_are_named_with_the_most_of_their_frames(points):
    take = swung()
    valid = take.points_valid.copy()
    free = [k for k in range(valid.shape[1]) if k not in (0, 1)][: len(points)]
    valid[:, free] = False
    valid[40 : 40 + int(0.5 * HARDLY_EVER * len(valid)), free] = True
    names = [take.garment.point_names[k] for k in free]
    (found,) = [one for one in judge(replace(take, points_valid=valid)) if one.name == "points_hardly_seen"]
    assert all(name in found.words for name in names)
    assert (" were seen in " in found.words) is found.words.endswith(" at most") is (len(points) == 2)


@pytest.mark.parametrize(("side", "fits"), [(0.1, True), (3.0, True), (0.0999, False), (3.001, False)])
def test_a_flat_cloth_of_the_shortest_and_the_longest_side_is_one(tmp_path, side, fits):
    rest = side * np.array([[0, 0], [1, 0], [0, 1], [1, 1.0]])
    points = np.concatenate([rest, np.zeros((4, 1))], 1)[None, :, [0, 2, 1]].repeat(5, axis=0)
    held = points[:, 2:]
    judged = partial(_check_places, points, np.ones((5, 4), bool), held, rest, tmp_path)
    if fits:
        judged()
    else:
        with pytest.raises(TakeError, match=r"m long in 'rest', a garment 0\.1 to 3 m"):
            judged()


def test_corners_that_are_never_seen_are_not_crossed():
    rest = np.array([[0, 0], [1, 0], [0, 1], [1, 1.0]])
    points = np.concatenate([rest, np.zeros((4, 1))], 1)[None].repeat(3, axis=0)
    held, valid = points[:, 2:], np.ones((3, 4), bool)
    assert not _is_crossed(held, points, valid, rest)
    assert _is_crossed(held[:, ::-1], points, valid, rest)
    assert not _is_crossed(held[:, ::-1], points, ~valid, rest)

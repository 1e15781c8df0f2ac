"""Sets of fitted and held-out takes, and the reuse of saved work for the same takes only."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.errors import FitError
from fit.folders import alone, set_aside_others
from fit.gap.diagnosis import diagnose
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import SI
from fit.recordings.copies import Track, are_copies
from fit.recordings.intact import FRAME_FIELDS
from fit.recordings.ready import ready
from fit.recordings.selection import check_together, content_of
from formats.archive import read_take, write_take
from formats.results import save_diagnosis, save_fit_result
from tests.fit.blind.blind_answers import diagnosis
from tests.fit.scenes import material, shared, sheet, simulate_take, swing

COARSE = Resolution(spacing=0.15)


@shared
def a_take(name="a", hz=0.7, garment=None):
    garment, time = garment or sheet(), np.arange(0, 2, 1 / 30)
    row = material(garment, velocity_damping=2.0)
    return simulate_take(garment, time, swing(time, hz=hz), row, noise=0.001, name=name, resolution=COARSE)


def asked(search="annealing"):
    return request_of(SI, [], iterations=60, seed=1, spacing=0.15, search=search)


def stop_after(count):
    told = []

    def progress(*_):
        told.append(1)
        if len(told) == count:
            raise KeyboardInterrupt

    return progress


def test_content_is_of_what_a_fit_sees_and_outlives_the_archive(tmp_path):
    take = read_take(write_take(tmp_path / "a.mcap", a_take()))
    assert content_of(take) == content_of(read_take(tmp_path / "a.mcap"))
    lighter = msgspec.structs.replace(take.garment, mass_kg=0.03)
    tilted = msgspec.structs.replace(take.rig, gravity=(0.0, 0.1, -0.995))
    moved = take.points + 1e-3
    for change in ({"points": moved}, {"garment": lighter}, {"rig": tilted}, {"points_sd": 2 * take.points_sd}):
        assert content_of(dataclasses.replace(take, **change)) != content_of(take)


@pytest.mark.parametrize(
    ("training", "held_out", "sentence"),
    [
        ([], ["a"], "no take was given"),
        (["a", "a"], [], "this take is given twice"),
        (["a", "b"], ["b"], "this take is both fitted to and held out"),
        (["a"], ["b", "b"], "this take is given twice"),
        (["a", "heavy"], [], "takes of different garments"),
        (["a"], ["heavy"], "takes of different garments"),
    ],
)
def test_takes_that_cannot_be_used_together_are_refused(training, held_out, sentence):
    known = {"a": a_take("a"), "b": a_take("b", hz=0.9), "heavy": a_take("heavy", garment=sheet(mass=0.08))}
    with pytest.raises(FitError, match=sentence):
        check_together([known[k] for k in training], [known[k] for k in held_out])


def test_takes_of_different_garments_are_refused_with_the_field_and_both_values():
    one, points = a_take("a"), a_take("a").garment.points
    moved = (*points[:3], msgspec.structs.replace(points[3], at_m=(0.1, -0.2)), *points[4:])
    x = points[3].at_m[0]
    for change, told in (
        ({"mass_kg": 0.041}, f"mass_kg is {one.garment.mass_kg} in 'a' and 0.041 in 'b'"),
        ({"layers": 2, "name": "other"}, "name is 'sheet' in 'a' and 'other' in 'b'; layers is 1 in 'a' and 2 in 'b'"),
        ({"points": moved}, f"points[3].at_m[0] is {x} in 'a' and 0.1 in 'b'"),
        ({"points": points[1:]}, f"points has the length {len(points)} in 'a' and {len(points) - 1} in 'b'"),
        ({"points_are": "silhouette"}, "points_are is left out in 'a' and 'silhouette' in 'b'"),
        ({"layers": 2, "held": "corners", "grain_degrees": 3.0, "mass_kg": 0.041},
         f"mass_kg is {one.garment.mass_kg} in 'a' and 0.041 in 'b'; held is 'edge' in 'a' and 'corners' in 'b'; and 2 "
         "more fields"),
    ):  # fmt: skip
        other = dataclasses.replace(one, take_id="b", garment=msgspec.structs.replace(one.garment, **change))
        with pytest.raises(FitError) as refused:
            check_together([one, other], [])
        assert refused.value.what == f"takes of different garments: {told}"


def test_takes_of_one_name_are_distinguished_by_their_files(tmp_path):
    """Also where one is a copy of the other, or cut; three thousand letters of a name are shown in part."""
    one = a_take("one")
    heavy = dataclasses.replace(one, garment=msgspec.structs.replace(one.garment, mass_kg=0.041))
    cut = {name: array[:40] for name in FRAME_FIELDS if (array := getattr(one, name)) is not None}
    for name, take in (("a", one), ("b", heavy), ("c", one), ("d", dataclasses.replace(one, **cut))):
        write_take(tmp_path / f"{name}.mcap", take)
    a, b, c, d = (tmp_path / f"{name}.mcap" for name in "abcd")
    for other, sentence in (
        (b, f"{b}: takes of different garments: mass_kg is {one.garment.mass_kg} in '{a}' and 0.041 in '{b}'; fit and"),
        (c, f"{c}: this take is given twice; give"),
        (d, f"{d}: this take holds frames of the recording that '{a}' holds; give"),
    ):
        with pytest.raises(FitError) as refused:
            check_together([read_take(a), read_take(other)], [])
        assert str(refused.value).startswith(sentence)
    long = dataclasses.replace(heavy, take_id="n" * 3000)
    with pytest.raises(FitError) as refused:
        check_together([one, long], [])
    part = f"{60 * 'n'} ... {60 * 'n'}"
    told = f"takes of different garments: mass_kg is {one.garment.mass_kg} in 'one' and 0.041 in '{part}'"
    advice = "fit and diagnose one garment at a time, and give all its takes one description"
    assert str(refused.value) == f"{part}: {told}; {advice}"


def test_two_versions_of_the_format_are_one_garment_and_a_statement_that_changes_a_fit_is_not_left_out():
    take, other = a_take("a"), a_take("b", hz=0.9)
    latest = msgspec.structs.replace(other.garment, format="hangtime-garment/2")
    check_together([take, dataclasses.replace(other, garment=latest)], [])
    stated = msgspec.structs.replace(latest, points_are="material")
    with pytest.raises(FitError, match="garments: points_are is left out in 'a' and 'material' in 'b'; fit and"):
        check_together([take, dataclasses.replace(other, garment=stated)], [])


@pytest.mark.parametrize("kept", [slice(0, 40), slice(30, None), np.r_[0:20, 35:60]])
def test_a_cut_or_damaged_copy_is_the_same_recording(kept):
    """It has another content, and judging on it would judge on frames that were fitted to."""
    take = a_take("a")
    arrays = {name: array[kept] for name in FRAME_FIELDS if (array := getattr(take, name)) is not None}
    copy = dataclasses.replace(take, take_id="copy", is_complete=False, **arrays)
    with pytest.raises(
        FitError, match=r"^copy: this take holds frames of the recording that 'a' holds, which is fitted to; judge"
    ):
        check_together([take, a_take("b", hz=0.9)], [copy])


def test_two_pieces_of_one_recording_that_share_most_frames_are_the_same_recording():
    take = a_take("a")
    pieces = []
    for kept in (slice(0, 42), slice(12, 54)):
        arrays = {name: array[kept] for name in FRAME_FIELDS if (array := getattr(take, name)) is not None}
        pieces.append(dataclasses.replace(take, take_id=str(kept.start), **arrays))
    with pytest.raises(
        FitError, match=r"^12: this take holds frames of the recording that '0' holds, which is fitted to; judge"
    ):
        check_together(pieces[:1], pieces[1:])


@pytest.mark.parametrize("change", ["later", "one point edited", "one point lost", "from its middle on"])
def test_a_copy_whose_clock_or_some_points_changed_is_the_same_recording(change):
    take = a_take("a")
    points, valid = take.points.copy(), take.points_valid.copy()
    if change == "one point edited":
        points[:, 0] += 1e-4
    if change == "one point lost":
        points[:, 0], valid[:, 0] = np.nan, False
    copy = dataclasses.replace(take, take_id="copy", time=take.time - 3.0, points=points, points_valid=valid)
    if change == "from its middle on":
        arrays = {name: array[30:] for name in FRAME_FIELDS if (array := getattr(copy, name)) is not None}
        copy = dataclasses.replace(copy, **arrays)
    for given in ([take, copy], [copy, take]):
        with pytest.raises(
            FitError, match=r"this take holds frames of the recording that .* holds, which is fitted to"
        ):
            check_together(given[:1], given[1:])
        with pytest.raises(FitError, match=r"that '.*' holds; give every recording once"):
            check_together(given, [])


def test_takes_that_share_their_rest_or_their_hanger_alone_stand_together():
    take, garment = a_take("a"), sheet()
    moved = dataclasses.replace(take, points=take.points + 0.001)
    assert not are_copies(Track(take), Track(moved))
    rest = np.tile(take.points[:1], (len(take.time), 1, 1))
    still = [dataclasses.replace(take, take_id=str(hz), points=rest + swing(take.time, hz=hz, start=1.0)[:, None])
             for hz in (0.7, 0.9)]  # fmt: skip
    assert (still[0].points == still[1].points).all((1, 2)).mean() > 0.5  # their rest
    check_together(still, [])
    time, row = np.arange(0, 2, 1 / 30), material(garment, velocity_damping=2.0)
    other = material(garment, velocity_damping=0.5)
    alike = [simulate_take(garment, time, swing(time), cloth, noise=0.0, resolution=COARSE) for cloth in (row, other)]
    held = [(one.points[:, :2] == alike[0].points[:, :2]).all() for one in alike]
    assert all(held)
    check_together(alike, [])


def test_two_takes_of_one_name_that_hold_one_recording_are_distinguished():
    take = a_take("a")
    copy = dataclasses.replace(take, time=take.time - 3.0)
    with pytest.raises(FitError, match=r"^a: this take holds frames of the recording that another take of its name h"):
        check_together([take, copy], [])


def test_two_recordings_of_one_name_may_stand_together():
    check_together([a_take("a"), a_take("a", hz=0.9)], [])


def test_a_search_does_not_go_on_with_another_recording_of_the_same_name(tmp_path):
    file = tmp_path / "c.json"
    with pytest.raises(KeyboardInterrupt):
        calibrate([a_take()], [], asked(), checkpoint=file, progress=stop_after(2))
    with pytest.raises(FitError, match="the saved search is of other takes"):
        calibrate([a_take(hz=0.9)], [], asked(), checkpoint=file)


@pytest.mark.parametrize("anew", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_diagnosis_does_not_go_on_with_another_recording_of_the_same_name(tmp_path, anew):
    options = {"effects": find_effects(["hem"]), "resolution": COARSE, "checkpoint": tmp_path / "kept"}

    def interrupt(stage, share):
        if stage.startswith("base fit"):
            raise KeyboardInterrupt

    takes = [a_take("a"), a_take("b", hz=0.9)]
    with pytest.raises(KeyboardInterrupt):
        diagnose(takes[:1], takes[1:], progress=interrupt, **options)
    takes[anew] = a_take("ab"[anew], hz=1.1)
    with pytest.raises(FitError, match="of other takes"):
        diagnose(takes[:1], takes[1:], **options)


def test_a_fit_is_of_takes_by_what_they_hold_and_an_old_one_by_their_names():
    result = calibrate([a_take()], [], request_of(SI, [], iterations=2, seed=1, spacing=0.15))
    assert ready([a_take()], []).are_of(result)
    assert not ready([a_take(hz=0.9)], []).are_of(result)
    old = msgspec.structs.replace(result, take_contents=[])
    assert ready([a_take(hz=0.9)], []).are_of(old)
    assert not ready([a_take("b")], []).are_of(old)


def test_results_of_other_takes_get_a_number_and_those_of_the_same_are_replaced(tmp_path):
    """The other one has the same name: its content distinguishes it. Old diagnoses know names alone."""
    fit, diagnosed, report = (tmp_path / name for name in ("fit.json", "diagnosis.json", "report.html"))
    save_fit_result(fit, calibrate([a_take()], [], request_of(SI, [], iterations=2, seed=1, spacing=0.15)))
    of_a = msgspec.structs.replace(diagnosis("none", [], []), take_ids=["a"])
    save_diagnosis(diagnosed, msgspec.structs.replace(of_a, take_contents=[content_of(a_take())]))
    report.write_text("one")
    for path in (fit, diagnosed, tmp_path / "gone.json"):
        assert set_aside_others(path, ready([a_take()], []).are_of) == ""
    said = set_aside_others(fit, ready([a_take(hz=0.9)], []).are_of)
    assert said == f"{fit} is of other takes (a): kept as fit.1.json, with its report."
    assert {p.name for p in tmp_path.iterdir()} == {"fit.1.json", "report.1.html", "diagnosis.json"}
    report.write_text("two")
    assert "kept as diagnosis.2.json" in set_aside_others(diagnosed, ready([a_take(hz=0.9)], []).are_of)
    assert (tmp_path / "report.2.html").read_text() == "two"
    save_diagnosis(diagnosed, of_a)
    assert set_aside_others(diagnosed, ready([a_take(hz=0.9)], []).are_of) == ""
    assert "kept as diagnosis.3.json" in set_aside_others(diagnosed, ready([a_take("b")], []).are_of)
    fit.write_text("{}")
    assert "is not known to be of these takes" in set_aside_others(fit, ready([a_take()], []).are_of)


def test_a_page_that_is_of_no_result_gets_a_number(tmp_path):
    """Somebody's own page stays; beside a diagnosis a page is the report of both, which the new one replaces."""
    fit, report, elsewhere = tmp_path / "fit.json", tmp_path / "report.html", tmp_path / "elsewhere.html"
    report.write_text("mine")
    said = set_aside_others(fit, ready([a_take()], []).are_of)
    assert said == f"{report} is of no result in this folder: kept as report.1.html."
    assert (tmp_path / "report.1.html").read_text() == "mine"
    assert set_aside_others(fit, ready([a_take()], []).are_of) == ""
    (tmp_path / "two\nlines").mkdir()
    (tmp_path / "two\nlines/report.html").write_text("mine")
    assert "\n" not in set_aside_others(tmp_path / "two\nlines/fit.json", ready([a_take()], []).are_of)
    report.symlink_to(elsewhere)
    assert "kept as report.2.html" in set_aside_others(fit, ready([a_take()], []).are_of)
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis("none", [], []))
    report.write_text("of both")
    assert set_aside_others(fit, ready([a_take()], []).are_of) == ""


def test_a_folder_is_one_commands_at_a_time(tmp_path):
    again = alone(tmp_path)
    with alone(tmp_path), pytest.raises(FitError, match="another command writes here"), again:
        pass
    with alone(tmp_path):
        assert list(tmp_path.iterdir()) == []

"""Takes that are fitted to and judged on together, and kept work that is of these takes and not of others so named."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.errors import FitError
from fit.folders import alone, set_aside_other_takes
from fit.gap.diagnosis import diagnose
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import SI
from fit.recordings.intact import FRAME_FIELDS
from fit.recordings.ready import ready
from fit.recordings.selection import check_together, content_of, shared_frames
from formats.archive import read_take, write_take
from formats.results import save_diagnosis, save_fit_result
from tests.fit.blind.blind_answers import diagnosis
from tests.fit.scenes import material, sheet, simulate_take, swing

COARSE = Resolution(spacing=0.15)


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
def test_what_cannot_be_used_together_is_refused(training, held_out, sentence):
    known = {"a": a_take("a"), "b": a_take("b", hz=0.9), "heavy": a_take("heavy", garment=sheet(mass=0.08))}
    with pytest.raises(FitError, match=sentence):
        check_together([known[k] for k in training], [known[k] for k in held_out])


@pytest.mark.parametrize("kept", [slice(0, 40), slice(30, None), np.r_[0:20, 35:60]])
def test_a_cut_or_damaged_copy_is_the_same_recording(kept):
    """It has another content, and judging on it would judge on frames that were fitted to."""
    take = a_take("a")
    arrays = {name: array[kept] for name in FRAME_FIELDS if (array := getattr(take, name)) is not None}
    copy = dataclasses.replace(take, take_id="copy", is_complete=False, **arrays)
    with pytest.raises(FitError, match=r"^copy: this take is both fitted to and held out"):
        check_together([take, a_take("b", hz=0.9)], [copy])


def test_takes_that_share_their_rest_or_their_hanger_alone_stand_together():
    take = a_take("a")
    moved = dataclasses.replace(take, points=take.points + 0.001)
    assert shared_frames(take, moved) == 0.0
    other = a_take("b", hz=0.9)
    rests = [dataclasses.replace(one, held=one.held + 0.1 * (one.time > 1.5)[:, None, None]) for one in (take, other)]
    still = [dataclasses.replace(one, held=np.where(one.time[:, None, None] > 1.5, one.held, take.held[:1]),
                                 points=take.points) for one in rests]  # fmt: skip
    assert shared_frames(*still) < 0.5
    check_together(still, [])


def test_two_recordings_of_one_name_may_stand_together():
    check_together([a_take("a"), a_take("a", hz=0.9)], [])


def test_a_search_does_not_go_on_with_another_recording_of_the_same_name(tmp_path):
    file = tmp_path / "c.json"
    with pytest.raises(KeyboardInterrupt):
        calibrate([a_take()], [], asked(), checkpoint=file, progress=stop_after(2))
    with pytest.raises(FitError, match="the saved search is of other takes"):
        calibrate([a_take(hz=0.9)], [], asked(), checkpoint=file)


@pytest.mark.parametrize("anew", [0, 1])
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
    """The other one has the same name: what tells it apart is what it holds. Old diagnoses know names alone."""
    fit, diagnosed, report = (tmp_path / name for name in ("fit.json", "diagnosis.json", "report.html"))
    save_fit_result(fit, calibrate([a_take()], [], request_of(SI, [], iterations=2, seed=1, spacing=0.15)))
    of_a = msgspec.structs.replace(diagnosis("none", [], []), take_ids=["a"])
    save_diagnosis(diagnosed, msgspec.structs.replace(of_a, take_contents=[content_of(a_take())]))
    report.write_text("one")
    for path in (fit, diagnosed, tmp_path / "gone.json"):
        assert set_aside_other_takes(path, ready([a_take()], []).are_of) == ""
    said = set_aside_other_takes(fit, ready([a_take(hz=0.9)], []).are_of)
    assert said == f"{fit} is of other takes (a): kept as fit.1.json, with its report."
    assert {p.name for p in tmp_path.iterdir()} == {"fit.1.json", "report.1.html", "diagnosis.json"}
    report.write_text("two")
    assert "kept as diagnosis.2.json" in set_aside_other_takes(diagnosed, ready([a_take(hz=0.9)], []).are_of)
    assert (tmp_path / "report.2.html").read_text() == "two"
    save_diagnosis(diagnosed, of_a)
    assert set_aside_other_takes(diagnosed, ready([a_take(hz=0.9)], []).are_of) == ""
    assert "kept as diagnosis.3.json" in set_aside_other_takes(diagnosed, ready([a_take("b")], []).are_of)
    fit.write_text("{}")
    assert "is not known to be of these takes" in set_aside_other_takes(fit, ready([a_take()], []).are_of)


def test_a_folder_is_one_commands_at_a_time(tmp_path):
    again = alone(tmp_path)
    with alone(tmp_path), pytest.raises(FitError, match="another command writes here"), again:
        pass
    with alone(tmp_path):
        assert list(tmp_path.iterdir()) == []

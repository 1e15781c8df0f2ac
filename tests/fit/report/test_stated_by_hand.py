"""What a page states of its takes, garment and sensor, and in which order its sections stand."""

from __future__ import annotations

import re
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from markupsafe import Markup

from fit.report import answer, page, sections
from fit.report.effects import meaning_of, sentence_of, sketch_of
from fit.report.origin import _calibration, _garment, _sensor, origin_of
from fit.report.page import SECTIONS, _takes, render_report
from fit.report.templating import coded
from formats.rig import Calibration
from tests.fit.report.report_scene import diagnosis, fit_result, motion
from tests.fit.scenes import hung, sheet, take_of


def test_a_garment_is_stated_with_its_layers_seams_and_hold():
    whole = msgspec.structs.replace(sheet(held="corners"), format="hangtime-garment/2", layers=2, seams=((1, 2),))
    assert _garment(whole).startswith(
        "sheet: swatch, 400 × 450 mm, 2 layers, front and back sewn, held by its two top corners, 5 tracked points ("
    )


def test_a_sensor_is_stated_with_its_pixels_and_imported_points_with_their_source():
    seen = SimpleNamespace(sensor=SimpleNamespace(width=640, height=480, fx=575.8), calibration=None)
    assert _sensor(seen, "kinect") == "kinect, 640 × 480 pixels, focal length 576 pixels"
    assert _sensor(seen, "").startswith("640 × 480")
    none = SimpleNamespace(sensor=None, calibration=None)
    assert _sensor(none, "a.c3d") == "none: imported points (a.c3d)"
    assert _sensor(none, "") == "none: imported points"
    assert (_calibration(seen), _calibration(none)) == ("none", "as the imported file states")
    known = SimpleNamespace(sensor=None, calibration=Calibration(depth_scale=1.01))
    assert _calibration(known).endswith("depth scale 1.0100 (not measured)")


def test_an_origin_without_a_take_or_a_command_has_the_version_alone():
    takes = SimpleNamespace(training=[], contents=[], held_out=[], held_out_contents=[])
    assert [name for name, _ in origin_of(takes).facts] == ["Hangtime", "simulation and libraries"]
    time = np.arange(0, 1, 1 / 30)
    take = take_of(sheet(), time, np.zeros((30, 3)), hung(sheet(), time))
    assert [name for name, _ in origin_of(takes, take, "hangtime fit").facts] == [
        "Hangtime", "command", "simulation and libraries", "garment", "mass", "sensor", "calibration",
    ]  # fmt: skip


@pytest.mark.parametrize(("count", "said"), [(1, "t0, h"), (3, "t0, t1, t2, h"), (4, "t0, t1, t2, t3 and 1 more")])
def test_a_page_names_four_of_its_takes(count, said):
    names = [f"t{k}" for k in range(count)]
    fit = msgspec.structs.replace(fit_result(), take_ids=names, held_out_ids=["h"])
    assert _takes(fit, None, []) == said
    assert _takes(fit, diagnosis(), []) == "swing-01, swing-02"
    assert _takes(None, None, [motion("alone")]) == "alone"


def test_sections_stand_in_their_order_and_only_where_they_hold_something():
    text = render_report(fit=fit_result(), diagnosis=diagnosis(), motions=[motion(seconds=2.0)])
    shown = re.findall(r'<section id="(\w+)"', text)
    order = [anchor for anchor, _, _ in SECTIONS]
    assert shown == [anchor for anchor in order if anchor in shown]
    assert set(order) - set(shown) == {"camera", "origin"}
    for anchor, short, title in SECTIONS:
        assert (f'href="#{anchor}"' in text) == (anchor in shown)
        if anchor in shown:
            assert short in text
            assert title in text
    assert "swing-01, swing-02 · 2026-03-01 12:10 UTC" in text


def test_motion_fills_what_the_words_leave_of_the_pages_size(monkeypatch):
    asked = []
    monkeypatch.setattr(page, "pack_motions", lambda motions, budget: asked.append(budget) or ([], ""))
    render_report(fit=fit_result(), diagnosis=None, motions=[motion(seconds=2.0)])
    words = len(page._page(fit_result(), None, [motion(seconds=2.0)], None, ([], 1, "")).encode())
    assert asked == [1_450_000 - words]
    monkeypatch.setattr(page, "PAGE_BUDGET", 10)
    render_report(fit=fit_result(), diagnosis=None, motions=[motion(seconds=2.0)])
    assert asked[1] == 0


@pytest.mark.parametrize(
    ("verdict", "tone", "words"),
    [
        ("none", "good", "no gap"), ("effect", "good", "one missing effect"), ("several", "good", "several missing"),
        ("ambiguous", "warn", "not distinguishable yet"), ("unknown", "warn", "cause unknown"),
        ("numerics", "bad", "refine the simulation first"), ("inconclusive", "bad", "too little data"),
    ],
)  # fmt: skip
def test_each_verdict_has_its_tone_and_its_tag(verdict, tone, words):
    named = ["air_drag", "hem"] if verdict == "ambiguous" else ["air_drag"] if verdict == "effect" else []
    shown = str(answer.verdict(None, diagnosis(verdict=verdict, named=named)))
    assert f'class="verdict is-{tone}"' in shown
    assert re.search(rf'class="tag tone-{tone}">{words}', shown)
    plain = str(answer.verdict(fit_result(), None))
    assert 'class="verdict is-plain"' in plain
    assert 'class="tag tone-plain">fit<' in plain


def test_figures_refer_to_what_is_named_and_of_ambiguous_effects_to_the_first():
    said = {
        ("ambiguous", ("air_drag", "hem")): "air drag (as one of 2)",
        ("several", ("air_drag", "hem")): "air drag and hem",
        ("unknown", ()): "the best effect",
    }
    for (verdict, named), words in said.items():
        found = diagnosis(verdict=verdict, named=list(named))
        assert answer.named(found) == words
        assert answer.run_names(fit_result(), found)["with_effect"] == f"with {words}"
    assert answer.run_names(None, None) == {
        "before": "before the fit", "after": "after the fit", "base": "base model",
        "with_effect": "with the effect", "fit": "the fit",
    }  # fmt: skip
    assert answer.run_names(fit_result(), None)["fit"] == "the fit (kinect-skirt)"


def test_the_meaning_of_an_unknown_size_has_no_number_and_of_an_endless_one_there_is_none():
    assert meaning_of("hem", None) == meaning_of("hem", 0.01) == "extra mass per length of the bottom edge"
    assert meaning_of("air_drag", None) == ""
    assert meaning_of("air_drag", float("inf")) == meaning_of("wind", 1.0) == sentence_of("wind") == ""
    assert "1 times that of a flat plate (1.2)" in meaning_of("air_drag", -1.2)
    assert str(sketch_of("wind")) == ""


def test_the_gap_says_why_its_share_can_be_surer_than_the_whiskers_and_only_where_both_stand():
    says = "the share of the gap closed can be surer than their whiskers"
    assert says in str(sections.gap(diagnosis()))
    for lacking in ({"closure": None}, {"with_effect_mm": None}):
        made = diagnosis(gap=msgspec.structs.replace(diagnosis().gap, **lacking))
        assert says not in str(sections.gap(made))


def test_a_command_in_a_note_is_set_as_code_and_everything_else_is_escaped():
    given = diagnosis(notes=["`hangtime takes show` gives <the> noise."])
    page = sections.cost(None, given)
    assert "<li><code>hangtime takes show</code> gives &lt;the&gt; noise.</li>" in page
    gate = msgspec.structs.replace(given.gates[0], sentence="Measure it by `hangtime calibrate` & record.")
    page = sections.gates(diagnosis(gates=[gate]))
    assert "Measure it by <code>hangtime calibrate</code> &amp; record." in page
    assert coded(Markup("<b>`a`</b>")) == Markup("<b><code>a</code></b>")
    assert coded("one ` alone") == "one ` alone"

"""What a page states of its takes, garment and sensor, and in which order its sections stand."""

from __future__ import annotations

import re
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.report import page
from fit.report.origin import _calibration, _garment, _sensor, origin_of
from fit.report.page import SECTIONS, _takes, render_report
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

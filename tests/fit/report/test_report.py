"""The report is one self-contained file that agrees with its records."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from html.parser import HTMLParser

import msgspec
import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.errors import FitError
from fit.gap.gates import data_gates
from fit.recordings.recording import prepare
from fit.report import charts, sections
from fit.report.effects import meaning_of, sentence_of, sketch_of
from fit.report.motion import Run
from fit.report.origin import Origin, _calibration
from fit.report.page import render_report, write_report
from fit.report.tables import effect_table, parameter_table
from fit.report.text import instant, interval, number, percent, probability
from formats.diagnosis_records import Gate
from formats.fit_records import FitParameter
from formats.results import load_diagnosis, save_diagnosis, save_fit_result
from formats.rig import Calibration
from tests.fit.report.report_scene import diagnosis, fit_result, motion
from tests.fit.scenes import hung, sheet, swing, take_of
from tests.sentences import words_of


class Tags(HTMLParser):
    """Collects tags, and complains about those not closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.attributes, self.text = [], [], []

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, name, value) for name, value in attrs]
        if tag not in {"meta", "input", "br", "link", "img", "circle", "line", "path", "polygon"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in {"path", "line", "circle", "polygon"}:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    both = [motion(), motion("swing-02", is_held_out=True)]
    return write_report(path, fit=fit_result(), diagnosis=diagnosis(), motions=both)


def test_every_tag_is_closed_and_every_anchor_exists(report):
    tags = Tags()
    tags.feed(report.read_text(encoding="utf-8"))
    assert tags.open == []
    anchors = {value for _, name, value in tags.attributes if name == "id"}
    links = [value for tag, name, value in tags.attributes if tag == "a" and name == "href"]
    assert len(links) >= 10
    assert {link.removeprefix("#") for link in links} <= anchors


def test_nothing_comes_from_outside(report):
    text = report.read_text(encoding="utf-8")
    assert not re.search(r"https?://|//cdn|@import|url\(|fetch\(|XMLHttpRequest", text)
    tags = Tags()
    tags.feed(text)
    assert not [a for a in tags.attributes if a[1] in {"src", "srcset", "data-src"}]
    assert not [a for a in tags.attributes if a[1] == "href" and not a[2].startswith("#")]


def test_two_takes_of_six_seconds_make_less_than_a_megabyte(report):
    assert report.stat().st_size < 1_000_000


def test_the_figures_of_the_records_are_on_the_page(report):
    tags = Tags()
    tags.feed(report.read_text(encoding="utf-8"))
    text = " ".join(tags.text)
    for figure in (
        "The model lacks air drag.", "12.3 mm", "5.2 mm", "4.1 mm", "87 %", "79 to 93 %",
        "1.09 times that of a flat plate", "61.2", "5 to 80", "Not identified", "1.02 to 1.6", "−0.006 to 0.002",
        "0.012 kg/m: extra mass per length of the bottom edge", "16.2 mm", "0.7 to 1.5 Hz", "83 %", "✗ failed",
        "912 simulations in 1.7 min", "Swing twice as fast", "8.4 standard deviations, against 2.1 now",
        "best mean distance of all points so far", "Errors before and after", "Share of velocity kept per frame.",
        "Mass of the cloth material. Not identified. Only ratios to the density are.",
    ):  # fmt: skip
        assert figure in text, figure


def test_a_parameter_that_is_not_identified_is_an_interval_and_never_a_number():
    """Of the mass, 1.7, the page shows 1.36 to 2.04 and no mark at 1.7; struct is a number with its mark."""
    mass, struct = fit_result().parameters[:2]
    shown = [str(parameter_table([p])) for p in (mass, struct)]
    assert "1.36 to 2.04" in shown[0]
    assert "1.7<" not in shown[0]
    assert "<b>61.2</b>" in shown[1]
    assert [page.count('class="to"') for page in shown] == [0, 1]


def test_figure_6_of_the_paper_is_a_table_with_its_own_63_percent():
    """0.1276 before, 0.0467 after: down by 1 - 0.366 = 63 %."""
    tags = Tags()
    tags.feed(render_report(fit=fit_result(), diagnosis=None))
    text = " ".join(" ".join(tags.text).split())
    assert "mean, takes used to fit 128 46.7 63 %" in text
    assert "maximum, takes used to fit 229 80.7 65 %" in text


def test_warnings_of_a_fit_stand_below_its_table():
    warned = msgspec.structs.replace(fit_result(), notes=["Warning: intervals <too> short.", "By hand."])
    table = sections.parameters(warned, None)
    assert "Warning: intervals &lt;too&gt; short." in table
    assert "By hand." not in table


def test_of_two_tables_of_parameters_the_second_says_why_its_values_differ():
    found = diagnosis(base_parameters=fit_result().parameters)
    differ = "So these values may differ from those above. So may the parameters at their bounds."
    assert [differ in sections.parameters(fit, found) for fit in (fit_result(), None)] == [True, False]


def test_a_gap_on_the_points_as_tracked_stands_beside_the_one_without_the_cameras_faults():
    gap = msgspec.structs.replace(diagnosis().gap, raw_mm=20.0, closure_from_raw=0.95)
    page = render_report(fit=None, diagnosis=diagnosis(gap=gap))
    assert (
        "base model on the points as tracked</dt><dd>20.0\u00a0mm<small>95\u00a0% of the gap from there closed" in page
    )
    assert "as tracked" not in render_report(fit=None, diagnosis=diagnosis())


def test_gap_bar_is_split_at_floor_and_at_what_the_effect_leaves():
    text = render_report(fit=None, diagnosis=diagnosis())
    row = re.search(r'<span class="name">base model</span><span class="track">(.*?)</span>', text).group(1)
    widths = {
        kind: float(width) for kind, width in re.findall(r'class="(\w+)" style="left:[\d.]+%;width:([\d.]+)%', row)
    }
    # 12.3 mm: 4.1 noise, 1.1 left, 7.1 removed
    assert widths["rest"] / widths["floor"] == pytest.approx(1.1 / 4.1, abs=0.01)
    assert widths["gone"] / widths["floor"] == pytest.approx(7.1 / 4.1, abs=0.01)


def test_every_effect_of_the_library_has_a_sentence_a_sketch_and_a_meaning_of_its_size():
    for effect in LIBRARY:
        assert words_of(sentence_of(effect.name)) <= 25
        assert sentence_of(effect.name).endswith(".")
        assert meaning_of(effect.name, effect.typical)
        drawn = re.findall(r' d="([^"]+)"', sketch_of(effect.name))
        assert len(drawn) >= 2
        places = [float(x) for path in drawn for x in re.findall(r"-?[\d.]+", path)]
        assert max(places) <= 80, effect.name
        styles = set(re.findall(r'path class="(\w+)"', sketch_of(effect.name)))
        assert styles <= {"cloth", "hot", "was", "bar", "thin", "thick", "dot", "ghost"}
    assert "1.5 times that of a flat plate" in meaning_of("air_drag", 1.8)


def test_a_page_holds_all_effects_each_with_its_sketch():
    every = [msgspec.structs.replace(diagnosis().effects[1], id=effect.name, closure=None) for effect in LIBRARY]
    page = render_report(fit=None, diagnosis=diagnosis(effects=every))
    assert page.count('<svg class="sketch"') == len(LIBRARY)
    assert all(sentence_of(effect.name) in html.unescape(page) for effect in LIBRARY)


def swung(seconds):
    """A take whose bottom swings farther than its hanger."""
    time = np.arange(0, seconds, 1 / 30)
    garment = sheet()
    down = np.array([-p.at_m[1] for p in garment.points])
    points = hung(garment, time) + swing(time)[:, None] * (1 + 2 * down)[:, None]
    points += np.random.default_rng(1).normal(0, 0.001, points.shape)  # frames that differ
    return take_of(garment, time, swing(time), points=points)


def test_a_passed_check_gives_no_order_and_a_failed_one_does():
    passed, failed = (data_gates([prepare(swung(seconds))], []) for seconds in (4.0, 2.0))
    shown = sections.gates(diagnosis(gates=passed))
    assert "at least 2.5 s are needed. <small>(length)</small>" in shown
    for gate in passed:
        assert gate.passed or gate.name == "calibration"
    orders = ("Record longer", "Swing it wider", "Swing faster", "leaves out frames")
    assert not [order for order in orders if order in shown]
    assert "Record longer" in sections.gates(diagnosis(gates=failed))


def test_the_garment_of_a_map_is_its_own_outline_and_not_the_hull_of_its_points():
    found = diagnosis().where.vertices
    trapeze = np.array([(-0.1, 0.0), (0.1, 0.0), (0.3, -0.4), (-0.3, -0.4)])
    assert 'points="-0.1000,-0.0000 0.1000,-0.0000 0.3000,0.4000 -0.3000,0.4000"' in charts.cloth_map(found, trapeze)
    assert "0.3000,0.4000" not in charts.cloth_map(found)


def test_the_page_closes_with_where_it_comes_from():
    origin = Origin(
        facts=[("Hangtime", "1.2.3"), ("command", "hangtime fit a.mcap")], takes=[("a", "fitted to", "f00d")]
    )
    page = render_report(fit=fit_result(), diagnosis=None, origin=origin)
    assert page.rindex("hangtime fit a.mcap") > page.rindex('id="reading"')
    assert "sha256 f00d" in page


def test_a_page_explains_its_own_words_and_no_others():
    """A fit has no gap and no p; a diagnosis has."""
    fitted, diagnosed = render_report(fit=fit_result(), diagnosis=None), render_report(fit=None, diagnosis=diagnosis())
    assert "<dt>Gap closed</dt>" not in fitted
    assert "<dt>90 % interval</dt>" in fitted
    assert "<dt>Gap closed</dt>" in diagnosed


def test_a_page_says_when_it_was_made_to_the_minute():
    assert "2026-03-01 12:00 UTC" in render_report(fit=fit_result(), diagnosis=None)
    assert instant("2026-03-01T14:05:59+02:00") == "2026-03-01 12:05 UTC"
    assert instant("once") == "once"


def test_an_effect_that_is_fitted_too_says_what_its_number_means():
    drag = FitParameter(name="air_drag", unit="1", initial=0.0, fitted=1.2, minimum=0.0, maximum=3.0, note="Air drag.")
    page = render_report(fit=msgspec.structs.replace(fit_result(), parameters=[drag]), diagnosis=None)
    assert "Drag coefficient in still air, 1 times that of a flat plate (1.2)." in page
    assert "Air drag." not in page


def test_a_rig_says_where_its_gravity_comes_from():
    """A rig without a calibrated gravity is accepted; depth to a fifth of a thousandth is not exact."""
    known = Calibration(depth_scale=1.0, depth_scale_sd=2e-4)
    instants = np.arange(0, 1, 1 / 30)
    rig = take_of(sheet(), instants, np.zeros((30, 3)), hung(sheet(), instants)).rig
    rig = msgspec.structs.replace(rig, calibration=known)
    assert _calibration(rig) == "gravity as the rig's file states; depth scale 1.0000 (± 0.02 %)"
    by_plumb = msgspec.structs.replace(known, gravity_from="plumb line")
    assert _calibration(msgspec.structs.replace(rig, calibration=by_plumb)).startswith("gravity from the plumb line;")


def test_names_from_outside_cannot_become_markup():
    evil = '</script><script>alert("x")</script><img src=x onerror=1>'
    result = fit_result()
    text = render_report(
        fit=result, diagnosis=diagnosis(sentence=evil), motions=[replace(motion(evil), point_names=(evil,) * 5)]
    )
    assert "<script>alert" not in text
    assert "<img" not in text
    assert text.count("</script>") == 2


def test_the_made_up_records_match_the_published_schemas(tmp_path):
    save_fit_result(tmp_path / "fit.json", fit_result())
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis())
    assert load_diagnosis(tmp_path / "diagnosis.json") == diagnosis()


def test_report_without_fit_or_without_diagnosis_or_without_both_is_still_a_page():
    for given in (
        {"fit": fit_result(), "diagnosis": None},
        {"fit": None, "diagnosis": diagnosis()},
        {"fit": None, "diagnosis": None},
    ):
        tags = Tags()
        tags.feed(render_report(**given))
        assert tags.open == []
    bare = render_report(fit=None, diagnosis=None)
    assert "<h1>Real and simulated motion, without a fit or a diagnosis.</h1>" in bare
    assert not any(
        f'<section id="{part}"' in bare for part in ("gap", "parameters", "effects", "where", "gates", "cost")
    )
    assert f"<h1>{diagnosis().sentence.partition('. ')[0]}." in render_report(fit=None, diagnosis=diagnosis())
    assert "stays 51.2 mm from the real cloth on average on motion not used to fit, against 131.0 mm" in render_report(
        fit=fit_result(), diagnosis=None
    )


def test_diagnosis_without_named_effect_or_force_shows_the_gap_alone():
    plain = diagnosis(verdict="unknown", named=[], missing_force=None, next_experiment=None, effects=[], gates=[])
    plain = msgspec.structs.replace(plain, gap=msgspec.structs.replace(plain.gap, with_effect_mm=None, closure=None))
    text = render_report(fit=None, diagnosis=plain)
    assert "cause unknown" in text
    assert 'class="gone"' not in text
    assert 'id="effects"' not in text
    assert 'id="force"' not in text


def test_motion_of_the_wrong_shape_is_refused():
    with pytest.raises(FitError, match="shape"):
        replace(motion(), runs={"base": Run(points=np.zeros((3, 5, 3)))})


def test_unwritable_folder_is_one_clear_sentence_and_leaves_nothing(tmp_path):
    with pytest.raises(FitError, match="cannot be written"):
        write_report(tmp_path / "nowhere" / "r.html", fit=None, diagnosis=None)
    (tmp_path / "r.html").mkdir()
    with pytest.raises(FitError, match="give another name: a folder has this one"):
        write_report(tmp_path / "r.html", fit=None, diagnosis=None)
    assert [p.name for p in tmp_path.iterdir()] == ["r.html"]


def test_numbers_keep_three_digits():
    assert [number(x) for x in (1.4e-5, 0.0467, 127.63, 0.0, None, float("nan"), -2.5e8)] == [
        "1.4 × 10⁻⁵", "0.0467", "128", "0", "–", "–", "−2.5 × 10⁸",
    ]  # fmt: skip
    assert interval((1.0, 2.345)) == "1 to 2.35"
    assert interval((0.0, float("inf"))) == ""
    assert percent(0.874) == "87 %"
    assert percent(-0.004) == "0 %"  # with no sign
    assert percent(-0.06) == "−6 %"
    assert (probability(2e-7), probability(0.0123), probability(0.64)) == ("< 0.001", "0.012", "0.64")


def test_a_named_effect_that_acts_in_one_region_says_where():
    slip = msgspec.structs.replace(diagnosis().effects[0], id="clip_slip", regions=["top left"])
    assert "Acts at the top left. " in effect_table([slip], ["clip_slip"])
    assert "Acts" not in effect_table([slip], [])
    assert "Acts" not in effect_table(diagnosis().effects, ["air_drag"])


def test_a_size_whose_interval_holds_zero_is_shown_as_that_interval_unless_its_effect_is_named():
    """The number between its ends says nothing, and may be very large."""
    hem = next(effect for effect in diagnosis().effects if effect.id == "hem")
    unnamed, named = (effect_table([hem], names) for names in ([], ["hem"]))
    assert "−0.001 to 0.009" in unnamed
    assert "0.004" not in unnamed
    assert "0.004" in named
    assert "−0.001 to 0.009" in named


def test_the_figures_at_the_top_hold_the_probability_of_a_named_effect_in_rows_of_like_length():
    page = html.unescape(render_report(fit=None, diagnosis=diagnosis()))
    assert "<dt>probability of air drag</dt><dd>94\u00a0%<small>that the model lacks the effect</small>" in page
    assert '<dl class="figures of-3">' in page  # of six figures


def test_a_missing_force_that_noise_hides_has_neither_picture_nor_figures():
    seen = diagnosis().missing_force
    hidden = msgspec.structs.replace(seen, odd_share=0.02, even_share=0.01, sentence="Noise hides it.")
    assert "grows with speed" in sections.missing_force(seen)
    assert sections.missing_force(hidden) == "<p>Noise hides it.</p>"


def test_a_gate_says_its_figures_in_its_sentence_alone():
    gate = Gate(name="clocks", passed=True, figure=0.0, limit=0.0, unit="takes", sentence="All go alike.")
    shown = sections.gates(diagnosis(gates=[gate]))
    assert "All go alike. <small>(clocks)</small>" in shown
    assert "0 takes" not in shown
    assert "limit" not in shown.split("All go alike.")[1]

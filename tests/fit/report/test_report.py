"""The report is one file that needs nothing else, says what the records say, and plays the motion it was given."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import zlib
from dataclasses import replace
from html.parser import HTMLParser

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.report import sections, write_report
from fit.report.motion import MESH_STEP, POINT_STEP, pack, pack_motions
from fit.report.page import render_report
from fit.report.tables import effect_table, parameter_table
from fit.report.text import interval, number, percent, probability
from formats.results import load_diagnosis, save_diagnosis, save_fit_result
from tests.fit.report.report_scene import diagnosis, fit_result, motion

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


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


def unpack(packed):
    """What the page's script does, in Python."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), np.uint8).astype(np.uint16)
    half = len(planes) // 2
    coded = planes[:half] | (planes[half:] << 8)
    change = ((coded >> 1) ^ -(coded & 1)).astype(np.int16).reshape(-1, packed["count"] * 3)
    whole = np.cumsum(change, axis=0, dtype=np.int16).reshape(len(change), -1, 3)
    return np.where(whole == -32768, np.nan, whole * packed["step"] + np.array(packed["centre"]))


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
    for figure in ("The model lacks air drag.", "12.3 mm", "5.2 mm", "4.1 mm", "87 %", "79 to 93 %", "127.6 → 46.7 mm",
                   "61.2", "5 to 80", "Not identified.", "1.02 to 1.6", "−0.006 to 0.002", "0.012", "16.2 mm",
                   "0.7 to 1.5 Hz", "83 %", "✗ failed", "912 simulations in 1.7 min", "Swing twice as fast",
                   "8.4 standard deviations, against 2.1 now", "best distance so far",
                   "Errors before and after"):  # fmt: skip
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


def test_what_a_fit_warns_of_stands_below_its_table():
    warned = msgspec.structs.replace(fit_result(), notes=["Warning: intervals <too> short.", "By hand."])
    table = sections.parameters(warned, None)
    assert "Warning: intervals &lt;too&gt; short." in table
    assert "By hand." not in table


def test_gap_bar_is_split_at_floor_and_at_what_the_effect_leaves():
    text = render_report(fit=None, diagnosis=diagnosis())
    row = re.search(r'<span class="name">base model</span><span class="track">(.*?)</span>', text).group(1)
    widths = {
        kind: float(width) for kind, width in re.findall(r'class="(\w+)" style="left:[\d.]+%;width:([\d.]+)%', row)
    }
    # 12.3 mm: 4.1 noise, 1.1 left, 7.1 removed
    assert widths["rest"] / widths["floor"] == pytest.approx(1.1 / 4.1, abs=0.01)
    assert widths["gone"] / widths["floor"] == pytest.approx(7.1 / 4.1, abs=0.01)


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


@pytest.mark.parametrize(("step", "limit"), [(POINT_STEP, 0.51e-4), (MESH_STEP, 2.51e-4)])
def test_packed_positions_come_back_within_half_a_step(step, limit):
    track = motion().mesh_after
    assert np.abs(unpack(pack(track, step)) - track).max() < limit
    assert np.abs(unpack(pack(track, step, 4)) - track[::4]).max() < limit


def test_hidden_points_come_back_hidden_and_thrown_ones_stay_finite():
    track = motion().real.copy()
    track[7, 1] = 1e9
    back = unpack(pack(track, POINT_STEP))
    assert np.array_equal(np.isnan(back), np.isnan(track))
    assert np.isnan(back).sum() == 12 * 3
    assert np.abs(back[8] - track[8]).max() < 1e-4


def test_motion_data_are_json_without_nan_and_with_all_frames(report):
    text = report.read_text(encoding="utf-8")
    data = re.search(r'<script type="application/json" id="motions">(.*?)</script>', text, re.S).group(1)
    motions = json.loads(data, parse_constant=lambda name: pytest.fail(name))
    assert [m["take_id"] for m in motions] == ["swing-01", "swing-02"]
    assert len(motions[0]["time"]) == len(unpack(motions[0]["real"])) == 180


def test_meshes_are_thinned_then_dropped_and_takes_left_out_to_keep_to_the_budget():
    three = [motion(f"swing-{k}") for k in range(3)]
    whole, note = pack_motions(three, 10_000_000)
    assert note == ""
    assert whole[0]["meshes"]["after"]["every"] == 1
    size = len(json.dumps(whole))
    thin, note = pack_motions(three, size // 2)
    assert len(json.dumps(thin)) <= size // 2
    assert thin[0]["meshes"]["after"]["every"] > 1
    bare, note = pack_motions(three, 20_000)
    assert len(json.dumps(bare)) <= 20_000
    assert "left out" in note or "first takes only" in note
    assert pack_motions(three, 10)[0] == []


def test_long_noisy_motion_stays_below_two_megabytes(tmp_path):
    noisy = motion(seconds=40.0)
    shaken = noisy.mesh_after + np.random.default_rng(1).normal(0, 0.01, noisy.mesh_after.shape)
    path = write_report(tmp_path / "r.html", fit=None, diagnosis=None, motions=[replace(noisy, mesh_after=shaken)] * 3)
    assert path.stat().st_size < 2_000_000


def test_motion_of_the_wrong_shape_is_refused():
    with pytest.raises(FitError, match="shape"):
        replace(motion(), after=np.zeros((3, 5, 3)))


def test_unwritable_folder_is_one_clear_sentence_and_leaves_nothing(tmp_path):
    with pytest.raises(FitError, match="cannot be written"):
        write_report(tmp_path / "nowhere" / "r.html", fit=None, diagnosis=None)
    (tmp_path / "r.html").mkdir()
    with pytest.raises(FitError, match="choose another folder"):
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


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize(
    ("address", "wanted"),
    [
        ("#t=1.4&view=side&run=before&cloth=wire", ("1.40 of 5.97 s", 4)),  # one corner is hidden then
        ("#t=0.5&motion=1", ("0.50 of 5.97 s", 5)),
    ],
)
def test_player_runs_in_a_browser_without_a_word_on_the_console(report, tmp_path, address, wanted):
    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-logging=stderr",
         f"--user-data-dir={tmp_path}", "--virtual-time-budget=5000", "--window-size=1200,900", "--dump-dom",
         f"{report.as_uri()}{address}"],
        capture_output=True, text=True, timeout=600, check=True,
    )  # fmt: skip
    assert "CONSOLE" not in done.stderr
    assert 'data-ready="yes"' in done.stdout
    assert wanted[0] in done.stdout
    shown = re.search(r"Mean error now ([\d.]+) mm over (\d) points", done.stdout)
    assert int(shown.group(2)) == wanted[1]
    frame, run = (42, "before") if "before" in address else (15, "after")
    by_hand = 1e3 * np.nanmean(motion().errors(run)[frame])
    assert float(shown.group(1)) == pytest.approx(by_hand, abs=0.15)  # positions are rounded to 0.1 mm
    # The darkest colour: the first round step that 95 % of the errors of all runs stay below.
    if "before" in address:
        every = np.concatenate([motion().errors(name)[::3].ravel() for name in ("before", "after", "with_effect")])
        quantile = np.quantile(every[np.isfinite(every)], 0.95, method="lower")
        steps = (0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5)
        worst = float(re.search(r'data-worst="([\d.]+)"', done.stdout).group(1))
        assert worst == next(step for step in steps if step >= quantile)


def test_a_named_effect_that_acts_in_one_place_says_where():
    slip = msgspec.structs.replace(diagnosis().effects[0], id="clip_slip", regions=["top left"])
    assert "Acts at the top left. " in effect_table([slip], ["clip_slip"])
    assert "Acts" not in effect_table([slip], [])
    assert "Acts" not in effect_table(diagnosis().effects, ["air_drag"])

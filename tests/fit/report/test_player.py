"""The report's player: compressed motion inside the page, and its decoding by a browser."""

from __future__ import annotations

import base64
import functools
import json
import re
import shutil
import subprocess
import zlib
from dataclasses import replace

import numpy as np
import pytest

from fit.report.motion import Run
from fit.report.packing import MESH_STEP, POINT_STEP, pack, pack_motions
from fit.report.page import render_report, write_report
from tests.fit.report.report_scene import diagnosis, fit_result, motion
from tests.repository import ROOT

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
PDFTOTEXT = shutil.which("pdftotext")  # poppler-utils
LOST = slice(100, 110)  # frames in which no free point of the second take is seen
# The page tells the frame that it is in how wide it is laid out, and what its player shows, once that is ready. Before
# that it is made ready for paper, and counts what stays folded away.
OUTPUT = """<script>
dispatchEvent(new Event("beforeprint"));
document.body.dataset.folded = document.querySelectorAll("details:not([open])").length;
dispatchEvent(new Event("afterprint"));
document.body.dataset.foldedAgain = document.querySelectorAll("details:not([open])").length;
setInterval(() => {
  const player = document.getElementById("player"), wide = document.documentElement.scrollWidth;
  if (player.dataset.ready) parent.postMessage([wide, player.outerHTML], "*");
}, 50);</script></body>"""
PHONE = """<body><iframe src="{address}" style="width:390px;height:800px;border:0"></iframe><script>
addEventListener("message", (event) => {{ [document.body.dataset.wide, told.innerHTML] = event.data; }});
</script><div id="told"></div></body>"""


SCENE = functools.cache(motion)


def lost_motion():
    """A held-out take in which no free point is seen for a third of a second."""
    real = motion().real.copy()
    real[LOST, 2:] = np.nan
    return motion("swing-02", is_held_out=True, real=real)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    page = render_report(fit=fit_result(), diagnosis=diagnosis(), motions=[motion(), lost_motion()])
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(page.replace("</body>", OUTPUT))
    return path


def unpack(packed):
    """What the page's script does, in Python."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), np.uint8).astype(np.uint16)
    half = len(planes) // 2
    coded = planes[:half] | (planes[half:] << 8)
    change = ((coded >> 1) ^ -(coded & 1)).astype(np.int16).reshape(-1, packed["count"] * 3)
    whole = np.cumsum(change, axis=0, dtype=np.int16).reshape(len(change), -1, 3)
    return np.where(whole == -32768, np.nan, whole * packed["step"] + np.array(packed["centre"]))


@pytest.mark.parametrize(("step", "limit"), [(POINT_STEP, 0.51e-4), (MESH_STEP, 2.51e-4)])
def test_packed_positions_come_back_within_half_a_step(step, limit):
    track = motion().runs["base"].mesh
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
    assert whole[0]["meshes"]["base"]["every"] == 1
    size = len(json.dumps(whole))
    thin, note = pack_motions(three, size // 2)
    assert len(json.dumps(thin)) <= size // 2
    assert thin[0]["meshes"]["base"]["every"] > 1
    bare, note = pack_motions(three, 20_000)
    assert len(json.dumps(bare)) <= 20_000
    assert "left out" in note or "first takes only" in note
    assert pack_motions(three, 10)[0] == []


def test_a_page_of_long_noisy_motion_stays_below_a_megabyte_and_a_half(tmp_path):
    noisy = motion(seconds=30.0)
    base = noisy.runs["base"]
    shaken = Run(points=base.points, mesh=base.mesh + np.random.default_rng(1).normal(0, 0.01, base.mesh.shape))
    three = [replace(noisy, runs={**noisy.runs, "base": shaken})] * 3
    path = write_report(tmp_path / "r.html", fit=fit_result(), diagnosis=diagnosis(), motions=three)
    assert path.stat().st_size < 1_500_000


def opened(page, address, folder):
    """The page after its scripts, as a browser makes it."""
    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-logging=stderr",
         f"--user-data-dir={folder}", "--virtual-time-budget=5000", "--window-size=1200,900", "--dump-dom",
         f"{page.as_uri()}{address}"],
        capture_output=True, text=True, timeout=600, check=True,
    )  # fmt: skip
    assert "CONSOLE" not in done.stderr
    assert 'data-ready="yes"' in done.stdout
    return done.stdout


def by_hand(frame, run):
    """Root mean square distance of the free points of a frame [mm]; the first two points are held."""
    scene = SCENE()
    apart = np.linalg.norm(scene.real[frame, 2:] - scene.runs[run].points[frame, 2:], axis=1)
    return 1e3 * np.sqrt(np.nanmean(apart**2))


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_player_begins_side_by_side_at_the_worst_frame_without_a_word_on_the_console(report, tmp_path):
    page = opened(report, "", tmp_path)
    worst = max(range(180), key=lambda frame: by_hand(frame, "base"))
    assert f"{motion().time[worst]:.2f} of 5.97 s" in page
    count = 2 if 40 <= worst < 52 else 3
    shown = re.search(
        r"Error now, base model: ([\d.]+)&nbsp;mm \(root mean square of (\d) free points\), largest ([\d.]+)&nbsp;mm "
        r"at [a-z ]+; with air drag: ([\d.]+)&nbsp;mm\.", page
    )  # fmt: skip
    assert int(shown[2]) == count
    assert float(shown[1]) == pytest.approx(by_hand(worst, "base"), abs=0.15)  # positions are rounded to 0.1 mm
    assert float(shown[4]) == pytest.approx(by_hand(worst, "with_effect"), abs=0.15)
    assert 'data-compare="both" aria-pressed="true"' in page
    assert 'data-folded="0"' in page
    assert int(re.search(r'data-folded-again="(\d+)"', page)[1]) > 2
    # The darkest colour: the first round step that 95 % of the errors of all runs stay below.
    every = np.concatenate([motion().errors(name).ravel() for name in motion().shown])
    every = every[np.isfinite(every)]
    quantile = np.quantile(every, 0.95, method="lower")
    steps = (0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5)
    worst = next(step for step in steps if step >= quantile)
    assert float(re.search(r'data-worst="([\d.]+)"', page)[1]) == worst
    more = " and more" if every.max() > worst else ""
    scale = re.search(r'<p class="ramp" data-part="ramp">error of the cloth: 0 <i></i> <span [^>]*>([^<]*)<', page)[1]
    assert scale == f"{1e3 * worst:.0f}&nbsp;mm{more}"


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_on_a_phone_nothing_scrolls_sideways_and_cloth_without_a_seen_point_is_see_through(report, tmp_path):
    phone = tmp_path / "phone.html"
    phone.write_text(PHONE.format(address=f"{report.as_uri()}#t=3.45&motion=1&run=fit&other=base&compare=ghost"))
    page = opened(phone, "", tmp_path / "profile")
    assert "3.43 of 5.97 s" in page
    assert "No free point is seen in this frame." in page
    assert 'data-bare="1.00"' in page
    assert 'data-run="fit" aria-pressed="true"' in page
    assert int(re.search(r'data-wide="(\d+)"', page)[1]) <= 390


def test_no_colour_of_the_errors_scale_is_grey_as_cloth_without_a_seen_point_is():
    """Light and dark page: from end to end of the scale, red and blue differ by a fifth of 255 at least."""
    style = (ROOT / "fit/report/page.css").read_text()
    ramps = list(zip(*(re.findall(rf"--{name}: #(\w{{6}})", style) for name in ("low", "high")), strict=True))
    assert len(ramps) == 2
    for ends in ramps:
        low, high = (np.array([int(end[k : k + 2], 16) for k in (0, 2, 4)]) for end in ends)
        shades = low + np.linspace(0, 1, 21)[:, None] * (high - low)
        assert np.ptp(shades, axis=1).min() > 255 / 5


@pytest.mark.skipif(CHROMIUM is None or PDFTOTEXT is None, reason="chromium or pdftotext is not installed")
def test_on_paper_no_heading_and_no_first_words_of_a_part_end_a_page(report, tmp_path):
    paper = tmp_path / "report.pdf"
    subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--no-pdf-header-footer",
         f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=5000", f"--print-to-pdf={paper}",
         report.as_uri()],
        capture_output=True, timeout=600, check=True,
    )  # fmt: skip
    text = subprocess.run([PDFTOTEXT, "-layout", paper, "-"], capture_output=True, text=True, check=True).stdout
    pages = [[" ".join(line.split()) for line in page.splitlines() if line.strip()] for page in text.split("\f")]
    pages = [lines for lines in pages if lines]
    assert 4 <= len(pages) <= 9
    found = re.findall(r'<p class="lead">(.*?)</p>|<h[23][^>]*>(.*?)</h[23]>', report.read_text(), re.DOTALL)
    first = [" ".join(re.sub("<[^>]*>", "", lead or title).split()) for lead, title in found]
    ends = [lines[-1] for lines in pages]
    assert [end for end in ends if any(end in words for words in first)] == []

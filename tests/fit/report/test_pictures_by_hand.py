"""The pictures of residuals and of errors over time: where each line, dot and word goes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.report import residual_picture as picture
from fit.report.plot import COLOURS, draw_plot
from fit.report.residual_picture import Views, _draw_chart, _draw_flat, _draw_row, _instants, _tangents
from tests.fit.report.report_scene import motion
from tests.fit.report.test_residual_picture import shifted


class Pen:
    """Notes what is drawn."""

    def __init__(self):
        self.lines, self.dots, self.boxes, self.words = [], [], [], []

    def line(self, places, fill, width=1):
        self.lines.append((np.array(places, float), fill))

    def ellipse(self, box, fill):
        self.dots.append((((box[0] + box[2]) / 2, (box[1] + box[3]) / 2), fill, box[2] - box[0]))

    def rectangle(self, box, outline):
        self.boxes.append(box)

    def text(self, at, words, fill):
        self.words.append((tuple(at), words, fill))


def views(frames=2):
    """Points at (0, 0.1, 0) and (0.4, 0.5, 0.2) m, seen 10 mm along and 20 mm down; the second not in frame 1."""
    simulated = np.tile([[0.0, 0.1, 0.0], [0.4, 0.5, 0.2]], (frames, 1, 1))
    along = np.tile([0.01, 0.02, 0.0], (frames, 2, 1))
    counted = np.ones((frames, 2), bool)
    counted[1:, 1] = False
    along[~counted] = np.nan
    return Views(np.arange(frames) + 10.0, simulated, simulated + along, along, counted)


def test_a_row_fits_all_of_its_frames_into_one_scale_and_joins_simulated_and_tracked_points():
    """0.41 m wide and 0.42 high, in 160 px less 20 and 210 less 40: 140 / 0.41 px a metre."""
    pen = Pen()
    _draw_row(pen, views(), [0, 1], (0, 1), 44, 160, "front")
    scale = 140 / 0.41
    assert pen.boxes == [[44, 44, 198, 248], [204, 44, 358, 248]]
    assert [(at, words) for at, words, _ in pen.words] == [((50, 48), "front, 10.0 s"), ((210, 48), "front, 11.0 s")]
    first = np.array([44 + 80 - scale * 0.205, 44 + 24])
    dots = [at for at, colour, _ in pen.dots if colour == picture.SIMULATED]
    assert dots[0] == pytest.approx(first)
    assert dots[1] == pytest.approx(first + scale * np.array([0.4, 0.4]))
    assert dots[2] == pytest.approx(first + np.array([160, 0]))
    assert len(dots) == 4
    assert [at for at, colour, _ in pen.dots if colour == picture.SEEN] == [
        pytest.approx(first + scale * np.array([0.01, 0.02])), pytest.approx(first + scale * np.array([0.41, 0.42])),
        pytest.approx(first + np.array([160, 0]) + scale * np.array([0.01, 0.02])),
    ]  # fmt: skip
    assert {size for _, _, size in pen.dots} == {3.0}
    for (line, colour), dot in zip(pen.lines, (0, 1, 2), strict=True):
        assert colour == picture.LINK_COLOUR
        assert line[0] == pytest.approx(dots[dot])
    tall = dataclasses.replace(views(), simulated=views().simulated * [0.1, 1, 1], seen=views().seen * [0.1, 1, 1])
    pen = Pen()
    _draw_row(pen, tall, [0], (0, 1), 44, 160, "front")
    assert pen.dots[2][0][1] - pen.dots[0][0][1] == pytest.approx(170 / 0.42 * 0.4)


def test_the_flat_cloth_shows_errors_along_and_down_from_the_points_places_and_unseen_points_in_grey():
    """0.3 m wide and 0.2 m high in 160 less 40 and 210 less 56 px: 400 px a metre."""
    pen = Pen()
    _draw_flat(pen, views(), [0, 1], np.array([[-0.1, 0.0], [0.2, 0.2]]), 464, 160)
    first = np.array([44 + 80 - 60, 464 + 30])
    assert pen.dots[0][0] == pytest.approx(first)
    assert pen.dots[1][0] == pytest.approx(first + np.array([4, 8]))
    assert pen.dots[2][0] == pytest.approx(first + np.array([120, 80]))
    seen, unseen = (picture.SIMULATED, picture.SEEN), (picture.FRAME,)
    assert [colour for _, colour, _ in pen.dots] == [*seen, *seen, *seen, *unseen]
    assert len(pen.lines) == 3


def test_the_chart_of_residuals_has_a_curve_of_each_direction_to_the_largest_error():
    """Errors of 10 along and 20 mm down in all frames: 20 mm is the top, 10 the middle, and nothing goes out."""
    pen = Pen()
    _draw_chart(pen, views(3), 682)
    left, right, bottom, top = 68, 1020, 682 + 190 - 24, 682 + 16
    levels = [line for line, colour in pen.lines if colour == picture.FRAME]
    assert [line[0].tolist() for line in levels] == [[left, bottom - k / 4 * (bottom - top)] for k in range(5)]
    assert levels[0][1, 0] == right
    shown = [words for _, words, _ in pen.words]
    assert shown[:5] == ["0 mm", "5 mm", "10 mm", "15 mm", "20 mm"]
    assert shown[5:10] == ["0 s", "0.5 s", "1 s", "1.5 s", "2 s"]
    assert shown[10:] == ["along the bar: 10.0 mm", "down the cloth: 20.0 mm", "out of the cloth: 0.0 mm"]
    curves = [line for line, colour in pen.lines if colour != picture.FRAME]
    across = [left, (left + right) / 2, right]
    for curve, height in zip(curves, ((top + bottom) / 2, top, bottom), strict=True):
        assert curve == pytest.approx(np.stack([across, [height] * 3], 1))
    pen = Pen()
    unseen = np.full((2, 2, 3), np.nan)
    _draw_chart(pen, Views(np.arange(2.0), unseen, unseen, unseen, np.zeros((2, 2), bool)), 682)
    assert [words for _, words, _ in pen.words][-1] == "out of the cloth: 0.0 mm"
    assert {colour for _, colour in pen.lines} == {picture.FRAME}
    assert "1 mm" in [words for _, words, _ in pen.words]  # the least top of the axis


def test_a_curve_of_residuals_breaks_where_no_point_is_seen():
    """Frames 3 and 4 of 8 show nothing: a line of three frames and one of three, and none across."""
    made, pen = views(8), Pen()
    along, counted = made.along.copy(), np.ones((8, 2), bool)
    along[:], counted[3:5] = [0.01, 0.02, 0.0], False
    along[~counted] = np.nan
    _draw_chart(pen, dataclasses.replace(made, along=along, counted=counted), 682)
    curves = [line for line, colour in pen.lines if colour == picture.DIRECTIONS[0][1]]
    assert [len(curve) for curve in curves] == [3, 3]


def test_each_row_of_residuals_names_its_axes_and_has_a_bar_of_100_mm(monkeypatch, tmp_path):
    pytest.importorskip("PIL")
    from PIL.ImageDraw import ImageDraw

    said, lines = [], []
    monkeypatch.setattr(ImageDraw, "text", lambda self, at, text, **more: said.append((text, at)))
    monkeypatch.setattr(ImageDraw, "line", lambda self, places, **more: lines.append(np.array(places, float)))
    recording, simulated = shifted((0.0, 0.004, 0.0))
    picture.draw_residuals(recording, simulated, tmp_path / "a.png")
    heads = {text.partition(":")[0]: at[1] for text, at in said if text.startswith(("Front:", "Side:", "In plane:"))}
    assert list(heads) == ["Front", "Side", "In plane"]
    assert [at[1] for text, at in said if text == "100 mm"] == list(heads.values())
    bars = [line for line in lines if line[0, 1] == line[1, 1] and line[1, 0] == picture.WIDTH - 70]
    assert len(bars) == 3
    places = np.array([point.at_m for point in recording.garment.points])
    wide, high = np.ptp(places, axis=0)
    scale = min(((picture.WIDTH - 44) // 6 - 40) / wide, (210 - 56) / high)
    assert bars[2][1, 0] - bars[2][0, 0] == pytest.approx(0.1 * scale)
    assert "Root mean square residual of the free points, mm, by direction" in [text for text, _ in said]


def test_an_instant_of_each_sixth_of_a_take_is_the_first_with_the_most_seen_points():
    counted = np.zeros((12, 3), bool)
    counted[[1, 4, 5, 6], 0] = True
    counted[5, 1] = True
    made = views(12)
    assert _instants(dataclasses.replace(made, counted=counted)) == [1, 2, 5, 6, 8, 10]
    assert _instants(dataclasses.replace(made, counted=counted[:4])) == [0, 1, 2, 3]


def test_down_is_from_the_bar_to_the_point_across_the_bar():
    found = _tangents(np.array([[[0.3, 0.3, 0.4], [0.1, 0.0, 0.0005], [0.0, -0.2, 0.0]]]))
    assert found == pytest.approx(np.array([[[0, 0.6, 0.8], [0, 1, 0], [0, -1, 0]]]))


def test_a_plot_has_levels_ticks_titles_and_curves_to_scale(monkeypatch, tmp_path):
    """Of 5.9 s with errors of 4 and 8 mm by turns: up to 8 mm, a tick each second, and a panel for each take."""
    pytest.importorskip("PIL")
    from PIL.ImageDraw import ImageDraw

    words, lines = [], []
    monkeypatch.setattr(
        ImageDraw, "text", lambda self, at, text, **more: words.append((tuple(at), text, more.get("fill")))
    )
    monkeypatch.setattr(
        "fit.report.plot.SoftLines.draw",
        lambda self, line, colour, width=1: lines.append((np.array(line, float), colour, width)),
    )
    made = motion(names=("base",), seconds=5.92, noise=0.0)
    real = np.zeros(made.real.shape)
    real[60:90] = np.nan
    off = np.zeros(real.shape)
    off[::2, :, 0], off[1::2, :, 0] = 0.004, 0.008
    run = dataclasses.replace(made.runs["base"], points=off)
    both = [dataclasses.replace(made, real=real, runs={"base": run}, is_held_out=held) for held in (False, True)]
    draw_plot(both, {"base": "base model"}, tmp_path / "a.png")
    half = len(words) // 2
    said = {text: at for at, text, _ in words[:half]}
    assert [text for _, text, _ in words[half:]][:5] == [text for _, text, _ in words[:half]][:5]
    assert [said[f"{k * 2} mm"] for k in range(5)] == [(74, round(292 - k / 4 * 220)) for k in range(5)]
    span = made.time[-1]
    for k in range(6):
        assert said[f"{k} s"] == pytest.approx((84 + k / span * 1092, 300))
    assert said["swing-01 (used to fit): root mean square distance of the free points"] == (84, 12)
    assert "swing-01 (held out): root mean square distance of the free points" in {text for _, text, _ in words}
    whole = 1e3 * np.sqrt(np.nanmean(np.where(np.isnan(real[:, 0, 0]), np.nan, off[:, 0, 0]) ** 2))
    assert said[f"base model: {whole:.1f} mm"] == (84, 38)
    levels = [line for line, colour, _ in lines if colour == "#dddddd"]
    assert [line.tolist() for line in levels[:5]] == [
        [[84, at], [1176, at]] for at in (round(292 - k / 4 * 220) for k in range(5))
    ]
    curves = [(line, width) for line, colour, width in lines if colour == COLOURS["base"]]
    assert [len(line) for line, _ in curves[:2]] == [60, len(made.time) - 90]
    assert {width for _, width in curves} == {3}
    assert curves[0][0][:2] == pytest.approx(np.array([[84, 182], [84 + made.time[1] / span * 1092, 72]]))
    bare = dataclasses.replace(both[0], real=np.full(real.shape, np.nan))
    draw_plot([bare], {"base": "base model"}, tmp_path / "b.png")
    assert "base model: no free point seen" in {text for _, text, _ in words}


def pixels_of(run, path):
    """The number of pixels of a plot's panel that have the colour of a run's curve."""
    from PIL import Image

    panel = np.asarray(Image.open(path).convert("RGB")).astype(int)[72:292]
    colour = [int(COLOURS[run][k : k + 2], 16) for k in (1, 3, 5)]
    return int((np.abs(panel - colour).sum(2) < 30).sum())


def test_a_fit_that_follows_the_base_model_hides_none_of_it(tmp_path):
    """Both curves coincide; each keeps a third of its pixels or more."""
    pytest.importorskip("PIL")
    made = motion("swing-01")
    runs = dict.fromkeys(("base", "fit"), made.runs["base"])
    draw_plot([dataclasses.replace(made, runs=runs)], {"base": "base model", "fit": "fit"}, tmp_path / "a.png")
    base, fit = (pixels_of(run, tmp_path / "a.png") for run in runs)
    assert min(base, fit) > 0.33 * (base + fit)
    draw_plot([dataclasses.replace(made, runs={"fit": runs["fit"]})], {"fit": "fit"}, tmp_path / "b.png")
    assert pixels_of("fit", tmp_path / "b.png") > 1.5 * fit


def test_the_points_places_are_drawn_from_the_top_of_the_cloth_down(monkeypatch, tmp_path):
    pytest.importorskip("PIL")
    recording, simulated = shifted((0.0, 0.004, 0.0))
    drawn = []
    monkeypatch.setattr(
        picture, "_draw_flat", lambda pen, views, frames, flat, top, width: drawn.append((flat, top, width)) or 1.0
    )
    picture.draw_residuals(recording, simulated, tmp_path / "a.png")
    ((flat, top, width),) = drawn
    places = np.array([point.at_m for point in recording.garment.points])
    assert flat == pytest.approx(np.stack([places[:, 0], places[:, 1].max() - places[:, 1]], 1))
    assert (top, width) == (44 + 2 * (24 + 210) + 24, (1200 - 44) // 6)

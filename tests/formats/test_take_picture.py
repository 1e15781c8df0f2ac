"""The picture of a take's motion shows the way in which most is moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from formats.figures import round_step
from formats.motion import axes_of
from formats.take_picture import LINE_COLOURS, MOST_DRAWN, draw_in_letters, draw_png, paths_of, well_spread
from tests.formats.test_archive import a_take
from tests.formats.test_motion import TIME, moved, turned


@pytest.mark.parametrize(
    ("way", "direction"), [("sideways", [1, 0, 0.3]), ("face-on", [0.3, 1, 0]), ("up-and-down", [0, 0.3, 1])]
)
def test_the_picture_shows_the_direction_of_most_motion(way, direction):
    """The points move with the bar; the named share of their motion is 0.05 m times a wave."""
    take = moved(direction)
    shown, names, paths = paths_of(take)
    assert shown == way
    assert names == ["held edge", "top left", "top right", "bottom right", "bottom left", "centre"]
    assert np.nanmax(np.abs(paths[:, 0])) == pytest.approx(0.05, rel=0.05)
    assert f"{way} over {TIME[-1] - TIME[0]:.1f} s" in draw_in_letters(take)


def test_axes_are_unit_vectors_square_to_each_other_with_gravity_down():
    axes = np.stack(list(axes_of(turned(0 * TIME)).values()))
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert axes == pytest.approx(np.eye(3))


LEFT, RIGHT, TOP, BOTTOM = 80, 800, 56, 484  # px of the frame in a picture of 960 x 540
GREY = (0xDD, 0xDD, 0xDD)


def coloured(name):
    return tuple(int(name[k : k + 2], 16) for k in (1, 3, 5))


def swaying(frames=73):
    """The held edge sways by 50 mm once in 2.4 s, p0 the other way, p1 is seen in the last quarter, p2 never."""
    take = a_take(frames)
    wave = 0.05 * np.sin(2 * np.pi * np.arange(frames) / (frames - 1))
    points = np.zeros((frames, 4, 3))
    points[:, 0, 0], points[:, 1, 0] = -wave, 0.02
    points[: 3 * frames // 4, 1] = points[:, 2] = np.nan
    points[-1, 1, 0], points[:, 3, 0] = -0.02, np.linspace(-0.03, 0.03, frames)
    held = np.zeros((frames, 2, 3))
    held[..., 0] = wave[:, None] + [-0.2, 0.2]
    return replace(take, time=np.arange(frames) / 30 + 5.0, held=held, points=points,
                   points_valid=np.isfinite(points).all(2))  # fmt: skip


def test_a_png_has_its_grid_its_paths_and_their_names_where_they_belong(tmp_path):
    image = pytest.importorskip("PIL.Image")
    take = swaying()
    way, _, paths = paths_of(take)
    assert way == "sideways"
    draw_png(take, tmp_path / "a.png")
    with image.open(tmp_path / "a.png") as file:
        assert (file.size, file.mode, file.format) == ((960, 540), "RGB", "PNG")
        seen = np.asarray(file).astype(int)
    assert {tuple(place) for place in seen[[0, -1]].reshape(-1, 3)} == {(255, 255, 255)}
    is_grey = (seen == GREY).all(2)
    rows, columns = is_grey[:, LEFT + 5 : RIGHT - 5].mean(1), is_grey[TOP + 5 : BOTTOM - 5].mean(0)
    assert np.flatnonzero(rows > 0.8).tolist() == [TOP, 163, 270, 377, BOTTOM]
    assert np.flatnonzero(columns > 0.8).tolist() == [LEFT, 230, 380, 530, 680, RIGHT]
    # After a quarter of the time the edge is at its height, and p0 at its depth, 50 mm either way of the middle.
    reach = np.nanmax(np.abs(paths))
    for path, colour in ((paths[:, 0], LINE_COLOURS[0]), (paths[:, 1], LINE_COLOURS[1])):
        for frame in (9, 18, 54, 63):
            x, y = LEFT + 720 * frame / 72, 270 - 214 * path[frame] / reach
            near = seen[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3].reshape(-1, 3)
            assert (near == coloured(colour)).all(1).any()
    late = (seen[TOP:BOTTOM, LEFT:RIGHT] == coloured(LINE_COLOURS[2])).all(2).any(0)
    assert np.flatnonzero(late)[0] == pytest.approx(720 * 54 / 72, abs=2)
    assert not (seen[TOP:BOTTOM, LEFT:RIGHT] == coloured(LINE_COLOURS[3])).all(2).any()
    for number in range(5):  # names stand beside the frame, one below the other, each in its path's colour
        beside = seen[TOP + 18 * number : TOP + 18 * number + 14, RIGHT + 12 :].reshape(-1, 3)
        ink = beside[beside.sum(1).argmin()]
        assert ink.sum() < 600
        assert min(LINE_COLOURS, key=lambda colour: np.abs(ink - coloured(colour)).sum()) == LINE_COLOURS[number]
    is_black = (seen < 60).all(2)
    for y in (TOP, 163, 270, 377, BOTTOM):
        assert is_black[y - 8 : y + 8, 8 : LEFT - 8].any()
    for x in (LEFT, 230, 380, 530, 680):  # every half second of 2.4 s
        assert is_black[BOTTOM + 8 : BOTTOM + 22, x - 12 : x + 20].any()
    for words, rows in (("title", slice(4, 24)), ("axis of distances", slice(TOP - 26, TOP - 8))):
        assert is_black[rows, 8:300].any(), words
        assert not is_black[rows, 700:].any(), words
    assert is_black[BOTTOM + 26 : BOTTOM + 42, 340:540].any()  # the axis of time


def test_a_picture_of_nothing_that_moves_and_of_many_points_is_drawn(tmp_path):
    """A dozen paths at most, each in a colour of its own."""
    image = pytest.importorskip("PIL.Image")
    for frames in (2, 1):
        still = {"held": np.zeros((frames, 2, 3)), "points": np.zeros((frames, 4, 3))}
        take = replace(a_take(frames), points_valid=np.ones((frames, 4), bool), **still)
        draw_png(take, tmp_path / f"still-{frames}.png")
        assert "+10 mm" in draw_in_letters(take)
    assert "over 1.0 s" in draw_in_letters(take)
    many = moved([1, 0, 0.3])
    wanted = min(1 + many.points.shape[1], MOST_DRAWN)
    draw_png(many, tmp_path / "many.png")
    with image.open(tmp_path / "many.png") as file:
        beside = np.asarray(file)[:, RIGHT + 12 :].astype(int)
    last = np.flatnonzero((beside != 255).any((1, 2)))[-1]
    assert (last - TOP) // 18 == wanted - 1


def test_of_many_points_the_corners_and_those_farthest_apart_are_drawn():
    """Of a grid of 9 x 9 the four corners are among eleven, and no two are neighbours."""
    places = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), -1).reshape(-1, 2)
    chosen = well_spread(places, 11)
    assert len(set(chosen)) == 11
    assert {0, 8, 72, 80} <= set(chosen)
    apart = np.linalg.norm(places[chosen][:, None] - places[chosen], axis=2)
    assert apart[~np.eye(11, dtype=bool)].min() > 2
    assert well_spread(places[:5], 11) == [0, 1, 2, 3, 4]


def test_the_steps_of_an_axis_are_round():
    assert [round_step(least) for least in (0.0471, 0.05, 0.48, 0.021, 1.01, 7)] == [0.05, 0.05, 0.5, 0.025, 2, 10]


def test_the_held_edge_is_dotted_and_the_lowest_point_drawn_through_and_the_picture_says_so():
    """The edge sways by 50 mm, and shows in every other letter; the lowest point, p0, sways the other way."""
    take = swaying(257)
    lines = draw_in_letters(replace(take, points=np.full_like(take.points, np.nan))).splitlines()
    both = replace(take, points=np.repeat(take.points[:, :1], 4, axis=1))
    for shown, step in ((lines, 2), (draw_in_letters(both).splitlines(), 1)):
        drawn = np.flatnonzero([any(line[10 + k] != "\u2800" for line in shown[:8]) for k in range(64)])
        assert drawn.tolist() == list(range(0, 64, step))
    assert lines[-1].strip() == "dotted: the held edge; drawn through: the lowest tracked point"


def test_every_line_has_a_colour_of_its_own():
    assert len(set(LINE_COLOURS)) == MOST_DRAWN == 12


def test_a_picture_of_a_take_in_which_nothing_was_seen_has_its_grid_alone(tmp_path):
    """Its scale is that of a take at rest."""
    image = pytest.importorskip("PIL.Image")
    take = a_take(5)
    unseen = {name: np.full_like(getattr(take, name), np.nan) for name in ("held", "points")}
    take = replace(take, **unseen, held_valid=np.zeros((5, 2), bool), points_valid=np.zeros((5, 4), bool))
    lines = draw_in_letters(take).splitlines()
    assert (lines[0].rstrip("\u2800 "), lines[7].rstrip("\u2800 ")) == ("   +10 mm", "   -10 mm")
    assert lines[9].endswith(" over 0.1 s, from each path's mean")
    draw_png(take, tmp_path / "a.png")
    with image.open(tmp_path / "a.png") as file:
        seen = np.asarray(file)[TOP + 5 : BOTTOM - 5, LEFT + 5 : RIGHT - 5].reshape(-1, 3)
    assert {tuple(place) for place in seen.tolist()} == {(255, 255, 255), GREY}


@pytest.mark.parametrize(
    ("noise", "words"), [(0.0, "at most 0.0 mm "), (0.0003, "at most 0.9 mm "), (0.002, "at most ")]
)
def test_the_noise_of_a_still_take_fills_no_plot(tmp_path, noise, words):
    """Paths of 3 mm or less at most fill a third of the axis; the axis and the words have their unit."""
    image = pytest.importorskip("PIL.Image")
    take = swaying(300)
    shake = np.random.default_rng(4).normal(0, noise, (300, 1, 3)).clip(-0.003, 0.003)
    take = replace(take, held=0 * take.held + [-0.2, 0, 0] + shake, points=np.repeat(shake, 4, 1),
                   points_valid=np.ones((300, 4), bool))  # fmt: skip
    rows = [line[10:] for line in draw_in_letters(take).splitlines()]
    labels = [line[:9].strip() for line in draw_in_letters(take).splitlines()]
    assert [label for label in labels if label] == ["+10 mm", "0 mm", "-10 mm"]
    drawn = [any(letter != chr(0x2800) for letter in row) for row in rows[:8]]
    assert not any(drawn[:2] + drawn[6:])
    assert rows[9].startswith(words)
    assert rows[9].endswith("mm sideways over 10.0 s, from each path's mean") or noise
    draw_png(take, tmp_path / "a.png")
    pixels = np.asarray(image.open(tmp_path / "a.png").convert("RGB")).astype(int)
    inside = pixels[TOP + 2 : BOTTOM - 2, LEFT + 1 : RIGHT - 1]
    rows_drawn = np.flatnonzero((np.ptp(inside, axis=2) > 60).any(1))  # neither white nor grey
    assert np.ptp(rows_drawn) < (BOTTOM - TOP) / 3 + 3  # and half a line's width at either end


def test_a_motion_of_a_centimetre_or_more_is_called_one():
    assert "motion sideways over" in draw_in_letters(swaying())
    assert "+50 mm" in draw_in_letters(swaying())

"""Each bound of the judgement of takes equals the fit's own: beyond it both refuse the take.

Before anything is simulated, a fit makes every take ready with `ready` and counts its half-seconds with `check_blocks`.
"""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.identification.free_intervals import blocks_of
from fit.recordings.ready import ready
from fit.search.intervals import check_blocks
from formats.garment import TrackedPoint
from formats.judgement import judge
from formats.rig import RigBody
from tests.fit.recordings.test_told_at_the_door import without_held
from tests.formats.test_judged_cloth import exchanged, of_markers, with_middle_of_edge
from tests.formats.test_judgement import swung, with_points
from tests.formats.test_judgement_sentences import imported, unseen


def frames(count):
    return swung(count / 30)


def seen_among(count, step):
    """A hanger at rest that shows in `count` frames, one of `step`."""
    take = swung(count * step / 30, reach=0.0)
    return without_held(take, np.arange(len(take.time)) % step != 0)


def sights(count):
    """One point below the held edge, in so many frames."""
    take = unseen(swung(), [2, 3])
    return unseen(take, [4], slice(count, None))


def after_a_gap(first):
    """Three points below the held edge, in so many frames before a gap, behind which nothing counts any more."""
    return without_held(swung(first / 30 + 3.4), slice(first, first + 27))


def moved(way):
    """A take whose hanger goes along its bar, way [m], (300,), and the cloth with it."""
    still = swung(10.0, reach=0.0)
    points = still.points + way[:, None, None] * [1.0, 0, 0]
    return imported(dataclasses.replace(with_points(still, points), markers=points[:, :2]))


def at_speed(speed):
    return moved(speed * swung(10.0).time)


def pulled(pull):
    """A hanger that goes evenly, turns round within a frame of 1/30 s, and goes back as fast."""
    return moved(pull / 60 * np.abs(swung(10.0).time - 5.0))


def with_bar_turned(seconds):
    """A hanger that is turned by 100 degrees while it is not seen."""
    take = imported(swung(10.0, reach=0.0))
    bar = take.held - take.held.mean(1, keepdims=True)
    angle = np.where(take.time < 5.0, 0.0, np.radians(100.0))[:, None]
    turned = np.stack([bar[..., 0] * np.cos(angle), bar[..., 1], bar[..., 0] * np.sin(angle)], 2)
    points = take.points.copy()
    points[:, :2] = take.held.mean(1, keepdims=True) + turned
    take = dataclasses.replace(with_points(take, points), markers=points[:, :2])
    return without_held(take, slice(150, 149 + round(30 * seconds)))


def at_nine_a_second(is_exchanged):
    """Slow enough for a hand: 0.4 m in 0.11 s are 3.6 m/s."""
    take = swung(8 / 3, reach=0.05)
    take = exchanged(take, slice(40, 45)) if is_exchanged else imported(take)
    return dataclasses.replace(take, time=take.time * 30 / 9)


def held_apart(apart):
    points = swung().points.copy()
    points[:, :2, 0] = points[:, :2, 0].mean(1, keepdims=True) + np.array([-apart / 2, apart / 2])
    return imported(with_points(swung(), points))


def hung_low(down):
    """The lower right corner is `down` below the right held end, 453 mm on the flat skirt."""
    points = swung().points.copy()
    points[:, 2] = points[:, 1] + [0.0, down, 0.0]
    return imported(with_points(swung(), points))


def before_a_wall(away):
    """The hanger swings in a plane, so far before a wall."""
    wall = RigBody(kind="plane", at_m=(0.0, 0.0, 1.6 + away), normal=(0.0, 0.0, -1.0))
    rig = msgspec.structs.replace(swung().rig, format="hangtime-rig/2", bodies=(wall,))
    return dataclasses.replace(swung(), rig=rig)


def between_clips(count):
    """A point between two held corners is seen in so many frames, and none below."""
    take = unseen(with_middle_of_edge(swung(), "corners"), [2, 3, 4])
    return unseen(take, [5], slice(count, None))


def with_strays(count):
    """Of 20 points so many are 60 cm too low, in every frame: a fit leaves out 5 % of the sightings, and no more."""
    take = swung(4.0)
    names = [TrackedPoint(name=f"p{k}", at_m=(0.0, -0.2)) for k in range(15)]
    garment = msgspec.structs.replace(take.garment, points=(*take.garment.points, *names))
    more = np.add(take.points[:, :2].mean(1, keepdims=True), [0.0, 0.2, 0.0])
    points = np.concatenate([take.points, more.repeat(15, 1)], 1)
    points[:, 2 : 2 + count, 1] += 0.6
    valid, sd = np.ones(points.shape[:2], bool), np.full(points.shape, 1e-3)
    return dataclasses.replace(with_points(take, points), garment=garment, points_valid=valid, points_sd=sd)


def sights_and_stray(count):
    """A point below the held edge is seen in so many frames, in one of them 60 cm too low."""
    take = sights(count)
    take.points[7, 4, 1] += 0.6
    return take


BOUNDS = {
    "frames": (frames, 30, 31),
    "sights of the hanger, one in three": (lambda count: seen_among(count, 3), 19, 20),
    "sights of the hanger, one in twelve": (lambda count: seen_among(count, 12), 19, 20),
    "sights of points": (sights, 19, 20),
    "sights between clips": (between_clips, 19, 20),
    "sights of points before a gap": (after_a_gap, 30, 31),
    "points far": (with_strays, 2, 1),
    "sights of points with a stray": (sights_and_stray, 20, 21),
    "speed [m/s]": (at_speed, 8.05, 7.95),
    "acceleration [m/s2]": (pulled, 151, 149),
    "time of a turn [s]": (with_bar_turned, 5 / 30, 6 / 30),
    "ends exchanged": (at_nine_a_second, True, False),
    "ends near [m]": (held_apart, 0.099, 0.101),
    "ends far [m]": (held_apart, 0.561, 0.559),
    "point far [m]": (hung_low, 0.627, 0.625),
    "wall [m]": (before_a_wall, -0.001, 0.001),
    "markers swapped": (lambda side: of_markers(swung(), swung().markers[:, ::side]), -1, 1),
}


def begin_fit(take):
    """What a fit checks of a take before it simulates."""
    check_blocks(np.concatenate(blocks_of(ready([take], []).training)))


@pytest.mark.parametrize("name", BOUNDS)
def test_a_take_that_a_fit_refuses_is_grave_and_one_that_it_takes_is_not(name):
    of, refused, taken = BOUNDS[name]
    with pytest.raises(FitError):
        begin_fit(of(refused))
    assert judge(of(refused))[0].is_grave
    begin_fit(of(taken))
    assert [one.name for one in judge(of(taken)) if one.is_grave] == []

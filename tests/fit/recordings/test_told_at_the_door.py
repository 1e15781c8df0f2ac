"""The judgement of takes reports the same faults for which a fit refuses a take."""

from __future__ import annotations

import contextlib
import dataclasses

import numpy as np
import pytest

from fit.errors import FitError
from fit.identification.free_intervals import blocks_of
from fit.recordings import geometry, recording
from fit.search.intervals import check_blocks
from formats.judgement import judge
from tests.formats.test_judged_cloth import exchanged, of_markers, turned
from tests.formats.test_judgement import swung, with_points, without_hanger
from tests.formats.test_judgement_sentences import imported, unseen

SECOND_HALF = slice(150, None)


def short_edge():
    points = swung(10.0).points.copy()
    points[:, :2, 0] = points[:, :2, 0].mean(1, keepdims=True) + np.array([-0.04, 0.04])
    return imported(with_points(swung(10.0), points))


def jumping():
    points = swung(10.0).points.copy()
    points[90:95, 0] += [0.0, 0.3, 0.0]
    return imported(with_points(swung(10.0), points))


def rushing():
    """At 9 m/s all the time, without any acceleration."""
    way = (9.0 * swung(10.0).time)[:, None, None] * [1.0, 0, 0]
    points = swung(10.0, reach=0.0).points + way
    return imported(dataclasses.replace(with_points(swung(10.0), points), markers=points[:, :2]))


def without_held(take, frames):
    """Both markers and ends are not seen."""
    held = take.held.copy()
    held[frames] = np.nan
    return dataclasses.replace(without_hanger(take, frames), held=held, held_valid=np.isfinite(held).all(2))


REFUSED = {
    "cloth once": lambda: unseen(swung(10.0), slice(None), np.arange(300) != 150),
    "cloth and hanger apart": lambda: unseen(without_held(swung(10.0), SECOND_HALF), slice(None), slice(0, 150)),
    "cloth only after a gap": lambda: unseen(
        without_held(swung(10.0), slice(90, 150)), slice(None), np.r_[0:90, 215:300]
    ),
    "ends exchanged": lambda: exchanged(swung(10.0), slice(90, 95)),
    "a jump": jumping,
    "faster than a hand": rushing,
    "a short edge": short_edge,
    "left is right": lambda: exchanged(swung(10.0), slice(None)),
    "oblique markers": lambda: of_markers(swung(10.0), turned(swung(10.0).markers, 30)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_take_that_a_fit_refuses_has_a_grave_finding(name):
    take = REFUSED[name]()
    with pytest.raises(FitError):
        geometry.check_geometry(recording.prepare(take))
    assert any(one.is_grave for one in judge(take))


@pytest.mark.parametrize(
    "take",
    [swung(1.1), swung(10.0), without_held(swung(10.0), slice(30, 60)), without_held(swung(10.0), slice(60, 170))],
    ids=["short", "whole", "hanger lost for a second", "hanger lost for long"],
)
def test_a_take_that_a_fit_takes_has_no_grave_finding(take):
    geometry.check_geometry(recording.prepare(take))
    assert not any(one.is_grave for one in judge(take))


@pytest.mark.parametrize("frames", [21, 29, 30, 31, 35, 45])
@pytest.mark.parametrize("lost", [slice(0, 0), slice(20, 45), slice(0, 20)], ids=["whole", "begin", "end"])
def test_a_take_with_too_few_half_seconds_is_refused_by_both_or_by_none(frames, lost):
    take = without_held(swung(90 / 30), np.r_[lost.start : lost.stop, lost.stop + frames : 90])
    is_told = any(one.is_grave and "intervals need 3 half-seconds" in one.words for one in judge(take))
    with pytest.raises(FitError, match="intervals need 3 half-seconds") if is_told else contextlib.nullcontext():
        check_blocks(np.concatenate(blocks_of([recording.prepare(take)])))

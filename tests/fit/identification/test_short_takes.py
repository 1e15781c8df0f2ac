"""A take that is too short by itself is fitted to beside a longer one, and the fit says so as `record` does."""

from __future__ import annotations

import pytest

from fit.errors import FitError
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import SI
from fit.recordings.intact import describe_short, flaw_notes
from formats.judgement import judge
from tests.fit.test_command_line import a_swung_take

SHORT = "Warning: the take short is too short to be fitted to by itself: {lack}."


def test_a_fit_warns_of_a_second_of_motion_in_the_words_of_record():
    short, longer = a_swung_take("short", hz=0.9, seconds=1.0), a_swung_take("long", seconds=3.0)
    (finding,) = [one for one in judge(short) if one.is_grave]
    lack = finding.words.partition("the take is too short: ")[2]
    assert lack == "intervals need 3 half-seconds of motion, and there are 2"
    request = request_of(SI, [], iterations=1, seed=1, spacing=0.15, search="annealing")
    with pytest.raises(FitError, match=f"the takes are too short: {lack}"):
        calibrate([short], [], request)
    result = calibrate([longer, short], [], request)
    assert flaw_notes(result.notes) == [SHORT.format(lack=lack)]
    assert flaw_notes(calibrate([longer], [short], request).notes) == []  # judged on: no interval comes from it


def test_a_take_of_three_half_seconds_is_not_warned_of():
    assert describe_short([a_swung_take("short", seconds=1.5)]) == []
    assert len(describe_short([a_swung_take("short", seconds=1.0), a_swung_take("b", seconds=1.0)])) == 2

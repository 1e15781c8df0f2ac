"""Repeated diagnosis of scored cases without the planted effect, with a stand-in for the diagnosis."""

from __future__ import annotations

import sys

import msgspec
import pytest

from fit.blind.cases import plan
from fit.blind.making import make_set, open_labels
from fit.blind.plants import PLANTS
from fit.blind.scoring import score_set
from fit.blind.striking import STRUCK, Struck, strike_set
from fit.effects import LIBRARY, library_without
from fit.errors import FitError
from formats.results import save_diagnosis
from tests.fit.blind.blind_answers import COARSE, NUMBERS, PLANTED, answer_rightly, diagnosis, finding

# Answers with the file that is named like the effect which the library is to lack.
STAND_IN = """
import pathlib, sys
words = sys.argv[1:]
assert words.count("--without") == 1
here, out = pathlib.Path(__file__).parent, pathlib.Path(words[words.index("--out") + 1])
(out / "diagnosis.json").write_bytes((here / (words[words.index("--without") + 1] + ".json")).read_bytes())
"""


@pytest.fixture(scope="module")
def scored(a_set):
    """The set of hem and time offset, both three times as large as can be seen, and its answers."""
    folder = a_set.parent
    answer_rightly(folder / "set", folder / "answers")
    (late,) = (t for t in open_labels(folder / "set").truths if [p.id for p in t.planted] == ["time_offset"])
    size = late.planted[0].amplitude
    alike = [finding("time_offset", size, size / 3), finding("filter_lag", size, size / 3, group="time_offset")]
    save_diagnosis(folder / "answers" / late.id / "diagnosis.json", diagnosis("effect", ["time_offset"], alike))
    score_set(folder / "set", folder / "answers")
    return folder / "set", folder / "answers"


def strike(scored, tmp_path, late, **more):
    (tmp_path / "diagnose.py").write_text(STAND_IN)
    save_diagnosis(tmp_path / "hem.json", diagnosis("unknown"))
    save_diagnosis(tmp_path / "time_offset.json", late)
    return strike_set(*scored, tmp_path / "out", command=[sys.executable, str(tmp_path / "diagnose.py")], **more)


def naming(verdict, names, probability):
    return diagnosis(verdict, names, [finding(name, probability=probability) for name in names])


@pytest.mark.parametrize(
    ("late", "said", "sure_and_wrong"),
    [
        (naming("effect", ["filter_lag"], 0.9), "twin", False),
        (naming("several", ["filter_lag", "clock_drift"], 0.9), "twin", True),
        (naming("several", ["filter_lag", "clock_drift"], 0.7), "twin", False),
        (naming("effect", ["clock_drift"], 0.9), "other", True),
        (naming("ambiguous", ["clock_drift", "filter_lag"], 0.4), "twin", False),
        (naming("several", ["clock_drift", "filter_lag"], 0.8), "other", True),
        (diagnosis("none"), "nothing", False),
        (diagnosis("unknown"), "unknown", False),
    ],
)
def test_verdicts_without_the_effect_are_counted(scored, tmp_path, late, said, sure_and_wrong):
    struck = strike(scored, tmp_path, late)
    assert [(c.planted, c.said) for c in struck.cases] == [("hem", "unknown"), ("time_offset", said)]
    assert [c.has_twin for c in struck.cases] == [False, True]
    assert struck.unknown.k == 1 + (said == "unknown")
    assert (struck.unknown.n, struck.unknown_without_twin.n, struck.unknown_without_twin.k) == (2, 1, 1)
    assert (struck.twin_named.k, struck.other_named.k, struck.nothing.k) == (
        said == "twin", said == "other", said == "nothing"
    )  # fmt: skip
    assert (struck.confident_and_wrong.k, struck.confident_and_wrong.n) == (sure_and_wrong, 2)
    assert struck.unknown_by_size.keys() == {"2 to 4"}
    assert msgspec.json.decode((tmp_path / "out" / STRUCK).read_bytes(), type=Struck) == struck


def test_only_large_effects_of_scored_answers_of_this_set_are_struck(scored, tmp_path):
    with pytest.raises(FitError, match=r"no case has one effect of 3\.5 times the smallest detectable amplitude"):
        strike(scored, tmp_path, diagnosis("none"), least=3.5)
    folder, answers = scored
    with pytest.raises(FitError, match="holds answers of the whole library"):
        strike_set(folder, answers, answers)
    with pytest.raises(FitError, match="the answers are not scored"):
        strike_set(folder, tmp_path, tmp_path / "out")
    make_set(tmp_path / "other", {"single": 0, "null": 1, "pair": 0, "unknown": 0}, PLANTED, 6, side=COARSE)
    with pytest.raises(FitError, match="the answers are of another set"):
        strike_set(tmp_path / "other", answers, tmp_path / "out")


def test_a_library_lacks_what_is_struck():
    left = library_without(["hem", "air_drag"])
    assert {e.name for e in LIBRARY} - {e.name for e in left} == {"hem", "air_drag"}
    with pytest.raises(FitError, match="no effect is left"):
        library_without([e.name for e in LIBRARY])


@pytest.mark.slow
def test_steps_of_a_ladder_hold_the_same_cases(tmp_path):
    numbers = {"single": 6, "null": 2, "pair": 1, "unknown": 1}
    drawn, given = plan(numbers, PLANTS, 3), plan(numbers, PLANTS, 3, sensor={"noise": 0.006, "away": 0.3, "rate": 120})
    for one, other in zip(drawn, given, strict=True):
        assert (other.look.noise, other.look.away, other.look.rate) == (0.006, 0.3, 120)
        look = msgspec.structs.replace(other.look, noise=one.look.noise, away=one.look.away, rate=one.look.rate)
        assert msgspec.structs.replace(other, look=look) == one
    make_set(tmp_path, {**NUMBERS, "pair": 0}, PLANTED, 5, side=COARSE)
    with pytest.raises(FitError, match="--seed and sensor as before"):
        make_set(tmp_path, {**NUMBERS, "pair": 0}, PLANTED, 5, side=COARSE, sensor={"rate": 30.0})

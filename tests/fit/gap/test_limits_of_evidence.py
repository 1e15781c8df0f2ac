"""Likelihood, evidence and the shares of errors at their limits, each against a figure worked by hand."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.gap import likelihood
from fit.gap.closure import BlockErrors, Resampling, block_errors
from fit.gap.correlation import Ringing
from fit.gap.detectable import MESH_SHARE
from fit.gap.edge_fit import LARGEST_AMPLITUDE, detectable_on_edge, leads
from fit.gap.likelihood import Likelihood, _root, _series_of_edges, shapes_of
from fit.gap.passing import is_brought
from fit.gap.rounds import RIVAL_SHARE, Rounds
from fit.gap.subsets import log_share
from fit.gap.verdict import Verdict
from fit.gap.weighed import LEAST_P_VALUE, decide_by_mass, limited, weigh
from fit.gap.where import find_where
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.test_gap_statistics import a_still_take
from tests.fit.gap.test_likelihood import NOISE, RINGING, SCALES, rows_of
from tests.fit.gap.test_rounds import a_search
from tests.fit.gap.test_weighed import found_of
from tests.fit.gap.verdict_scene import evidence_of, hypothesis
from tests.fit.scenes import hung, sheet, swing, take_of

TOP = slice(0, 3)  # points of a grid of three on the held edge


def seen(*hidden):
    """Two short takes, of which some hide the points on the held edge."""
    rng, recordings = np.random.default_rng(5), []
    for number, frames in enumerate((24, 21)):
        time, garment = np.arange(frames) / 30.0, sheet(grid=3)
        displacement = swing(time, start=0.0)
        points = hung(garment, time) + displacement[:, None] + rng.normal(0, NOISE, (frames, 9, 3))
        if number in hidden:
            points[:, TOP] = np.nan
        recordings.append(prepare(take_of(garment, time, displacement, points, sd=NOISE)))
    return Observer(recordings, SI, LIBRARY, frequency=0.0)


def sums_of(observer, monkeypatch):
    """Products of one motion of the cloth, without error of the held edge."""
    monkeypatch.setattr(likelihood, "ringing_of", lambda *_: RINGING)
    noise = [np.full(9, NOISE)] * 2
    found = Likelihood(observer, noise, np.zeros(len(observer.layout.take)), SCALES)
    rng = np.random.default_rng(1)
    row = rows_of(observer, [rng.normal(0, 2e-3, r.points.shape) for r in observer.recordings])
    row[observer.layout.is_edge] = 0.0
    return found.of(row[None])


def test_a_cloth_has_the_same_likelihood_whether_or_not_its_held_edge_is_seen(monkeypatch):
    whole, none = sums_of(seen(), monkeypatch), sums_of(seen(0, 1), monkeypatch)
    assert not seen(0, 1).layout.is_edge.any()
    assert none.inner == pytest.approx(whole.inner)
    assert none.log_det == pytest.approx(whole.log_det)


def test_a_take_without_a_held_edge_hides_none_of_the_next_take():
    observer = seen(0)
    assert [s.take for s in _series_of_edges(observer.layout, observer.recordings)] == [1]


def test_a_long_take_has_no_more_modes_than_fit_into_memory(monkeypatch):
    """24 frames of nine points with nine shapes each, twice: two modes of time, and one that is always there."""
    (recording, _) = seen().recordings
    monkeypatch.setattr(likelihood, "KEPT_VARIANCE", 1.0 - 1e-12)
    monkeypatch.setattr(likelihood, "FASTEST_MODE", 30.0)
    ringing = Ringing(decay=0.4, hertz=0.9, share=1.0)
    assert _root(recording, ringing).shape[-1] > 3 * 9
    monkeypatch.setattr(likelihood, "MOST_ENTRIES", 2.0 * 24 * 9 * 9)
    assert _root(recording, ringing).shape == (9, 24, 3 * 9)


def test_a_point_a_little_below_the_outline_moves_as_its_lower_edge_does():
    """A micrometre below a metre of cloth."""
    corners = [(-0.5, 0.0), (0.5, 0.0), (0.5, -1.0), (-0.5, -1.0)]
    places = [(0.0, -0.5), (0.0, -1.0), (0.0, -1.000001)]
    garment = SimpleNamespace(outline_m=corners, points=[SimpleNamespace(at_m=at) for at in places])
    _, edge, below = shapes_of(SimpleNamespace(garment=garment, judged=np.ones(3, bool)))
    assert below == pytest.approx(edge)


def test_a_half_second_in_which_one_point_was_seen_once_counts():
    recording = a_still_take(1e-3, rate=30)
    valid = recording.valid.copy()
    valid[105:] = False
    valid[110, 20] = True
    observer = Observer([dataclasses.replace(recording, valid=valid)], SI, (), frequency=0.0)
    errors = block_errors(observer, np.ones(len(observer.layout.take)))
    assert errors.counts[-1] == pytest.approx(1.0)
    assert errors.counts.sum() == pytest.approx(observer.layout.is_judged.sum() / 3)
    assert errors.between_blocks.shape == (len(errors.sums),) * 2


def test_draws_of_an_error_of_less_than_a_millimetre_scatter_about_it():
    """A tenth and three tenths of a mm^2 about a fifth, their distance doubled in logarithms: 0.05 and 0.45."""
    errors = BlockErrors(np.array([1.0, 3.0]), np.array([10.0, 10.0]), np.zeros(3))
    assert errors.draw(Resampling(np.array([[0, 0], [1, 1]]), 2.0)) == pytest.approx([0.05, 0.45])


def test_a_sheet_of_a_second_has_its_bands_by_its_frames():
    """31 frames at 30 a second resolve 0.97 Hz: three times that is below three hertz."""
    recording = a_still_take(0.0, rate=30, seconds=31 / 30 - 1e-6)
    assert len(recording.time) == 31
    observer = Observer([recording], SI, (), frequency=0.0)
    by = 0.004 * np.sin(2 * np.pi * 3 * np.arange(31) / 31)[:, None, None] * np.ones(recording.points.shape)
    found = find_where(observer, observer.residuals_of([(recording.points - by)[None]])[0])
    assert {b.name: b.share for b in found.frequency}["1.5 to 3 Hz"] == pytest.approx(1.0)


def test_shares_of_an_error_of_a_micrometre_add_up_to_one():
    recording = a_still_take(0.0, rate=30)
    observer = Observer([recording], SI, (), frequency=0.0)
    by = 1e-6 * np.random.default_rng(0).normal(size=recording.points.shape)
    found = find_where(observer, observer.residuals_of([(recording.points - by)[None]])[0])
    assert sum(b.share for b in found.term) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("low", "high", "mean", "covariance"),
    [
        ((-1.0, 0.0), (0.5, np.inf), (-0.2, 0.4), ((0.5, 0.5), (0.5, 1.0))),
        ((0.5, 0.5), (np.inf, np.inf), (0.0, 0.0), ((1.0, 0.9), (0.9, 1.0))),
    ],
)  # fmt: skip
def test_a_range_narrows_what_comes_after_it(low, high, mean, covariance):
    """Shares of 400,000 draws; the second of two correlated sizes is weighed after the first one's range has cut it."""
    drawn = np.random.default_rng(3).multivariate_normal(mean, covariance, 400_000)
    expected = np.mean(((drawn >= low) & (drawn <= high)).all(1))
    given = np.array([mean]), np.array(covariance)[None], np.array(low), np.array(high)
    assert float(np.exp(log_share(*given)[0])) == pytest.approx(expected, rel=0.01)


def test_nearly_equal_effects_far_beyond_their_range_have_a_share():
    """A thousand deviations below its range the first size has no spread left, which rounding makes less than none."""
    alike = 1.0 - 1e-9
    covariance = np.array([[1.0, alike], [alike, 1.0]])
    found = log_share(np.array([[-1e3, 0.0]]), covariance[None], np.array([0.0, -np.inf]), np.full(2, np.inf))
    assert found[0] == pytest.approx(-0.5e6, rel=1e-4)


@pytest.mark.parametrize(("size", "is_part"), [(0.5, True), (0.501, False)])
def test_an_effect_of_exactly_the_size_that_another_brings_is_part_of_it(size, is_part):
    one, other = (SimpleNamespace(name=n, components=("",), typical=1.0, brings=b) for n, b in (("a", ()), ("b", ())))
    one.brings = (("b", 0.5),)
    observer = SimpleNamespace(library={"a": one, "b": other}, columns={"a": slice(0, 1), "b": slice(1, 2)})
    fitted = SimpleNamespace(
        active=("a", "b"), vector=np.zeros(1), amplitudes=np.array([1.0, size]), deviation=np.zeros(3)
    )
    assert is_brought(observer, fitted, "b") == is_part


def test_an_effect_that_closes_exactly_seven_tenths_of_the_best_ones_share_is_no_further_start():
    """Of 144 mm^2 the best closes 100; the next one 70, or a little more."""
    search = a_search((12.0, 100.0), {"air_drag": (9.0, 40.0), "hem": (9.1, 41.0)})

    def closing(name, mm2):
        errors = BlockErrors(np.full(12, 10.0 * mm2), np.full(12, 10.0), np.zeros(3))
        return dataclasses.replace(hypothesis((name,), 9.0), errors=errors)

    search.base = dataclasses.replace(search.base, errors=closing("hem", 144.0).errors)
    best = closing("air_drag", 44.0)
    assert RIVAL_SHARE * (144.0 - best.errors.squared_mm) == 70.0
    for left, starts in ((74.0, []), (73.9, [("hem",)])):
        found = search._further_starts([best, closing("hem", left)])
        assert [one.effects for one in found] == starts


def test_an_effect_of_an_ambiguous_verdict_is_the_one_that_is_named_first():
    singles = {"hem": hypothesis(("hem",), 6.0), "air_drag": hypothesis(("air_drag",), 6.0)}
    search = SimpleNamespace(singles=singles, joint=[])
    assert Rounds.named(search, Verdict("ambiguous", ["air_drag", "hem"], "")) is singles["air_drag"]
    assert Rounds.named(search, Verdict("unknown", [], "")) is None


def test_error_of_exactly_what_the_mesh_may_make_is_worth_another_round(monkeypatch):
    """Half of 4^2 mm^2, beyond 25 of noise; of a gap of 10 mm^2 no share is that large."""
    numerics = 4.0
    errors = BlockErrors(np.full(12, 10.0 * (25.0 + MESH_SHARE * numerics**2)), np.full(12, 10.0), np.zeros(3))
    search = a_search((35.0**0.5, 100.0), {"air_drag": (5.0, 40.0)})
    search.singles["air_drag"] = dataclasses.replace(search.singles["air_drag"], errors=errors)
    tried = []
    monkeypatch.setattr(Rounds, "_further_starts", lambda self, order: [])
    monkeypatch.setattr(Rounds, "_with_another", lambda self, start, floor: tried.append(start.effects) or [])
    search.further_rounds(5.0, numerics)
    assert errors.squared_mm - 25.0 == MESH_SHARE * numerics**2
    assert tried == [("air_drag",)]


def test_a_fit_of_a_set_that_is_no_longer_weighed_is_not_the_likeliest():
    """Twins that are found later leave the sets that are weighed, and their fit stays among the fits."""
    evidence = evidence_of({"air_drag": 5.5, "hem": 6.0})
    found = found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)})
    found.fits[("hem",)] = None
    found.fits = dict(sorted(found.fits.items(), reverse=True))
    assert decide_by_mass(evidence, found).named == ["air_drag"]


def test_a_better_set_whose_gain_is_certain_keeps_finite_odds(monkeypatch):
    """A probability of nothing counts as 1e-300, of which the odds are e^691; the likelihood's were e^1000."""
    monkeypatch.setattr("fit.gap.weighed.gain_p_value", lambda errors, least, known: 0.0)
    monkeypatch.setattr("fit.gap.weighed.block_errors", lambda observer, residual: hypothesis((), 5.0).errors)
    monkeypatch.setattr("fit.gap.weighed.is_brought", lambda *given: False)
    found = found_of({(): (0.1, 0.0), ("air_drag",): (0.1, 0.0), ("hem",): (0.1, 0.0)})
    found.fits = {one: SimpleNamespace(residual=None) for one in found.fits}
    mass = dataclasses.replace(found.mass, known=np.array([-2000.0, 0.0, -1000.0]), wide=np.full(3, -3000.0))
    found.mass = mass
    after = limited(SimpleNamespace(), found)
    assert after.known[2] == pytest.approx(np.log(LEAST_P_VALUE))


def test_an_effect_leads_on_the_held_edge_only_if_it_moves_the_edge():
    """Neither air, which moves no edge, nor a clip that moved nothing; see `fit.gap.edge_fit.leads`."""
    observer = seen()
    on_edge = observer.layout.is_edge
    row = np.where(on_edge, 1.0, 0.0)
    given = {
        "air_drag": SimpleNamespace(raw=row[None]), "clip_slack": SimpleNamespace(raw=0.0 * row[None]),
        "time_offset": SimpleNamespace(raw=row[None]),
    }  # fmt: skip
    assert leads(observer, given, -3.0 * row) == ["time_offset"]


@dataclasses.dataclass
class Edge:
    """An error of the held edge of which all is shown."""

    moving: float

    @property
    def shown(self):
        return self.moving


def test_an_effect_that_would_have_to_be_a_thousand_typical_sizes_is_not_detectable_on_the_edge():
    """A typical size of 2 that shows a millionth, or a little more: 2000, or a little less."""
    effect = SimpleNamespace(moves_edge=True)
    layout = SimpleNamespace(is_edge=np.ones(4, bool), frame=np.zeros(4, int))
    screened = {"clip_slack": SimpleNamespace(raw=np.ones((1, 4)), typical=2.0)}
    for shown, size in ((1e-6, np.inf), (1.0001e-6, 1999.9)):
        observer = SimpleNamespace(
            library={"clip_slack": effect}, layout=layout, edge_errors=lambda row, shown=shown: Edge(shown)
        )
        assert detectable_on_edge(observer, observer, screened)["clip_slack"] == pytest.approx(size)
    assert LARGEST_AMPLITUDE * 2.0 == 2.0 / 1e-6**0.5


def test_each_refit_of_a_search_by_evidence_is_judged_once(monkeypatch):
    base, hem, pair = (SimpleNamespace(active=names, residual=None) for names in ((), ("hem",), ("air_drag", "hem")))
    asked = []
    search = SimpleNamespace(
        go=lambda tell: SimpleNamespace(fits={one.active: one for one in (base, hem, pair)}, mass=None)
    )
    for name, value in (
        ("Search", lambda *given: search), ("screen", lambda *given: {}), ("measured_noise", lambda *given: None),
        ("known_error_mm", lambda *given: 0.0),
        ("judged", lambda judge, fits: asked.extend(fits) or [SimpleNamespace(effects=one.active) for one in fits]),
    ):  # fmt: skip
        monkeypatch.setattr(f"fit.gap.weighed.{name}", value)
    rounds = SimpleNamespace(
        observer=None, base=SimpleNamespace(fitted=base), tested=[], judge=None, refit_alone=lambda names: None,
        keep_the_better=lambda: None,
    )  # fmt: skip
    weigh(rounds, None, None, ())
    assert asked == [hem, pair]

"""Screening and the sandwich on linear models whose truth is known: closed forms, level, power and coverage."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.gap.correlation import block_correlation, correlation_of, ringing_of
from fit.gap.fitting import Problem, sandwich
from fit.gap.screening import DETECTION, _correlation, block_scores, cosine, groups, screen, secants_of
from fit.methods import SI
from tests.fit.gap.linear_scene import FRAMES, LinearObserver, layout_of, white
from tests.fit.gap.verdict_scene import KINDS, like, signature

NONE = np.zeros((len(layout_of().take), len(SI.initial)))


def drawn(seed):
    return np.random.default_rng(seed)


def test_an_effect_explains_only_error_that_the_parameters_cannot_imitate():
    """r = -3 s + q, and s is one third of J's column and two thirds of a row at right angles, of equal length."""
    rng = drawn(0)
    raw = np.linalg.qr(rng.normal(size=(len(NONE), 3)))[0].T * 100.0
    along, beside, other = raw
    jacobian = NONE.copy()
    jacobian[:, 0] = along
    typical = KINDS["hem"].typical
    seen = np.sqrt(2 / 3) * beside + np.sqrt(1 / 3) * along
    observer = LinearObserver(-3.0 * seen + other, jacobian, {"hem": seen / typical})
    found = screen(observer, observer.fitted(), ("hem", "air_drag"))["hem"]
    assert found.amplitude[0] == pytest.approx(3.0 * typical, rel=1e-3)
    assert found.absorbed == pytest.approx(1 / 3, rel=1e-3)
    # Of 9 x 2/3 that are left beside the parameters, and 1 of something else: 6/7.
    assert found.explained == pytest.approx(6 / 7, rel=1e-3)
    assert found.predicted == pytest.approx(6 * 100.0**2, rel=1e-3)
    numbers = len(NONE)
    assert found.predicted_mm2 == pytest.approx(3 * 6 * 100.0**2 / numbers, rel=1e-3)
    assert found.correlation == pytest.approx(3 / np.sqrt(10), rel=1e-3)
    assert found.contribution @ found.contribution == pytest.approx(6 * 100.0**2, rel=1e-3)
    assert found.secant.rows[0] == pytest.approx(seen / typical)


def test_a_parameter_imitates_no_more_than_its_prior_lets_it():
    """Ridge regression of a column as long as its prior's row: half of an effect along it is left."""
    along = np.linalg.qr(drawn(5).normal(size=(len(NONE), 1)))[0].T[0]
    observer = LinearObserver(-300.0 * along, NONE.copy(), {"hem": 100.0 * along / KINDS["hem"].typical})
    observer.jacobian[:, 0] = along / Problem(observer).prior_sd[0]
    found = screen(observer, observer.fitted(), ("hem", "air_drag"))["hem"]
    assert found.projected[0] == pytest.approx(50.0 * along)
    assert found.absorbed == pytest.approx(0.75)
    assert found.amplitude[0] == pytest.approx(3.0 * KINDS["hem"].typical, rel=1e-3)


def test_a_one_sided_effect_that_would_have_to_be_negative_explains_nothing():
    rng = drawn(1)
    row = rng.normal(size=len(NONE))
    for sign, name, explains in ((1.0, "hem", False), (-1.0, "hem", True), (1.0, "clip_slack", True)):
        observer = LinearObserver(sign * row, NONE, {name: row / KINDS[name].typical})
        found = screen(observer, observer.fitted(), (name, "air_drag"))[name]
        assert (found.predicted > 0.0) == explains
        assert (found.amplitude[0] != 0.0) == explains
        assert (found.correlation > 0.0) == explains


def test_an_effect_that_moves_nothing_could_not_have_been_seen():
    rng = drawn(2)
    row = rng.normal(size=len(NONE))
    observer = LinearObserver(-row, NONE, {"hem": row / KINDS["hem"].typical})
    found = screen(observer, observer.fitted(), ("hem", *[e.name for e in LIBRARY[8:20]]))
    assert found["air_drag"].predicted == 0.0
    observer_block = observer.layout.block
    none = found["air_drag"].minimum_detectable(observer.missed, observer_block, np.eye(12))
    assert np.isinf(none).all()


def test_secants_are_taken_at_the_typical_size_on_both_sides_and_at_probes():
    """Residuals are linear here, so that every secant is the row itself; only those of probes are for one size."""
    row = drawn(3).normal(size=len(NONE))
    probed = next(e for e in LIBRARY if e.probes and not e.is_one_sided)
    observer = LinearObserver(0 * row, NONE, {probed.name: row, "air_drag": 2 * row})
    found = secants_of(observer, observer.fitted(), (probed.name, "air_drag"))
    assert len(found["air_drag"]) == 1
    assert len(found[probed.name]) == 1 + 2 * (1 + len(probed.probes))
    for secant in found[probed.name]:
        assert secant.rows[0] == pytest.approx(row)
    sizes = [secant.at for secant in found[probed.name]]
    assert sizes[0] == 0.0
    near = found[probed.name][1]
    assert [near.holds(np.array([share * near.at])) for share in (0.49, 0.51, 1.59, 1.61)] == [False, True, True, False]
    assert found[probed.name][0].holds(np.array([1e9]))


BLOCKS = 12


def test_scores_are_summed_by_block_before_they_are_judged():
    rows, residual = np.array([[1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 0.0, 1.0]]), np.array([1.0, -1.0, 2.0, 0.5])
    assert block_scores(rows, residual, np.array([0, 0, 2, 2])) == pytest.approx(
        np.array([[-1.0, -1.0], [0.0, 0.0], [8.0, 0.5]])
    )


def test_four_in_five_effects_of_the_detectable_size_are_found():
    """Power 0.8 of a one-sided test at 5 %: (1.645 + 0.842) deviations; the noise is white and of 1."""
    rng = drawn(6)
    row = rng.normal(size=len(NONE))
    observer = LinearObserver(white(rng), NONE, {"hem": row / KINDS["hem"].typical})
    found = screen(observer, observer.fitted(), ("hem", "air_drag"))["hem"]
    block = observer.layout.block
    sizes = [float(found.minimum_detectable(white(rng), block, np.eye(BLOCKS))[0]) for _ in range(40)]
    size = float(np.mean(sizes))
    assert size == pytest.approx(DETECTION * KINDS["hem"].typical / np.sqrt((row**2).sum()), rel=0.1)
    estimates = [-(row @ (white(rng) - size * row / KINDS["hem"].typical)) / (row @ row) for _ in range(400)]
    threshold = 1.645 / np.sqrt(row @ row)
    assert np.mean(np.array(estimates) > threshold) == pytest.approx(0.8, abs=0.06)
    alike = np.full((BLOCKS, BLOCKS), 1.0)
    wider = found.minimum_detectable(white(drawn(1)), block, alike) / found.minimum_detectable(
        white(drawn(1)), block, np.eye(BLOCKS)
    )
    assert wider == pytest.approx(np.sqrt(BLOCKS))


def test_of_two_components_each_has_its_own_detectable_size():
    rng = drawn(7)
    rows = np.stack([rng.normal(size=len(NONE)), 0.1 * rng.normal(size=len(NONE))]) / KINDS["gravity_tilt"].typical
    observer = LinearObserver(white(rng), NONE, {"gravity_tilt": rows})
    found = screen(observer, observer.fitted(), ("gravity_tilt", "air_drag"))["gravity_tilt"]
    along, across = found.minimum_detectable(white(rng), observer.layout.block, np.eye(BLOCKS))
    assert across / along == pytest.approx(10.0, rel=0.8)
    half = LinearObserver(white(rng), NONE, {"gravity_tilt": rows * [[1.0], [0.0]]})
    found = screen(half, half.fitted(), ("gravity_tilt", "air_drag"))["gravity_tilt"]
    assert np.isfinite(found.minimum_detectable(white(rng), observer.layout.block, np.eye(BLOCKS))).tolist() == [
        True,
        False,
    ]


def test_the_correlation_that_screening_uses_is_that_of_its_residual():
    time = np.arange(FRAMES) / 30
    layout = layout_of()
    slow = np.sin(2 * np.pi * 0.8 * time)[layout.frame]
    observer = LinearObserver(slow + 0.1 * white(drawn(0)), NONE, {})
    expected = block_correlation(layout, ringing_of(observer.by_place(observer.missed), 30.0))
    assert correlation_of(observer, observer.missed) == pytest.approx(expected)
    assert expected[0, 1] > 0.3


@pytest.mark.parametrize("size", [1.0, 1e-4])
def test_the_multiple_correlation_is_a_share_whatever_the_size_of_the_residual(size):
    """Of (3, 4, 12) the first two axes hold 5 of 13; a one-sided effect that would have to be negative has none."""
    rows, residual = np.eye(3)[:2], size * np.array([3.0, 4.0, 12.0])
    assert _correlation(rows, residual, False) == pytest.approx(5 / 13)
    assert _correlation(rows, -residual, True) == pytest.approx(5 / 13)
    assert _correlation(rows, residual, True) == 0.0


def test_effects_are_alike_by_what_they_would_explain():
    assert cosine(signature((3.0, 0.0)), signature((1.0, 1.0))) == pytest.approx(np.sqrt(0.5))
    assert cosine(signature((3.0, 0.0)), signature((0.0, 0.0))) == 0.0
    # Complete linkage: the third is like the first, but not like the second, which is of the first's group.
    chain = {"a": signature((1.0, 0.0)), "b": signature((0.95, 0.31)), "c": signature((0.95, -0.31))}
    assert groups(chain) == {"a": "a", "b": "a", "c": "c"}
    opposite = groups(like(hem=1.0, draught=0.2, anisotropy=-0.95))
    assert opposite == {"hem": "hem", "draught": "draught", "anisotropy": "hem"}


def test_the_sandwich_of_independent_numbers_is_the_textbook_variance_and_knows_of_blocks():
    """The mean of 400 numbers of deviation 1: 1/20, or 1/10 where four at a time are the same number."""
    rng, block = drawn(8), np.repeat(np.arange(100), 4)
    free, ones = np.array([1e6]), np.ones((400, 1))
    single = [sandwich(ones, rng.standard_normal(400), block, free)[0] for _ in range(20)]
    assert np.mean(single) == pytest.approx(0.05, rel=0.05)
    alike = [sandwich(ones, np.repeat(rng.standard_normal(100), 4), block, free)[0] for _ in range(20)]
    assert np.mean(alike) == pytest.approx(0.1, rel=0.05)
    # Two blocks that add up to nothing: sqrt(2 x 2 x 2^2) / 4 with one degree of freedom of two left.
    two = sandwich(np.ones((4, 1)), np.array([1.0, 1.0, -1.0, -1.0]), np.array([0, 0, 1, 1]), free)
    assert two[0] == pytest.approx(np.sqrt(2 * 8) / 4)
    # A prior as wide as the data's 1/20 halves the weight of the data, and so the deviation.
    held = sandwich(ones, np.tile([1.0, -1.0, 1.0, 1.0], 100), block, np.array([0.05]))
    assert held[0] == pytest.approx(sandwich(ones, np.tile([1.0, -1.0, 1.0, 1.0], 100), block, free)[0] / 2, rel=1e-3)


class Snapping(LinearObserver):
    """Residuals that are linear, and jump by one number wherever an effect is there at all."""

    jump = 0.0

    def residuals(self, vectors, amplitudes):
        return super().residuals(vectors, amplitudes) + self.jump * (amplitudes > 0).any(1)[:, None]


def test_secants_are_taken_where_an_effect_may_be_and_beside_its_smallest_size():
    """Of two components on both sides, of probes on both, of one-sided effects above; all within the range."""
    row = drawn(4).normal(size=len(NONE))
    observer = LinearObserver(0 * row, NONE, {"gravity_tilt": np.stack([row, 2 * row]), "clip_slack": row})
    found = secants_of(observer, observer.fitted(), ("gravity_tilt", "clip_slack", "hem", "hanger_compliance"))
    slack, compliance = KINDS["clip_slack"], KINDS["hanger_compliance"]
    sizes = [0.0, *(sign * size for size in (slack.typical, 0.003, 0.018) for sign in (1, -1))]
    assert [secant.at for secant in found["clip_slack"]] == pytest.approx(np.clip(sizes, slack.low, slack.high))
    assert len(found["gravity_tilt"]) == len(found["hem"]) == 1
    assert found["gravity_tilt"][0].rows == pytest.approx(np.stack([row, 2 * row]))
    assert [secant.at for secant in found["hanger_compliance"]] == pytest.approx([0.0, *compliance.probes])


def test_a_secant_begins_at_the_amplitude_that_the_fit_has():
    """Half a typical size of a one-sided and of a two-sided effect with two components: the row is the same there."""
    row = drawn(4).normal(size=len(NONE))
    observer = LinearObserver(0 * row, NONE, {"gravity_tilt": np.stack([row, 2 * row]), "hem": 3 * row})
    amplitudes = observer.off.copy()
    for name in ("gravity_tilt", "hem"):
        amplitudes[observer.columns[name]] = 0.5 * KINDS[name].typical
    residual = observer.residuals(observer.fitted().vector[None], amplitudes[None])[0]
    fitted = dataclasses.replace(observer.fitted(), amplitudes=amplitudes, residual=residual)
    found = secants_of(observer, fitted, ("gravity_tilt", "hem"))
    assert found["gravity_tilt"][0].rows == pytest.approx(np.stack([row, 2 * row]))
    assert found["hem"][0].rows[0] == pytest.approx(3 * row)


def test_an_effect_that_shortens_the_step_is_compared_with_its_smallest_size():
    """Contact of any size makes the step shorter and all residuals larger by 7: that is no signature of it."""
    row = drawn(4).normal(size=len(NONE))
    observer = Snapping(0 * row, NONE, {"self_contact": row, "hem": row})
    observer.jump = 7.0
    found = secants_of(observer, observer.fitted(), ("self_contact", "hem"))
    assert found["self_contact"][0].rows[0] == pytest.approx(row, rel=1e-3)
    assert found["hem"][0].rows[0] == pytest.approx(row + 7.0 / KINDS["hem"].typical)


def test_eight_effects_that_promise_most_are_taken_anew_where_all_are_known(monkeypatch):
    rng = drawn(11)
    names = [e.name for e in LIBRARY if len(e.components) == 1 and not e.probes and not e.no_size and not e.in_base]
    names = names[:10]
    rows = np.linalg.qr(rng.normal(size=(len(NONE), 10)))[0].T
    strengths = dict(zip(names, (3, 9, 1, 7, 5, 10, 2, 8, 6, 4), strict=True))
    given = {name: 100.0 * row / KINDS[name].typical for name, row in zip(names, rows, strict=True)}
    missed = -sum(strengths[name] * row for name, row in zip(names, rows, strict=True))
    observer = LinearObserver(missed, NONE, given)
    whole = screen(observer, observer.fitted(), names)
    asked = []
    monkeypatch.setattr(
        "fit.gap.screening.secants_of",
        lambda observer, fitted, chosen: asked.append(list(chosen)) or secants_of(observer, fitted, chosen),
    )
    again = screen(observer, observer.fitted(), names, whole)
    assert asked == [[name for name in names if strengths[name] > 2]]
    for name in names:
        assert again[name].predicted == pytest.approx(strengths[name] ** 2, rel=1e-3)


def test_at_the_end_of_an_effects_range_secants_are_taken_on_its_inner_side_alone():
    """A slack of 30 mm, the most there is: its typical size and both probes below, and none above."""
    row = drawn(4).normal(size=len(NONE))
    observer = LinearObserver(0 * row, NONE, {"clip_slack": row})
    amplitudes = observer.off.copy()
    amplitudes[observer.columns["clip_slack"]] = 0.03
    residual = observer.residuals(observer.fitted().vector[None], amplitudes[None])[0]
    fitted = dataclasses.replace(observer.fitted(), amplitudes=amplitudes, residual=residual)
    found = secants_of(observer, fitted, ("clip_slack",))["clip_slack"]
    assert [one.at for one in found] == pytest.approx([0.0, -0.008, -0.003, -0.018])
    for one in found:
        assert one.rows[0] == pytest.approx(row)

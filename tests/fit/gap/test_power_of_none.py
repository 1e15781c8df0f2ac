"""No gap is evidence that nothing is missing only where an effect of usual size would have made a gap."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.gap.closure import SIGNIFICANT_GAP, BlockErrors
from fit.gap.detectable import needed_mm2
from fit.gap.power import Power, imitated, power_of, shown_share
from fit.gap.verdict import decide, gap_numbers, no_gap
from tests.fit.gap.linear_cloth import EFFECTS, World, a_take, diagnosed, three_takes
from tests.fit.gap.verdict_scene import BLOCKS, KINDS, evidence_of, signature

ADVICE = {
    "imitate some": " Add takes that swing faster and slower, and hold one of them out.",
    "beside the noise": " Swing faster, or come nearer to the sensor.",
}
DAMPING = 4  # of the base parameters; in this world it moves the cloth as air drag does


@dataclasses.dataclass
class Slow(World):
    """A motion in which air drag moves the cloth as a base parameter does, but for the share `own` of its motion.

    - `in_all`: whether this holds for every take, or for the gentle ones, whose name begins with g, alone
    - `faint`: {effect: factor of its motion}
    """

    own: float = 0.1
    in_all: bool = True
    faint: dict[str, float] = dataclasses.field(default_factory=dict)

    def columns(self, recording):
        base, made = super().columns(recording)
        if self.in_all or recording.take_id.startswith("g"):
            drag = KINDS["air_drag"].typical
            alike = np.sqrt(1 - self.own**2) * self.effect / self.parameter * base[DAMPING]
            made["air_drag"] = (alike + self.own * made["air_drag"][0] * drag)[None] / drag
        for name, factor in self.faint.items():
            made[name] = factor * made[name]
        return base, made


def gentle(world, sizes):
    return [a_take("gentle", world, sizes, seed=4, noise=0.7e-3)]


@pytest.mark.parametrize("size", [0.0, 1.2])
def test_a_gentle_take_in_which_damping_imitates_drag_cannot_tell_whether_there_is_drag(size):
    """A typical drag moves the cloth by 4 mm, of which a tenth, 0.4 mm, is its own; the noise is 1.2 mm."""
    world = Slow(effect=4e-3)
    d = diagnosed(gentle(world, {"air_drag": size}), [], world).diagnosis
    assert (d.verdict, d.named) == ("inconclusive", []), d.sentence
    assert "These could not have been seen: air drag below " in d.sentence
    assert "imitate" in d.sentence
    drag = next(one for one in d.effects if one.id == "air_drag")
    assert drag.minimum_detectable > KINDS["air_drag"].typical
    assert f"air drag below {drag.minimum_detectable:.2g}" in d.sentence
    assert drag.absorbed > 0.95


def test_where_drag_moves_the_cloth_in_its_own_way_the_same_take_shows_that_there_is_none():
    world = Slow(own=0.9)
    d = diagnosed(gentle(world, {}), [], world).diagnosis
    assert (d.verdict, d.named) == ("none", []), d.sentence
    assert next(one for one in d.effects if one.id == "air_drag").minimum_detectable < KINDS["air_drag"].typical


def test_a_second_kind_of_motion_beside_the_gentle_one_shows_that_there_is_no_drag():
    world = Slow(in_all=False)
    training, held_out = three_takes(world, {})
    d = diagnosed([*gentle(world, {}), training[0]], held_out, world).diagnosis
    assert (d.verdict, d.named) == ("none", []), d.sentence
    assert "imitate" not in d.sentence


def test_where_noise_hides_most_effects_no_gap_says_nothing():
    """Five of eight effects move the cloth by 0.3 mm, beside a noise of 2.6 mm; three would show, or five in turn."""
    names = [effect.name for effect in EFFECTS]
    for count, verdict in ((5, "inconclusive"), (3, "none")):
        world = Slow(in_all=False, faint=dict.fromkeys(names[:count], 0.02))
        training, held_out = three_takes(world, {})
        d = diagnosed(training, held_out, world).diagnosis
        assert (d.verdict, d.named) == (verdict, []), d.sentence
        assert ("most effects of usual size would not show" in d.sentence) == (verdict == "inconclusive")


def test_most_effects_show_if_each_component_that_moves_anything_does():
    typical = {name: KINDS[name].typical for name in ("air_drag", "hem", "gravity_tilt", "self_contact")}
    sizes = {
        "air_drag": [0.9 * typical["air_drag"]], "hem": [1.1 * typical["hem"]], "self_contact": [np.inf],
        "gravity_tilt": [typical["gravity_tilt"], np.inf],
    }  # fmt: skip
    smallest = {name: np.array(given) for name, given in sizes.items()}
    assert shown_share(KINDS, smallest) == pytest.approx(2 / 3)
    smallest["gravity_tilt"][1] = 1.01 * typical["gravity_tilt"]
    assert shown_share(KINDS, smallest) == pytest.approx(1 / 3)
    assert shown_share(KINDS, {"self_contact": np.array([np.inf])}) == 1.0


def test_takes_that_show_half_of_the_effects_at_their_typical_sizes_show_most(monkeypatch):
    """Of drag and a hem; one whose smallest detectable size is the typical one is shown, and imitated by nothing."""
    evidence = evidence_of({"air_drag": 6.0, "hem": 6.0})
    evidence.observer.in_mm = lambda row: 2.0 * float(np.abs(row).max())
    for name in ("air_drag", "hem"):
        evidence.screened[name] = signature(projected=np.full((1, 3), 0.5))
    drag, hem = KINDS["air_drag"].typical, KINDS["hem"].typical
    for needed, sizes, reason in (
        (9.0, (drag, 1.1 * hem), ""),
        (9.0, (1.1 * drag, 1.1 * hem), "beside the noise"),
        (4.0, (drag, 1.1 * hem), "imitate some"),  # 2 mm are as much as the verdict requires
        (4.0, (drag, hem), ""),
    ):
        smallest = {"air_drag": np.array(sizes[:1]), "hem": np.array(sizes[1:])}
        monkeypatch.setattr("fit.gap.power.needed_mm2", lambda *given, needed=needed: needed)
        monkeypatch.setattr("fit.gap.power.smallest_detectable", lambda given, smallest=smallest: smallest)
        found = power_of(evidence)
        assert reason in found.reason
        assert (found.reason != "", found.advice) == (reason != "", ADVICE.get(reason, ""))
        told = zip(("air_drag", "hem"), sizes, strict=True)
        names = [KINDS[name].title for name, size in told if size > KINDS[name].typical]
        assert sorted(one.split(" below ")[0] for one in found.unseen) == sorted(names)


@pytest.mark.parametrize(
    ("names", "said"),
    [(["a"], "a"), (["a", "b", "c", "d"], "a, b, c, d"), (list("abcdefg"), "a, b, c, d and 3 more")],
)
def test_a_sentence_lists_four_components_and_counts_the_others(names, said):
    assert Power("", names).listed == said


@pytest.mark.parametrize("has_gap", [False, True])
@pytest.mark.parametrize("missed", [[], ["air drag below 2"]])
def test_no_gap_is_said_with_what_mesh_and_solver_hide_and_what_could_not_have_been_seen(monkeypatch, has_gap, missed):
    evidence = evidence_of({"air_drag": 5.0}, base=5.3)
    monkeypatch.setattr("fit.gap.verdict.power_of", lambda given: Power("", missed))
    hidden = " Mesh and solver may be wrong by 1.0 mm." if has_gap else ""
    unseen = " At their usual sizes, these takes could not have shown: air drag below 2." if missed else ""
    said = f"No gap: the base model explains the motion down to noise and mesh. {gap_numbers(evidence)}{hidden}{unseen}"
    assert no_gap(evidence, has_gap=has_gap).sentence == said


def test_effects_that_hardly_move_the_cloth_do_not_stop_none_and_are_named_in_its_sentence():
    """A hem and a draught of usual size move this cloth by 0.12 mm, beside a noise of 2.6 mm."""
    world = World()
    faint = Slow(in_all=False, faint={"hem": 0.02, "draught": 0.02})
    training, held_out = three_takes(faint, {})
    d = diagnosed(training, held_out, faint).diagnosis
    assert d.verdict == "none", d.sentence
    said = d.sentence.split("these takes could not have shown: ")[1]
    assert "hem below " in said
    assert "draught" in said
    assert "air drag" not in said
    training, held_out = three_takes(world, {})
    whole = diagnosed(training, held_out, world).diagnosis
    assert whole.verdict == "none"
    assert "could not have shown" not in whole.sentence


@pytest.mark.parametrize(
    ("raw", "own", "size", "is_imitated"),
    [
        (1.01, 0.99, 1.01, True),  # the motion excites it, and parameters hide it
        (0.99, 0.98, 1.01, False),  # the motion does not excite it
        (1.02, 1.01, 1.01, False),  # noise hides it, or another component of its own
        (1.01, 0.99, 0.99, False),  # the held edge shows it
        (1.01, 0.99, 1.0, False),  # just as large as what the held edge shows
        (9.0, 0.0, np.inf, False),  # nothing of it is left to be detected
    ],
)
def test_an_effect_is_imitated_if_it_moves_the_points_enough_and_parameters_hide_it(raw, own, size, is_imitated):
    """Enough is what the verdict requires, of all the motion and of that beyond parameters; sizes in typical ones."""
    evidence = evidence_of({"air_drag": 6.0})
    evidence.observer.in_mm = lambda row: float(np.abs(row).max())
    rows = np.sqrt(needed_mm2(evidence, "air_drag")) * np.ones((1, 3))
    evidence.screened["air_drag"] = signature(raw=raw * rows, projected=own * rows)
    found = imitated(evidence, {"air_drag": np.array([size * KINDS["air_drag"].typical])})
    assert bool(found) == is_imitated
    if is_imitated:
        assert found["air_drag"].tolist() == [size * KINDS["air_drag"].typical]


def test_only_the_components_that_are_imitated_are_told():
    """Of a tilt one component is imitated, and the other one moves nothing."""
    evidence = evidence_of({"gravity_tilt": 6.0})
    evidence.observer.in_mm = lambda row: float(np.abs(row).max())
    typical = KINDS["gravity_tilt"].typical
    evidence.screened["gravity_tilt"] = signature(
        raw=np.array([[9.0] * 3, [0.0] * 3]), projected=np.array([[0.1] * 3, [0.0] * 3])
    )
    found = imitated(evidence, {"gravity_tilt": np.array([2.0, 3.0]) * typical})["gravity_tilt"]
    assert found[0] == 2.0 * typical
    assert np.isnan(found[1])


@pytest.mark.parametrize(("most", "verdict"), [(1.02, "inconclusive"), (0.98, "none")])
def test_an_error_beyond_noise_and_mesh_that_few_half_seconds_hold_is_not_called_no_gap(most, verdict):
    """One half-second of twelve holds all that exceeds the noise, so that draws without it show no gap."""
    evidence = evidence_of({"air_drag": 5.0})
    limit = most * SIGNIFICANT_GAP * (evidence.floor_mm**2 + evidence.numerics_mm**2)
    quiet = 0.5 * evidence.floor_mm**2
    blocks = np.where(np.arange(BLOCKS) == 0, BLOCKS * limit - (BLOCKS - 1) * quiet, quiet)
    errors = BlockErrors(10.0 * blocks, np.full(BLOCKS, 10.0), np.zeros(3))
    assert errors.squared_mm == pytest.approx(limit)
    found = decide(dataclasses.replace(evidence, base=dataclasses.replace(evidence.base, errors=errors)))
    assert (found.verdict, found.named) == (verdict, [])
    assert ("differs too much between half-seconds" in found.sentence) == (verdict == "inconclusive")

"""The state machine: the documentation's table agrees with the code."""

from __future__ import annotations

import re
from pathlib import Path

from capture.appliance import showing
from capture.appliance.showing import Light, lamp_signal
from capture.appliance.states import TRANSITIONS, Event, State, StateMachine
from docs.generator.appliance_states import SHORT, picture

REFERENCE = (Path(__file__).parents[3] / "docs/reference/appliance.md").read_text()


def test_the_reference_draws_the_table_that_the_code_follows():
    lines = ["| state | what happens | state afterwards |", "|---|---|---|"]
    lines += [
        f"| {before.name.lower()} | {event.value} | {after.name.lower()} |"
        for (before, event), after in TRANSITIONS.items()
    ]
    assert "\n".join(lines) + "\n" in REFERENCE


def test_the_drawing_has_an_arrow_for_each_way_of_the_table_and_its_events_beside_it():
    drawn = picture()
    ways = {(before, after) for (before, _), after in TRANSITIONS.items()}
    assert drawn.count("<line ") == len(ways)
    assert all(f">{state.name.lower()}<" in drawn for state in State)
    labels = " ".join(re.findall(r"<text[^>]*>([^<]*)<", drawn)).replace(",", "")
    told = [SHORT[event] for _, event in TRANSITIONS]
    assert sum(labels.count(word) for word in set(told)) >= len(told)
    assert "<!-- generated: appliance states -->" in REFERENCE


def test_every_state_can_be_left_and_reached_from_starting():
    assert {before for before, _ in TRANSITIONS} == set(State)
    reached = {State.STARTING}
    for _ in State:
        reached |= {after for (before, _), after in TRANSITIONS.items() if before in reached}
    assert reached == set(State)


def test_a_recording_leaves_only_by_way_of_saving():
    assert {after for (before, _), after in TRANSITIONS.items() if before is State.RECORDING} == {State.SAVING}
    assert {event for before, event in TRANSITIONS if before is State.SAVING} == {Event.SAVED}


def test_an_event_that_the_table_does_not_name_changes_nothing():
    machine = StateMachine()
    assert not machine.take(Event.STOP)
    assert machine.state is State.STARTING
    assert not machine.may_record
    assert machine.take(Event.SOUND)
    assert machine.may_record


def test_each_state_has_a_light_of_its_own_and_the_reference_lists_it():
    calm = {"is_tracking": True, "behind_s": 0.0, "kept_ago_s": 99.0, "has_complaint": False}
    shown = {state: lamp_signal(state, **calm) for state in State}
    assert len(set(shown.values())) == len(State)
    lights = [one for one in vars(showing).values() if isinstance(one, Light)]
    assert len(lights) == 11
    for light in lights:
        rhythm = f"{light.light_ms} ms light, {light.dark_ms} ms dark" if light.dark_ms else "steady"
        assert f"| {light.name} | {rhythm}" in REFERENCE


def test_green_without_a_pause_is_never_shown_while_two_seconds_are_not_on_the_disk():
    late = {"is_tracking": True, "behind_s": 2.1, "kept_ago_s": 99.0, "has_complaint": False}
    assert lamp_signal(State.RECORDING, **late).dark_ms > 0
    assert lamp_signal(State.RECORDING, **late | {"behind_s": 1.9}).dark_ms == 0

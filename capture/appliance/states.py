"""The state machine of the appliance: the table of states, events and transitions.

An event without a transition from the current state changes nothing.
"""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """The appliance's state; the interface shows each value."""

    STARTING = "starting: the sensor is being opened"
    READY = "ready: waiting for the hanger to come into view"
    ARMED = "armed: the hanger is in view and the last seconds before a press are held"
    RECORDING = "recording"
    SAVING = "saving: the end of the take is being put on the disk"
    SYNCING = "syncing: takes are on their way to the server"
    FAULT = "fault: nothing can be recorded until it is mended"


WITH_TAKE = (State.RECORDING, State.SAVING)  # while a take is on its way to the disk


class Event(Enum):
    """The events that cause transitions."""

    SOUND = "sensor and spool are sound"
    FAULTY = "sensor or spool fails"
    HANGER_SEEN = "hanger comes into view"
    HANGER_GONE = "hanger is out of view for a while"
    START = "button or `hangtime start`"
    STOP = "button, `hangtime stop`, longest take, or shutdown"
    SAVED = "the take is kept, or nothing of it could be"
    SYNC_BEGAN = "sync begins to send"
    SYNC_ENDED = "sync has ended"


S, E = State, Event
TRANSITIONS: dict[tuple[State, Event], State] = {
    (S.STARTING, E.SOUND): S.READY,
    (S.STARTING, E.FAULTY): S.FAULT,
    (S.READY, E.HANGER_SEEN): S.ARMED,
    (S.READY, E.START): S.RECORDING,
    (S.READY, E.SYNC_BEGAN): S.SYNCING,
    (S.READY, E.FAULTY): S.FAULT,
    (S.SYNCING, E.SYNC_ENDED): S.READY,
    (S.SYNCING, E.HANGER_SEEN): S.ARMED,
    (S.SYNCING, E.START): S.RECORDING,
    (S.SYNCING, E.FAULTY): S.FAULT,
    (S.ARMED, E.HANGER_GONE): S.READY,
    (S.ARMED, E.START): S.RECORDING,
    (S.ARMED, E.FAULTY): S.FAULT,
    (S.RECORDING, E.STOP): S.SAVING,
    (S.RECORDING, E.FAULTY): S.SAVING,
    (S.SAVING, E.SAVED): S.READY,
    (S.FAULT, E.SOUND): S.READY,
}


class StateMachine:
    """The appliance's current state."""

    def __init__(self) -> None:
        self.state = State.STARTING

    def take(self, event: Event) -> bool:
        """Apply an event; return whether it caused a transition."""
        after = TRANSITIONS.get((self.state, event))
        if after is None:
            return False
        self.state = after
        return True

    @property
    def may_record(self) -> bool:
        """Return whether a press of the button would begin a take."""
        return (self.state, Event.START) in TRANSITIONS

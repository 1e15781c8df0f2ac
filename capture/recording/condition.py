"""The current condition of a recording: the one message for the lamp and the command line.

The bits of a frame (`formats.take.FrameState`) may be set in any combination and change with every frame. A frame's
condition is its most basic fault. An announced condition stays until no frame has shown it for `HOLD` seconds, so that
a lamp does not flicker. The next condition is the most frequent one since then. So alternating faults are announced as
well.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum

from formats.take import FrameState

HOLD = 0.4  # s without the announced condition: longer than markers are lost at the end of a hard swing
RECORD_AGAIN = "record the file again"


class Lamp(Enum):
    """The lamp's signal of a condition; a lamp of one colour shows the blinking only."""

    STEADY = "green, steady"
    SLOW = "yellow, one blink a second"
    FAST = "red, four blinks a second"


@dataclass(frozen=True)
class Saying:
    """A condition in words, the next action, and the lamp's signal.

    of_file: next action where the frames come from a recording, '' for `advice`
    """

    words: str
    advice: str
    lamp: Lamp
    of_file: str = ""

    def next_step(self, *, is_live: bool) -> str:
        """Return the next action for frames of a live sensor, or of a recording."""
        return self.advice if is_live else self.of_file or self.advice


class Condition(Enum):
    """The conditions, the most basic first."""

    WRONG_SIZE = Saying(
        "pictures of another size than the rig's",
        "set the rig's [sensor] to what `hangtime sensor play` says",
        Lamp.FAST,
    )
    CLOCK = Saying(
        "the sensor's clock runs backwards or leaps", "unplug and replug the sensor", Lamp.FAST, RECORD_AGAIN
    )
    NO_DEPTH = Saying(
        "no depth", "uncover the sensor, keep the sun out, replug it", Lamp.FAST,
        f"{RECORD_AGAIN} with the sensor uncovered and out of the sun",
    )  # fmt: skip
    NO_COLOUR = Saying(
        "no colour picture", "replug the sensor; without colour no marker is found", Lamp.FAST,
        f"{RECORD_AGAIN} with colour, without which no marker is found",
    )  # fmt: skip
    BLOCKED = Saying("something is in front of the hanger or the garment", "step out of the view", Lamp.SLOW)
    TOO_NEAR = Saying("too near", "go back until the hanger is 1.2 to 2.5 m away", Lamp.SLOW)
    TOO_FAR = Saying("too far", "come closer until the hanger is 1.2 to 2.5 m away", Lamp.SLOW)
    ONE_MARKER = Saying("only one marker is seen", "turn the hanger so that both markers face the sensor", Lamp.SLOW)
    SEEN_TWICE = Saying(
        "a marker of the hanger is seen more than once", "leave only the hanger's own markers in view", Lamp.SLOW
    )
    NO_MARKERS = Saying(
        "no markers are seen", "show both markers to the sensor, flat, in even light, 1.2 to 2.5 m away", Lamp.SLOW
    )
    MISFIT = Saying(
        "both markers are read, but depth and the rig's sizes contradict each other",
        "check that depth comes in millimetres; measure marker_size_m and marker_distance_m of the rig again; keep "
        "sun and gloss off the markers", Lamp.SLOW,
    )  # fmt: skip
    NO_GARMENT = Saying(
        "the garment is not seen", "let it hang free below the hanger, away from walls and things", Lamp.SLOW
    )
    GOOD = Saying("hanger and garment are seen", "", Lamp.STEADY)


CONDITIONS_BY_STATE = (
    (FrameState.WRONG_SIZE, Condition.WRONG_SIZE),
    (FrameState.DEPTH_MISSING, Condition.NO_DEPTH),
    (FrameState.COLOUR_MISSING, Condition.NO_COLOUR),
    (FrameState.VIEW_BLOCKED, Condition.BLOCKED),
    (FrameState.TOO_NEAR, Condition.TOO_NEAR),
    (FrameState.TOO_FAR, Condition.TOO_FAR),
    (FrameState.ONE_MARKER, Condition.ONE_MARKER),
    (FrameState.MARKER_LOST, Condition.NO_MARKERS),
    (FrameState.GARMENT_LOST, Condition.NO_GARMENT),
)


def condition_of(state: int, *, are_read: bool = False) -> Condition:
    """Return the most basic condition of a frame's bits; a single jump of the clock does not affect detection.

    are_read: both markers were decoded in the image, with or without a position
    """
    found = next((condition for bit, condition in CONDITIONS_BY_STATE if state & bit), Condition.GOOD)
    return Condition.MISFIT if found is Condition.NO_MARKERS and are_read else found


class ConditionWatch:
    """Derives the announced condition from the conditions of the frames."""

    def __init__(self) -> None:
        self.current: Condition | None = None
        self.frames: Counter[Condition] = Counter()
        self._others: Counter[Condition] = Counter()  # since the last frame of `current`
        self._since = 0.0

    def add(self, time: float, condition: Condition) -> Condition | None:
        """Add a frame's condition at a time [s]; return the condition to announce, None if unchanged.

        The first frame's condition is announced at once.
        """
        self.frames[condition] += 1
        if condition is self.current:
            self._others.clear()
            return None
        if not self._others:
            self._since = time
        self._others[condition] += 1
        if self.current is not None and time - self._since < HOLD:
            return None
        self.current = self._most_seen()
        self._others.clear()
        return self.current

    def _most_seen(self) -> Condition:
        """Return the most frequent recent fault, the most basic of equals; none if most frames have none."""
        if 2 * self._others[Condition.GOOD] > self._others.total():
            return Condition.GOOD
        return max((one for one in Condition if one is not Condition.GOOD), key=lambda one: self._others[one])

    @property
    def worst(self) -> Condition:
        """Return the fault of most frames."""
        faults = [(condition, count) for condition, count in self.frames.most_common() if condition != Condition.GOOD]
        return faults[0][0] if faults else Condition.GOOD

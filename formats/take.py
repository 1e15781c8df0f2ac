"""A take: one recording of a swung garment, as arrays in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from formats.arrays import Booleans, Floats, Unsigned
from formats.garment import Garment
from formats.plain_text import shortened
from formats.rig import Rig
from formats.surface import SurfaceScan
from formats.take_report import Span, State, TakeReport
from formats.templating import environment

LONGEST_GAP = 0.5  # s, longest time between two sights of the hanger that is interpolated: half a swing


@dataclass(frozen=True, kw_only=True, repr=False)
class Take:
    """One recording, in the sensor frame of its rig (imported takes: the frame in which `rig.gravity` is given).

    - `time` [s], (frames,), strictly increasing: of the sensor's clock; from 0 where imported
    - `held` [m], (frames, 2, 3): the two ends of the held edge, left first; NaN where not valid
    - `held_valid`, (frames, 2)
    - `held_sd` [m], (frames, 2, 3): standard deviation per axis
    - `points` [m], (frames, points, 3): in the order of `garment.points`; NaN where not valid
    - `points_valid`, (frames, points)
    - `points_sd` [m], (frames, points, 3): standard deviation per axis
    - `state`, (frames,), uint16: bits of `formats.take.FrameState`
    - `markers` [m], (frames, 2, 3): marker centres where the rig has a hanger, else the same as `held`
    - `pitch`, `pitch_sd` [rad], (frames,): the hanger's rotation about the line between its markers, as their plates
      show. Positive with the lower edge towards the sensor; NaN where not seen, None in a take without pitch
    - `points_hidden`, (frames, points): whether the point is invalid because something occludes it; False or None where
      not determined
    - `quality`, (frames,): the seen share of everything visible, 0 to 1; NaN or None where not determined
    - `scans`: of the visible surface, in the order of time, fewer than frames; empty where none were taken
    - `is_complete`: the recording was finished, and no frame of it is missing
    - `missing` [s]: spans of the sensor's clock without frames, lost by damage or an interruption. A span goes from the
      last frame before to the first frame after, and is infinite where the recording's begin or end is not known
    - `report`: on the file from which the take was read; None for a take without a file
    """

    take_id: str
    created: str
    rig: Rig
    garment: Garment
    time: Floats
    held: Floats
    held_valid: Booleans
    held_sd: Floats
    points: Floats
    points_valid: Booleans
    points_sd: Floats
    state: Unsigned
    markers: Floats
    pitch: Floats | None = None
    pitch_sd: Floats | None = None
    points_hidden: Booleans | None = None
    quality: Floats | None = None
    scans: tuple[SurfaceScan, ...] = ()
    source: str = ""
    notes: dict[str, str] = field(default_factory=dict)
    is_complete: bool = True
    missing: tuple[Span, ...] = ()
    report: TakeReport | None = None

    @property
    def state_of_file(self) -> State:
        """The state in one word, as every command tells it: of the file, else of the take itself."""
        if self.report is not None:
            return self.report.state
        return "sound" if self.is_complete and not self.missing else "incomplete"

    def __repr__(self) -> str:
        """Return one line: the take's name, garment and length; the arrays stay out of it."""
        facts = (f"{name} {text}" for name, text in self._facts())
        return f"Take({shortened(self.take_id)!r}, {', '.join(facts)})"

    def _repr_html_(self) -> str | None:
        """Return the same as a table for a notebook, with a row for each array; None, for the text, without Jinja2."""
        arrays = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        rows = [("take", shortened(self.take_id)), *self._facts(), ("created", self.created)]
        rows += [(name, f"array of shape {value.shape}") for name, value in arrays.items()]
        try:
            return environment("formats").get_template("take.html").render(rows=rows)
        except ModuleNotFoundError:  # the appliance has no Jinja2
            return None

    def _facts(self) -> list[tuple[str, str]]:
        """Return the take in a few words: names, and what they are."""
        frames = len(self.time)
        span = float(self.time[-1] - self.time[0]) if frames else 0.0
        seen = f"{100 * float(self.points_valid.mean()):.0f} %" if self.points_valid.size else "none"
        return [
            ("length", f"{span:.1f} s in {frames} frames"),
            ("garment", shortened(self.garment.name)),
            ("points", f"{len(self.garment.points)}, {seen} seen"),
            ("state", self.state_of_file),
        ]


def told_apart(takes: Sequence[Take]) -> list[str]:
    """Return names that distinguish takes in sentences: their own, or their files' names where several share one."""
    return names_apart([(take.take_id, take.report.file if take.report else "") for take in takes])


def names_apart(takes: Sequence[tuple[str, str]]) -> list[str]:
    """Return the names of `told_apart` from the id and the file's name of each take, '' without a file."""
    ids = [own for own, _ in takes]
    return [shortened(file if file and ids.count(own) > 1 else own) for own, file in takes]


class FrameState:
    """Bits of `Take.state`: the faults of a frame. `MARKER_LOST` means that the two markers were not both located.

    `HANGER_ALONE` and `POINTS_ALONE` mean that only the hanger, or only the points, were measured in this frame, since
    the two have separate clocks (`formats.two_clocks`).
    """

    MARKER_LOST = 1
    GARMENT_LOST = 2
    DEPTH_MISSING = 4
    COLOUR_MISSING = 8
    FRAMES_DROPPED_BEFORE = 16
    CLOCK_JUMPED = 32
    ONE_MARKER = 64
    TOO_NEAR = 128
    TOO_FAR = 256
    VIEW_BLOCKED = 512
    WRONG_SIZE = 1024
    HANGER_ALONE = 2048
    POINTS_ALONE = 4096

"""Records of a fit: its parameters, errors and combinations, and its takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec

Interval = tuple[float, float]
NOT_IDENTIFIED = "not identified"
AT_BOUND = "at its bound"
WARNING = "Warning:"  # beginning of every note that warns of the takes or of the figures
BOUND_NOTE = "At its bound:"  # beginning of the note on parameters at their bounds
OF_A_TAKE = f"{WARNING} the take "  # beginning of every note that warns of one take
JUDGED_ON = "--held-out"  # key among a result's options, of the content of the takes judged on


class FitParameter(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One fitted parameter, its bounds and its 90 % interval.

    - `fitted`: the end of the search; where `is_identified` is false, one of many values that follow the takes as well
    - `is_identified`: None where no interval was computed; a parameter at its bound is never identified: the range
      stopped it
    """

    name: str
    unit: str
    initial: float
    fitted: float
    minimum: float
    maximum: float
    interval_low: float | None = None
    interval_high: float | None = None
    is_identified: bool | None = None
    is_at_bound: bool = False
    note: str = ""


def verdict_on(number: FitParameter | Combination) -> str:
    """Return in words why a fitted number is not identified, '' where the takes identify it."""
    if number.is_identified is not False:
        return ""
    return f"{NOT_IDENTIFIED}, {AT_BOUND}" if number.is_at_bound else NOT_IDENTIFIED


def warnings_in(notes: Sequence[str]) -> list[str]:
    """Return the notes of a result that warn of its takes or of its figures."""
    return [note for note in notes if note.startswith(WARNING)]


def held_out_option(contents: Sequence[str]) -> dict[str, str]:
    """Return the content of the held-out takes among the options of a result, nothing without any.

    contents: sha256 of each take's content, in any order
    """
    return {JUDGED_ON: " ".join(sorted(contents))} if contents else {}


class ErrorFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Distance of the tracked points [m], averaged over the points of each frame.

    `time_s` has the frames of several takes one take after the other, each begun 1 s after the end of the last.
    """

    mean_m: float
    max_m: float
    per_frame_m: list[float]
    time_s: list[float]

    def __repr__(self) -> str:
        """Return one line; the figures of the frames stay out of it."""
        frames = len(self.per_frame_m)
        return f"ErrorFigure(mean {1e3 * self.mean_m:.1f} mm, largest {1e3 * self.max_m:.1f} mm, {frames} frames)"


class FitError(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors before (initial parameters) and after the fit."""

    train_before: ErrorFigure
    train_after: ErrorFigure
    held_out_before: ErrorFigure | None = None
    held_out_after: ErrorFigure | None = None


TRIVIAL_NAMES = {"vertical": "a rigid sheet that hangs straight", "pendulum": "a rigid sheet that swings as a pendulum"}


class TrivialFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors of a rigid sheet beside a fit: `vertical` hangs straight down, `pendulum` swings about the held edge."""

    name: str
    train: ErrorFigure
    parameters: dict[str, float] = {}
    held_out: ErrorFigure | None = None


class Combination(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A combination of fitted parameters on which the motion depends, whether or not the takes identify it."""

    name: str
    unit: str
    initial: float
    fitted: float
    interval_low: float
    interval_high: float
    is_identified: bool
    is_at_bound: bool = False


class ObjectiveFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The objective before and after the fit, averaged over the fitted takes, and its terms by name."""

    name: str
    unit: str
    before: float
    after: float
    parts: dict[str, Interval] = {}


class CameraFinding(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A camera fault in some takes, found before the fit.

    - `name`: latency, publish_time, frame_shifts, frame_offsets, clocks, skewed_grids, held_edge, sliding_points,
      eaten_border, eaten_by_pose, depth_scale, lean, hanger_gap or points_are
    - `figure`, `interval`: its size in `unit`, and the 90 % interval
    - `is_fault`: whether the takes or the garment file must be corrected
    - `is_left`: whether the fault stays in the data; all other faults were corrected
    """

    name: str
    take_ids: list[str]
    unit: str
    sentence: str
    figure: float | None = None
    interval: Interval | None = None
    is_fault: bool = False
    is_left: bool = False


class TakeState(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The state of a take as its file shows it: complete or not, and everything that is wrong.

    - `state`: `damaged` where something is wrong; `too large` where blocks need more memory than one file may take
    - `missing`: the missing seconds in words, '' where none is missing
    - `missing_frames`: None where the end of the take is not known
    - `unread_blocks`: blocks that need too much memory, which is no damage
    - `other_blocks`, `other_takes`: number of blocks of other takes in the same file, and number of these takes
    - `trailing_bytes`: number of bytes behind the end of the take
    - `doubts`: sentences about contradictions in the file
    - `earlier_doubts`: the same of an earlier file or of the import, '' without any
    """

    take_id: str
    state: Literal["sound", "incomplete", "damaged", "too large"]
    is_complete: bool
    missing: str
    missing_frames: int | None
    missing_scans: int
    unread_blocks: int
    damaged_blocks: int
    other_blocks: int
    other_takes: int
    trailing_bytes: int
    doubts: list[str]
    earlier_doubts: str


class FitResult(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The result of a fit."""

    format: Literal["hangtime-fit/1"]
    created: str
    take_ids: list[str]
    held_out_ids: list[str]
    method: str
    search: str
    seed: int
    parameters: list[FitParameter]
    error: FitError
    effects: dict[str, float]
    history: list[float]
    simulations: int
    seconds: float
    notes: list[str]
    objective: ObjectiveFigure | None = None
    combinations: list[Combination] = []
    material: dict[str, float] = {}  # SI, the solver's final values, effects on the cloth included
    engine: str = "own"  # the simulator
    spacing: float | None = None  # m, of the mesh; absent in results of older versions
    take_contents: list[str] = []  # sha256 of the content of each take fitted to
    layers: int = 1  # of fabric, one on the other, that were fitted as one
    garment: str = ""  # its name; empty in results of older versions
    garment_content: str = ""  # sha256 of its description
    camera: list[CameraFinding] = []
    trivial: list[TrivialFigure] = []
    take_states: list[TakeState] = []  # of the takes fitted to, then of those held out
    options: dict[str, str | float] = {}  # that no other field states; none in results of older versions
    digest: str | msgspec.UnsetType = msgspec.UNSET  # in a file alone: `formats.result_digests`

    def __repr__(self) -> str:
        """Return one line; `hangtime.load` of its file prints the whole."""
        return f"FitResult({self.label!r}, {self.method}, {len(self.parameters)} parameters, {self.created})"

    @property
    def label(self) -> str:
        """Return words that name this fit in a message."""
        return f"fit of {self.garment or ', '.join(self.take_ids)}"

"""Records of a fit: its parameters, errors and combinations, and its takes."""

from __future__ import annotations

from typing import Literal

import msgspec

Interval = tuple[float, float]
NOT_IDENTIFIED = "not identified"
AT_BOUND = "at its bound"


class FitParameter(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One fitted parameter, its bounds and its 90 % interval.

    A parameter at its bound is never identified: the range stopped it.
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
    """Return in words why a fitted number is not known, and nothing where the takes identify it."""
    if number.is_identified is not False:
        return ""
    return f"{NOT_IDENTIFIED}, {AT_BOUND}" if number.is_at_bound else NOT_IDENTIFIED


class ErrorFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Distance of the tracked points [m], averaged over the points of each frame."""

    mean_m: float
    max_m: float
    per_frame_m: list[float]
    time_s: list[float]


class FitError(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors before (initial parameters) and after the fit."""

    train_before: ErrorFigure
    train_after: ErrorFigure
    held_out_before: ErrorFigure | None = None
    held_out_after: ErrorFigure | None = None


class TrivialFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Errors of a rigid sheet beside a fit: `vertical` hangs straight down, `pendulum` swings about the held edge."""

    name: str
    train: ErrorFigure
    parameters: dict[str, float] = {}
    held_out: ErrorFigure | None = None


class Combination(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A combination of fitted parameters that motion depends on, whether or not the takes tell it."""

    name: str
    unit: str
    initial: float
    fitted: float
    interval_low: float
    interval_high: float
    is_identified: bool
    is_at_bound: bool = False


class ObjectiveFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The minimised figure before and after the fit, mean of the takes used to fit, and its parts by name."""

    name: str
    unit: str
    before: float
    after: float
    parts: dict[str, Interval] = {}


class CameraFinding(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A fault that a camera left in some takes, found before anything was fitted.

    - `name`: latency, publish_time, frame_shifts, frame_offsets, clocks, skewed_grids, held_edge, sliding_points,
      eaten_border, eaten_by_pose, depth_scale, lean, hanger_gap or points_are
    - `figure`, `interval`: its size in `unit`, and the 90 % interval
    - `is_fault`: whether the takes or the garment file must be mended
    - `is_left`: whether the fault was left in; all others were taken out
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
    """The state of a take as its file shows it: whole or not, and everything that does not hold.

    - `state`: damaged where something does not hold; too large where blocks need more memory than one file may take
    - `missing`: the missing seconds in words, '' where none is
    - `missing_frames`: None where the end of the take is not known
    - `unread_blocks`: that need too much memory, which is no damage
    - `other_blocks`, `other_takes`: blocks of other takes in the same file, and how many takes these are
    - `trailing_bytes`: that follow the end of the take
    - `doubts`: sentences about what the file says and what cannot be
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
    material: dict[str, float] = {}  # SI, what the solver was told in the end, effects on the cloth included
    engine: str = "own"  # who simulated
    spacing: float | None = None  # m, of the mesh; absent in results that are so old that they do not say
    take_contents: list[str] = []  # sha256 of the content of each take fitted to
    layers: int = 1  # of fabric, one on the other, that were fitted as one
    garment: str = ""  # its name; empty in results that are so old that they do not say
    garment_content: str = ""  # sha256 of its description
    camera: list[CameraFinding] = []
    trivial: list[TrivialFigure] = []
    take_states: list[TakeState] = []  # of the takes fitted to, then of those held out

    @property
    def label(self) -> str:
        """Return words that name this fit in a message."""
        return f"fit of {self.garment or ', '.join(self.take_ids)}"

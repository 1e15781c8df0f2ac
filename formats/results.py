"""Fit results and diagnoses: JSON files with published schemas, validated when written and when read."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_type_hints

import msgspec

from formats.errors import ResultError
from formats.whole_files import write_whole

Interval = tuple[float, float]


class FitParameter(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One fitted parameter, its bounds and its 90 % interval."""

    name: str
    unit: str
    initial: float
    fitted: float
    minimum: float
    maximum: float
    interval_low: float | None = None
    interval_high: float | None = None
    is_identified: bool | None = None
    note: str = ""


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
    """A combination of fitted parameters that motion can tell, whether or not it tells them one by one."""

    name: str
    unit: str
    initial: float
    fitted: float
    interval_low: float
    interval_high: float
    is_identified: bool


class ObjectiveFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The minimised figure before and after the fit, mean of the takes used to fit, and its parts by name."""

    name: str
    unit: str
    before: float
    after: float
    parts: dict[str, Interval] = {}


class CameraFinding(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a camera made of some takes, found before anything was fitted.

    name: latency, publish_time, frame_shifts, clocks, skewed_grids, held_edge, sliding_points, hanger_gap, points_are
    figure, interval: its size in `unit`, and the 90 % interval
    is_fault: whether the takes or the garment file must be mended; is_left: whether it was left in; everything else was
    taken out
    """

    name: str
    take_ids: list[str]
    unit: str
    sentence: str
    figure: float | None = None
    interval: Interval | None = None
    is_fault: bool = False
    is_left: bool = False


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
    take_contents: list[str] = []  # sha256 of what each take fitted to held
    layers: int = 1  # of fabric, one on the other, that were fitted as one
    camera: list[CameraFinding] = []
    trivial: list[TrivialFigure] = []


class Figure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A figure and its 90 % interval."""

    value: float
    interval: Interval | None = None


class Gap(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Root mean square error [mm] of the base model, with the named effect, and of the sensor's noise alone.

    - `is_floor_most`: a model fell below the noise that the takes seem to have; the noise is at most `floor_mm`
    - `edge_mm`: distance of the tracked held edge from the base model's edge
    - `edge_with_effect_mm`: the same with the named effect
    - `held_by_edge_mm`, `closure_held_by_edge`: of the base model held at its tracked edge instead of the hanger's,
      where the cause is unknown and the two edges differ
    """

    base_mm: Figure
    floor_mm: Figure
    is_floor_most: bool = False
    numerics_mm: float | None = None
    with_effect_mm: Figure | None = None
    closure: Figure | None = None
    is_held_out: bool = False
    edge_mm: float | None = None
    edge_with_effect_mm: float | None = None
    held_by_edge_mm: Figure | None = None
    closure_held_by_edge: Figure | None = None


class EffectFinding(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The findings about one effect of the library.

    - `explained`: share of the residual, after the part that the base model can imitate was taken out of both
    - `correlation`: of the residual with the effect as it is
    - `fitted_share`: of the squared error on the takes for fitting that a refit removes
    - `regions`: of the cloth that a local effect acts in
    """

    id: str
    group: str
    tested: bool
    amplitude: float
    unit: str
    probability: float | None = None
    amplitude_interval: Interval | None = None
    closure: Figure | None = None
    p_value: float | None = None
    minimum_detectable: float | None = None
    explained: float | None = None
    absorbed: float | None = None
    correlation: float | None = None
    fitted_share: float | None = None
    components: dict[str, float] = {}
    regions: list[str] = []
    note: str = ""


def place_of(regions: Sequence[str]) -> str:
    """Return regions of the cloth in words, `at the top left` or `along the bottom`; an empty text of none."""
    for row in ("top", "bottom"):
        if set(regions) == {f"{row} left", f"{row} centre", f"{row} right"}:
            return f"along the {row}"
    return f"at the {' and '.join(regions)}" if regions else ""


class WhereBin(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One place, phase, frequency band or direction and its share of the squared error."""

    name: str
    value_mm: float
    share: float


class VertexResidual(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Root mean square residual at one place of the flat garment."""

    at_m: tuple[float, float]
    value_mm: float


class Where(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The places of the gap, split four ways."""

    space: list[WhereBin]
    vertices: list[VertexResidual]
    time: list[WhereBin]
    frequency: list[WhereBin]
    term: list[WhereBin]


class ForceAt(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Root mean square of the missing force per mass [m/s^2] at one place of the flat garment, in two directions."""

    at_m: tuple[float, float]
    normal: float
    in_plane: float


class MissingForce(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The force that the base model lacks.

    power [W/kg]: that it gives to the cloth in the mean, below 0 where it takes energy out; None in older results
    """

    normal_share: float
    odd_share: float
    even_share: float
    amplitude_exponent: float | None
    spatial_share: dict[str, float]
    sentence: str
    places: list[ForceAt] = []
    power: float | None = None


class NextExperiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The recording that would settle most."""

    id: str
    motion: str
    separates: list[str]
    sentence: str
    sigmas_next: float | None = None
    sigmas_now: float | None = None


class Gate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A condition that must hold before anything is diagnosed."""

    name: str
    passed: bool
    figure: float | None
    limit: float | None
    unit: str
    sentence: str


class Cost(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The cost of the diagnosis."""

    simulations: int
    seconds: float


Verdict = Literal["none", "effect", "ambiguous", "several", "unknown", "numerics", "inconclusive"]


class Diagnosis(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The sim-to-real gap of some takes: how large, where, why, and what would help.

    alternatives: of an effect that is one of several, others that do nearly as well in its place
    """

    format: Literal["hangtime-diagnosis/1"]
    created: str
    take_ids: list[str]
    held_out_ids: list[str]
    verdict: Verdict
    sentence: str
    named: list[str]
    gap: Gap
    effects: list[EffectFinding]
    where: Where
    missing_force: MissingForce | None
    next_experiment: NextExperiment | None
    gates: list[Gate]
    cost: Cost
    base_parameters: list[FitParameter]
    notes: list[str]
    alternatives: dict[str, list[str]] = {}
    take_contents: list[str] = []  # sha256 of what each take fitted to held
    camera: list[CameraFinding] = []


POSITIVE = ("areal_density", "stretch_stiffness", "bending_stiffness")  # of every material: others are divided by them
LARGEST = 1e100  # SI: products of three such numbers are still finite in double precision

Result = TypeVar("Result", FitResult, Diagnosis)

SCHEMAS = {"fit-result.json": FitResult, "diagnosis.json": Diagnosis}


def schema_of(record: type[FitResult] | type[Diagnosis]) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a result file."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(record)}


def save_fit_result(path: Path, result: FitResult) -> None:
    """Write a fit result; the file appears whole or not at all."""
    _save(path, result)


def load_fit_result(path: Path) -> FitResult:
    """Read a fit result.

    Raises:
        ResultError: the file is missing or does not match the schema.
    """
    return _load(path, FitResult)


def fit_result_from(raw: bytes, where: object) -> FitResult:
    """Return the fit result in the bytes of its file.

    Raises:
        ResultError: they do not match the schema.
    """
    return _decoded(raw, FitResult, where)


def diagnosis_from(raw: bytes, where: object) -> Diagnosis:
    """Return the diagnosis in the bytes of its file.

    Raises:
        ResultError: they do not match the schema.
    """
    return _decoded(raw, Diagnosis, where)


def save_diagnosis(path: Path, diagnosis: Diagnosis) -> None:
    """Write a diagnosis; the file appears whole or not at all."""
    _save(path, diagnosis)


def load_diagnosis(path: Path) -> Diagnosis:
    """Read a diagnosis.

    Raises:
        ResultError: the file is missing or does not match the schema.
    """
    return _load(path, Diagnosis)


def _save(path: Path, record: FitResult | Diagnosis) -> None:
    raw = result_bytes(record, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, raw)


def result_bytes(record: FitResult | Diagnosis, path: Path) -> bytes:
    """Return a result as its file holds it; path: what that file will be.

    Raises:
        ResultError: a number in it is not finite.
    """
    _check(record, path)
    raw = msgspec.json.format(msgspec.json.encode(record), indent=2)
    msgspec.json.decode(raw, type=type(record))
    return raw + b"\n"


def _load(path: Path, kind: type[Result]) -> Result:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ResultError(f"cannot be read ({error.strerror})", where=path, advice="check the path") from error
    return _decoded(raw, kind, path)


def _decoded(raw: bytes, kind: type[Result], where: object) -> Result:
    try:
        record = msgspec.json.decode(raw, type=kind)
    except (msgspec.MsgspecError, RecursionError) as error:
        _refuse_other_version(raw, kind, where)
        raise ResultError(f"is not a {kind.__name__}: {error}", where=where, advice="make it again") from error
    _check(record, where)
    return record


def _refuse_other_version(raw: bytes, kind: type[Result], where: object) -> None:
    """Raise where a file names another version of its own format."""
    (known,) = get_args(get_type_hints(kind)["format"])
    try:
        named = msgspec.json.decode(raw, type=_Named).format
    except (msgspec.MsgspecError, RecursionError):
        return
    if named != known and named.split("/")[0] == known.split("/")[0]:
        raise ResultError(
            f"has the format {named}, and this version of Hangtime reads {known}", where=where,
            advice="read it with the version that wrote it, or make it again",
        )  # fmt: skip


class _Named(msgspec.Struct):
    format: str


def _check(record: FitResult | Diagnosis, where: object) -> None:
    """Check what a schema cannot say: finite numbers, and that named effects were tested."""
    _check_finite(msgspec.to_builtins(record), where, "")
    if isinstance(record, FitResult):
        _check_fit(record, where)
    if isinstance(record, Diagnosis):
        known = {finding.id for finding in record.effects}
        for name in [*record.named, *record.alternatives, *itertools.chain(*record.alternatives.values())]:
            if name not in known:
                raise ResultError(f"names the effect {name!r}, which is not among its findings", where=where)
        if record.verdict == "effect" and len(record.named) != 1:
            raise ResultError("the verdict `effect` names exactly one effect", where=where)


def _check_fit(result: FitResult, where: object) -> None:
    """Check that a fit belongs together: layers, intervals and material."""
    again = "fit again"
    if result.layers < 1:
        raise ResultError(f"layers is {result.layers}, and cloth has one or more", where=where, advice=again)
    for p in result.parameters:
        low, high = p.interval_low, p.interval_high
        if (low is None) != (high is None) or (low is not None and high is not None and low > high):
            raise ResultError(f"the interval of {p.name} has not a lower and an upper end", where=where, advice=again)
    for name in POSITIVE:
        if not 0 < result.material.get(name, 1.0) < LARGEST:
            raise ResultError(f"no cloth has {name} = {result.material[name]:g}", where=where, advice=again)


def _check_finite(value: Any, where: object, at: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise ResultError(f"{at or 'value'} is not a finite number", where=where)
    if isinstance(value, dict):
        for key, inner in value.items():
            _check_finite(inner, where, f"{at}.{key}" if at else str(key))
    elif isinstance(value, list | tuple):
        for number, inner in enumerate(value):
            _check_finite(inner, where, f"{at}[{number}]")

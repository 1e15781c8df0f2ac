"""Records of a diagnosis: gap, effects, location of the gap, checks and cost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec

from formats.fit_records import AT_BOUND, CameraFinding, FitParameter, Interval, TakeState
from formats.plain_text import shortened


class Figure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A figure and its 90 % interval."""

    value: float
    interval: Interval | None = None


class Gap(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Root mean square error [mm] of the base model, with the named effect, and of the sensor's noise alone.

    - `is_floor_most`: always false; older diagnoses set it where a model's error was below the estimated noise
    - `edge_mm`: distance of the tracked held edge from the base model's edge
    - `edge_with_effect_mm`: the same with the named effect
    - `held_by_edge_mm`, `closure_held_by_edge`: of the base model held at its tracked edge instead of the hanger's.
      Given where the cause is unknown and the two edges differ
    - `raw_mm`: of the base model on the points as tracked, where camera faults were corrected
    - `closure_from_raw`: share of the gap, measured from `raw_mm`, that camera correction and effect close together
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
    raw_mm: float | None = None
    closure_from_raw: float | None = None


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
    """Return regions of the cloth in words, such as `at the top left` or `along the bottom`; '' without regions."""
    for row in ("top", "bottom"):
        if set(regions) == {f"{row} left", f"{row} centre", f"{row} right"}:
            return f"along the {row}"
    return f"at the {' and '.join(regions)}" if regions else ""


def is_refitted(effect: EffectFinding) -> bool:
    """Return whether an effect was refitted; the size of any other one is a linear estimate of the screening."""
    figures = (effect.fitted_share, effect.closure, effect.amplitude_interval)
    return any(one is not None for one in figures) or effect.note.lower().startswith(AT_BOUND)


def has_size(effect: EffectFinding) -> bool:
    """Return whether an effect was tested and its size is not at its bound."""
    is_at_bound = effect.amplitude_interval is None and effect.note.lower().startswith(AT_BOUND)
    return effect.tested and not is_at_bound


def tells_size(effect: EffectFinding, named: Sequence[str]) -> bool:
    """Return whether the takes tell an effect's size: it has one, and is named or surely not 0.

    A size without an interval is told where the takes could have shown an effect of this size.
    """
    if not has_size(effect) or effect.id in named:
        return has_size(effect)
    if effect.amplitude_interval is None:
        return effect.minimum_detectable is not None and abs(effect.amplitude) >= effect.minimum_detectable
    low, high = effect.amplitude_interval
    return not low <= 0 <= high


LIKELY = 0.5  # probability of a cause that the verdict calls probable and the report weighs; our choice: as a wager


def in_percent(probability: float) -> str:
    """Return a probability in words of percent, never 0 or 100 %: draws and masses are not that sure."""
    if probability <= 0.005:
        return "less than 1 %"
    return f"{100 * probability:.0f} %" if probability < 0.995 else "more than 99 %"


class WhereBin(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One region, phase, frequency band or direction, and its share of the squared error."""

    name: str
    value_mm: float
    share: float


class VertexResidual(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Root mean square residual at one point of the flat garment."""

    at_m: tuple[float, float]
    value_mm: float


class Where(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The gap split by region, phase, frequency and direction."""

    space: list[WhereBin]
    vertices: list[VertexResidual]
    time: list[WhereBin]
    frequency: list[WhereBin]
    term: list[WhereBin]


class ForceAt(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Root mean square of the missing force per mass [m/s^2] at one point of the flat garment, in two directions."""

    at_m: tuple[float, float]
    normal: float
    in_plane: float


# share of the pull that features must explain before its shape is described. Our choice: below, most of the pull has
# no shape. Half and double were not tried.
VISIBLE_FORCE = 0.2


class MissingForce(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The force that the base model lacks.

    power [W/kg]: mean power into the cloth, negative where the force dissipates energy; None in older results
    """

    normal_share: float
    odd_share: float
    even_share: float
    amplitude_exponent: float | None
    spatial_share: dict[str, float]
    sentence: str
    places: list[ForceAt] = []
    power: float | None = None

    @property
    def is_hidden(self) -> bool:
        """Whether the sensor's noise hides the force, so that its figures are of the noise."""
        return self.odd_share + self.even_share < VISIBLE_FORCE


class NextExperiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The recording that would best separate the remaining explanations."""

    id: str
    motion: str
    separates: list[str]
    sentence: str
    sigmas_next: float | None = None
    sigmas_now: float | None = None


class Gate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A condition that takes or fits must meet before anything is diagnosed."""

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
    """The sim-to-real gap of some takes: its size, location, causes and the next experiment.

    alternatives: for one effect of several, the others that explain the takes nearly as well
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
    take_contents: list[str] = []  # sha256 of the content of each take fitted to
    camera: list[CameraFinding] = []
    take_states: list[TakeState] = []  # of the takes fitted to, then of those held out
    options: dict[str, str | float] = {}  # that no other field states; none in results of older versions
    digest: str | msgspec.UnsetType = msgspec.UNSET  # in a file alone: `formats.result_digests`

    @property
    def ranked(self) -> list[EffectFinding]:
        """The effects, by rules with probabilities only if there is a gap of which they may be causes.

        Where no gap shows, no effect has a closure. Masses of `--by evidence` hold without a gap too.
        """
        is_by_mass = self.options.get("--by") == "evidence"
        if is_by_mass or self.named or any(effect.closure is not None for effect in self.effects):
            return self.effects
        return [msgspec.structs.replace(effect, probability=None) for effect in self.effects]

    def __repr__(self) -> str:
        """Return one line; `sentence` says the finding."""
        takes = ", ".join(map(shortened, self.take_ids))
        named = f", {' and '.join(self.named)}" if self.named else ""
        return f"Diagnosis({takes!r}, verdict {self.verdict}{named}, {self.created})"

"""Closure from raw points: the base model's error on points before the camera's faults are corrected.

The camera's faults are corrected in silhouettes before any fit (`fit.recordings.camera`). A gap measured afterwards
does not include the gain of this step. So the base model is fitted once more, to the same takes without corrections.
The points are judged as if they stayed on the cloth. With the errors E of the raw points and of the verdict's model,
and the noise floor,

    closure from raw = (E_raw^2 - E^2) / (E_raw^2 - floor^2)

The two errors are of different points of the same takes, hence no interval. Moving points to their material positions
removes their error in the cloth's plane by construction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from msgspec.structs import replace as changed

from fit.gap.checkpoint import Checkpoint
from fit.gap.fitting import Fitted, Task, fit
from fit.gap.hypotheses import judged
from fit.observer.residuals import Observer
from fit.recordings.camera import CameraSteps
from fit.recordings.recording import Recording, prepare
from formats.diagnosis_records import Gap
from formats.take import Take

NO_STEPS = CameraSteps(stamps=False, skew=False, edge=False, frames=False, places=False)

# of the squared floor, which is itself known to some percent. Our choice: half and double were not tried.
LEAST_GAP = 0.1


def raw_recordings(takes: Sequence[Take]) -> list[Recording]:
    """Return recordings of takes without correction of the camera's faults."""
    return [prepare(replace(one, garment=changed(one.garment, points_are="material")), NO_STEPS) for one in takes]


def raw_error_mm(
    observer: Observer, judge: Observer, training: Sequence[Take], held_out: Sequence[Take], base: Fitted,
    kept: Checkpoint,
) -> float | None:  # fmt: skip
    """Return the base model's error [mm], fitted to and judged on raw points; None if nothing was corrected.

    observer, judge: of the takes fitted to and judged on; base: the fit that is begun from
    """
    if not any(recording.camera.is_placed for recording in (*observer.recordings, *judge.recordings)):
        return None
    there = observer.of(raw_recordings(training))
    tested = observer.of(raw_recordings(held_out)) if held_out else there
    starts = (base.vector, observer.parameterisation.initial)
    tasks = [Task(vector, observer.off, is_rough=True) for vector in starts]
    found = kept.recall([f"raw-{k}" for k in range(len(tasks))], partial(fit, there, tasks))
    best = min(found, key=lambda one: one.cost)
    return float(judged(tested, [best])[0].errors.squared_mm ** 0.5)


def with_raw(gap: Gap, raw_mm: float | None) -> Gap:
    """Return the gap with the base model's error on the raw points and the closure from raw.

    If the error on raw points hardly exceeds the floor, the closure from raw is undefined.
    """
    if raw_mm is None:
        return gap
    after, floor = (gap.with_effect_mm or gap.base_mm).value, gap.floor_mm.value
    whole = raw_mm**2 - floor**2
    closure = min((raw_mm**2 - after**2) / whole, 1.0) if whole > LEAST_GAP * floor**2 else None
    return changed(gap, raw_mm=raw_mm, closure_from_raw=closure)


def sentence(gap: Gap) -> str:
    """Return a sentence on the closure from raw points, or nothing if no fault was corrected."""
    if gap.raw_mm is None or gap.closure_from_raw is None:
        return ""
    after = (gap.with_effect_mm or gap.base_mm).value
    return (
        f" From the points as tracked, which the base model misses by {gap.raw_mm:.1f} mm, to {after:.1f} mm "
        f"{100 * gap.closure_from_raw:z.0f} % of the gap is closed."
    )

"""Gates of a diagnosis: enough moving data, predictable takes, a converged fit, a fine mesh."""

from __future__ import annotations

import numpy as np

from fit.gap.fitting import Fitted
from fit.observer.residuals import Observer
from fit.recordings.camera_findings import foreign_clock
from fit.recordings.hanger_path import hanger_axes
from fit.recordings.point_kind import describe_contradiction
from fit.recordings.recording import Recording
from formats.arrays import Floats
from formats.diagnosis_records import Gate
from formats.impossible_points import MOST_LEFT_OUT, describe_impossible

SHORTEST_MOTION = 2.5  # s of motion: five blocks a take, below which no statistic holds
MOST_REPEATED = 0.1  # of the frames
SMALLEST_SWING = 0.03  # m of travel of the hanger
LEAST_OWN_MOTION = 2.0  # times the noise: a board on the hanger would move by the noise alone
LARGEST_NUMERICS = 0.4  # of the gap that a finer mesh and step may remove
SHARE_OF_EFFECT = 0.5  # of the logarithm of the cost that the best effect saves
CONVERGED = 0.15  # relative difference in cost between the best fits
PULL_FREQUENCIES = (0.0, 0.5, 1.0, 2.0, 3.0, 4.5, 6.0)  # Hz, of the observer's pull
NUDGE = 1e-3  # relative change of a parameter that a predictable take forgets
FORGOTTEN_SHARE = 0.2  # of the sensor's noise


def data_gates(training: list[Recording], held_out: list[Recording]) -> list[Gate]:
    """Is there enough data, and does anything move, both in the takes fitted to and in those judged on?

    Single takes may be still: a hanger at rest shows what leans the cloth.
    """
    groups = [group for group in (training, held_out) if group]
    every = [r for group in groups for r in group]
    shortest = min(r.duration for r in every)
    swing = min(max(float(np.ptp(r.held(r.time), axis=0).max()) for r in group) for group in groups)
    own, noise = min(max((_own_motion(r), _noise(r)) for r in group) for group in groups)
    least = LEAST_OWN_MOTION * noise
    lasts = np.floor(10 * shortest + 1e-6) / 10  # s: too short a take is not rounded up to one that is long enough
    repeated = max(_repeated(r) for r in every)
    impossible = max(r.impossible for r in every)
    guessed = sum(not r.is_calibrated for r in every)
    imported = sum(r.is_imported for r in every)
    contradiction = describe_contradiction(every[0].garment, every)
    strange = foreign_clock(every)
    return [
        Gate(name="calibration", passed=guessed == 0, figure=guessed, limit=0.0, unit="takes",
             sentence=_measured(imported) if guessed == 0 else
             f"The rig of {guessed} takes was never measured, so a wrong number in it would pass for an effect. Run "
             "`hangtime calibrate` and record with the rig that it writes."),
        Gate(name="length", passed=shortest >= SHORTEST_MOTION, figure=shortest, limit=SHORTEST_MOTION, unit="s",
             sentence=f"The shortest take lasts {lasts:.1f} s; at least {SHORTEST_MOTION:g} s are needed."
             + _unless(shortest >= SHORTEST_MOTION, "Record longer.")),
        Gate(name="motion", passed=swing >= SMALLEST_SWING, figure=1e3 * swing, limit=1e3 * SMALLEST_SWING, unit="mm",
             sentence=f"The hanger travels {1e3 * swing:.0f} mm in the liveliest take; at least "
             f"{1e3 * SMALLEST_SWING:.0f} mm are needed." + _unless(swing >= SMALLEST_SWING, "Swing it wider.")),
        Gate(name="cloth motion", passed=own >= least, figure=1e3 * own, limit=1e3 * least, unit="mm",
             sentence=f"The points move by {1e3 * own:.1f} mm against the hanger in the liveliest take. At least "
             f"{LEAST_OWN_MOTION:g} times their noise of {1e3 * noise:.1f} mm is needed."
             + _unless(own >= least, "Swing faster, or come nearer to the sensor.")),
        Gate(name="repeated frames", passed=repeated <= MOST_REPEATED, figure=100 * repeated,
             limit=100 * MOST_REPEATED, unit="%",
             sentence=f"{100 * repeated:.0f} % of the frames repeat the one before; at most "
             f"{100 * MOST_REPEATED:.0f} % may."
             + _unless(repeated <= MOST_REPEATED, "Record with a tracker that leaves out frames that it did not see.")),
        Gate(name="impossible points", passed=impossible <= MOST_LEFT_OUT, figure=100 * impossible,
             limit=100 * MOST_LEFT_OUT, unit="%", sentence=describe_impossible(impossible)),
        Gate(name="clocks", passed=strange is None, figure=len(strange.take_ids) if strange else 0, limit=0.0,
             unit="takes",
             sentence=strange.sentence if strange else "Points and hanger can have one clock in every take."),
        Gate(name="kind of points", passed=not contradiction, figure=None, limit=None, unit="",
             sentence=contradiction or f"Nothing contradicts {every[0].garment.point_kind} points."),
    ]  # fmt: skip


def _unless(passed: bool, advice: str) -> str:
    """Return the advice behind a sentence where the gate did not pass."""
    return "" if passed else f" {advice}"


def _measured(imported: int) -> str:
    """Say who measured gravity, depth and the held edge of takes, so many of which were imported."""
    if imported == 0:
        return "Gravity, depth and where the garment is held are measured."
    return (
        f"Gravity, depth and where the garment is held are as {imported} imported takes state them; nobody measured "
        "them here."
    )


def _noise(recording: Recording) -> float:
    """Stated noise of a point's distance, root mean square [m]."""
    return float(np.sqrt(3 * np.mean(recording.point_sd**2)))


def _own_motion(recording: Recording) -> float:
    """Root mean square motion of the judged points in the hanger's frame [m]: a board that turns with it has none."""
    held = recording.held(recording.time)
    middle = held.reshape(-1, 2, 3).mean(1)
    apart = (recording.points - middle[:, None])[:, recording.judged & recording.valid.any(0)]
    apart = np.einsum("fij,fpi->fpj", hanger_axes(held), apart)
    return float(np.sqrt(np.nanmean(((apart - np.nanmean(apart, axis=0)) ** 2).sum(2))))


def _repeated(recording: Recording) -> float:
    """Share of the frames, with points that the one before has too, in which none of them moves in the least."""
    change = np.diff(recording.points, axis=0)
    is_seen = np.isfinite(change)
    same = (~is_seen | (change == 0)).all((1, 2))[is_seen.any((1, 2))]
    return float(same.mean()) if len(same) else 0.0


def choose_frequency(observer: Observer, vector: Floats) -> tuple[float, Gate]:
    """Return the weakest pull [Hz] under which the takes are predictable, and the gate that says so.

    Two simulations that differ by a thousandth in every stiffness must stay within a fifth of the noise of each other.
    If no pull achieves this, the pull with the nearest simulations is taken. Hard pulls on noisy points crumple limp
    cloth.
    """
    tried: list[tuple[float, float]] = []
    most = FORGOTTEN_SHARE * _mean_noise(observer)
    for frequency in PULL_FREQUENCIES:
        tried.append((_apart(observer.with_frequency(frequency), vector, observer.off), frequency))
        if tried[-1][0] <= most:
            break
    apart, frequency = tried[-1] if tried[-1][0] <= most else min(tried)
    return frequency, _predictability_gate(observer, apart, frequency)


def predictability_gate(observer: Observer, vector: Floats, amplitudes: Floats) -> Gate:
    """Are takes predictable under the observer's own pull? Two simulations must stay within the noise of each other.

    vector, (parameters,); amplitudes, (components,) of all effects
    """
    return _predictability_gate(observer, _apart(observer, vector, amplitudes), observer.frequency)


def _apart(observer: Observer, vector: Floats, amplitudes: Floats) -> float:
    """Return the distance [mm] by which a thousandth in every stiffness moves the points."""
    nudged = np.stack([vector, vector * (1 + NUDGE)])
    both = observer.residuals(nudged, np.stack([amplitudes, amplitudes]))
    return float(observer.in_mm(both[1] - both[0]))


def _mean_noise(observer: Observer) -> float:
    layout = observer.layout
    return float(np.sqrt(3 * np.mean(layout.sd[layout.is_judged] ** 2))) * 1e3


def _predictability_gate(observer: Observer, apart: float, frequency: float) -> Gate:
    noise = _mean_noise(observer)
    sentence = f"A change of {NUDGE:g} in the parameters moves the points by {apart:.2f} mm" + (
        f" under a pull of {frequency:g} Hz." if frequency else " in a free rollout."
    )
    return Gate(name="predictability", passed=apart <= noise, figure=apart, limit=noise, unit="mm", sentence=sentence)


def disagreement(fits: list[Fitted]) -> float:
    """By how much the second best fit's cost exceeds the best one's, relative to that."""
    costs = np.sort([f.cost for f in fits])
    return float(costs[1] / costs[0] - 1) if len(costs) > 1 else 0.0


def convergence_gate(fits: list[Fitted], best_effect: float) -> Gate:
    """Do independent starts of the base fit end at the same cost, or at least much nearer than an effect brings them?

    best_effect: cost of the best refit, with an effect or, where none is better, of the base model.
    """
    spread = disagreement(fits)
    limit = max(CONVERGED, float(min(f.cost for f in fits) / best_effect) ** SHARE_OF_EFFECT - 1)
    return Gate(
        name="base fit", passed=spread <= limit, figure=100 * spread, limit=100 * limit, unit="%",
        sentence=f"The best two of {len(fits)} starts of the base fit end {100 * spread:.1f} % apart in cost.",
    )  # fmt: skip


def numerics_gate(closed: float | None, numerics_mm: float, ratio: float) -> Gate:
    """Does a finer mesh and step explain the gap? It is judged like an effect: by its closure on the same motion.

    ratio: how many times finer
    """
    share = max(closed or 0.0, 0.0)
    sentence = (
        f"A mesh {ratio:.1f} times finer with its smaller step, refitted, removes {100 * share:.0f} % of the gap; "
        f"the mesh moves the points by about {numerics_mm:.1f} mm."
    )
    if closed is None:
        sentence = f"There is hardly a gap; the mesh moves the points by about {numerics_mm:.1f} mm."
    return Gate(
        name="mesh and step",
        passed=share <= LARGEST_NUMERICS,
        figure=100 * share,
        limit=100 * LARGEST_NUMERICS,
        unit="%",
        sentence=sentence,
    )

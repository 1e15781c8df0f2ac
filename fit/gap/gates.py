"""Gates of a diagnosis: conditions on data, predictability, convergence of the fit, and mesh."""

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
from formats.figures import beside
from formats.findings import HARDLY_MOVED, SHORTEST_DIAGNOSED
from formats.impossible_points import MOST_LEFT_OUT, describe_impossible

MOST_REPEATED = 0.1  # of the frames; our choice: repeats pose as data that nobody saw
LEAST_OWN_MOTION = 2.0  # times the noise: a rigid board on the hanger would show motion of the noise's size
# Of the gap that a finer mesh and step may remove; our choice: below half, so that most is not theirs.
LARGEST_NUMERICS = 0.4
SHARE_OF_EFFECT = 0.5  # of the log cost that the best effect saves; our choice: at 1, starts may differ by all of it
CONVERGED = 0.15  # relative difference in cost between the best fits; our choice: 7 % in the error, whose square it is
# Hz, of the observer's pull; our choice: 3 Hz make cloth predictable (decision 4), and twice that is a limit. Weaker
# pulls are tried first, because a strong one hides what the model lacks.
PULL_FREQUENCIES = (0.0, 0.5, 1.0, 2.0, 3.0, 4.5, 6.0)
NUDGE = 1e-3  # relative change of the stiffnesses for predictability; our choice: small, so that only chaos shows
FORGOTTEN_SHARE = 0.2  # of the sensor's noise; our choice: its square adds a 25th to the noise's variance


def data_gates(training: list[Recording], held_out: list[Recording]) -> list[Gate]:
    """Check that fitted and judged takes hold enough data and enough motion.

    Single takes may be still: a hanger at rest shows the effects that lean the cloth. Of the takes fitted to the
    liveliest counts, and of those judged on as well. The gate is about the less lively of these two.
    """
    groups = [(training, " fitted to"), (held_out, " judged on")] if held_out else [(training, "")]
    every = [r for group, _ in groups for r in group]
    shortest = min(r.duration for r in every)
    swing, of_swing = min((max(float(np.ptp(r.held(r.time), axis=0).max()) for r in group), of) for group, of in groups)
    (own, noise), of_own = min((max((_own_motion(r), _noise(r)) for r in group), of) for group, of in groups)
    least = LEAST_OWN_MOTION * noise
    # s: a take that is too short is rounded down, so that it never seems long enough
    is_long = shortest >= SHORTEST_DIAGNOSED
    lasts = shortest if is_long else np.floor(10 * shortest + 1e-6) / 10
    repeated = max(_repeated(r) for r in every)
    spans, least_span = beside(1e3 * swing, 1e3 * HARDLY_MOVED)
    moves, least_move = beside(1e3 * own, 1e3 * least, 1)
    repeats, most_repeats = beside(100 * repeated, 100 * MOST_REPEATED)
    is_swung, is_moved, is_fresh = swing >= HARDLY_MOVED, own >= least, repeated <= MOST_REPEATED
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
        Gate(name="length", passed=is_long, figure=shortest, limit=SHORTEST_DIAGNOSED, unit="s",
             sentence=f"The shortest take lasts {lasts:.1f} s; at least {SHORTEST_DIAGNOSED:g} s are needed."
             + _unless(is_long, "Record longer.")),
        Gate(name="motion", passed=is_swung, figure=1e3 * swing, limit=1e3 * HARDLY_MOVED, unit="mm",
             sentence=f"The hanger's smoothed path spans {spans} mm in the liveliest take{of_swing}; at "
             f"least {least_span} mm are needed." + _unless(is_swung, "Swing it wider.")),
        Gate(name="cloth motion", passed=is_moved, figure=1e3 * own, limit=1e3 * least, unit="mm",
             sentence=f"The points move by {moves} mm against the hanger in the liveliest take{of_own}. At "
             f"least {least_move} mm are needed, {LEAST_OWN_MOTION:g} times their noise."
             + _unless(is_moved, "Swing faster, or come nearer to the sensor.")),
        Gate(name="repeated frames", passed=is_fresh, figure=100 * repeated, limit=100 * MOST_REPEATED, unit="%",
             sentence=f"{repeats} % of the frames repeat the one before; at most {most_repeats} % may."
             + _unless(is_fresh, "Record with a tracker that leaves out frames that it did not see.")),
        Gate(name="impossible points", passed=impossible <= MOST_LEFT_OUT, figure=100 * impossible,
             limit=100 * MOST_LEFT_OUT, unit="%", sentence=describe_impossible(impossible)),
        Gate(name="clocks", passed=strange is None, figure=len(strange.take_ids) if strange else 0, limit=0.0,
             unit="takes",
             sentence=strange.sentence if strange else "Points and hanger can have one clock in every take."),
        Gate(name="kind of points", passed=not contradiction, figure=None, limit=None, unit="",
             sentence=contradiction or f"Nothing contradicts {every[0].garment.point_kind} points."),
    ]  # fmt: skip


def _unless(passed: bool, advice: str) -> str:
    """Return the advice after a gate's sentence, or nothing if the gate passed."""
    return "" if passed else f" {advice}"


def _measured(imported: int) -> str:
    """Say whether gravity, depth and held edge were measured or imported; `imported`: number of imported takes."""
    if imported == 0:
        return "Gravity, depth and where the garment is held are measured."
    return (
        f"Gravity, depth and where the garment is held are as {imported} imported takes state them; nobody measured "
        "them here."
    )


def _noise(recording: Recording) -> float:
    """Return the stated noise of a point's position, root mean square distance [m]."""
    return float(np.sqrt(3 * np.mean(recording.point_sd**2)))


def _own_motion(recording: Recording) -> float:
    """Return the root mean square motion of the judged points in the hanger's frame [m]; a rigid board has none."""
    held = recording.held(recording.time)
    middle = held.reshape(-1, 2, 3).mean(1)
    apart = (recording.points - middle[:, None])[:, recording.judged & recording.valid.any(0)]
    apart = np.einsum("fij,fpi->fpj", hanger_axes(held), apart)
    return float(np.sqrt(np.nanmean(((apart - np.nanmean(apart, axis=0)) ** 2).sum(2))))


def _repeated(recording: Recording) -> float:
    """Return the share of frames that repeat the frame before: none of the points seen in both moves at all."""
    change = np.diff(recording.points, axis=0)
    is_seen = np.isfinite(change)
    same = (~is_seen | (change == 0)).all((1, 2))[is_seen.any((1, 2))]
    return float(same.mean()) if len(same) else 0.0


def choose_frequency(observer: Observer, vector: Floats) -> tuple[float, Gate]:
    """Return the weakest pull [Hz] under which the takes are predictable, and the predictability gate.

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
    apart, frequency = min(tried)  # the last one, if it was near enough
    return frequency, _predictability_gate(observer, apart, frequency)


def predictability_gate(observer: Observer, vector: Floats, amplitudes: Floats) -> Gate:
    """Check that takes are predictable under the observer's pull: two simulations differ by less than the noise.

    vector, (parameters,); amplitudes, (components,) of all effects
    """
    return _predictability_gate(observer, _apart(observer, vector, amplitudes), observer.frequency)


def _apart(observer: Observer, vector: Floats, amplitudes: Floats) -> float:
    """Return the distance [mm] by which a change of a thousandth in every stiffness moves the points."""
    nudged = np.stack([vector, vector * (1 + NUDGE)])
    both = observer.residuals(nudged, np.stack([amplitudes, amplitudes]))
    return float(observer.in_mm(both[1] - both[0]))


def _mean_noise(observer: Observer) -> float:
    layout = observer.layout
    return float(np.sqrt(3 * np.mean(layout.sd[layout.is_judged] ** 2))) * 1e3


def _predictability_gate(observer: Observer, apart: float, frequency: float) -> Gate:
    noise = _mean_noise(observer)
    moved, most = beside(apart, noise, 2, 1)
    sentence = f"A change of {NUDGE:g} in the parameters moves the points by {moved} mm" + (
        f" under a pull of {frequency:g} Hz" if frequency else " in a free rollout"
    )
    sentence += f"; at most their noise, {most} mm, is allowed."
    return Gate(name="predictability", passed=apart <= noise, figure=apart, limit=noise, unit="mm", sentence=sentence)


def disagreement(fits: list[Fitted]) -> float:
    """Return the relative excess of the second best fit's cost over the best fit's cost."""
    costs = np.sort([f.cost for f in fits])
    return float(costs[1] / costs[0] - 1) if len(costs) > 1 else 0.0


def convergence_gate(fits: list[Fitted], best_effect: float) -> Gate:
    """Check that independent starts of the base fit agree in cost, compared with the gain by the best effect.

    best_effect: cost of the best refit, with an effect or, where none is better, of the base model.
    """
    spread = disagreement(fits)
    limit = max(CONVERGED, float(min(f.cost for f in fits) / best_effect) ** SHARE_OF_EFFECT - 1)
    above, most = beside(100 * spread, 100 * limit, 1, 0)
    return Gate(
        name="base fit", passed=spread <= limit, figure=100 * spread, limit=100 * limit, unit="%",
        sentence=f"Of {len(fits)} starts of the base fit, the second best ends {above} % above the best in "
        f"cost. At most {most} % above is allowed; this limit grows with what the best effect saves. Ends "
        "near in cost may still differ in their parameters.",
    )  # fmt: skip


def numerics_gate(closed: float | None, numerics_mm: float, ratio: float) -> Gate:
    """Check whether a finer mesh and step explain the gap; they are judged like an effect, by their closure.

    ratio: how many times finer
    """
    share = max(closed or 0.0, 0.0)
    removed, most = beside(100 * share, 100 * LARGEST_NUMERICS)
    sentence = (
        f"A mesh {ratio:.1f} times finer with its smaller step, refitted, removes {removed} % of the squared "
        f"error above the noise. At most {most} % is allowed. "
        f"The mesh moves the points by about {numerics_mm:.1f} mm."
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

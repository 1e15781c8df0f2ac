"""Propose the next recording: the motion of a menu whose simulation best separates the remaining explanations.

Two explanations i and j have contributions c_i and c_j: the change of the residual at their fitted amplitudes. The
contributions cover the present takes and a new one together. Base parameters and the other amplitude can imitate a
part, which is projected out. The rest is their distance

    T_ij = min over (theta, beta) of | c_i - J theta - beta c_j |^2 / phi

in squared standard deviations. The factor phi is the excess of the present residual's block scores over those of white
noise. The motion with the largest sum of p_i p_j (sqrt T_ij(next) - sqrt T_ij(now)) is proposed.
Sources: A. C. Atkinson, V. V. Fedorov, "The design of experiments for discriminating between two rival models",
Biometrika 62 (1975); G. E. P. Box, W. J. Hill, Technometrics 9 (1967).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fit.gap.fitting import Fitted, Problem
from fit.gap.hypotheses import Hypothesis
from fit.gap.screening import with_amplitude
from fit.observer.residuals import Observer, residuals_together
from fit.recordings.held_edge import HeldEdge
from fit.recordings.recording import Recording
from formats.arrays import Floats
from formats.diagnosis_records import NextExperiment

# s; frames per second, of a proposed recording; our choice: above 2.5 s; the PS1080's at VGA.
PROPOSED_TIME, FRAME_RATE = 4.0, 30.0
# Of the box, for the Jacobian; our choice: simulations without noise allow a smaller step than fits to data, which take
# 0.05. Half and double were not tried.
JACOBIAN_STEP = 0.01
MOST_ALIVE = 4  # explanations that are compared; our choice: a limit on the cost
WORTH_IT = 1.0  # standard deviations: least gain of a proposed recording; our choice: less, and noise may hide it


@dataclass(frozen=True)
class Motion:
    """One motion of the menu: path of the hanger's middle, (n,) s -> (n, 3) m, its yaw [rad], and turned effects.

    `turned` gives factors on the components of effects that change sign, or vanish, when cloth or rig is turned.
    """

    id: str
    sentence: str
    path: Callable[[Floats], Floats]
    yaw: Callable[[Floats], Floats] = lambda t: 0 * t
    turned: dict[str, tuple[float, ...]] = field(default_factory=dict)


def _ramp(t: Floats) -> Floats:
    s = np.clip((t - 0.3) / 0.6, 0, 1)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s * s))


def _still(t: Floats) -> Floats:
    return np.zeros((len(t), 3))


def _face_on(t: Floats) -> Floats:
    grown = np.interp(t, [1.3, 1.6, 2.6, 2.9], [0.02, 0.06, 0.06, 0.12])
    return np.stack([0 * t, grown * np.sin(2 * np.pi * 0.8 * t) * _ramp(t), 0 * t], 1)


def _edge_on(t: Floats) -> Floats:
    return np.asarray(_face_on(t)[:, [1, 0, 2]])


def _chirp(t: Floats) -> Floats:
    phase = 2 * np.pi * (0.4 * t + 0.5 * (2.6 / PROPOSED_TIME) * t**2)
    return np.stack([0 * t, 0.015 * np.sin(phase) * _ramp(t), 0 * t], 1)


def _flick(t: Floats) -> Floats:
    s = np.clip((t - 0.5) / 0.25, 0, 1)
    return np.stack([0 * t, 0.12 * s**3 * (10 - 15 * s + 6 * s * s), 0 * t], 1)


def _bounce(t: Floats) -> Floats:
    return np.stack([0 * t, 0 * t, 0.05 * np.sin(2 * np.pi * 1.5 * t) * _ramp(t)], 1)


MENU = (
    Motion("S0", "hold the hanger still for five seconds", _still),
    Motion("S1", "hang the cloth back to front and swing it face-on", _face_on,
           turned={"mass_distribution": (-1, 1), "rest_curvature": (-1, -1)}),
    Motion("S2", "turn the cloth upside down, its face still to the front, and swing it face-on", _face_on,
           turned={"hem": (0,), "mass_distribution": (-1, -1), "rest_curvature": (1, 1)}),
    Motion("S3", "swing face-on at one pace, first 2 cm, then 6 cm, then 12 cm wide", _face_on),
    Motion("S4", "swing edge-on at one pace, first 2 cm, then 6 cm, then 12 cm wide", _edge_on),
    Motion("S5", "shake gently face-on, from slow to fast", _chirp),
    Motion("S6", "flick the hanger face-on and stop dead", _flick),
    Motion("S7", "twist the hanger to and fro by 30 degrees", _still,
           yaw=lambda t: np.asarray(np.radians(30) * np.sin(2 * np.pi * 0.7 * t) * _ramp(t))),
    Motion("S8", "bounce the hanger up and down", _bounce),
    Motion("S9", "turn the whole rig by 180 degrees in the room and swing face-on", _face_on,
           turned={"draught": (-1, -1)}),
)  # fmt: skip


def propose(observer: Observer, base: Fitted, alive: list[Hypothesis], weights: list[float]) -> NextExperiment | None:
    """Return the motion that best separates the remaining explanations, or None if none adds a standard deviation.

    weights, (alive,): probability of each explanation; a single explanation is compared with `no effect`.
    """
    alive, weights = alive[:MOST_ALIVE], weights[:MOST_ALIVE]
    if not alive:
        return None
    now_j, now_c = base.jacobian[:, : len(base.vector)], _changes(observer, base, _rows(observer, alive, {}))
    inflation = _inflation(observer, base, now_c)
    pairs = _pairs(len(alive))
    apart = [_apart(observer, now_j, now_c, i, j) / np.sqrt(inflation) for i, j in pairs]
    found: list[tuple[float, Motion, float, float, tuple[int, int | None]]] = []
    imagined = followed(observer, [imagine(observer.recordings[0], motion) for motion in MENU], base)
    for motion, (next_j, next_c) in zip(MENU, _imagined(observer, imagined, base, alive), strict=True):
        both_j = np.concatenate([now_j, next_j])
        both_c = [np.concatenate(pair) for pair in zip(now_c, next_c, strict=True)]
        gains = []
        for (i, j), before in zip(pairs, apart, strict=True):
            after = _apart(observer, both_j, both_c, i, j) / np.sqrt(inflation)
            share = float(np.prod([weights[k] for k in (i, j) if k is not None]))
            gains.append((share * (after - before), before, after, (i, j)))
        found.append((sum(one[0] for one in gains), motion, *max(gains, key=lambda one: one[0])[1:]))
    _, motion, now, after, (i, j) = max(found, key=lambda one: one[0])
    if after - now < WORTH_IT:
        return None
    names = [alive[k].effects[-1] for k in (i, j) if k is not None]
    titles = [*(observer.library[name].title for name in names), "no effect"]
    return NextExperiment(
        id=motion.id,
        motion=motion.sentence,
        separates=names,
        sigmas_now=float(now),
        sigmas_next=float(after),
        sentence=f"Next, {motion.sentence}: with such a take, {titles[0]} would differ from {titles[1]} by {after:.1f} "
        f"standard deviations. The present takes alone give {now:.1f}.",
    )


def imagine(like: Recording, motion: Motion) -> Recording:
    """Return a simulated recording of a motion of the menu, with the same garment, hanger and sensor."""
    time = np.asarray(np.arange(0, PROPOSED_TIME, 1 / FRAME_RATE))
    ends = like.held(np.zeros(1))[0].reshape(2, 3)
    middle, arm = ends.mean(0), (ends[1] - ends[0]) / 2
    across = np.array([arm[0], arm[1], 0.0])
    across = across / max(float(np.linalg.norm(across)), 1e-9)
    frame = np.stack([across, np.cross([0.0, 0.0, 1.0], across), [0.0, 0.0, 1.0]], 1)

    def held(instants: Floats) -> Floats:
        moved = middle + motion.path(instants) @ frame.T
        angle = motion.yaw(instants)
        turned = np.stack(
            [np.cos(angle) * arm[0] - np.sin(angle) * arm[1], np.sin(angle) * arm[0] + np.cos(angle) * arm[1],
             np.full(len(angle), arm[2])], 1,
        )  # fmt: skip
        return np.concatenate([moved - turned, moved + turned], 1)

    places = np.array([p.at_m for p in like.garment.points]) - np.mean(like.garment.outline_m[:2], axis=0)
    hung = middle + places[:, :1] * across + places[:, 1:] * [0.0, 0.0, 1.0]
    points = np.repeat(hung[None], len(time), 0)
    still = tuple(lambda instants, at=at: np.tile(np.concatenate([at, np.zeros(3)]), (len(instants), 1)) for at in hung)
    return Recording(
        take_id=motion.id, garment=like.garment, time=time, points=points, valid=np.ones(points.shape[:2], bool),
        point_sd=like.point_sd, held_sd=like.held_sd, held=held, held_seen=held(time),
        held_cut_off=like.held_cut_off, target_curves=still,
        edge_turn=lambda instants: np.zeros((len(instants), 2)), turn_rms=like.turn_rms,
        slip_at=HeldEdge(time, np.zeros((len(time), 0, 3)), np.zeros(0), held).slip_at(), judged=like.judged,
        held_error=like.held_error, offset_sd=like.offset_sd,
    )  # fmt: skip


def followed(observer: Observer, recordings: list[Recording], base: Fitted) -> list[Recording]:
    """Return simulated recordings whose points follow the base model, as targets of the observer's pull."""
    if observer.frequency == 0.0:
        return recordings
    found = observer.of(recordings).trajectories(base.vector[None], observer.off[None], frequency=0.0)
    return [
        recording.with_points(points[0]) if np.isfinite(points).all() else recording
        for recording, points in zip(recordings, found, strict=True)
    ]


def _rows(observer: Observer, alive: list[Hypothesis], turned: dict[str, tuple[float, ...]]) -> list[Floats]:
    """Return the amplitudes of each hypothesis' last effect, transformed for a turned cloth or rig, (components,)."""
    rows = []
    for hypothesis in alive:
        effect = hypothesis.effects[-1]
        columns = observer.columns[effect]
        factors = np.asarray(turned.get(effect, 1.0))
        rows.append(with_amplitude(observer.off, columns, hypothesis.fitted.amplitudes[columns] * factors))
    return rows


def _changes(observer: Observer, base: Fitted, rows: list[Floats]) -> list[Floats]:
    """Return the change of the residual by amplitudes at the base parameters, each (numbers,)."""
    found = observer.residuals(np.tile(base.vector, (len(rows) + 1, 1)), np.stack([observer.off, *rows]))
    return list(found[1:] - found[0])


def _imagined(
    observer: Observer, recordings: list[Recording], base: Fitted, alive: list[Hypothesis]
) -> list[tuple[Floats, list[Floats]]]:
    """Return Jacobian and changes of the residual for every motion of the menu, from its simulated recordings.

    The Jacobian is of the base parameters in working coordinates, (numbers, parameters). The changes are by each
    hypothesis.
    """
    problem = Problem(observer)
    unit = problem.space.to_unit(base.vector)
    steps = np.where(unit + JACOBIAN_STEP <= 1, JACOBIAN_STEP, -JACOBIAN_STEP)
    aside = problem.space.from_unit(unit + np.diag(steps))
    vectors = np.concatenate([base.vector[None], aside, np.tile(base.vector, (len(alive), 1))])
    asked = [
        (observer.of([recording]), vectors,
         np.stack([*[observer.off] * (1 + len(aside)), *_rows(observer, alive, motion.turned)]))
        for motion, recording in zip(MENU, recordings, strict=True)
    ]  # fmt: skip
    answers = []
    for found in residuals_together(asked):
        moved = found[1:] - found[0]
        jacobian = (moved[: len(aside)] / (steps * problem.space.scale)[:, None]).T
        answers.append((np.asarray(jacobian), list(moved[len(aside) :])))
    return answers


def _inflation(observer: Observer, base: Fitted, contributions: list[Floats]) -> float:
    """Return the excess factor of the residual's block scores over white noise of deviation 1, at least 1."""
    least = base.residual
    for c in contributions:
        least = least - c * float(c @ least) / max(float(c @ c), 1e-12)
    block = observer.layout.block
    ratios = []
    for c in contributions:
        score = np.bincount(block, c * least)
        ratios.append(float((score**2).sum() / max(float(c @ c), 1e-12)))
    return max(1.0, float(np.median(ratios)))


def _apart(observer: Observer, jacobian: Floats, contributions: list[Floats], i: int, j: int | None) -> float:
    """Return the norm of c_i after projecting out base parameters and, unless j is None, c_j."""
    precision = np.diag(Problem(observer).prior_sd ** -2)
    columns = jacobian
    if j is not None:
        columns = np.concatenate([jacobian, contributions[j][:, None]], 1)
        precision = np.pad(precision, ((0, 1), (0, 1)))
        precision[-1, -1] = 1e-6
    wanted = contributions[i]
    solution = np.linalg.solve(columns.T @ columns + precision, columns.T @ wanted)
    return float(np.linalg.norm(wanted - columns @ solution))


def _pairs(count: int) -> list[tuple[int, int | None]]:
    return [(0, None)] if count == 1 else [(i, j) for i in range(count) for j in range(count) if i < j]

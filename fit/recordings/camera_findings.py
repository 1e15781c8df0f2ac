"""Report a camera's faults in takes, with their sizes and intervals.

The faults are late stamps, skewed grids, a moved edge, points that slide, an eroded outline, wrong depths, and a lean.
Sizes over several takes are means over the takes, weighted by their certainty. Their 90 % interval comes from the
spread over the takes or from the intervals of the takes, whichever is larger.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fit.recordings.grids import SKEWED
from fit.recordings.point_kind import describe_contradiction, describe_steady
from fit.recordings.recording import Recording
from fit.recordings.timing import is_sure, why_foreign
from formats.fit_records import CameraFinding, Interval
from formats.plain_text import shortened

CERTAIN_LEFT = 0.02  # s: delay of material points from which it is reported, though the diagnosis treats it
# m: correction of the edge from which it is reported. Half and double report the same 16 of the 16 public recordings of
# swung cloth, whose median is 18 mm.
LEAST_EDGE = 0.002
# m rms beyond noise, from which sliding points are reported. Our choice: a camera's noise of 2 mm and more; the public
# silhouettes slide by 17 mm (notebook, real cloth). Half and double report the same 16 of 16.
LEAST_SLIDE = 0.003
# m: apparent loss of a perfect silhouette's grid, by stretch and folds of the cloth. Of the 16 public recordings, whose
# median is 2.4 mm, this reports 13; half reports all, and double none.
LEAST_BORDER = 0.002
# Of depths; our choice: the least error of the source of `fit.effects.depth_scale`, which states 0.3 to 3 %.
LEAST_SCALE = 0.003
# rad, 0.3 degrees. Our choice: 2 mm at the bottom of 0.45 m, as `LEAST_BORDER`. Half and double report the same 10 of
# the public recordings.
LEAST_LEAN_TOLD = 0.005
# m per unit of lean. Our choice: a swing of 0.2 then loses 2 mm, as `LEAST_BORDER`. It reports 6 of the public
# recordings, as half does; double reports 5.
LEAST_BY_POSE = 0.01


def describe_camera(recordings: Sequence[Recording]) -> list[CameraFinding]:
    """Return the camera's faults in takes and their corrections, in the order of the corrections."""
    found = [*_gaps(recordings), *_clocks(recordings), *_skewed(recordings)]
    # If points and path do not belong together, no further finding is valid.
    sound = [r for r in recordings if (t := r.camera.timing) is None or t.is_of_hanger]
    for more in (_edge, _offset, _placed, _eroded, _scaled, _leaning):
        found += more(sound)
    for describe, is_fault in ((describe_contradiction, True), (describe_steady, False)):
        if recordings and (sentence := describe(recordings[0].garment, recordings)):
            takes = [r.take_id for r in recordings]
            found.append(
                CameraFinding(name="points_are", take_ids=takes, unit="1", sentence=sentence, is_fault=is_fault)
            )
    return found


def camera_clause(found: Sequence[CameraFinding], reported: str = "") -> str:
    """Return a sentence on the corrections before the fit, with sizes, and remaining faults; empty without any.

    reported: the verdict so far, which may mention a fault already
    """
    words = [text for one in found if not one.is_fault and (text := _short(one))]
    taken = f" Corrected before anything was fitted: {'; '.join(words)}." if words else ""
    return taken + "".join(f" {one.sentence}" for one in found if one.is_fault and one.sentence not in reported)


def _short(one: CameraFinding) -> str:
    """Return a corrected fault in a few words; nothing for an uncorrected fault or one that is not the camera's."""
    if one.figure is None or one.is_left:
        return ""
    if one.name == "latency":
        low, high = one.interval or (one.figure, one.figure)
        return f"stamps {_late(one.figure)} [{low:.3f} to {high:.3f} s]"
    return {
        "publish_time": f"time stamps that are late by {one.figure:.2f} of the excess of the frame interval",
        "frame_offsets": f"whole frames that are off by {1e3 * one.figure:.0f} mm rms",
        "skewed_grids": f"{100 * one.figure:.0f} % skewed grids",
        "held_edge": f"a held edge {1e3 * one.figure:.0f} mm from where the path has it",
        "sliding_points": f"points that slide over the cloth, by {1e3 * one.figure:.0f} mm rms",
        "eaten_border": f"a border eroded by {1e3 * one.figure:.1f} mm, the mean of its three sides",
        "eaten_by_pose": f"an outline that depends on pose, by {1e3 * abs(one.figure):.0f} mm per unit of lean",
    }.get(one.name, "")


def _gaps(recordings: Sequence[Recording]) -> list[CameraFinding]:
    found = []
    for recording in recordings:
        if not recording.gaps:
            continue
        longest = max(float(end - begin) for begin, end in recording.gaps)
        begin = recording.begin + min(begin for begin, _ in recording.gaps)
        times = "once" if len(recording.gaps) == 1 else f"{len(recording.gaps)} times"
        found.append(CameraFinding(
            name="hanger_gap", take_ids=[recording.take_id], figure=longest, unit="s", sentence=(
                f"In {shortened(recording.take_id)} the hanger's path is lost {times}, up to {longest:.2f} s, "
                f"first at {begin:.2f} s. Both sides are used. The cloth is judged again once it has forgotten the "
                "motion in the gap."),
        ))  # fmt: skip
    return found


def foreign_clock(recordings: Sequence[Recording]) -> CameraFinding | None:
    """Return the finding on takes whose points cannot have the hanger's clock; None if there are none."""
    timed = [(r, r.camera.timing) for r in recordings if r.camera.timing is not None]
    lost = [(r, t) for r, t in timed if not t.is_of_hanger]
    if not lost:
        return None
    recording, timing = min(lost, key=lambda one: one[1].explained)
    return CameraFinding(
        name="clocks", take_ids=[r.take_id for r, _ in lost], figure=timing.explained, unit="1", is_fault=True,
        sentence=(
            f"The clock of the points cannot be the hanger's in {_listed([r for r, _ in lost])}. In "
            f"{shortened(recording.take_id)} {why_foreign(timing)}. Check that path and points are of the same take "
            "and which clock each has."),
    )  # fmt: skip


def _clocks(recordings: Sequence[Recording]) -> list[CameraFinding]:
    timed = [(r, r.camera.timing) for r in recordings if r.camera.timing is not None]
    foreign = foreign_clock(recordings)
    found = [foreign] if foreign is not None else []
    sound = [(r, t) for r, t in timed if t.is_of_hanger]
    mended = [(r, t) for r, t in sound if r.camera.is_retimed]
    figure, interval = _together([(t.latency, t.latency_interval) for _, t in mended])
    if is_sure(interval):
        found.append(CameraFinding(
            name="latency", take_ids=[r.take_id for r, _ in mended], figure=figure, interval=interval, unit="s",
            sentence=(
                f"The points' stamps are {_late(figure)} [{interval[0]:.3f} to {interval[1]:.3f} s] in "
                f"{_listed([r for r, _ in mended])}, as the held row shows against the hanger's path. "
                "This is corrected."),
        ))  # fmt: skip
    shares = [(r, t.share, t.share_interval) for r, t in mended if t.share_interval is not None]
    figure, interval = _together([(share, span) for _, share, span in shares])
    if is_sure(interval):
        found.append(CameraFinding(
            name="publish_time", take_ids=[r.take_id for r, _, _ in shares], figure=figure, interval=interval,
            unit="1", sentence=(
                "Stamps say when a frame was published. Stamps are late by a share of the interval's excess over the "
                f"usual one: {figure:.2f} [{interval[0]:.2f} to {interval[1]:.2f}]. This is corrected."),
        ))  # fmt: skip
    own = [(r, t) for r, t in mended if t.deviation > 0]
    if own:
        deviation = float(np.sqrt(np.mean([t.deviation**2 for _, t in own])))
        found.append(CameraFinding(
            name="frame_shifts", take_ids=[r.take_id for r, _ in own], figure=deviation, unit="s",
            is_left=True, sentence=(
                f"In each frame the held row is off as if the stamp were wrong by another {1e3 * deviation:.0f} ms "
                "rms. Stamps are not changed for it; frames are moved back across the cloth where that is certain."),
        ))  # fmt: skip
    left = [
        (r, t)
        for r, t in sound
        if not r.camera.is_retimed and is_sure(t.latency_interval) and abs(t.latency) > CERTAIN_LEFT
    ]
    if left:
        figure, interval = _together([(t.latency, t.latency_interval) for _, t in left])
        found.append(CameraFinding(
            name="latency", take_ids=[r.take_id for r, _ in left], figure=figure, interval=interval, unit="s",
            is_left=True, sentence=(
                f"The held row is {_late(figure)} [{interval[0]:.3f} to {interval[1]:.3f} s] against the hanger's "
                "path. This was left in: the cause may be a clock, a tracker that lags, or the hanger."),
        ))  # fmt: skip
    return found


def _skewed(recordings: Sequence[Recording]) -> list[CameraFinding]:
    askew, frames = (
        sum(values) for values in zip(*[(r.camera.skewed, r.camera.frames) for r in recordings], strict=True)
    )
    if not askew:
        return []
    share = askew / frames
    return [CameraFinding(
        name="skewed_grids", take_ids=[r.take_id for r in recordings if r.camera.skewed], figure=share, unit="1",
        sentence=(
            f"{askew} of {frames} grids ({100 * share:.0f} %) lie askew on the silhouette by more than {SKEWED:g} "
            "degrees. These grids are left out."),
    )]  # fmt: skip


def _edge(recordings: Sequence[Recording]) -> list[CameraFinding]:
    moved = [(r, r.camera.edge) for r in recordings if r.camera.edge is not None]
    if not moved:
        return []
    down, out = (float(np.mean(values)) for values in zip(*[(e.down, e.out) for _, e in moved], strict=True))
    if np.hypot(down, out) < LEAST_EDGE:
        return []
    where = f"{1e3 * abs(down):.0f} mm {'higher' if down < 0 else 'lower'} and {1e3 * abs(out):.0f} mm further " + (
        "out" if out > 0 else "in"
    )
    return [CameraFinding(
        name="held_edge", take_ids=[r.take_id for r, _ in moved], figure=float(np.hypot(down, out)), unit="m",
        sentence=(
            f"The held edge is taken from the top row of the points at rest, {where} than the hanger's path has it. "
            "The edge is as long as on the flat cloth."),
    )]  # fmt: skip


def _offset(recordings: Sequence[Recording]) -> list[CameraFinding]:
    moved = [(r, r.camera.offsets) for r in recordings if r.camera.offsets is not None]
    if not moved:
        return []
    rms = float(np.sqrt(np.mean([o.rms**2 for _, o in moved])))
    return [CameraFinding(
        name="frame_offsets", take_ids=[r.take_id for r, _ in moved], figure=rms, unit="m", sentence=(
            f"While the hanger moves, whole frames are off across the cloth by {1e3 * rms:.0f} mm rms, as the held row "
            "shows, on which no physics acts. These frames are moved back by this shift."),
    )]  # fmt: skip


def _placed(recordings: Sequence[Recording]) -> list[CameraFinding]:
    placed = [r for r in recordings if r.camera.is_placed]
    if not placed:
        return []
    moved = np.concatenate([np.linalg.norm(r.points - r.seen_points, axis=2).ravel() for r in placed])
    seen = float(np.mean([r.valid.mean() for r in placed]))
    # The move also removes noise along the cloth's two directions, which is no sliding.
    noise = 2 * float(np.mean([np.mean(r.point_sd**2) for r in placed]))
    slide = float(np.sqrt(max(np.nanmean(moved**2) - noise, 0.0))) if np.isfinite(moved).any() else 0.0
    if slide < LEAST_SLIDE:
        return []
    return [CameraFinding(
        name="sliding_points", take_ids=[r.take_id for r in placed], figure=slide, unit="m", sentence=(
            f"Points of a silhouette slide over the cloth, here by {1e3 * slide:.0f} mm rms. Each point got the "
            f"material position at its distance from the held edge. {100 * seen:.0f} % of these positions are seen."),
    )]  # fmt: skip


def _eroded(recordings: Sequence[Recording]) -> list[CameraFinding]:
    """Return the erosion of the borders, and its dependence on pose, if certain."""
    shown = [(r, r.camera.outline) for r in recordings if r.camera.outline is not None]
    found = []
    bottom, bottom_span = _together([(o.bottom, o.bottom_interval) for _, o in shown])
    side, side_span = _together([(o.side, o.side_interval) for _, o in shown])
    figure = (bottom + 2 * side) / 3
    half = float(np.hypot(bottom_span[1] - bottom, 2 * (side_span[1] - side))) / 3
    if figure > LEAST_BORDER and is_sure((figure - half, figure + half)):
        found.append(CameraFinding(
            name="eaten_border", take_ids=[r.take_id for r, _ in shown], figure=figure, unit="m",
            interval=(figure - half, figure + half), sentence=(
                f"The silhouette ends inside the cloth: by {1e3 * bottom:.1f} mm [{1e3 * bottom_span[0]:.1f} to "
                f"{1e3 * bottom_span[1]:.1f}] at the bottom and {1e3 * side:.1f} mm [{1e3 * side_span[0]:.1f} to "
                f"{1e3 * side_span[1]:.1f}] at each side. Positions beyond it count as unseen."),
        ))  # fmt: skip
    leaning = [
        (r, (o.by_pose, o.by_pose_interval)) for r, o in shown
        if o.by_pose is not None and o.by_pose_interval is not None
    ]  # fmt: skip
    if leaning:
        figure, span = _together([(value, interval) for _, (value, interval) in leaning])
        if abs(figure) > LEAST_BY_POSE and is_sure(span):
            least, most = sorted(abs(value) for value in span)
            found.append(CameraFinding(
                name="eaten_by_pose", take_ids=[r.take_id for r, _ in leaning], figure=figure, interval=span, unit="m",
                sentence=(
                    f"The silhouette's length depends on pose: the silhouette {'loses' if figure > 0 else 'gains'} "
                    f"{1e3 * abs(figure):.0f} mm per unit of lean [{1e3 * least:.0f} to {1e3 * most:.0f}]. Positions "
                    "beyond it count as unseen."),
            ))  # fmt: skip
    return found


def _scaled(recordings: Sequence[Recording]) -> list[CameraFinding]:
    """Return the relative error of depths, from the travel of the held row against the hanger's path."""
    figure, span = scale_together(recordings)
    if abs(figure) < LEAST_SCALE or not is_sure(span):
        return []
    known = [r.take_id for r in recordings if (t := r.camera.timing) is not None and t.scale_interval is not None]
    return [CameraFinding(
        name="depth_scale", take_ids=known, figure=figure, interval=span, unit="1",
        is_left=True, sentence=(
            f"The held row travels {100 * abs(figure):.1f} % [{100 * span[0]:.1f} to {100 * span[1]:.1f}] "
            f"{'farther' if figure > 0 else 'less far'} than the hanger, away from the camera and back: depths and "
            "path differ in scale. This was left in."),
    )]  # fmt: skip


def scale_together(recordings: Sequence[Recording]) -> tuple[float, Interval]:
    """Return the scale of the row's travel against that of the path, less 1, with its 90 % interval; 0 of no take."""
    timed = [r.camera.timing for r in recordings if r.camera.timing is not None]
    return _together([(t.scale, t.scale_interval) for t in timed if t.scale_interval is not None])


def _leaning(recordings: Sequence[Recording]) -> list[CameraFinding]:
    """Return the finding on the lean of cloth at rest."""
    shown = [(r, lean.angle, lean.interval) for r in recordings if (lean := r.camera.lean) is not None]
    figure, span = _together([(angle, interval) for _, angle, interval in shown])
    if abs(figure) < LEAST_LEAN_TOLD or not is_sure(span):
        return []
    degrees = [float(np.degrees(value)) for value in (figure, *span)]
    return [CameraFinding(
        name="lean", take_ids=[r.take_id for r, _, _ in shown], figure=figure, interval=span, unit="rad", is_left=True,
        sentence=(
            f"At rest the cloth leans out of the vertical by {degrees[0]:.1f} degrees [{degrees[1]:.1f} to "
            f"{degrees[2]:.1f}]. Gravity or the camera is tilted, or a draught is steady. This was left in."),
    )]  # fmt: skip


def _together(values: Sequence[tuple[float, Interval]]) -> tuple[float, Interval]:
    """Return the mean of values with 90 % intervals, and its interval; 0 without values.

    Less certain values than the median count less.
    """
    from scipy.special import stdtrit

    if not values:
        return 0.0, (0.0, 0.0)
    figures = np.array([value for value, _ in values])
    half = np.array([(high - low) / 2 for _, (low, high) in values])
    weight = 1.0 / np.maximum(half**2 + float(np.median(half)) ** 2, 1e-30)
    weight /= weight.sum()
    mean, count = float(weight @ figures), len(values)
    reach = float(np.sqrt((weight**2 * half**2).sum()))
    if count > 1:
        spread = np.sqrt(weight @ (figures - mean) ** 2 * (weight**2).sum() * count / (count - 1))
        reach = max(reach, float(stdtrit(count - 1, 0.95) * spread))
    return mean, (mean - reach, mean + reach)


def _late(seconds: float) -> str:
    return f"{abs(seconds):.3f} s {'late' if seconds > 0 else 'early'}"


def _listed(recordings: Sequence[Recording]) -> str:
    return shortened(recordings[0].take_id) if len(recordings) == 1 else f"{len(recordings)} takes"

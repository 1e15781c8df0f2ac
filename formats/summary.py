"""Summarise a take in a few figures, for people and for programs."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np

from formats.fault_words import state_of_take
from formats.findings import means_silhouette
from formats.garment import PointKind
from formats.missing import DOUBTS
from formats.motion import kind_of
from formats.plain_text import counted, plain
from formats.rig import Calibration
from formats.take import FrameState, Take
from formats.two_clocks import shows_hanger, shows_points

STATE_NAMES = {
    FrameState.MARKER_LOST: "marker lost",
    FrameState.GARMENT_LOST: "garment lost",
    FrameState.DEPTH_MISSING: "depth missing",
    FrameState.COLOUR_MISSING: "colour missing",
    FrameState.FRAMES_DROPPED_BEFORE: "frames dropped before",
    FrameState.CLOCK_JUMPED: "clock jumped",
    FrameState.ONE_MARKER: "one marker only",
    FrameState.TOO_NEAR: "too near",
    FrameState.TOO_FAR: "too far",
    FrameState.VIEW_BLOCKED: "view blocked",
    FrameState.WRONG_SIZE: "wrong picture size",
    FrameState.HANGER_ALONE: "hanger alone, on a clock of its own",
    FrameState.POINTS_ALONE: "points alone, on a clock of their own",
}
POINT_WORDS: dict[PointKind, str] = {
    "material": "material points, which stay on the cloth",
    "silhouette": "points of a silhouette, which slide over the cloth",
}
ASSUMED = "points that count as silhouette points: the garment file states no points_are"


def summarise(take: Take) -> dict[str, Any]:
    """Return a take's state and its figures as plain numbers and text."""
    frames = len(take.time)
    duration = float(take.time[-1] - take.time[0])
    pictures, sights = shows_points(take), shows_hanger(take)
    seen = take.points_valid[pictures].mean(0) if pictures.any() else np.zeros(take.points_valid.shape[1])
    hidden = take.points_hidden.mean(0) if take.points_hidden is not None else np.zeros(len(seen))
    quality = take.quality[np.isfinite(take.quality)] if take.quality is not None else np.empty(0)
    points = []
    for k, name in enumerate(take.garment.point_names):
        sd = take.points_sd[take.points_valid[:, k], k]
        points.append(
            {
                "name": name,
                "seen_percent": round(100 * float(seen[k]), 1),
                "hidden_percent": round(100 * float(hidden[k]), 1),
                "sd_mm": round(1e3 * float(np.sqrt((sd**2).mean())), 2) if len(sd) else None,
            }
        )
    swing = np.ptp(take.held[take.held_valid.all(1)], axis=0).max(0) if take.held_valid.all(1).any() else np.zeros(3)
    return {
        **msgspec.to_builtins(state_of_take(take)),
        "created": take.created,
        "missing_s": [list(span) for span in take.missing],
        "frames": frames,
        "duration_s": round(duration, 3),
        "rate_hz": _rate(take),
        "rig": take.rig.name,
        "calibration": None if take.rig.calibration is None else msgspec.to_builtins(take.rig.calibration),
        "garment": take.garment.name,
        "mass_kg": take.garment.mass_kg,
        "hanger_seen_percent": round(100 * float(take.held_valid[sights].all(1).mean()), 1) if sights.any() else 0.0,
        "motion": kind_of(take),
        "hanger_travel_mm": [round(1e3 * float(s), 1) for s in swing],
        "pitch_seen_percent": 0.0 if take.pitch is None else round(100 * float(np.isfinite(take.pitch).mean()), 1),
        "points_are": take.garment.point_kind,
        "points_are_assumed": means_silhouette(take),
        "points": points,
        "quality": round(float(np.median(quality)), 2) if quality.size else None,
        "surface_scans": len(take.scans),
        "states": {name: int(((take.state & bit) > 0).sum()) for bit, name in STATE_NAMES.items()},
        "source": take.source,
        "notes": take.notes,
    }


def _rate(take: Take) -> float | None:
    """Return the frame rate [1/s] over the time without lost frames; None for a single frame."""
    time = take.time[shows_points(take)]
    steps = np.diff(time)
    is_hole = np.zeros(len(steps), bool)
    for begin, end in take.missing:
        is_hole |= (time[:-1] <= begin) & (end <= time[1:])
    return round(1 / float(steps[~is_hole].mean()), 2) if (~is_hole).any() else None


def describe(summary: dict[str, Any]) -> str:
    """Return a summary as lines for a terminal."""
    s = summary
    fault = "" if s["state"] == "sound" else f"   ({s['state'].upper()})"
    lines = [
        f"take      {s['take_id']}{fault}",
        *([f"missing   {s['missing']}"] if s["missing"] else []),
        f"created   {s['created']}",
        f"length    {s['duration_s']:g} s, {counted(s['frames'], 'frame')}"
        + (f", {s['rate_hz']:g} a second" if s["rate_hz"] is not None else "")
        + " with points" * bool(s["rate_hz"] is not None and s["states"][STATE_NAMES[FrameState.HANGER_ALONE]]),
        f"rig       {s['rig']}",
        *_calibrated(s["calibration"]),
        f"garment   {s['garment']}, {1e3 * s['mass_kg']:.1f} g",
        f"hanger    seen in {s['hanger_seen_percent']:g} % of the frames, "
        f"travels {' x '.join(f'{t:.0f}' for t in s['hanger_travel_mm'])} mm",
        f"motion    {s['motion']}",
    ]
    lines.append(f"tracked   {ASSUMED if s['points_are_assumed'] else POINT_WORDS[s['points_are']]}")
    points = s["points"]
    if len(points) <= 12:
        for p in points:
            noise = f"noise {p['sd_mm']:g} mm a coordinate" if p["sd_mm"] is not None else "never seen"
            hidden = f"   hidden {p['hidden_percent']:g} %" if p["hidden_percent"] else ""
            lines.append(f"point     {p['name']:<14} seen {p['seen_percent']:5.1f} %   {noise}{hidden}")
    else:
        shares = [p["seen_percent"] for p in points]
        noises = [p["sd_mm"] for p in points if p["sd_mm"] is not None]
        noise = f"median noise {float(np.median(noises)):g} mm a coordinate" if noises else "never seen"
        least, most = f"{min(shares):g}", f"{max(shares):g}"
        seen = most if least == most else f"{least} to {most}"
        lines.append(f"points    {len(points)}, seen {seen} %, {noise}")
    if s["quality"] is not None:
        lines.append(f"quality   {s['quality']:g} in the median frame, 1 at best")
    if s["surface_scans"]:
        lines.append(f"surface   scanned {counted(s['surface_scans'], 'time')}")
    for name, count in s["states"].items():
        if count:
            lines.append(f"state     {name} in {counted(count, 'frame')}")
    if s["source"]:
        lines.append(f"source    {s['source']}")
    lines += [f"note      {key}: {text}" for key, text in s["notes"].items() if key not in DOUBTS]
    lines += [f"warning   {text}" for key, text in s["notes"].items() if key in DOUBTS]
    return "\n".join(plain(line) for line in lines)


def _calibrated(plain: dict[str, Any] | None) -> list[str]:
    """Return a line on the accuracy of the rig's calibration, none for a rig that was never calibrated."""
    if plain is None:
        return []
    known = msgspec.convert(plain, Calibration)
    parts = []
    if known.gravity_sd_degrees is not None:
        how = f" ({known.gravity_from})" if known.gravity_from else ""
        sd = known.gravity_sd_degrees
        parts.append(f"gravity +- {sd:g} degrees{how}" if sd > 0 else f"gravity exact{how}")
    if known.depth_scale_sd is not None:
        parts.append(f"depth scale {known.depth_scale:.4f} +- {known.depth_scale_sd:g}")
    if known.depth_offset_sd_px is not None:
        right, down = known.depth_offset_px
        parts.append(f"depth offset {right:.2f}, {down:.2f} px +- {min(known.depth_offset_sd_px):g}")
        if not math.isfinite(max(known.depth_offset_sd_px)):
            parts[-1] += " along the one axis that was measured"
    if known.held_sd_m is not None:
        parts.append(f"held ends +- {1e3 * max(max(end) for end in known.held_sd_m):.1f} mm")
    return ["calibrated " + "; ".join(parts)] if parts else []

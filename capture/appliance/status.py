"""The content of `hangtime status`: one dictionary for programs, and the same in a few lines for people."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from capture.appliance.config import InForce
from capture.appliance.faults import FaultBook
from capture.appliance.showing import Light
from capture.appliance.states import State
from capture.appliance.wall_clock import wall_time
from capture.recording.condition import Condition
from formats.plain_text import counted, sized, with_advice


@dataclass
class Counts:
    """The daemon's counts since its start.

    - `last_take`: the outcome of the last take
    - `findings`: the last take's defects that matter to a fit
    """

    begun_s: float
    frames: int = 0
    dropped: int = 0
    gaps: int = 0
    takes: int = 0
    waiting: int = 0
    salvaged: int = 0
    bytes_kept: int = 0
    free_bytes: int = 0
    last_take: dict[str, Any] | None = None


def report(
    *, state: State, faults: FaultBook, counts: Counts, now: float, light: Light, running: dict[str, Any] | None,
    condition: Condition, pre_roll_s: float, behind_s: float, sync: dict[str, Any], config: InForce,
) -> dict[str, Any]:  # fmt: skip
    """Return the state of the appliance; times in seconds."""
    clock = wall_time()
    return {
        "state": state.name.lower(), "says": state.value, "lamp": light.name, "lamp_means": light.meaning,
        "condition": condition.value.words,
        "faults": [
            {"name": fault.name, "sentence": fault.sentence, "advice": fault.advice, "blocks": fault.blocks,
             "for_s": round(now - fault.since_s, 1)}
            for fault in faults.all
        ],
        "recording": running, "pre_roll_s": round(pre_roll_s, 3), "disk_behind_s": round(behind_s, 3),
        "frames": counts.frames, "dropped": counts.dropped, "gaps": counts.gaps,
        "takes": counts.takes, "waiting": counts.waiting, "salvaged": counts.salvaged,
        "bytes_kept": counts.bytes_kept, "free_bytes": counts.free_bytes, "last_take": counts.last_take,
        "sync": sync, "last_sync": sync["last_sync"], "last_proof": sync["last_proof"],
        "clock": {"utc": clock.utc, "source": clock.source, "uncertainty_s": clock.uncertainty_s},
        "running_s": round(now - counts.begun_s, 1), "sensor": config.config.sensor.address,
        "garment": config.garment.name,
    }  # fmt: skip


def lines(status: dict[str, Any]) -> list[str]:
    """Return a report as lines of text: the state, each fault with its next action, and the counts."""
    said = [status["says"]]
    running = status["recording"]
    if running:
        said[0] += f" for {running['seconds']:.1f} s: {running['frames']} frames, {running['dropped']} lost; "
        said[0] += running["condition"]
    said += [f"! {with_advice(fault['sentence'], fault['advice'])}" for fault in status["faults"]]
    last = status["last_take"]
    if last:
        said.append(f"last take: {_place(last['kept']) if last['kept'] else 'not kept'}")
        said += [f"! {with_advice(finding['words'], finding['advice'])}" for finding in last["findings"]]
    lost = f"{status['dropped']} lost in {counted(status['gaps'], 'gap')}"
    said.append(
        f"since the start: {counted(status['frames'], 'frame')}, {lost}; "
        f"{sized(status['bytes_kept'])} kept, {sized(status['free_bytes'])} free"
    )
    salvaged = f", {status['salvaged']} of them salvaged after a crash" if status["salvaged"] else ""
    said.append(f"takes: {status['takes']}, {status['waiting']} of them wait for the server{salvaged}")
    said += status["sync"]["says"]
    clock = status["clock"]
    off = "" if clock["uncertainty_s"] is None else f", off by {clock['uncertainty_s']:.3f} s at most"
    set_by = {"NTP": "set by the network", "RTC": "from the board's battery clock", "none": "set by nobody"}
    said.append(f"clock: {clock['utc']}, {set_by[clock['source']]}{off}")
    return said


def _place(kept: str) -> str:
    """Return where the last take is; it may have been removed since, which the recorder does not hear of."""
    path = Path(kept)
    try:
        path.stat()
    except FileNotFoundError:
        return f"{path.stem}, removed from this device since; `hangtime sync status` says what is safe"
    except OSError:
        pass  # who asks may not look
    return kept

"""Export a take as an `.rrd` file for the viewer Rerun: points, held edge, markers, surface and state.

Entities lie below `take/`, on the timelines `sensor` (seconds of the sensor's clock) and `frame`. An entity is empty in
a frame that does not show it. Positions are 32-bit floats in metres.
Format and calls: rerun.io, reference of the Python SDK.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from formats.arrays import Booleans, Floats
from formats.descriptions import dump_description
from formats.exporters.by_library import bytes_by_library
from formats.missing import missing_words
from formats.outputs import write_bytes
from formats.plain_text import lines_of
from formats.take import Take
from formats.unfinished import ANOTHER_FOLDER

DRAWN_RADIUS = 0.006  # m of a drawn point: a tracked marker has about 12 mm
# m of the arrow that shows which way gravity pulls. Our choice: seen beside a garment of half a metre; a longer arrow
# would cross the cloth.
GRAVITY_LENGTH = 0.3


def write_rrd(path: Path, take: Take, *, overwrite: bool = True) -> None:
    """Write a take as a recording of Rerun.

    Raises:
        ModuleNotFoundError: rerun-sdk is not installed.
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
    import rerun

    def save(file: Path) -> None:
        with rerun.RecordingStream("hangtime", recording_id=take.take_id) as stream:
            stream.save(file)
            _send_still(rerun, stream, take)
            _send_moving(rerun, stream, take)
            stream.flush()
            stream.disconnect()

    write_bytes(path, bytes_by_library(save, "take.rrd"), overwrite=overwrite, instead=ANOTHER_FOLDER)


def _send_still(rerun: Any, stream: Any, take: Take) -> None:
    """Send the facts of the whole take: the frame, gravity, and the descriptions as text."""
    gravity = np.asarray(take.rig.gravity)
    axis = int(np.abs(gravity).argmax())
    upright = f"RIGHT_HAND_{'XYZ'[axis]}_{'UP' if gravity[axis] < 0 else 'DOWN'}"
    view = "RDF" if take.rig.sensor is not None else upright
    stream.log("take", getattr(rerun.ViewCoordinates, view), static=True)
    seen = take.held[np.isfinite(take.held).all((1, 2))]
    origin = seen[0].mean(0) if len(seen) else np.zeros(3)
    arrow = rerun.Arrows3D(origins=[origin], vectors=[GRAVITY_LENGTH * gravity], labels=["gravity"])
    stream.log("take/gravity", arrow, static=True)
    texts = {"about": about(take), "rig": dump_description(take.rig), "garment": dump_description(take.garment)}
    for name, text in texts.items():
        stream.log(f"text/{name}", rerun.TextDocument(text), static=True)


def about(take: Take) -> str:
    """Return a description of a take, one item a line, with line breaks in items escaped."""
    words = [("take_id", take.take_id), ("created", take.created), ("source", take.source), *take.notes.items()]
    lines = [f"{name} = {text}" for name, text in words]
    lines += [f"missing: {missing}"] if (missing := missing_words(take)) else []
    return "\n".join(lines_of(line).replace("\n", "\\n") for line in lines)


def _send_moving(rerun: Any, stream: Any, take: Take) -> None:
    """Send the values of every frame."""

    def times(seconds: Floats) -> list[Any]:
        nanoseconds = np.rint(seconds * 1e6).astype("timedelta64[us]").astype("timedelta64[ns]")
        return [rerun.TimeColumn("sensor", duration=nanoseconds)]

    every = [*times(take.time), rerun.TimeColumn("frame", sequence=np.arange(len(take.time)))]

    def send(entity: str, places: Floats, valid: Booleans, indexes: list[Any]) -> None:
        """Send the valid positions of each frame, out of (frames, places, 3)."""
        columns = rerun.Points3D.columns(positions=places[valid].astype(np.float32)).partition(valid.sum(1))
        stream.log(entity, rerun.Points3D.from_fields(radii=DRAWN_RADIUS), static=True)
        stream.send_columns(entity, indexes, columns)

    for k, name in enumerate(take.garment.point_names):
        entity = rerun.new_entity_path(["take", "points", name])
        send(entity, take.points[:, k : k + 1], take.points_valid[:, k : k + 1], every)
    for k, side in enumerate(("left", "right")):
        send(f"take/held/{side}", take.held[:, k : k + 1], take.held_valid[:, k : k + 1], every)
        centres = take.markers[:, k : k + 1]
        send(f"take/markers/{side}", centres, np.asarray(np.isfinite(centres).all(2)), every)
    if take.scans:
        places = [np.concatenate([scan.grid.reshape(-1, 3), scan.contour.reshape(-1, 3)]) for scan in take.scans]
        seen = [part[np.isfinite(part).all(1)] for part in places]
        found = np.concatenate(seen).astype(np.float32)
        columns = rerun.Points3D.columns(positions=found).partition([len(part) for part in seen])
        stream.send_columns("take/surface", times(np.array([scan.time for scan in take.scans])), columns)
    stream.send_columns("state", every, rerun.Scalars.columns(scalars=take.state.astype(float)))

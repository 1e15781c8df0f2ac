"""Small worlds and recordings with known answers, for the tests of the sensors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from firmware_host.oni_records import RECORD_HEADER, Record
from firmware_host.oni_writer import OniWriter
from firmware_host.synthetic.scene import TOP_WIDTH, demo_garment, place
from firmware_host.synthetic.world import World
from formats.arrays import Bytes, Unsigned
from formats.rig import Sensor

SMALL = Sensor(width=64, height=48, fx=57.58, fy=57.58, cx=31.5, cy=23.5)
PERIOD_US = 33_333


def flat_world(frames: int = 4, depth_step: float = 0.0) -> World:
    """A rigid, flat, upright cloth under a hanger that moves away by `depth_step` metres a frame."""
    time = np.arange(frames) / 30
    displacement = np.zeros((frames, 3))
    displacement[:, 2] = depth_step * np.arange(frames)
    hanger = place(displacement, np.zeros(frames), np.zeros(frames))
    outline = np.array(demo_garment().outline_m)
    down = np.linspace(0, 1, 5)[:, None, None]
    across = np.linspace(0, 1, 5)[None, :, None]
    flat = (1 - down) * ((1 - across) * outline[0] + across * outline[1]) + down * (
        (1 - across) * outline[3] + across * outline[2]
    )
    flat_3d = np.concatenate([flat * [1, -1], np.zeros((5, 5, 1))], axis=-1)
    nodes = hanger.held[:, None, None, 0] + flat_3d + np.array([TOP_WIDTH / 2, 0, 0])
    corners = nodes[:, [0, 0, -1, -1], [0, -1, -1, 0]]
    return World(time, hanger, nodes, np.concatenate([corners, nodes[:, 2:3, 2]], axis=1), seed=5)


def picture(number: int) -> tuple[Unsigned, Bytes]:
    """Return depth with noise, jumps, holes and the largest value, and colour; different for every number."""
    rng = np.random.default_rng(number)
    depth = (900 + np.arange(64)[None] + rng.integers(-8, 9, (48, 64))).astype(np.uint16)
    depth[10:20, 5 + number : 20 + number] = 4000
    depth[:, :3] = 0
    depth[-1, -1] = 10000
    return depth, rng.integers(0, 256, (48, 64, 3)).astype(np.uint8)


def payload_of(record: Record) -> slice:
    """Return the slice of a file that holds a record's payload."""
    begins = record.position + RECORD_HEADER.size + len(record.fields)
    return slice(begins, begins + record.payload_size)


def write_recording(path: Path, frames: int = 6, *, depth_codec: str = "16zT", colour_delay_us: int = 2000) -> Path:
    """Write a recording of `picture(0)`, `picture(1)` and so on."""
    with OniWriter(path, SMALL, depth_codec=depth_codec) as writer:
        write_pictures(writer, frames, lambda k: 1000 + k * PERIOD_US, lambda k: 1000 + k * PERIOD_US + colour_delay_us)
    return path


def write_pictures(
    writer: OniWriter, frames: int, depth_at: Callable[[int], int], colour_at: Callable[[int], int]
) -> None:
    """Write `picture(0)`, `picture(1)` and so on; depth and colour have functions from number to timestamp [us]."""
    for number in range(frames):
        depth, colour = picture(number)
        writer.write_depth(depth_at(number), depth)
        writer.write_colour(colour_at(number), colour)


class AnyStamps(OniWriter):
    """Writes timestamps unchecked, as a recorder does whose device's clock wraps around or is set."""

    def _append(self, stream: Any, time_us: int, payload: bytes) -> None:
        latest, stream.last_time_us = stream.last_time_us, 0
        super()._append(stream, time_us, payload)
        stream.last_time_us = max(latest, time_us)

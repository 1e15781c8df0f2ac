"""The synthetic sensor: the synthetic world behind the common interface of depth sensors."""

from __future__ import annotations

import time
from typing import Self
from urllib.parse import parse_qsl

from firmware_host.depth_sensor import STALL_TIMEOUT, DepthSensor, SensorFrame, SensorInfo
from firmware_host.errors import SensorAddressError
from firmware_host.synthetic.scene import CAMERA, FPS
from firmware_host.synthetic.world import FIRST_STAMP, World, make_world
from formats.plain_text import shortened
from formats.terminal import ProgressLine

NUMBERS = {"amplitude": "a number", "seconds": "a number", "seed": "a whole number"}  # the options that are numbers


class SyntheticSensor(DepthSensor):
    """Renders frames of a synthetic world on demand."""

    def __init__(self, world: World, uri: str) -> None:
        self.world, self._uri = world, uri
        self._renderer = world.renderer()
        self._number = 0
        self._is_closed = False

    @classmethod
    def from_uri(cls, uri: str) -> Self:
        """Open `synthetic:MOTION?effect=NAME&amplitude=A&seconds=S&seed=N&fabric=NAME`.

        Raises:
            SensorAddressError: an unknown motion, effect, fabric or option, or a number that no world has.
        """
        motion, _, query = uri.removeprefix("synthetic:").partition("?")
        options = dict(parse_qsl(query, keep_blank_values=True))
        unknown = set(options) - {"effect", "amplitude", "seconds", "seed", "fabric"}
        if unknown:
            raise SensorAddressError(
                f"unknown option {sorted(unknown)[0]!r}", where=uri,
                advice="choose one of effect, amplitude, seconds, seed, fabric",
            )  # fmt: skip
        numbers = {name: _number(text, name, uri) for name, text in options.items() if name in NUMBERS}
        line = ProgressLine("synthetic world")
        effect, fabric = options.get("effect", "none"), options.get("fabric", "plain")
        try:
            world = make_world(
                motion=motion or "swing", effect=effect, amplitude=numbers.get("amplitude"),
                seconds=numbers.get("seconds", 8.0), seed=int(numbers.get("seed", 1)), fabric=fabric,
                progress=lambda stage, share: line.show(share, stage),
            )  # fmt: skip
        except SensorAddressError as error:  # which names the option of a command
            raise SensorAddressError(error.what, where=uri, advice=error.advice) from error
        line.end()
        return cls(world, uri)

    @property
    def info(self) -> SensorInfo:
        """Return the sensor's properties."""
        return SensorInfo(
            name="synthetic sensor",
            width=CAMERA.width,
            height=CAMERA.height, uri=self._uri, fps=FPS, intrinsics=CAMERA, is_live=False,
            frame_count=len(self.world.time),
        )  # fmt: skip

    def read(self, timeout_s: float = STALL_TIMEOUT) -> SensorFrame | None:
        """Return the next frame, or None from the end on."""
        if self._is_closed or self._number >= len(self.world.time):
            return None
        number = self._number
        self._number += 1
        depth, colour = self.world.frame(number, self._renderer)
        stamp = float(self.world.time[number]) + FIRST_STAMP
        return SensorFrame(index=number, time_s=stamp, host_time_s=time.monotonic(), depth=depth, colour=colour)

    def close(self) -> None:
        """End the sensor."""
        self._is_closed = True


def _number(text: str, name: str, uri: str) -> float:
    try:
        return int(text) if name == "seed" else float(text)
    except ValueError as error:
        raise SensorAddressError(f"{name} is {shortened(text)!r}", where=uri, advice=f"give {NUMBERS[name]}") from error

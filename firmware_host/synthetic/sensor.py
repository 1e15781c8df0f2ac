"""The synthetic sensor: the synthetic world behind the common interface of depth sensors."""

from __future__ import annotations

import time
from typing import Self
from urllib.parse import parse_qsl

from firmware_host.depth_sensor import STALL_TIMEOUT, DepthSensor, SensorFrame, SensorInfo
from firmware_host.errors import SensorAddressError
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import CAMERA, FPS
from firmware_host.synthetic.world import FIRST_STAMP, World, make_world
from formats.garment import Garment
from formats.plain_text import shortened
from formats.terminal import ProgressLine

OPTIONS = ("effect", "amplitude", "seconds", "seed", "fabric", "garment")
NUMBERS = {"amplitude": "a number", "seconds": "a number", "seed": "a whole number"}  # the options that are numbers


def garment_of(uri: str) -> Garment:
    """Return the garment that a synthetic world swings, the demo's skirt unless its address names another.

    Raises:
        SensorAddressError: there is no such garment.
    """
    name = _parts(uri)[1].get("garment", "skirt")
    if name not in GARMENTS:
        raise SensorAddressError(
            f"the synthetic world has no garment {shortened(name)!r}", where=uri,
            advice=f"choose one of {', '.join(GARMENTS)}",
        )  # fmt: skip
    return GARMENTS[name]()


class SyntheticSensor(DepthSensor):
    """Renders frames of a synthetic world on demand."""

    def __init__(self, world: World, uri: str) -> None:
        self.world, self._uri = world, uri
        self._renderer = world.renderer()
        self._number = 0
        self._is_closed = False

    @classmethod
    def from_uri(cls, uri: str) -> Self:
        """Open `synthetic:MOTION?effect=NAME&amplitude=A&seconds=S&seed=N&fabric=NAME&garment=NAME`.

        Raises:
            SensorAddressError: an unknown motion, effect, fabric, garment or option, or a number that no world has.
        """
        motion, options = _parts(uri)
        unknown = set(options) - set(OPTIONS)
        if unknown:
            raise SensorAddressError(
                f"unknown option {sorted(unknown)[0]!r}", where=uri, advice=f"choose one of {', '.join(OPTIONS)}"
            )
        garment = garment_of(uri)
        numbers = {name: _number(text, name, uri) for name, text in options.items() if name in NUMBERS}
        line = ProgressLine("synthetic world")
        effect, fabric = options.get("effect", "none"), options.get("fabric", "plain")
        try:
            world = make_world(
                motion=motion or "swing", effect=effect, amplitude=numbers.get("amplitude"),
                seconds=numbers.get("seconds", 8.0), seed=int(numbers.get("seed", 1)), garment=garment, fabric=fabric,
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
            notes=(f"the synthetic world swings the {_in_words(self.world.garment)}",),
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


def _parts(uri: str) -> tuple[str, dict[str, str]]:
    """Return the motion and the options of an address."""
    motion, _, query = uri.removeprefix("synthetic:").partition("?")
    return motion, dict(parse_qsl(query, keep_blank_values=True))


def _in_words(garment: Garment) -> str:
    """Return a garment's name and size."""
    across, along = ([corner[axis] for corner in garment.outline_m] for axis in (0, 1))
    return f"{garment.name}, {max(across) - min(across):.2f} m wide and {max(along) - min(along):.2f} m high"


def _number(text: str, name: str, uri: str) -> float:
    try:
        return int(text) if name == "seed" else float(text)
    except ValueError as error:
        raise SensorAddressError(f"{name} is {shortened(text)!r}", where=uri, advice=f"give {NUMBERS[name]}") from error

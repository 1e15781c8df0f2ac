"""Checks of the streams of a live sensor or recording: frames arrive, at the nominal rate, with depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firmware_host import openni2_library
from firmware_host.depth_sensor import MOST_FRAMES_OF_DUE
from firmware_host.doctor.checks import Check, Examination, Finding, StreamSample, ok, problem, skipped
from firmware_host.errors import SensorUnavailableError
from firmware_host.opening import SYNTHETIC, open_sensor
from firmware_host.openni2_sensor import OpenNI2Sensor
from firmware_host.usb_control.devices import UsbDevice
from formats.terminal import ProgressLine

LIVE_SENSOR = "openni2:"
# s of frames that are checked. Our choice: one dropped frame of 151 stays below `MOST_DROPPED`. At half, one of 76
# would exceed it; at twice, everybody waits longer.
WATCHED_SECONDS = 5.0
WARM_UP = 10  # first frames of a live sensor that are ignored: exposure settles, and they may be late
HIGHEST_RATE = 1.5  # of the nominal rate; a higher measured rate means that the device's clock lags
LOWEST_RATE = 0.95  # of the nominal rate; the device's clock is far better than this, so less means lost frames
MOST_DROPPED = 0.01  # of the frames: one in five seconds at 30 a second, which tracking bridges
LEAST_COVERAGE = 0.3  # of the pixels, on average; a real room measured 60 to 95 %, a garment before a far wall has less


def streams_start(examination: Examination) -> Finding:
    """Open the sensor and wait for the first frame."""
    camera = examination.camera
    if examination.source is not None or camera is None:
        sensor = open_sensor(examination.source or LIVE_SENSOR)
    else:
        uris = openni2_library.live_uris()
        uri = _uri_of(camera, examination.devices, uris)
        if uri is None and uris:
            return skipped(f"OpenNI2 would open {', '.join(uris)} and not the {camera.where}; unplug the others")
        sensor = OpenNI2Sensor(device=uri)
    examination.sensor = sensor
    frame = sensor.read()
    if frame is None:
        return problem("there is no frame in it", "record again")
    info = sensor.info
    examination.sample = StreamSample(info=info)
    examination.sample.add(frame)
    text = f"{info.name}, {info.width} x {info.height} at {info.fps:g} frames a second"
    if frame.colour is None:
        return problem(f"{text}, but no colour beside the depth", "colour is needed to find the markers")
    return ok(text)


def rate_and_drops(examination: Examination) -> Finding:
    """Measure the rate and the drops of the streams over some seconds."""
    sensor, sample = examination.sensor, _sample(examination)
    if sensor is None:
        raise SensorUnavailableError("no sensor is open", where="streams", advice="see the checks above")
    if sample.info.is_live:
        for _ in range(WARM_UP):
            sensor.read()
        sample = examination.sample = StreamSample(info=sample.info)
    most = MOST_FRAMES_OF_DUE * WATCHED_SECONDS * sample.info.fps
    line = ProgressLine("synthetic frames") if sample.info.uri.startswith(SYNTHETIC) else None  # a minute, else 5 s
    while sample.duration < WATCHED_SECONDS and len(sample.times) < most and (frame := sensor.read()) is not None:
        sample.add(frame)
        if line is not None:
            line.show(min(sample.duration / WATCHED_SECONDS, 1.0), f"{len(sample.times)} rendered")
    if line is not None:
        line.end()
    return judge_rate(sample)


def judge_rate(sample: StreamSample) -> Finding:
    """Compare the received frames with the nominal rate."""
    if len(sample.times) < 2:
        return problem("a second frame never came", "record longer")
    if HIGHEST_RATE * sample.duration < (len(sample.times) - 1) / sample.info.fps:
        return problem(
            f"its clock stands still or runs backwards: {len(sample.times)} frames came while it went from "
            f"{sample.times[0]:.2f} to {sample.times[-1]:.2f} s",
            "unplug and replug the sensor",
        )
    rate, counted = (len(sample.times) - 1) / sample.duration, len(sample.times) + sample.dropped
    text = f"{rate:.1f} frames a second for {sample.duration:.1f} s, {sample.dropped} of {counted} dropped"
    if sample.dropped > MOST_DROPPED * counted:
        return problem(text, "end other programs, and plug the sensor into a port of its own")
    if rate < LOWEST_RATE * sample.info.fps:
        return problem(f"{text}, but {sample.info.fps:g} a second are due", "end other programs and try again")
    return ok(text)


def depth_coverage(examination: Examination) -> Finding:
    """Look at how many pixels have a depth."""
    sample = _sample(examination)
    mean, least = float(np.mean(sample.coverage)), float(np.min(sample.coverage))
    text = f"depth in {100 * mean:.0f} % of the pixels, in the worst frame {100 * least:.0f} %"
    if mean < LEAST_COVERAGE:
        return problem(
            text,
            "look at it from 1.2 to 2.5 m, keep the sun out, look for a covered emitter or a mirror in the view",
        )
    return ok(text)


def _uri_of(camera: UsbDevice, devices: Sequence[UsbDevice], uris: Sequence[str]) -> str | None:
    """Return OpenNI2's name of a camera on the bus, or None.

    If a name contains no bus address, it is the camera's only if there is one name and one camera.
    """
    for uri in uris:
        if uri.endswith(f"@{camera.bus}/{camera.address}"):
            return uri
    cameras = [device for device in devices if device.model.is_camera]
    return uris[0] if len(cameras) == len(uris) == 1 and "@" not in uris[0] else None


def _sample(examination: Examination) -> StreamSample:
    if examination.sample is None:
        raise SensorUnavailableError("nothing came from the sensor", where="streams", advice="see the checks above")
    return examination.sample


STREAM_CHECKS = (
    Check(name="streams", look=streams_start, needs=("device", "permission", "driver"), is_for_recordings=True),
    Check(name="frame rate", look=rate_and_drops, needs=("streams",), is_for_recordings=True),
    Check(name="depth", look=depth_coverage, needs=("streams",), is_for_recordings=True),
)

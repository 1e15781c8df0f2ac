"""The properties of a sensor, as readable lines of name and value."""

from __future__ import annotations

from collections.abc import Callable

from firmware_host import openni2_library
from firmware_host.errors import FirmwareRefusalError, FirmwareUnsupportedError
from firmware_host.usb_control.devices import SPEEDS, UsbDevice
from firmware_host.usb_control.kinect_motor import KinectMotor, Motor
from firmware_host.usb_control.models import Protocol
from firmware_host.usb_control.ps1080 import Ps1080
from formats.telling import tell_entry

Lines = list[tuple[str, str]]

MOTOR_WORDS = {Motor.STOPPED: "stopped", Motor.AT_LIMIT: "at its limit", Motor.MOVING: "moving"}


def tell_sensor(name: str, lines: Lines) -> None:
    """Print a sensor's name and its properties, a line each."""
    tell_entry(
        "sensors", "\n".join([name, *(f"    {of:<14} {value}" for of, value in lines)]), name=name, facts=dict(lines)
    )


def driver_status(device: UsbDevice) -> str:
    """Return whether OpenNI2 has a driver for a device, and whether a kernel driver has claimed it."""
    name = device.model.openni2_driver
    if not device.model.is_camera:
        status = "none needed, this part gives no pictures"
    elif name is None:
        status = "OpenNI2 as Debian ships it has no driver for it"
    elif openni2_library.find_driver(name) is None:
        status = f"OpenNI2 driver {name} is not installed"
    else:
        status = f"OpenNI2 driver {name}"
    return status + ("; held by a driver of the kernel" if device.kernel_driver else "")


def place_lines(device: UsbDevice) -> Lines:
    """Return the properties of a device on the bus, as lines of name and value."""
    return [
        ("place", f"USB {device.bus}:{device.address}, {device.vendor:04x}:{device.product:04x}"),
        ("serial", device.serial or "not readable, or none"),
        ("speed", SPEEDS.get(device.speed, SPEEDS[0])[0]),
        ("driver", driver_status(device)),
    ]


def information(device: UsbDevice) -> Lines:
    """Query all properties of a device.

    Raises:
        FirmwareError: the device does not answer, or gives an invalid answer.
    """
    link = device.open_link()
    try:
        if device.model.protocol is Protocol.PS1080:
            return _ps1080_lines(Ps1080(link, device.where))
        return _motor_lines(KinectMotor(link, device.where))
    finally:
        link.close()


def _ps1080_lines(sensor: Ps1080) -> Lines:
    version = sensor.version()
    return [
        ("firmware", f"{version} on {version.chip_name}, system {version.system}"),
        ("serial number", _if_known(sensor.serial_number)),
        ("platform", _if_known(sensor.platform)),
        ("geometry", _if_known(lambda: _geometry(sensor))),
        ("processor", _if_known(lambda: _processor(sensor))),
        ("gravity", "not measured: this sensor has no accelerometer"),
    ]


def _geometry(sensor: Ps1080) -> str:
    fixed = sensor.fixed_parameters()
    return (
        f"depth focal length {fixed.focal_length(640):.1f} px at 640 px, "
        f"emitter at {1000 * fixed.emitter_baseline_m:.1f} mm, colour camera at {1000 * fixed.colour_baseline_m:.1f} mm"
    )


def _processor(sensor: Ps1080) -> str:
    seconds = [task.seconds for task in sensor.cpu_statistics()]
    if not sum(seconds):
        return "no times"
    return (
        f"{len(seconds)} tasks, {sum(seconds):.1f} s in all, {100 * max(seconds) / sum(seconds):.0f} % in the busiest"
    )


def _motor_lines(motor: KinectMotor) -> Lines:
    state = motor.state()
    lines = [
        ("tilt", "unknown while it moves" if state.tilt_degrees is None else f"{state.tilt_degrees:.1f} degrees"),
        ("motor", MOTOR_WORDS[state.motor] if isinstance(state.motor, Motor) else f"state {state.motor}"),
        ("acceleration", "{:.2f} {:.2f} {:.2f} m/s^2".format(*state.acceleration) + f", {state.size_g:.2f} g"),
    ]
    if state.is_still:
        gravity = ", ".join(f"{part:.4f}" for part in state.gravity())
        lines.append(("gravity", f"[{gravity}] in the sensor frame, as in rig.toml; within about 3 degrees"))
    else:
        lines.append(("gravity", "unknown: the sensor is not standing still"))
    return lines


def _if_known(ask: Callable[[], str]) -> str:
    try:
        return ask() or "empty"
    except (FirmwareUnsupportedError, FirmwareRefusalError):
        return "not in this firmware"

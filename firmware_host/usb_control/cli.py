"""`hangtime sensor info|log|reset|led`: queries and commands to the sensor's firmware."""

from __future__ import annotations

from contextlib import closing
from typing import Annotated

import typer

from formats.telling import tell

Place = Annotated[
    str | None,
    typer.Option("--device", metavar="BUS:ADDRESS", help="Sensor to use, as `hangtime sensor list` shows it."),
]


def add_commands(sensor: typer.Typer) -> None:
    """Add these commands to `hangtime sensor`."""
    sensor.command("info", short_help="Ask the sensor for firmware, serial number, tilt.")(info)
    sensor.command("log", short_help="Print what the firmware logged.")(log)
    sensor.command("reset", short_help="Reset the firmware, or reboot the sensor.")(reset)
    sensor.command("led", short_help="Switch the sensor's lamp.")(led)


def info(device: Place = None) -> None:
    """Query firmware, serial number and platform of the sensor; of a Kinect, tilt, acceleration and gravity."""
    from firmware_host.usb_control import devices
    from firmware_host.usb_control.models import Protocol
    from firmware_host.usb_control.report import information, place_lines, tell_sensor

    found = devices.find_devices()
    for chosen in devices.choose(found, (Protocol.PS1080, Protocol.KINECT_MOTOR), "its properties", device):
        tell_sensor(chosen.model.name, place_lines(chosen) + information(chosen))


def log(device: Place = None) -> None:
    """Print the firmware's log since the last reading; reading clears the log."""
    from firmware_host.usb_control import devices
    from firmware_host.usb_control.models import Protocol
    from firmware_host.usb_control.ps1080 import Ps1080

    chosen = devices.choose(devices.find_devices(), (Protocol.PS1080,), "a log", device)[0]
    with closing(chosen.open_link()) as link:
        lines = Ps1080(link, chosen.where).log()
    tell("\n".join(lines) if lines else "The log is empty.", lines=list(lines))


def reset(
    reboot: Annotated[bool, typer.Option("--reboot", help="Reboot: the sensor leaves the bus and returns.")] = False,
    device: Place = None,
) -> None:
    """Reset the firmware, or reboot the sensor, and wait until it answers again."""
    from firmware_host.errors import UsbTimeoutError
    from firmware_host.usb_control import devices
    from firmware_host.usb_control.link import PyusbLink
    from firmware_host.usb_control.models import Protocol
    from firmware_host.usb_control.ps1080 import Ps1080, wait_until_answering

    chosen = devices.choose(devices.find_devices(), (Protocol.PS1080,), "a reset", device)[0]
    with closing(chosen.open_link()) as link:
        sensor = Ps1080(link, chosen.where)
        if reboot:
            sensor.reboot()
        else:
            sensor.soft_reset()

    def find_again() -> PyusbLink | None:
        """Return the sensor of the same kind and serial; its address changes with a reboot."""
        for other in devices.find_devices():
            same_kind = (other.vendor, other.product) == (chosen.vendor, chosen.product)
            if same_kind and (chosen.serial is None or other.serial in (None, chosen.serial)):
                return other.open_link()
        return None

    seconds = wait_until_answering(find_again)
    if seconds is None:
        raise UsbTimeoutError("does not answer after the reset", where=chosen.where, advice="unplug and replug it")
    done = "rebooted" if reboot else "reset"
    tell(f"{chosen.where}: {done}, answers again after {seconds:.1f} s", where=chosen.where, done=done, seconds=seconds)


def led(
    colour: Annotated[
        str,
        typer.Argument(metavar="COLOUR", help="Kinect: off, green, red, yellow, blink-green, blink-red-yellow; "
                       "PS1080: on or off."),
    ],
    device: Place = None,
) -> None:  # fmt: skip
    """Switch the sensor's lamp: the Kinect's has colours, the PS1080's is on or off."""
    from firmware_host.errors import SensorAddressError
    from firmware_host.usb_control import devices
    from firmware_host.usb_control.kinect_motor import KinectMotor, Led
    from firmware_host.usb_control.models import Protocol
    from firmware_host.usb_control.ps1080 import Ps1080

    either = (Protocol.PS1080, Protocol.KINECT_MOTOR)
    chosen = devices.choose(devices.find_devices(), either, "a lamp", device)[0]
    is_kinect = chosen.model.protocol is Protocol.KINECT_MOTOR
    colours = {led.name.lower().replace("_", "-"): led for led in Led}
    known = list(colours) if is_kinect else ["on", "off"]
    if colour not in known:
        raise SensorAddressError(
            f"its lamp has no state {colour!r}", where=chosen.where, advice=f"choose one of {', '.join(known)}"
        )
    with closing(chosen.open_link()) as link:
        if is_kinect:
            KinectMotor(link, chosen.where).set_led(colours[colour])
        else:
            Ps1080(link, chosen.where).set_led(colour == "on")
    tell(f"{chosen.where}: lamp {colour}", where=chosen.where, lamp=colour)

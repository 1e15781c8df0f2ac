"""Checks of the USB device: presence, permission, speed and power, firmware, driver."""

from __future__ import annotations

from firmware_host import openni2_library
from firmware_host.doctor.checks import Check, Examination, Finding, ok, problem
from firmware_host.errors import SensorUnavailableError
from firmware_host.usb_control import devices
from firmware_host.usb_control.devices import NO_SENSOR_FOUND, PLUG_IN, SPEEDS, UNPOWERED_PORT, USB_BUS, UsbDevice
from firmware_host.usb_control.models import Protocol
from firmware_host.usb_control.ps1080 import Ps1080

NEEDED_SPEED = 480.0  # Mbit/s: depth of 11 bits at 640 x 480 and 30 frames a second is 101 Mbit/s, colour comes on top
USUAL_DRIVER = "PS1080"


def on_the_bus(examination: Examination) -> Finding:
    """Find a depth camera on the bus."""
    found = devices.find_devices()
    examination.devices = found
    if examination.place is not None:
        wanted = devices.parse_place(examination.place)
        found = [device for device in found if (device.bus, device.address) == wanted]
    cameras = [device for device in found if device.model.is_camera]
    if not cameras:
        parts = ", ".join(device.where for device in found)
        if parts:
            return problem(
                f"only a part of a sensor is there: {parts}", "plug in its power supply, the camera needs it"
            )
        return problem(f"{USB_BUS}: {NO_SENSOR_FOUND}", PLUG_IN)
    camera = examination.camera = cameras[0]
    more = f"; {len(cameras) - 1} more, choose with --device" if len(cameras) > 1 else ""
    return ok(f"{camera.where}, {camera.vendor:04x}:{camera.product:04x}{more}")


def may_be_opened(examination: Examination) -> Finding:
    """Check that this user may open the device."""
    _camera(examination).check_access()
    return ok("this user may open it")


def fast_and_powered(examination: Examination) -> Finding:
    """Compare the connection's speed and current with the streams' needs."""
    camera = _camera(examination)
    speed = SPEEDS.get(camera.speed, SPEEDS[0])[0]
    if 0 < camera.megabits < NEEDED_SPEED:
        return problem(
            f"connected at {speed}, the streams need 480 Mbit/s",
            "use a USB 2 or 3 port of the computer itself, and another cable",
        )
    if camera.on_unpowered_hub and camera.milliamperes > UNPOWERED_PORT:
        return problem(
            f"the camera may draw {camera.milliamperes} mA from a hub without a supply, which gives "
            f"{UNPOWERED_PORT} mA",
            "plug it into the computer itself, or give the hub its supply",
        )
    current = f", up to {camera.milliamperes} mA" if camera.milliamperes else ""
    return ok(speed + current)


def firmware_answers(examination: Examination) -> Finding:
    """Query the firmware's version and serial number."""
    camera = _camera(examination)
    if camera.model.protocol is not Protocol.PS1080:
        return ok("none of its own to ask: this sensor's camera has no request for it")
    link = camera.open_link()
    try:
        sensor = Ps1080(link, camera.where)
        sensor.keep_alive()
        return ok(f"{sensor.version()} on {sensor.version().chip_name}")
    finally:
        link.close()


def driver_is_there(examination: Examination) -> Finding:
    """Load OpenNI2 and find the sensor's driver; without a sensor, the PS1080's driver."""
    openni2_library.load()
    camera = examination.camera
    name = USUAL_DRIVER if camera is None else camera.model.openni2_driver
    if camera is not None and name is None:
        return problem(
            f"OpenNI2 as Debian ships it has no driver for the {camera.model.name}",
            "record with its maker's OpenNI2 and play the .oni file here, or use a PS1080 sensor",
        )
    file = openni2_library.find_driver(name or USUAL_DRIVER)
    if file is None:
        return problem(f"OpenNI2's driver lib{name}.so is not installed", openni2_library.INSTALL_ADVICE)
    if camera is not None and camera.kernel_driver:
        return problem(
            "a driver of the kernel holds the sensor",
            "`lsusb -t` names the driver, and `sudo modprobe -r` removes the driver",
        )
    return ok(f"OpenNI2 and its driver {file.name}")


def _camera(examination: Examination) -> UsbDevice:
    if examination.camera is None:
        raise SensorUnavailableError(NO_SENSOR_FOUND, where=USB_BUS, advice=PLUG_IN)
    return examination.camera


USB_CHECKS = (
    Check(name="device", look=on_the_bus),
    Check(name="permission", look=may_be_opened, needs=("device",)),
    Check(name="speed and power", look=fast_and_powered, needs=("device",)),
    Check(name="firmware", look=firmware_answers, needs=("device", "permission")),
    Check(name="driver", look=driver_is_there),
)

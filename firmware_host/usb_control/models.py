"""The USB devices that are depth sensors, or parts of one, and the requests that each understands.

Vendor and product numbers: Debian's `60-libopenni2-0.rules` and OpenNI2's `PS1080/Sensor/XnDeviceEnumeration.cpp`
(PS1080), `PSLink/LinkDeviceEnumeration.cpp` and `primesense-usb.rules` (PSLink), libfreenect's
`src/freenect_internal.h` (Kinect), ros_astra_camera's `56-orbbec-usb.rules` (Orbbec).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Protocol(Enum):
    """The protocol of a device's control endpoint."""

    PS1080 = "PS1080 host protocol"
    KINECT_MOTOR = "Kinect v1 motor"
    NONE = "none that Hangtime speaks"


@dataclass(frozen=True, kw_only=True)
class Model:
    """A model of depth sensor, by its USB ids.

    - `openni2_driver`: the file name of OpenNI2's driver without `lib` and `.so`, None where Debian ships none
    - `is_camera`: whether this device measures depth; a Kinect v1 is three devices, of which one does
    """

    name: str
    protocol: Protocol = Protocol.NONE
    openni2_driver: str | None = None
    is_camera: bool = True


PRIMESENSE = 0x1D27  # USB vendor number, see the module
MICROSOFT = 0x045E  # USB vendor number, see the module
ORBBEC = 0x2BC5  # USB vendor number, see the module

_PS1080 = Model(
    name="PrimeSense PS1080 (Carmine, Xtion)", protocol=Protocol.PS1080, openni2_driver="PS1080"
)  # fmt: skip
_PSLINK = Model(name="PrimeSense PSLink (Carmine 1.25 and relatives)", openni2_driver="PSLink")
_ASTRA = Model(name="Orbbec Astra")

MODELS: dict[tuple[int, int], Model] = {
    **{(PRIMESENSE, product): _PS1080 for product in (0x0200, 0x0300, 0x0400, 0x0401, 0x0500, 0x0600, 0x0601, 0x0609)},
    **{(PRIMESENSE, product): _PSLINK for product in (0x1250, 0x1260, 0x1270, 0x1280, 0x1290, 0x2100, 0x2200, 0xF9DB)},
    (MICROSOFT, 0x02AE): Model(name="Kinect v1 camera"),
    (MICROSOFT, 0x02B0): Model(name="Kinect v1 motor", protocol=Protocol.KINECT_MOTOR, is_camera=False),
    (MICROSOFT, 0x02AD): Model(name="Kinect v1 audio", is_camera=False),
    (MICROSOFT, 0x02BF): Model(name="Kinect for Windows camera"),
    (MICROSOFT, 0x02BB): Model(name="Kinect for Windows audio", is_camera=False),
    (MICROSOFT, 0x02BE): Model(name="Kinect for Windows audio", is_camera=False),
    (MICROSOFT, 0x02C3): Model(name="Kinect for Windows audio", is_camera=False),
    **{(ORBBEC, product): _ASTRA for product in (0x0401, 0x0402, 0x0403, 0x0404, 0x0407)},
}

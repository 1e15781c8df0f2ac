"""The tables of the appliance's configuration file: type, range and default of every key."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from formats.errors import DescriptionError, HangtimeError
from formats.meant_units import meant
from formats.toml_files import read_toml
from formats.wrong_fields import wrong_field

OUT_OF_RANGE = re.compile(r"(\w+)\.(\w+) must be a (?:whole )?number (?:at most|at least) \S+$")
OTHER_UNITS = {
    "_s": (("milliseconds", 1e-3), ("minutes", 60.0)),
    "_mb": (("bytes", 1e-6), ("kB", 1e-3), ("GB", 1e3)),
    "_hz": (("frames a minute", 1 / 60),),
}  # of keys by their ending: other units, and how many of the key's unit each is
# points around the silhouette for each point along a side. Our choice: twice a square's 4, so that the outline is
# denser than the grid.
CONTOUR = 8


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base class of the file's tables; an unknown key raises a validation error."""


class SensorPart(Part, frozen=True, kw_only=True):
    """`[sensor]`: the sensor, and the rig and garment in front of it."""

    rig: Annotated[Path, Meta(description="the rig description; a relative path starts at the file's folder")]
    garment: Annotated[Path, Meta(description="the garment description")]
    address: Annotated[
        str, Meta(min_length=1, description="`openni2:` for the connected device; `live:FILE.oni` for none")
    ] = "openni2:"


MOST_SCAN_PLACES = 1_000_000  # of all scans of a take: checking them needs 24 MB and 20 s of a fast core


class RecordingPart(Part, frozen=True, kw_only=True):
    """`[recording]`: the length of a take, and the rate and size of its surface scans."""

    pre_roll_s: Annotated[
        float, Meta(ge=0.0, le=10.0, description="seconds before the press that belong to the take")
    ] = 2.0  # s; our choice: a swing that began before the press belongs to the take
    longest_s: Annotated[
        float, Meta(ge=5.0, le=3600.0, description="seconds after the press at which a take ends by itself")
    ] = 120.0  # s; our choice: a take that nobody ends stays small
    scan_rate_hz: Annotated[float, Meta(ge=0.0, le=60.0, description="surface scans a second; 0 for none")] = 0.0
    # Our choice: one point every 42 mm on a garment of half a metre.
    scan_points: Annotated[int, Meta(ge=3, le=64, description="a scan's grid has so many places a side")] = 12

    def __post_init__(self) -> None:
        scans = self.scan_rate_hz * (self.pre_roll_s + self.longest_s)
        places = scans * self.scan_points * (self.scan_points + CONTOUR)
        if places > MOST_SCAN_PLACES:
            raise ValueError(
                f"the scans of the longest take have {places / 1e6:.1f} million places, at most 1 million can be "
                "judged; lower scan_rate_hz, scan_points or longest_s"
            )


class ButtonPart(Part, frozen=True, kw_only=True):
    """`[button]`: the input device of the button."""

    device: Annotated[
        str,
        Meta(
            description="input device by path (`/dev/input/event0`) or name (`gpio-keys`), `gpio:/dev/gpiochip0:17`, "
            "a named pipe of input events, or empty for no button"
        ),
    ] = ""


class LampPart(Part, frozen=True, kw_only=True):
    """`[lamp]`: the LEDs that show the state."""

    led: Annotated[str, Meta(description="name of the LED in the folder of LEDs; empty for none")] = ""
    fault_led: Annotated[str, Meta(description="a second, red LED for faults; empty: `led` shows them too")] = ""
    leds: Annotated[Path, Meta(description="the folder of LEDs")] = Path("/sys/class/leds")


class ControlPart(Part, frozen=True, kw_only=True):
    """`[control]`: the control socket, and the group that may use it."""

    socket: Annotated[Path, Meta(description="the Unix socket that `hangtime start` and the like speak to")] = Path(
        "/run/hangtime/control.sock"
    )
    group: Annotated[str, Meta(description="the group that may use the socket; empty: the recorder's own")] = ""


class SpoolPart(Part, frozen=True, kw_only=True):
    """`[spool]`: the folder that holds takes until they are on the server."""

    folder: Annotated[Path, Meta(description="the folder of the takes")] = Path("/var/lib/hangtime/takes")
    least_free_mb: Annotated[
        int, Meta(ge=10, le=1_000_000, description="room on the disk [MB] below which no take begins")
    ] = 50  # MB; our choice: a take of minutes has megabytes
    slowest_s: Annotated[
        float, Meta(ge=1.0, le=4.0, description="seconds that the disk may be behind before a take is ended")
    ] = 3.0  # s; our choice: a slow card's pause is waited for, and a broken one is not


class PowerPart(Part, frozen=True, kw_only=True):
    """`[power]`: the file that reports undervoltage of the board."""

    alarm: Annotated[
        Path | None,
        Meta(description="file that says 1 after too low a voltage; left out: a Raspberry Pi's is found by itself"),
    ] = None


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All tables of the file. `hangtime sync` validates the table `sync` itself."""

    sensor: SensorPart
    recording: RecordingPart = RecordingPart()
    button: ButtonPart = ButtonPart()
    lamp: LampPart = LampPart()
    control: ControlPart = ControlPart()
    spool: SpoolPart = SpoolPart()
    power: PowerPart = PowerPart()
    sync: dict[str, Any] = {}


def read_tables(file: Path, failure: type[HangtimeError] = DescriptionError) -> Any:
    """Return the tables of a configuration file as they are; failure: class of the error to raise.

    Raises:
        HangtimeError: of the class `failure`; the file is absent, cannot be read, or is not TOML.
    """
    try:
        return read_toml(file, failure)
    except failure as error:
        if not isinstance(error.__cause__, FileNotFoundError):
            raise
        advice = "install the appliance (docs/how-to/appliance.md), or give another file with --config"
        raise failure("is absent", where=file, advice=advice) from error.__cause__


def wrong_in_tables(error: msgspec.ValidationError, plain: Any) -> str:
    """Return the invalid key and the values that it accepts; of a number also the given one and the unit meant.

    plain: the tables of the file
    """
    words = wrong_field(error, (Config, *Part.__subclasses__()), plain)
    found = OUT_OF_RANGE.match(words)
    if not found:
        return words
    value = plain.get(found[1], {}).get(found[2])
    bounds = next(part.type for part in msgspec.structs.fields(Config) if part.name == found[1])
    table: Any = msgspec.inspect.type_info(bounds)
    kind = next(field.type for field in table.fields if field.name == found[2])
    of_key = getattr(kind, "type", kind)  # within its description
    least, most = (-math.inf if of_key.ge is None else of_key.ge, math.inf if of_key.le is None else of_key.le)
    units = next((units for ending, units in OTHER_UNITS.items() if found[2].endswith(ending)), ())
    return f"{words} (got {value:g}){meant(value, least, most, units)}"

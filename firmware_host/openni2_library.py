"""Load OpenNI2's Python binding and its native library, once per process.

The module makes two repairs. On Python 3.13 ctypes builds classes in `__init__`, so the binding's enum metaclass must
finish its classes there. The native library is loaded by its versioned name, the only one that distributions install
without headers.
"""

from __future__ import annotations

import configparser
import ctypes
import ctypes.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from firmware_host.errors import SensorUnavailableError

LIBRARY_NAME = "libOpenNI2.so.0"
INSTALL_ADVICE = "install it: apt-get install libopenni2-0"
SETTINGS_FILE = Path("/etc/openni2/OpenNI.ini")  # Debian's path; [Drivers] Repository= names the folder of drivers
DRIVER_FOLDERS = (  # beside the library, unless a setting names another folder
    "/usr/lib/*/OpenNI2/Drivers", "/usr/lib/OpenNI2/Drivers", "/usr/lib64/OpenNI2/Drivers",
    "/usr/local/lib/OpenNI2/Drivers", "/usr/local/lib/*/OpenNI2/Drivers",
)  # fmt: skip

LONGEST_URI = 255  # bytes: ONI_MAX_STR of OpenNI2's OniCTypes.h, less the zero at the end
OPENED = "/proc/self/fd/"  # Linux: an open file by its number (`man 5 proc`)

_loaded: dict[str, Any] = {}


def load() -> Any:
    """Return the binding's `openni2` module, initialised.

    Raises:
        SensorUnavailableError: the binding or the native library is not installed.
    """
    if "module" in _loaded:
        return _loaded["module"]
    try:
        _repair_enums()
        from openni import _openni2, openni2
    except ModuleNotFoundError as error:
        raise SensorUnavailableError(
            "the Python package `openni` is not installed",
            where=None,
            advice="in Hangtime's checkout: pip install -e '.[capture]'",
        ) from error
    try:
        _openni2.load_dll(LIBRARY_NAME)
    except OSError as error:
        raise SensorUnavailableError(
            f"the OpenNI2 library ({LIBRARY_NAME}) is not installed", where=None, advice=INSTALL_ADVICE
        ) from error
    try:
        _openni2.oniInitialize(_openni2.ONI_API_VERSION)
    except openni2.OpenNIError as error:
        raise SensorUnavailableError(
            f"the library does not start ({reason(error)})",
            where="OpenNI2",
            advice="install it again with its drivers: apt-get install --reinstall libopenni2-0",
        ) from error
    openni2._openni2_initialized = True
    openni2.loaded_dll_directory = LIBRARY_NAME
    _loaded["module"] = openni2
    return openni2


def live_uris() -> list[str]:
    """Return OpenNI2's names of the connected devices; a PS1080's is like `1d27/0600@1/4`, bus and address at its end.

    OpenNI2 also lists recordings that this process has played, even closed ones; they are omitted here.

    Raises:
        SensorUnavailableError: the library is missing or cannot list devices.
    """
    binding = load()
    try:
        uris = [uri.decode(errors="replace") for uri in binding.Device.enumerate_uris()]
    except binding.OpenNIError as error:
        raise SensorUnavailableError(
            f"the library cannot list the devices ({reason(error)})",
            where="OpenNI2",
            advice="`hangtime sensor doctor` checks bus, permission and driver",
        ) from error
    return [uri for uri in uris if not uri.lower().endswith(".oni") and not uri.startswith(OPENED)]


@contextmanager
def playable(path: Path) -> Iterator[str]:
    """Yield a name under which OpenNI2 opens a recording, for as long as this context lasts.

    A letter outside ASCII ends the process within OpenNI2, and it does not open a longer name than `LONGEST_URI`.

    Raises:
        OSError: the file cannot be read.
    """
    name = str(path)
    if name.isascii() and len(name) <= LONGEST_URI:
        yield name
        return
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        yield f"{OPENED}{handle}"
    finally:
        os.close(handle)


def reason(error: BaseException) -> str:
    """Return the library's message in an error of the binding, which stores it as bytes with a code and a file name."""
    for part in error.args:
        if isinstance(part, bytes) and part.strip():
            return part.decode(errors="replace").strip().rstrip("!.")
    return str(error)


def find_driver(name: str) -> Path | None:
    """Return the file of OpenNI2's driver of this name, such as `PS1080`, or None if it is not installed."""
    folders = [folder for pattern in DRIVER_FOLDERS for folder in sorted(Path("/").glob(pattern.lstrip("/")))]
    settings = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        settings.read(SETTINGS_FILE)
        chosen = settings.get("Drivers", "Repository", fallback="").strip()
    except (configparser.Error, UnicodeDecodeError):
        chosen = ""
    if chosen.startswith("/"):
        folders = [Path(chosen)]
    for folder in folders:
        for file in sorted(folder.glob(f"lib{name}.so*")):
            return file
    return None


def _repair_enums() -> None:
    if sys.version_info < (3, 13):
        return
    from openni import utils

    base = type(ctypes.c_int)

    def create(cls: Any, name: str, bases: Any, namespace: Any) -> Any:
        return base.__new__(cls, name, bases, namespace)

    def finish(self: Any, name: str, bases: Any, namespace: Any) -> None:
        base.__init__(self, name, bases, namespace)
        if namespace.get("__module__") == utils.__name__:
            return
        namespace["_values_"].clear()
        for member in namespace["_names_"]:
            if not member.startswith("_"):
                setattr(self, member, self(namespace[member]))
                namespace["_names_"][member] = namespace[member]
                namespace["_values_"][namespace[member]] = member

    utils.CEnumMeta.__new__ = staticmethod(create)
    utils.CEnumMeta.__init__ = finish

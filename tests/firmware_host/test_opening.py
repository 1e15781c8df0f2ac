"""Opening a sensor by its name; wrong names get one clear sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_host import openni2_library
from firmware_host.errors import RecordingError, SensorAddressError, SensorError, SensorUnavailableError
from firmware_host.opening import open_sensor


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"absent\.oni"):
        open_sensor(str(tmp_path / "absent.oni"))


def test_a_picture_is_not_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "photo.oni"
    path.write_bytes(b"\x89PNG" + bytes(100))
    with pytest.raises(RecordingError, match=r"not an \.oni recording"):
        open_sensor(str(path))


@pytest.mark.parametrize("name", ["synthetic:backflip", "synthetic:swing?effect=magic", "synthetic:swing?colour=red"])
def test_a_synthetic_sensor_that_does_not_exist_lists_what_does(name: str) -> None:
    with pytest.raises(SensorAddressError, match="choose of"):
        open_sensor(name)


def test_an_option_that_is_no_number_is_refused() -> None:
    with pytest.raises(SensorAddressError, match="not a number"):
        open_sensor("synthetic:swing?seconds=long")


def test_an_address_of_an_unknown_kind_is_refused() -> None:
    with pytest.raises(SensorError, match="there is no sensor"):
        open_sensor("https://example.org/stream")


def test_without_the_native_library_the_advice_is_the_apt_command(monkeypatch: pytest.MonkeyPatch) -> None:
    binding = pytest.importorskip("openni._openni2")
    monkeypatch.setattr(binding, "_the_dll", None)
    monkeypatch.setattr(openni2_library, "_loaded", {})
    monkeypatch.setattr(openni2_library, "LIBRARY", "libNotThere.so.0")
    with pytest.raises(SensorUnavailableError, match="apt-get install libopenni2-0"):
        openni2_library.load()
    assert not openni2_library.is_available()

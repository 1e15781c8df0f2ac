"""Opening a sensor by its name; wrong names get one clear sentence."""

from __future__ import annotations

import re
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from firmware_host import openni2_library
from firmware_host.errors import RecordingError, SensorAddressError, SensorError, SensorUnavailableError
from firmware_host.opening import open_sensor
from firmware_host.synthetic.scene import CAMERA
from firmware_host.synthetic.swatch import make_swatch_take
from formats.command import app, gather_commands
from tests import openni2


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"absent\.oni"):
        open_sensor(str(tmp_path / "absent.oni"))


def test_a_picture_is_not_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "photo.oni"
    path.write_bytes(b"\x89PNG" + bytes(100))
    with pytest.raises(RecordingError, match=r"not an \.oni recording"):
        open_sensor(str(path))


@pytest.mark.parametrize("name", ["synthetic:backflip", "synthetic:swing?effect=magic", "synthetic:swing?colour=red",
    "synthetic:swing?fabric=tweed", "synthetic:swing?garment=coat",
])  # fmt: skip
def test_a_synthetic_sensor_that_does_not_exist_lists_what_does(name: str) -> None:
    with pytest.raises(SensorAddressError, match="choose one of"):
        open_sensor(name)


@pytest.mark.parametrize(("text", "told"), [("long", "'long'"), ("", "''"), ("x" * 900, f"'{'x' * 60} .*")])
def test_an_option_that_is_no_number_is_refused(text: str, told: str) -> None:
    with pytest.raises(SensorAddressError, match=f"seconds is {told}; give a number") as refused:
        open_sensor(f"synthetic:swing?seconds={text}")
    assert len(refused.value.what) < 200


@pytest.mark.parametrize(
    ("option", "sentence"),
    [
        ("seconds=-1", "cannot last for -1 seconds; give 1 to 120"),
        ("seconds=0.5", "cannot last for 0.5 seconds"),
        ("seconds=nan", "cannot last for nan seconds"),
        ("seconds=inf", "cannot last for inf seconds"),
        ("seconds=1e9", r"cannot last for 1e\+09 seconds; give 1 to 120"),
        ("seconds=121", "cannot last for 121 seconds"),
        ("effect=air_drag&amplitude=1e9", r"air_drag cannot have the amplitude 1e\+09; choose 0 to 100"),
        ("effect=time_offset&amplitude=-0.6", "time_offset cannot be -0.6 s; choose -0.5 to 0.5"),
        ("amplitude=1", "the amplitude 1 is of no effect; name the effect too: one of none, air_drag"),
        ("seed=-1", "the seed -1 is below 0; give 0 or more"),
        ("effect=hem&amplitude=nan", "nan is no size of an effect"),
    ],
)
def test_a_number_that_no_world_has_is_refused(option: str, sentence: str) -> None:
    with pytest.raises(SensorAddressError, match=rf"^synthetic:swing\?{re.escape(option)}: .*{sentence}"):
        open_sensor(f"synthetic:swing?{option}")


def test_a_synthetic_world_reports_how_far_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    open_sensor("synthetic:swing?seconds=1").close()
    lines = capsys.readouterr().err.splitlines()
    assert (lines[0], lines[-1]) == ("synthetic world: 0 %, cloth", "synthetic world: 100 %, cloth")


@pytest.mark.parametrize(
    ("command", "option", "number"),
    [("synthesise", "--seed", "-1"), ("synthesise-swatch", "--seed", "-1"), ("synthesise", "--seconds", "121"),
     ("synthesise-silhouette", "--seconds", "121"), ("synthesise-silhouette", "--seconds", "3.9")],
)  # fmt: skip
def test_a_seed_or_length_beyond_its_ends_is_refused_before_anything_is_made(
    tmp_path: Path, command: str, option: str, number: str
) -> None:
    gather_commands()
    done = CliRunner().invoke(app, ["sensor", command, str(tmp_path / "d"), option, number])
    assert done.exit_code == 2
    assert f"Invalid value for '{option}'" in done.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "sentence"),
    [
        ({"seed": -1}, "seed -1"),
        ({"air_drag": float("nan")}, "nan is no drag"),
        ({"air_drag": 1e9}, r"1e\+09 is no drag coefficient; give 0 to 100"),
    ],
)
def test_a_number_that_no_swatch_has_is_refused(tmp_path: Path, number: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SensorAddressError, match=sentence):
        make_swatch_take(tmp_path, fabric="silk", **number)


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ([], "0 frames in 0.00 s, "), ([5.0], "1 frame in 0.00 s, "), ([5.0, 6.0], "2 frames in 1.00 s (1.0 a second)"),
        ([5.0, 2.0], "depth in 100 % of the pixels; its clock was set back 1 time\n"),
        ([5.0, 5.1, 5.0, 5.3, 5.2, 5.5], "6 frames in 0.50 s (10.0 a second), 0 dropped, 6 without colour; depth in "
         "100 % of the pixels; its clock was set back 2 times\n"),
        ([5.0, 5.0], "2 frames in 0.00 s (its clock stands still), "),
    ],
)  # fmt: skip
def test_playing_reports_a_rate_where_there_are_two_frames(
    monkeypatch: pytest.MonkeyPatch, times: list[float], said: str
) -> None:
    played = [SimpleNamespace(time_s=time, dropped_before=0, colour=None, depth=np.ones((2, 2))) for time in times]
    info = SimpleNamespace(name="a", intrinsics=CAMERA, fps=30.0, notes=())
    sensor = SimpleNamespace(info=info, frames=lambda: iter(played))
    monkeypatch.setattr("firmware_host.opening.open_sensor", lambda source, anyway: nullcontext(sensor))
    gather_commands()
    assert said in CliRunner().invoke(app, ["sensor", "play", "a.oni"]).output


@pytest.mark.parametrize("words", [[], ["--anyway"]])
def test_playing_accepts_implausible_stamps_only_where_anyway_is_given(
    monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    asked: list[bool] = []
    sensor = SimpleNamespace(
        info=SimpleNamespace(name="a", intrinsics=CAMERA, fps=30.0, notes=()), frames=lambda: iter(())
    )
    monkeypatch.setattr(
        "firmware_host.opening.open_sensor", lambda source, anyway: asked.append(anyway) or nullcontext(sensor)
    )
    gather_commands()
    CliRunner().invoke(app, ["sensor", "play", "a.oni", *words])
    assert asked == [bool(words)]


def test_an_address_of_an_unknown_kind_is_refused() -> None:
    with pytest.raises(SensorError, match="no sensor has such an address"):
        open_sensor("https://example.org/stream")


def test_without_the_native_library_the_advice_is_the_apt_command(monkeypatch: pytest.MonkeyPatch) -> None:
    binding = pytest.importorskip("openni._openni2")
    monkeypatch.setattr(binding, "_the_dll", None)
    monkeypatch.setattr(openni2_library, "_loaded", {})
    monkeypatch.setattr(openni2_library, "LIBRARY_NAME", "libNotThere.so.0")
    with pytest.raises(SensorUnavailableError, match="apt-get install libopenni2-0"):
        openni2_library.load()
    assert not openni2.is_available()

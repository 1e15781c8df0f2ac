"""The command that makes a sensor's recording passes on each of its options."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from firmware_host.errors import SensorAddressError
from firmware_host.synthetic import recording
from tests.fit.here import hangtime_here


def test_every_option_of_a_synthetic_recording_is_passed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}

    def make(out: Path, name: str, **options: Any) -> tuple[Path, ...]:
        given.update(options, out=out, name=name)
        return (out / f"{name}.oni",)

    monkeypatch.setattr(recording, "make_recording", make)
    numbers = ["--amplitude", "1.5", "--seconds", "6", "--seed", "4", "--rest", "2.5"]
    words = ["--name", "swing", "--motion", "twist", "--effect", "hem", "--garment", "swatch", "--fabric", "felt"]
    done = hangtime_here("sensor", "synthesise", tmp_path, *words, *numbers, "--overwrite", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    del given["progress"]
    assert given == {
        "out": tmp_path, "name": "swing", "motion": "twist", "effect": "hem", "amplitude": 1.5, "seconds": 6.0,
        "seed": 4, "garment": "swatch", "fabric": "felt", "overwrite": True, "rest": 2.5,
    }  # fmt: skip
    assert done.stdout == f"{tmp_path / 'swing.oni'}\n"


@pytest.mark.parametrize("rest", [-0.1, 4.21, float("nan")])
def test_a_hand_that_would_not_move_for_a_second_is_refused(tmp_path: Path, rest: float) -> None:
    """It stops at 65 % of 8 s, 5.2 s."""
    advice = "give 0 to 4.2, or a longer recording"
    with pytest.raises(SensorAddressError, match=rf"--rest: the hand cannot rest for .* of 8 seconds; {advice}"):
        recording.make_recording(tmp_path, "swing", rest=rest)
    assert list(tmp_path.iterdir()) == []

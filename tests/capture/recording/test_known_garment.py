"""The garment of a synthetic world is known, so that a garment.toml of another outline is refused."""

from __future__ import annotations

import msgspec
import pytest

from capture.errors import UntrackableError
from capture.recording.known_garment import check_known_garment
from firmware_host.opening import garment_in_view, open_sensor
from firmware_host.synthetic.garments import shirt, swatch
from firmware_host.synthetic.scene import RIG, demo_garment
from formats.descriptions import dump_description
from tests.fit.here import hangtime_here


def moved(garment, *, by=(0.0, 0.0), wider=0.0):
    """The same outline from another origin, with a fifth corner on its hem, and a hem that is wider at one end [m]."""
    left, right, low, other = [(x + by[0], y + by[1]) for x, y in garment.outline_m]
    middle = ((low[0] + other[0]) / 2, low[1])
    return msgspec.structs.replace(garment, outline_m=(left, right, (low[0] + wider, low[1]), middle, other))


def test_the_same_outline_from_another_origin_and_by_4_mm_is_the_same_garment():
    check_known_garment(moved(demo_garment(), by=(0.3, -1.0), wider=0.004), demo_garment(), "garment.toml")


@pytest.mark.parametrize(
    ("described", "apart"), [(moved(demo_garment(), wider=0.02), 20), (swatch(), 58), (shirt(), 146)]
)
def test_another_outline_is_refused_with_its_distance(described, apart):
    with pytest.raises(UntrackableError, match=f"the demo skirt that .* up to {apart} mm apart; choose a garment"):
        check_known_garment(described, demo_garment(), "garment.toml")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"mass_kg": 1.06}, "the description states 37.1 g instead of 35.0 g"),
        ({"mass_kg": 0.94}, "the description states 32.9 g instead of 35.0 g"),
        ({"held": "corners"}, "the description has the garment held by its corners instead of its edge"),
        ({"kind": "swatch"}, "its kind is swatch instead of skirt"),
        ({"layers": 2}, "its layers differ"),
        ({"seams": ((1, 2), (3, 0))}, "its seams differ"),
        ({"holes_m": (((0.0, -0.1), (0.05, -0.1), (0.0, -0.15)),)}, "its holes_m differ"),
        ({"grain_degrees": 45.0}, "its grain_degrees differ"),
    ],
)
def test_the_same_outline_of_another_cloth_is_refused_with_the_difference(changed, said):
    """A fit to such a take hides the difference in its parameters, as it does that of an outline."""
    real = demo_garment()
    changed = {name: real.mass_kg * new if name == "mass_kg" else new for name, new in changed.items()}
    with pytest.raises(UntrackableError, match=f"the demo skirt that the synthetic world swings: {said}; choose"):
        check_known_garment(msgspec.structs.replace(real, **changed), real, "garment.toml")


def test_a_weight_by_a_kitchen_scale_and_other_points_are_of_the_same_garment():
    real = demo_garment()
    weighed = msgspec.structs.replace(real, name="mine", mass_kg=real.mass_kg + 1e-3, points=real.points[:4])
    check_known_garment(weighed, real, "garment.toml")


@pytest.mark.parametrize(
    ("sensor", "garment"), [("synthetic:swing", swatch()), ("synthetic:swing?garment=t-shirt", demo_garment())]
)
def test_a_recording_of_another_garment_is_refused_before_the_world_is_simulated(tmp_path, sensor, garment):
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    (tmp_path / "garment.toml").write_text(dump_description(garment))
    words = ["record", "--sensor", sensor, "--rig", "rig.toml", "--garment", "garment.toml", "--out", "a.mcap"]
    done = hangtime_here(*words, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("hangtime: garment.toml: describes another garment than the ")
    assert done.stderr.endswith("`hangtime sensor synthesise` writes of it, or --anyway\n")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("address", "name", "size"),
    [
        ("synthetic:swing?seconds=1", "demo skirt", "0.50 m wide and 0.45 m high"),
        ("synthetic:swing?seconds=1&garment=swatch", "swatch", "0.40 m wide and 0.42 m high"),
    ],
)
def test_a_synthetic_sensor_says_which_garment_it_swings(address, name, size):
    assert garment_in_view(address).name == name
    with open_sensor(address) as sensor:
        assert sensor.info.notes == (f"the synthetic world swings the {name}, {size}",)
        assert sensor.world.garment == garment_in_view(address)


def test_no_other_sensor_knows_its_garment():
    assert garment_in_view("a.oni") is garment_in_view("openni2:") is None

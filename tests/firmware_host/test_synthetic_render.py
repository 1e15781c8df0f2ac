"""The synthetic camera's images agree with the true positions."""

from __future__ import annotations

import json
import resource
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_host.errors import RecordingError
from firmware_host.oni_records import summarise
from firmware_host.synthetic import recording, world
from firmware_host.synthetic.render import View
from firmware_host.synthetic.scene import CAMERA, HANGER, Placement, demo_garment, place
from firmware_host.synthetic.world import World
from formats.descriptions import load_garment, load_rig
from formats.errors import OutputError
from tests.firmware_host.scenes import flat_world


def pixel(place_m: np.ndarray) -> tuple[float, float]:
    return (
        CAMERA.fx * place_m[0] / place_m[2] + CAMERA.cx,
        CAMERA.fy * place_m[1] / place_m[2] + CAMERA.cy,
    )


def drawn(world: World, hanger: Placement) -> View:
    renderer = world.renderer()
    return renderer.with_hanger(renderer.cloth(world.nodes[0]), hanger.origin[0], hanger.rotation[0])


def test_the_plates_and_the_cloth_have_their_true_depth() -> None:
    world = flat_world(1)
    depth = drawn(world, world.hanger).depth
    for spot in [*world.hanger.markers[0], world.points[0, 4]]:
        u, v = pixel(spot)
        assert depth[round(v), round(u)] == pytest.approx(spot[2], abs=1e-9)


def test_a_turned_plate_has_its_true_depth_at_its_centre() -> None:
    world = flat_world(1)
    turned = place(np.zeros((1, 3)), np.array([np.radians(20)]), np.zeros(1))
    depth = drawn(world, turned).depth
    for spot in turned.markers[0]:
        u, v = pixel(spot)
        # Half a pixel is 1.4 mm of width, on a plane at 20 degrees 0.5 mm of depth.
        assert depth[round(v), round(u)] == pytest.approx(spot[2], abs=6e-4)


def test_the_skirt_covers_as_many_pixels_as_its_area_says() -> None:
    world = flat_world(1)
    depth = drawn(world, world.hanger).depth
    top = int(np.ceil(pixel(world.points[0, 0])[1])) + 5  # below the bar, which covers the held edge
    lowest = int(pixel(world.points[0, 2])[1]) + 3
    covered = (depth[top:lowest] < 2.0).sum()
    height = world.points[0, 2, 1] - (top - 0.5 - CAMERA.cy) / CAMERA.fy * 1.6
    width_at_top = 0.5 - 0.1 * height / 0.45
    area = 0.5 * (0.5 + width_at_top) * height
    # The hem is level. Its row of 180 pixels shows cloth or not: an error of at most half a row, 90 of 25500 pixels.
    assert covered == pytest.approx(area * (CAMERA.fx / 1.6) ** 2, abs=0.5 * 0.5 * CAMERA.fx / 1.6)


def test_the_markers_show_black_borders_white_plates_and_their_first_bits() -> None:
    world = flat_world(1)
    colour = drawn(world, world.hanger).colour[..., 0]
    cell = HANGER.marker_size_m / 6
    for centre, first_row in zip(world.hanger.markers[0], ([1, 0, 1, 1], [0, 0, 0, 0]), strict=True):

        def brightness(column: float, row: float, centre: np.ndarray = centre) -> float:
            u, v = pixel(centre + np.array([(column - 2.5) * cell, (row - 2.5) * cell, 0.0]))
            return float(colour[round(v), round(u)])

        assert [int(brightness(1 + k, 1) > 128) for k in range(4)] == first_row
        assert max(brightness(k, 0) for k in range(6)) < 60
        assert min(brightness(k, -0.8) for k in range(6)) > 200


def test_a_hanger_moving_across_an_exposure_is_blurred() -> None:
    def sharpness(step: float) -> float:
        world = flat_world(3)
        world.hanger.origin[:, 0] += step * np.arange(3)
        _, colour = world.frame(1, world.renderer())
        u, v = pixel(world.hanger.markers[1, 0])
        patch = colour[round(v) - 12 : round(v) + 13, round(u) - 12 : round(u) + 13, 0].astype(float)
        return float(np.abs(np.diff(patch, axis=1)).max())

    # 60 mm a frame is 1.8 m/s: 14 mm or 5 px in 8 ms, so steps from white to black become ramps.
    assert sharpness(0.06) < 0.8 * sharpness(0.0)


def test_the_centre_lies_where_all_four_corners_are_equally_far() -> None:
    garment = demo_garment()
    centre = np.array(garment.points[4].at_m)
    # 0.2^2 + d^2 = 0.25^2 + (0.45 - d)^2 gives d = 0.25 and a distance of 0.320 m.
    np.testing.assert_allclose(centre, [0.0, -0.25])
    np.testing.assert_allclose(np.linalg.norm(np.array(garment.outline_m) - centre, axis=1), 0.3201562, atol=1e-6)


def test_the_hanger_keeps_its_frame_when_it_yaws_and_rolls() -> None:
    placed = place(np.zeros((1, 3)), np.array([0.3]), np.array([0.05]))
    x, y, z = placed.rotation[0].T
    left, right = placed.markers[0]
    np.testing.assert_allclose(x, (right - left) / 0.3, atol=1e-12)
    gravity = np.array([0.0, 1.0, 0.0])
    down = gravity - (gravity @ x) * x
    np.testing.assert_allclose(y, down / np.linalg.norm(down), atol=1e-12)
    np.testing.assert_allclose(z, np.cross(x, y), atol=1e-12)


def test_a_recording_comes_with_its_rig_garment_and_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = flat_world(3, depth_step=0.01)
    monkeypatch.setattr(recording, "make_world", lambda **_: world)
    paths = recording.make_recording(tmp_path, "take", motion="swing", effect="none", seed=1)
    assert {path.name for path in paths} == {"take.oni", "take.truth.npz", "rig.toml", "garment.toml"}
    assert not list(tmp_path.glob("*.partial"))
    assert summarise(tmp_path / "take.oni").depth_frames == 3
    rig, garment = load_rig(tmp_path / "rig.toml"), load_garment(tmp_path / "garment.toml")
    assert rig.sensor == CAMERA
    assert garment.mass_kg == 0.035
    with np.load(tmp_path / "take.truth.npz") as truth:
        assert truth["markers"].shape == (3, 2, 3)
        np.testing.assert_allclose(truth["held"][2, :, 2], 1.62)
        np.testing.assert_allclose(truth["points"], world.points)
        assert json.loads(str(truth["meta"]))["effect"] == "none"


@pytest.mark.parametrize("room", [10_000, 1_500_000, 5_000_000])
def test_a_disk_that_is_full_leaves_one_sentence_and_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    """The process may write no file longer than this [bytes]: nothing, a frame and a half, all but the last frame."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    monkeypatch.setattr(recording, "make_world", lambda **_: flat_world(6))
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        with pytest.raises(RecordingError, match=r"writing the recording failed \(File too large\); raise the limit"):
            recording.make_recording(tmp_path, "take")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


def test_truth_that_cannot_be_written_is_named_and_no_recording_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder takes the name while the world is simulated; one that has it before is refused before."""

    def world_beside_a_folder(**_: object) -> World:
        (tmp_path / "take.truth.npz").mkdir()
        return flat_world(2)

    monkeypatch.setattr(recording, "make_world", world_beside_a_folder)
    with pytest.raises(
        OutputError,
        match=r"take.truth.npz: cannot be written \(Is a directory\); give another name: a folder has this one",
    ):
        recording.make_recording(tmp_path, "take", overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["take.truth.npz"]
    with pytest.raises(OutputError, match=r"take.truth.npz: is a folder; give another name"):
        recording.make_recording(tmp_path, "take", overwrite=True)


@pytest.mark.parametrize(
    ("folder", "name", "sentence"),
    [
        ("mine", "take", r"mine: cannot be made or written to \(File exists\)"),
        ("/proc", "take", r"/proc/take.oni: cannot be written \(.*\); choose another folder: this one takes no"),
        ("new", "a/b", "--name: no file can have the name 'a/b'"),
        ("new", "", "--name: no file can have the name ''"),
    ],
)
def test_a_path_where_no_recording_can_be_is_reported_before_the_world_is_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, name: str, sentence: str
) -> None:
    """/proc is a folder that even root writes no file into."""
    (tmp_path / "mine").write_text("mine")
    monkeypatch.setattr(recording, "make_world", lambda **_: pytest.fail("simulated"))
    with pytest.raises(OutputError, match=sentence):
        recording.make_recording(tmp_path / folder, name)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_folder_that_goes_away_is_reported_with_what_went_wrong_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file comes in its place: what was half written is then no longer there to be removed."""

    def make(**_: object) -> World:
        (tmp_path / "d").rmdir()
        (tmp_path / "d").touch()
        return flat_world(1)

    monkeypatch.setattr(recording, "make_world", make)
    with pytest.raises(RecordingError, match=r"the recording cannot be written \(Not a directory\)"):
        recording.make_recording(tmp_path / "d", "take")


def test_points_among_surroundings_are_half_a_pixel_apart_where_the_cloth_comes_nearest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A hanger that comes to 1.35 m, whose cloth swings 0.35 m towards the sensor: half a pixel at 1 m."""
    made: dict[str, float] = {}
    monkeypatch.setattr(world, "Renderer", lambda pattern, around, spacing: made.update(spacing=spacing))
    monkeypatch.setattr(world, "lay", lambda *given: None)
    origin = np.array([[0.0, 0.0, 1.6], [0.0, 0.0, 1.35]])
    shown = SimpleNamespace(
        nodes=np.zeros((2, 5, 5, 3)), garment=demo_garment(), surroundings=(), hanger=SimpleNamespace(origin=origin)
    )
    World.renderer(shown)
    assert made["spacing"] == pytest.approx(0.5 / CAMERA.fx)

"""A camera's faults on synthetic cloth: each has its stated size when enabled, and is absent otherwise."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from inspect import signature

import numpy as np
import pytest

from firmware_host.cli import synthesise_silhouette
from firmware_host.errors import SensorAddressError
from firmware_host.synthetic import silhouette
from firmware_host.synthetic.silhouette import SIDE, CameraFaults, held_path, make_silhouette_take, seen_silhouette
from formats.errors import OutputError
from formats.importers.swung_cloth import import_swung_cloth

SECONDS = 4.0
KNOWN = cache(lambda: silhouette.swung_cloth(SECONDS))  # the cloth does not depend on the camera


@cache
def seen(**faults):
    with pytest.MonkeyPatch.context() as patch:
        known = KNOWN()
        patch.setattr(silhouette, "swung_cloth", lambda seconds, progress: known)
        return seen_silhouette(CameraFaults(**faults), seconds=SECONDS)


@pytest.mark.slow
def test_a_camera_without_faults_shows_material_points_when_they_were_there():
    made = seen()
    assert (made.stamps == made.exposures).all()
    assert (made.places == made.places[0]).all()
    assert np.ptp(made.places[0], axis=0) == pytest.approx([SIDE, SIDE])
    on_edge = made.points[:, -8:].mean(1)
    assert on_edge == pytest.approx(held_path(made.exposures).mean(1), abs=2e-3)


def test_stamps_are_late_by_the_latency_and_a_share_of_the_interval_before():
    made = seen(latency=0.2, publish_share=0.9)
    late = made.stamps - made.exposures
    assert np.ptp(late[1:] - 0.9 * np.diff(made.stamps)) < 1e-9
    assert np.median(late) == pytest.approx(0.2, abs=0.01)
    assert (np.diff(made.exposures) > 0).all()
    assert made.ends == pytest.approx(held_path(made.stamps))


def test_the_bottom_border_is_lost_by_pose_and_the_others_by_the_border():
    made = seen(eroded_border=0.01, eaten_by_pose=0.06)
    length = SIDE - made.places[:, :, 1].min(1)
    assert length == pytest.approx(SIDE - 0.01 - 0.06 * made.lean)
    assert np.ptp(made.lean) > 0.3
    assert np.ptp(made.places[:, :, 0], axis=1) == pytest.approx(SIDE - 0.02)


def test_a_scale_of_depth_and_a_path_below_move_points_from_the_eye_and_ends_down():
    """5 % farther from (0, -1.5, 0); the path 20 mm lower."""
    plain, made = seen(), seen(depth_scale=0.05, path_below=0.02)
    assert made.points == pytest.approx(plain.points + 0.05 * (plain.points - [0.0, -1.5, 0.0]), nan_ok=True)
    assert made.ends == pytest.approx(plain.ends - [0.0, 0.0, 0.02])


def test_a_share_of_the_grids_is_askew():
    made = seen(skewed_share=0.3)
    assert 0.15 < made.is_skewed.mean() < 0.45
    laid = made.places.reshape(-1, 8, 8, 2)
    column = laid[:, -1, 3] - laid[:, 0, 3]
    angle = np.degrees(np.arctan2(column[:, 0], column[:, 1]))
    assert np.abs(angle) == pytest.approx(6.0 * made.is_skewed, abs=1e-6)


@pytest.mark.slow
def test_the_files_become_a_take_of_a_silhouette(tmp_path):
    paths = make_silhouette_take(tmp_path, "a", CameraFaults(latency=0.1, noise=0.002), seconds=4.0)
    take = import_swung_cloth(paths[0])
    assert take.garment.points_are == "silhouette"
    with np.load(paths[1]) as truth:
        assert len(truth["exposures"]) == len(take.time)
        assert truth["latency"] == 0.1


@pytest.mark.parametrize(
    ("folder", "name", "says"), [("file", "a", "cannot be made"), ("new", "a/b", "no file can have the name")]
)
def test_a_folder_that_cannot_be_written_is_reported_before_the_cloth_is_simulated(
    tmp_path, monkeypatch, folder, name, says
):
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr(silhouette, "swung_cloth", lambda *_: pytest.fail("the cloth was simulated"))
    with pytest.raises(OutputError, match=says):
        make_silhouette_take(tmp_path / folder, name, CameraFaults())


@pytest.mark.parametrize(
    ("fault", "value", "option"),
    [("latency", 0.6, "--latency"), ("noise", float("nan"), "--noise"), ("skewed_share", -0.1, "--skewed")],
)
def test_a_fault_that_no_camera_has_is_refused_by_the_name_of_its_option_and_leaves_no_folder(
    fault, value, option, tmp_path
):
    with pytest.raises(SensorAddressError, match=f"^{option}: cannot be"):
        make_silhouette_take(tmp_path / "new", "a", CameraFaults(**{fault: value}))
    assert not (tmp_path / "new").exists()


def test_every_fault_is_named_by_an_option_that_there_is():
    given = signature(synthesise_silhouette, eval_str=True).parameters.values()
    options = {getattr(one.annotation, "__metadata__", [None])[0].default for one in given}
    assert {silhouette.option_of(one.name) for one in fields(CameraFaults)} - {"--skew"} <= options

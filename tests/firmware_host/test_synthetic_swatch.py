"""The synthetic swatch: the properties of the published recording, and a cloth that hangs from its corners."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_host.errors import SensorAddressError
from firmware_host.synthetic import swatch as synthetic
from firmware_host.synthetic.swatch import (
    HELD_APART,
    MARKER_NOISE,
    SWATCH_MOTIONS,
    TRUE_FABRICS,
    make_swatch_take,
    measured,
    swung_markers,
)
from formats.descriptions import load_garment
from formats.errors import OutputError
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from formats.swatch import SWATCH_SIDE, swatch
from tests.formats.full_disk import no_file_beyond

TIME = np.arange(60) / 120


@pytest.fixture(scope="module")
def markers():
    return swung_markers(swatch(0.055), TIME, "swing", TRUE_FABRICS["polyester-rayon"], cells=1)


def test_only_the_two_top_corners_are_held(markers):
    """They are 0.92 x 0.5 m apart throughout; the middle of the top edge sags below them."""
    corners = markers[:, [0, 8]]
    assert np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1) == pytest.approx(HELD_APART * SWATCH_SIDE)
    assert (markers[:, 4, 2] < corners[:, :, 2].min(1) - 0.01).all()


def test_gravity_pulls_towards_minus_z_and_the_swing_goes_through_the_cloth(markers):
    assert markers[0, 76, 2] < -0.45
    assert np.ptp(markers[:, 0, 1]) > 0.02
    assert np.ptp(markers[:, 0, 0]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_every_motion_begins_at_rest_at_one_position_and_is_another_swing_of_a_hand():
    """Corners of the same cloth: in the first 8 ms by under a tenth of a millimetre, up to 1 m/s later."""
    time = np.arange(150) / 120
    corners = [
        swung_markers(swatch(0.055), time, m, TRUE_FABRICS["polyester-rayon"], cells=1)[:, 0, 1] for m in SWATCH_MOTIONS
    ]
    for one in corners:
        assert one[0] == pytest.approx(corners[0][0])
        assert abs(one[1] - one[0]) < 1e-4
        assert 0.2 < np.abs(np.gradient(one, time)).max() < 1.0
    for k, one in enumerate(corners):
        assert all(np.sqrt(np.mean((one - other) ** 2)) > 0.02 for other in corners[:k])


def test_markers_are_hardly_further_apart_than_on_the_flat_swatch(markers):
    grid = markers.reshape(len(TIME), 9, 9, 3)
    for axis in (1, 2):
        assert np.linalg.norm(np.diff(grid, axis=axis), axis=3).max() < 1.1 * SWATCH_SIDE / 8


def test_measured_markers_have_the_stated_noise_and_gaps():
    """200 micrometres per axis; about one frame in a hundred lost."""
    seen = measured(np.zeros((500, 81, 3)), np.random.default_rng(0))
    assert np.nanstd(seen) == pytest.approx(MARKER_NOISE, rel=0.02)
    assert 0.006 < np.isnan(seen[..., 0]).mean() < 0.014


def test_an_unknown_fabric_or_motion_is_refused(tmp_path):
    with pytest.raises(SensorAddressError, match="there is no fabric 'tweed'"):
        make_swatch_take(tmp_path, fabric="tweed")
    with pytest.raises(SensorAddressError, match="there is no motion 'jump'"):
        make_swatch_take(tmp_path, fabric="silk", motion="jump")


@pytest.mark.slow
def test_a_made_take_is_imported_whole(tmp_path):
    """81 markers, 500 frames, 120 a second."""
    csv, truth, garment = make_swatch_take(tmp_path, fabric="polyester-rayon")
    take = import_marker_take(csv, load_garment(garment), MarkerOptions(frames=500))
    assert take.points.shape == (500, 81, 3)
    assert take.time[-1] == pytest.approx(499 / 120, abs=1e-5)
    true = np.load(truth)
    assert np.nanmax(np.abs(take.points - true["markers"])) < 6 * MARKER_NOISE
    assert load_garment(garment).areal_density == pytest.approx(float(true["density"]))


def test_a_folder_that_cannot_be_made_is_reported_before_the_cloth_is_simulated(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="cannot be made"):
        make_swatch_take(tmp_path / "file", fabric="cotton")


@pytest.mark.parametrize(
    ("room", "first", "left"),
    [(1_000, "silk-swing.truth.npz", []), (1_000_000, "silk-swing.csv", ["silk-swing.truth.npz", "silk.toml"])],
)
def test_a_full_disk_leaves_no_half_file_under_a_final_name(tmp_path, monkeypatch, room, first, left):
    """The process may write no file longer than this [bytes]; the truth takes 0.98 MB, the markers 1.1 MB."""
    still = np.broadcast_to(np.float64(-0.1), (500, 81, 3))
    monkeypatch.setattr(synthetic, "swung_markers", lambda *_, **__: still)
    sentence = rf"{first}: cannot be written \(File too large\); raise the limit"
    with no_file_beyond(room), pytest.raises(OutputError, match=sentence):
        make_swatch_take(tmp_path, fabric="silk")
    assert sorted(path.name for path in tmp_path.iterdir()) == left

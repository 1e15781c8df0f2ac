"""The picture of residuals: errors split by direction, in a valid PNG file."""

from __future__ import annotations

import numpy as np
import pytest

from fit.recordings.recording import prepare
from fit.report.residual_picture import Views, draw_residuals, views_of
from tests.fit.recordings.silhouettes import silhouette_sheet, swung

TIME = np.arange(0, 6, 1 / 10)


def shifted(offset):
    """A recording, and a simulation that is off from it by an offset in the world."""
    recording = prepare(swung(silhouette_sheet("material"), TIME, TIME))
    return recording, recording.points - np.asarray(offset)


@pytest.mark.parametrize(("offset", "part"), [((0.004, 0, 0), 0), ((0, 0.004, 0), 2)])
def test_errors_are_split_along_the_bar_down_and_out(offset, part):
    """The hanger's bar lies along x; at rest the sheet hangs down and its normal is y, or against it."""
    views = views_of(*shifted(offset))
    middle = np.sqrt(np.nanmean(views.along[views.counted] ** 2, axis=0))
    assert np.argmax(middle) == part
    assert np.sqrt((middle**2).sum()) == pytest.approx(0.004)
    assert np.nanmax(views.parts_mm) <= 4.01


def test_a_frames_error_is_the_root_mean_square_over_the_points_that_it_shows():
    """3 and 4 mm down the cloth, and a third point that is not seen: the root of 12.5 mm^2; nothing where none is."""
    along = np.zeros((5, 3, 3))
    along[0, :2, 1] = 0.003, 0.004
    along[0, 2] = along[1] = np.nan
    counted = np.isfinite(along).all(2)
    views = Views(np.arange(5.0), along, along, along, counted)
    assert views.parts_mm[0] == pytest.approx([0.0, np.sqrt(12.5), 0.0])
    assert np.isnan(views.parts_mm[1]).all()


def test_a_picture_of_moderate_size_is_written(tmp_path):
    pytest.importorskip("PIL")
    from PIL import Image

    recording, simulated = shifted((0.0, 0.01, 0.0))
    draw_residuals(recording, simulated, tmp_path / "left.png", "ten millimetres")
    with Image.open(tmp_path / "left.png") as picture:
        assert picture.size[0] == 1200
        assert len(picture.getcolors(100_000)) > 4
    assert (tmp_path / "left.png").stat().st_size < 200_000

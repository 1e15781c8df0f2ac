"""The conditional amplitude of a pair's second effect, by hand."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from benchmarks.pair_oracle import conditional_size, main, sizes_of
from fit.blind.plants import Planted
from tests.fit.gap.verdict_scene import EFFECTS


@pytest.mark.parametrize(
    ("gain", "floor", "numerics", "share", "size"),
    [
        (0.8, 2.0, 0.5, 0.5, 1.0),  # a fifth of the squared noise
        (3.2, 2.0, 0.5, 0.5, 2.0),  # sizes go with the root of what they save
        (0.5, 1.0, 1.0, 0.5, 1.0),  # half of the squared error of mesh and solver
        (3.0, 1.0, 1.0, 3.0, 1.0),  # thrice that, for effects by which sound solvers differ
        (-1.0, 2.0, 0.5, 0.5, 0.0),  # a pair that leaves more than a single
    ],
)
def test_a_second_effect_is_as_large_as_what_it_alone_can_save(gain, floor, numerics, share, size):
    assert conditional_size(gain, floor, numerics, share) == pytest.approx(size)


def test_planted_sizes_stand_in_the_order_of_the_library_and_within_its_range():
    observer = SimpleNamespace(**EFFECTS)
    tilt = Planted(id="gravity_tilt", amplitude=0.03, unit="rad", components={"y": 0.02, "x": -0.01})
    assert sizes_of(observer, tilt, -1.0) == pytest.approx([0.01, -0.02])
    drag = Planted(id="air_drag", amplitude=1e9, unit="1", components={"": 1e9})
    assert sizes_of(observer, drag, 1.0) == pytest.approx([EFFECTS["library"]["air_drag"].high])


def test_a_set_whose_seal_is_closed_stays_closed(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([str(tmp_path), str(tmp_path)])
    assert "its seal is closed" in capsys.readouterr().err

"""The benchmark of the Kinect method judges every motion by a fit to the others."""

from __future__ import annotations

import pytest

from benchmarks import skirt


def test_a_fall_is_reported_as_missed_below_the_papers_own():
    told = skirt.described([(100.0, 36.0), (200.0, 72.0)])
    assert told.split() == ["100.0", ">", "36.0", "-64", "%", "200.0", ">", "72.0", "-64", "%", "missed"]


@pytest.mark.slow
@pytest.mark.processor_time(900)
def test_a_motion_is_followed_better_by_a_fit_to_the_others(tmp_path, capsys):
    """Sixteen iterations on a coarse mesh lower the error on the swing; recordings are kept for the next run."""
    few = ["--folder", str(tmp_path), "--iterations", "16", "--spacing", "0.1", "--held-out", "swing"]
    (result,) = skirt.main(few)
    assert sorted(result.take_ids) == ["gentle", "mixed", "twist"]
    assert result.held_out_ids == ["swing"]
    ((before, after), _) = skirt.falls(result)
    assert after < before
    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "none-1").glob("*.mcap")}
    assert len(made) == len(skirt.MOTIONS)
    skirt.main(few)
    assert {path: path.stat().st_mtime_ns for path in made} == made
    assert capsys.readouterr().out.count("together") == 2

"""The error about an invalid option value names the value in plain words."""

from __future__ import annotations

import pytest

from tests.fit.here import hangtime_here


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("record --seconds 1,5", "'1,5' is no number; write a decimal point: 1.5"),
        ("record --seconds 1,500", "'1,500' is no number"),
        ("record --seconds 500ms", "'500ms' is no number; was 0.5 meant?"),
        ("record --seconds 2min", "'2min' is no number; was 120 meant?"),
        ("record --seconds nan", "'nan' is no number"),
        ("swatch a.toml --mass 40g", "'40g' is no number; was 0.04 meant?"),
        ("swatch a.toml --mass 0.04 --side 50cm", "'50cm' is no number; was 0.5 meant?"),
        ("batch a --hours 90min", "'90min' is no number; was 1.5 meant?"),
        ("takes prune --keep-days 48h", "'48h' is no number; was 2 meant?"),
        ("fit a --spacing 5cm", "'5cm' is no number; was 0.05 meant?"),
        ("record --seconds x", "'x' is no number"),
        ("import a --out o --frames 2.5", "'2.5' is no whole number"),
        ("swatch a.toml --mass 1_0", "'1_0' is no number; write it without an underscore"),
        ("record --seconds 1_0", "'1_0' is no number; write it without an underscore"),
        ("swatch a.toml --mass 0.04 --markers 1_0", "'1_0' is no whole number; write it without an underscore"),
        ("takes export a --to pdf --out x", "'pdf' is not one of 'csv', 'c3d', 'npz', 'parquet', 'rrd'"),
        ("record --seconds 100000", "100000 is outside the range: it must be"),
    ],
)
def test_a_value_that_an_option_does_not_take_is_named_with_what_was_meant(tmp_path, words, said):
    done = hangtime_here(*words.split(), folder=tmp_path)
    told = " ".join(done.stderr.split())
    assert done.returncode == 2
    assert said in told, told
    assert "Input should" not in told
    assert "Value error" not in told

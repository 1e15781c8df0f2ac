"""The error about an invalid option value names the value in plain words."""

from __future__ import annotations

import pwd

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
        ("record --seconds=-nan", "'-nan' is no number"),
        ("record --seconds=+NaN", "'+NaN' is no number"),
        ("record --seconds inf", "inf is outside the range: the value must be"),
        ("fit a --gamma 5cm", "'5cm' is no number"),
        ("fit a --gamma 5,5", "'5,5' is no number; write a decimal point: 5.5"),
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
        ("takes export a --to cvs --out x", "'parquet', 'rrd'; did you mean 'csv'?"),
        ("export a --to blendr", "'abc', 'pc2'; did you mean 'blender'?"),
        ("export a --to USD-Physic", "'abc', 'pc2'; did you mean 'usd-physics'?"),
        ("record --seconds 100000", "100000 is outside the range: the value must be"),
    ],
)
def test_a_value_that_an_option_does_not_take_is_named_with_what_was_meant(tmp_path, words, said):
    done = hangtime_here(*words.split(), folder=tmp_path)
    told = " ".join(done.stderr.split())
    assert done.returncode == 2
    assert said in told, told
    assert "Input should" not in told
    assert "Value error" not in told


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["takes", "list", ""], "'DIR': the text is empty; give DIR, or set the variable that stands for it"),
        (["import", "a.csv", ""], "'FILE': the text is empty; give FILE, or set the variable"),
        (["import", "a.csv", "--out", ""], "'--out': the text is empty; give --out DIR, or leave it out"),
        (["takes", "export", "a", "--to", "csv", "--out="], "'--out': the text is empty; give --out PATH"),
        (["takes", "export", "a", "--to", "", "--out", "x"], "'--to': the text is empty; give --to with a value"),
        (["takes", "prune", "--spool", ""], "'--spool': the text is empty; give --spool DIR, or leave it out"),
        (["markers", "print", "--ids", "", "x.svg"], "'--ids': the text is empty; give --ids ID,ID, or leave it out"),
        (["swatch", "a.toml", "--mass", ""], "'--mass': the text is empty; give --mass KG"),
        (["fit", "a", "--held-out", ""], "'--held-out': the text is empty; give --held-out"),
        (["status", "--socket", ""], "the text is empty; give --socket PATH, or leave it out"),
    ],
)
def test_an_empty_text_is_refused_before_it_becomes_the_current_folder(tmp_path, words, said):
    done = hangtime_here(*words, folder=tmp_path)
    told = " ".join(done.stderr.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert said in told, told
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        ["import", "a.csv", "--out", "~/b c"],
        ["import", "a.csv", "--out=~/b c"],
        ["takes", "export", "a", "--to", "csv", "--out", "~/b c"],
        ["takes", "recover", "a", "--out", "~/b c"],
        ["sensor", "synthesise", "~/b c"],
        ["takes", "list", "~/b c"],
        ["fit", "a", "~/b c"],
        ["batch", "~/b c"],
    ],
)
def test_a_path_below_a_home_folder_that_the_shell_left_out_makes_no_folder_of_this_name(tmp_path, monkeypatch, words):
    monkeypatch.setenv("HOME", "/people/anna")
    done = hangtime_here(*words, folder=tmp_path)
    told = " ".join(done.stderr.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert "the shell did not put your home folder in place of ~ in ~/b c; give '/people/anna/b c'" in told, told
    assert list(tmp_path.iterdir()) == []


def test_a_path_below_the_home_folder_of_another_user_is_refused_too_and_no_other_name(tmp_path):
    done = hangtime_here("import", "a.csv", "--out", "~root/b", folder=tmp_path)
    home = pwd.getpwnam("root").pw_dir
    told = " ".join(done.stderr.split())
    assert f"the shell did not put root's home folder in place of ~root in ~root/b; give {home}/b" in told, told
    assert "home folder" not in hangtime_here("takes", "list", "~no such user/b", folder=tmp_path).stderr
    (tmp_path / "~root").mkdir()
    assert "home folder" not in hangtime_here("takes", "list", "~root", folder=tmp_path).stderr


def test_a_folder_that_is_named_like_the_home_folder_is_read(tmp_path):
    (tmp_path / "~").mkdir()
    assert "~" in hangtime_here("takes", "list", "~/none", folder=tmp_path).stderr
    assert "your home folder" not in hangtime_here("takes", "list", "~/none", folder=tmp_path).stderr


def test_an_empty_text_that_is_the_default_and_an_empty_variable_of_the_environment_are_left(tmp_path, monkeypatch):
    monkeypatch.setenv("HANGTIME_SOCKET", "")
    assert "no recorder listens here" in hangtime_here("status", folder=tmp_path).stderr
    done = hangtime_here("import", "a.csv", "--subject", "", "--garment", "g.toml", folder=tmp_path)
    assert "g.toml" in done.stderr

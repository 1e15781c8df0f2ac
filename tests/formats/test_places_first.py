"""A wrong ending and an absent folder of an output are refused before anything is read; several takes are shown."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from fit.errors import FitError
from fit.folders import make_folder
from formats.archive import write_take
from formats.errors import OutputError
from formats.outputs import check_place
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take
from tests.formats.unprivileged import hangtime_unprivileged

NO_FILES = "(No such file or directory); choose another folder: this one takes no files"
ABSENT = "gone/x{}: cannot be written (No such file or directory); make its folder first"
PNG = "pictures are written as PNG; give a name that ends in .png"
PAGE = "pages are written as HTML; give a name that ends in .html"
DOORS = [
    ("takes show damaged.mcap --plot x.jpg", f"x.jpg: {PNG}"),
    ("takes show damaged.mcap --plot x", f"x: {PNG}"),
    ("fit damaged.mcap --out results --plot x.svg", f"x.svg: {PNG}"),
    ("fit damaged.mcap --out results --plot results/x.pdf", f"results/x.pdf: {PNG}"),
    ("diagnose damaged.mcap --out results --plot x.jpg", f"x.jpg: {PNG}"),
    ("diagnose damaged.mcap --out results --arrows x --overwrite", f"x: {PNG}"),
    ("report none --plot none/x.svg", f"none/x.svg: {PNG}"),
    ("report none --out x.pdf", f"x.pdf: {PAGE}"),
    ("report none --out damaged.mcap --overwrite", f"damaged.mcap: {PAGE}"),
    ("compare none none --out x.png", f"x.png: {PAGE}"),
    ("takes show damaged.mcap --plot gone/x.png", ABSENT.format(".png")),
    ("takes show damaged.mcap --plot damaged.mcap/x.png", "cannot be written (Not a directory)"),
    ("takes export damaged.mcap --to parquet --out x.csv", "x.csv: one table of all takes is written as Parquet; give"),
    ("takes export damaged.mcap --to parquet --out gone/x.parquet", ABSENT.format(".parquet")),
    ("takes export damaged.mcap --to parquet --out gone/x", ABSENT.format("")),
    ("takes export damaged.mcap --to parquet --out .", ".: is a folder; give another name"),
    ("takes export damaged.mcap --to parquet --out /", "/: is a folder; give another name"),
    ("swatch gone/x.toml --mass 0.05", ABSENT.format(".toml")),
    ("calibrate --sensor none.oni --rig none.toml --out x.json", "x.json: a rig is written as TOML; give a name that"),
    ("calibrate --sensor none.oni --rig none.toml --out gone/x.toml", ABSENT.format(".toml")),
    (
        f"calibrate --sensor none.oni --rig none.toml --out {'n' * 300}.toml",
        "(File name too long)",
    ),
    (f"record --sensor none.oni --rig none.toml --garment none.toml --out {'n' * 300}.mcap", "(File name too long)"),
    ("swatch damaged.mcap/x.toml --mass 0.05 --overwrite", "x.toml: cannot be written (Not a directory)"),
    ("fit damaged.mcap --out results --plot gone/x.png", ABSENT.format(".png")),
    ("diagnose damaged.mcap --out results --plot gone/x.png", ABSENT.format(".png")),
    ("diagnose damaged.mcap --out results --arrows damaged.mcap/x.png --overwrite", "written (Not a directory)"),
    ("report none --plot gone/x.png", ABSENT.format(".png")),
    ("report none --out gone/x.html", ABSENT.format(".html")),
    ("compare none none --out gone/x.html", ABSENT.format(".html")),
    ("record --sensor none.oni --rig none.toml --garment none.toml --out bad\udcff.mcap", "a name that is not UTF-8"),
    ("sensor synthesise /proc/x", f"/proc/x: cannot be made or written to {NO_FILES}"),
    ("takes export damaged.mcap --to npz --out /proc/x/y", f"/proc/x/y: cannot be made or written to {NO_FILES}"),
    ("report damaged.mcap --plot /proc/x.png", NO_FILES),
    ("record --sensor none.oni --rig none.toml --garment none.toml --out gone/x.mcap", ABSENT.format(".mcap")),
]


@pytest.mark.parametrize(("words", "said"), DOORS)
def test_an_output_that_cannot_be_is_refused_before_the_inputs_are_read(tmp_path, words, said):
    (tmp_path / "damaged.mcap").write_bytes(b"no take")
    done = hangtime_here(*words.split(), folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["damaged.mcap"]


def test_a_locked_folder_is_refused_before_the_inputs_are_read(tmp_path):
    """No input is there, so that each command would have named it otherwise."""
    (tmp_path / "locked").mkdir(mode=0o555)
    doors = {
        "record --sensor none.oni --rig none.toml --garment none.toml --out locked/x.mcap": "x.mcap",
        "calibrate --sensor none.oni --rig none.toml --out locked/x.toml": "x.toml",
        "takes show none.mcap --plot locked/x.png": "x.png",
        "fit none.mcap --out results --plot locked/x.png": "x.png",
        "diagnose none.mcap --out results --arrows locked/x.png": "x.png",
    }
    doors |= {f"{words} --overwrite": name for words, name in doors.items()}
    for name, done in zip(doors.values(), hangtime_unprivileged(*map(str.split, doors), folder=tmp_path), strict=True):
        said = f"hangtime: locked/{name}: cannot be written (Permission denied); choose another folder, or get the "
        assert (done.returncode, done.stdout, done.stderr) == (2, "", f"{said}permission to write to this one\n")
    assert [path.name for path in tmp_path.iterdir()] == ["locked"]


def test_an_ending_may_be_in_capitals_and_any_counts_where_none_is_asked_for(tmp_path):
    check_place(tmp_path / "A.PNG", "", ".png")
    check_place(tmp_path / "a.any")
    with pytest.raises(OutputError, match=r"a\.any: as PNG; give a name that ends in \.png$"):
        check_place(tmp_path / "a.any", "as PNG", ".png")


def test_several_takes_are_shown_and_a_lost_one_keeps_no_other_from_it(tmp_path):
    for name in ("a", "b"):
        write_take(tmp_path / f"{name}.mcap", replace(a_take(frames=12), take_id=name))
    alone = hangtime_here("takes", "show", "a.mcap", folder=tmp_path)
    done = hangtime_here("takes", "show", "a.mcap", "gone.mcap", "b.mcap", folder=tmp_path)
    assert done.returncode == 2
    shown, lost = done.stdout.split("lost: ")
    assert shown == f"a.mcap\n{alone.stdout}\n"
    assert lost.startswith("gone.mcap: cannot be read (No such file or directory); check the path\nb.mcap\ntake")
    told = json.loads(hangtime_here("takes", "show", "a.mcap", "gone.mcap", "--json", folder=tmp_path).stdout)
    first, second = told["takes"]
    one = json.loads(hangtime_here("takes", "show", "a.mcap", "--json", folder=tmp_path).stdout)
    assert first == {"file": "a.mcap", **one}
    assert (second["file"], second["state"], told["error"]) == ("gone.mcap", "lost", second["error"])


@pytest.mark.parametrize("option", ["--plot", "--png"])
def test_a_picture_is_drawn_of_one_take(tmp_path, option):
    done = hangtime_here("takes", "show", "a.mcap", "b.mcap", option, "x.png", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"hangtime: {option}: draws one take; give one take, or leave out {option}\n"


def test_the_two_names_of_a_picture_are_not_given_together(tmp_path):
    done = hangtime_here("takes", "show", "a.mcap", "--png", "x.png", "--plot", "y.png", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "hangtime: --png: is the same as --plot; give one of the two\n"


def test_a_folder_of_results_that_cannot_be_made_has_no_false_next_step():
    """/proc refuses each new name as absent, so that no folder can be made first."""
    with pytest.raises(FitError, match="cannot be made or written to") as refused:
        make_folder(Path("/proc/x"))
    assert str(refused.value).endswith(NO_FILES)


def test_a_picture_in_the_folder_of_the_results_needs_no_folder_yet(tmp_path):
    """The command makes that folder, so the first fault is that of the take."""
    (tmp_path / "damaged.mcap").write_bytes(b"no take")
    done = hangtime_here("fit", "damaged.mcap", "--out", "results", "--plot", "results/x.png", folder=tmp_path)
    assert done.stderr.startswith("hangtime: damaged.mcap: is not a take archive")

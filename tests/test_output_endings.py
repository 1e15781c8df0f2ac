"""Every writer refuses a name by which programs take its file for another kind, and a folder with the name of a file.

The writers are found, not listed: a new one fails these tests until its endings are stated here or it refuses others.
"""

from __future__ import annotations

import inspect
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hangtime
from docs.generator.commands import every_command, whole_command
from fit.export.kinds import EXPORT_KINDS, WITHOUT_TAKE, Order, checked_names
from formats.outputs import check_folder_name
from formats.results import save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis
from tests.fit.scenes import hung, sheet, swing, take_of

OF_OTHERS = {".pdf", ".png", ".html", ".xlsx", ".zip", ".mcap", ".mp4", ".stl", ".v2"}
EVERY = OF_OTHERS.union(*(kind.endings for kind in EXPORT_KINDS.values()))


def order_of(kind):
    time = np.arange(0, 0.8, 1 / 30)
    take = take_of(sheet(), time, swing(time), hung(sheet(), time))
    return Order(result=a_fit(), take=None if kind in WITHOUT_TAKE else take)


@pytest.mark.parametrize("kind", EXPORT_KINDS)
def test_an_export_refuses_every_ending_but_its_own_and_names_them(kind, tmp_path):
    own = EXPORT_KINDS[kind].endings
    for ending in [*sorted(EVERY - {*own}), f"{own[0]}.gz"]:
        place = tmp_path / f"x{ending}"
        with pytest.raises(hangtime.HangtimeError) as refused:
            hangtime.export(hangtime.FitOutcome(result=a_fit()), kind, place, take=order_of(kind).take)
        assert own[0] in refused.value.advice or own[0] in str(refused.value), ending
        assert str(refused.value).startswith(f"{place}: ")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", EXPORT_KINDS)
def test_an_export_takes_its_own_endings_in_small_letters_and_capitals_and_a_name_without_one(
    kind, tmp_path, monkeypatch
):
    """A library that is not installed is no matter of the name."""
    monkeypatch.setitem(EXPORT_KINDS, kind, replace(EXPORT_KINDS[kind], check=lambda: None))
    bare = [""] * EXPORT_KINDS[kind].may_lack
    for ending in [
        *bare,
        *EXPORT_KINDS[kind].endings,
        EXPORT_KINDS[kind].endings[0].upper(),
        EXPORT_KINDS[kind].suffix,
    ]:
        place = tmp_path / f"denim{ending}"
        assert place in checked_names(order_of(kind), kind, place).values()


@pytest.mark.parametrize("kind", [name for name, kind in EXPORT_KINDS.items() if not kind.may_lack])
def test_a_format_that_programs_know_by_its_ending_is_not_written_without_one(kind, tmp_path):
    """OpenUSD opens no file `swing`, whatever it holds."""
    own = EXPORT_KINDS[kind].endings[0]
    with pytest.raises(hangtime.HangtimeError, match=f"has no ending, .*; give a name that ends in \\{own}$"):
        checked_names(order_of(kind), kind, tmp_path / "swing")


def test_usd_without_an_ending_is_opened_by_no_program_and_a_table_is_read(tmp_path):
    usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    hangtime.export(FIT, "usd-physics", tmp_path / "a.usda")
    (tmp_path / "a").write_bytes((tmp_path / "a.usda").read_bytes())
    assert usd.Stage.Open(str(tmp_path / "a.usda"))
    with pytest.raises(Exception, match="a"):
        usd.Stage.Open(str(tmp_path / "a"))
    assert {name for name, kind in EXPORT_KINDS.items() if not kind.may_lack} == {
        "usd-physics", "usd", "gltf", "abc", "pc2", "u3m",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "name", "advice"),
    [
        ("table", "t.pdf", "give a name that ends in .txt"),
        ("usd-physics", "u.png", "give a name that ends in .usda"),
        ("usd-physics", "u.usdc", "give a name that ends in .usda, or --to usd, which writes .usdc"),
        ("csv", "x.json", "give a name that ends in .csv, or --to newton, which writes .json"),
        ("gltf", "x.mp4", "give a name that ends in .glb, or `hangtime animate`, which writes .mp4"),
        ("csv", "x.csv.gz", "nothing is compressed here: give x.csv, and compress that file"),
        ("csv", "x.cvs", "did you mean x.csv?"),
    ],
)
def test_a_refused_ending_names_the_next_step(kind, name, advice, tmp_path):
    with pytest.raises(hangtime.HangtimeError) as refused:
        checked_names(order_of(kind), kind, tmp_path / name)
    assert refused.value.advice == advice


def a_simulation():
    error = a_fit().error.train_after
    return hangtime.Simulation(takes=(), values={}, error=error, by_take=())


FIT = hangtime.FitOutcome(result=a_fit(), request=object(), prepared=object())
PYTHON = {
    "DiagnosisOutcome.save": (hangtime.DiagnosisOutcome(result=diagnosis()).save, (".json",)),
    "DiagnosisOutcome.to_csv": (hangtime.DiagnosisOutcome(result=diagnosis()).to_csv, (".csv", ".txt")),
    "FitOutcome.save": (FIT.save, (".json",)),
    "FitOutcome.to_csv": (FIT.to_csv, (".csv", ".txt")),
    "Simulation.to_csv": (a_simulation().to_csv, (".csv", ".txt")),
    "export": (lambda path: hangtime.export(FIT, "csv", path), (".csv", ".txt")),
    "report": (lambda path: hangtime.report(FIT, path), (".html", ".htm")),
}


def writers_of_python():
    """The names of all calls that take `overwrite`."""
    for name in hangtime.__all__:
        one = getattr(hangtime, name)
        methods = vars(one).items() if inspect.isclass(one) else ()
        for called, function in [(name, one), *((f"{name}.{method}", function) for method, function in methods)]:
            if inspect.isfunction(function) and "overwrite" in inspect.signature(function).parameters:
                yield called


def test_every_call_that_writes_a_file_is_known_here():
    assert sorted(writers_of_python()) == sorted(PYTHON)


@pytest.mark.parametrize("name", PYTHON)
def test_a_call_refuses_every_ending_but_its_own(name, tmp_path):
    write, own = PYTHON[name]
    for ending in [*sorted(EVERY - {*own}), f"{own[0]}.gz"]:
        with pytest.raises(hangtime.HangtimeError) as refused:
            write(tmp_path / f"x{ending}")
        assert own[0] in refused.value.advice, ending
    assert not list(tmp_path.iterdir())
    if name != "report":  # draws what no test of names has
        for ending in ("", *own, own[0].upper()):
            write(tmp_path / f"x{ending}")
            assert (tmp_path / f"x{ending}").stat().st_size > 10


# Each option that names an output: the words around it, and the endings of its file; () for a folder's.
FILES = {
    "record --out": ("record --sensor none.oni --rig none.toml --garment none.toml --out", ".mcap"),
    "calibrate --out": ("calibrate --sensor none.oni --rig none.toml --out", ".toml"),
    "markers print --out": ("markers print --out", ".svg"),
    "status --preview": ("status --socket none --preview", ".png"),
    "swatch path": ("swatch --mass 0.05", ".toml"),
    "takes show --plot": ("takes show none.mcap --plot", ".png"),
    "takes show --png": ("takes show none.mcap --png", ".png"),
    "fit --plot": ("fit none.mcap --plot", ".png"),
    "diagnose --plot": ("diagnose none.mcap --plot", ".png"),
    "diagnose --arrows": ("diagnose none.mcap --arrows", ".png"),
    "report --out": ("report none --out", ".html"),
    "report --plot": ("report none --plot", ".png"),
    "compare --out": ("compare none none --out", ".html"),
    "export --out": ("export fit.json --to csv --out", ".csv"),
    "animate --out": ("animate fit.json --motion twist --out", ".mp4"),
    "blind report --out": ("blind report SET SET/answers --out", ".html"),
}
FOLDERS = {
    "sensor synthesise out": ("sensor synthesise", ".oni"),
    "sensor synthesise-swatch out": ("sensor synthesise-swatch", ".csv"),
    "sensor synthesise-silhouette out": ("sensor synthesise-silhouette", ".npz"),
    "import --out": ("import none.c3d --garment none.toml --out", ".mcap"),
    "takes recover --out": ("takes recover none.mcap --out", ".mcap"),
    "takes export --out": ("takes export none.mcap --to csv --out", ".csv"),
    "fit --out": ("fit none.mcap --out", ".json"),
    "diagnose --out": ("diagnose none.mcap --out", ".html"),
    "batch --out": ("batch . --out", ".html"),
    "blind make folder": ("blind make", ".json"),
    "blind run --out": ("blind run none --out", ".json"),
    "blind strike --out": ("blind strike none none/answers --out", ".json"),
}
# Options that name what is read, a socket, a cluster, or the spool of an appliance.
READ = {
    "--sensor", "--rig", "--garment", "--config", "--socket", "--spool", "--hanger", "--fit", "--scheduler", "--bvh",
    "--take", "--held-out", "--real",
    "source", "paths", "folder", "url", "answers", "takes", "fit_file",
}  # fmt: skip


def test_every_option_that_names_an_output_is_known_here():
    """An option whose value is a path is read, or is an output that another test below gives a wrong name."""
    found = set()
    for command, made in every_command(whole_command()):
        for parameter in made.params:
            name = f"{command.removeprefix('hangtime ')} {parameter.opts[0]}"
            if (parameter.opts[0] in READ and name not in FOLDERS) or not any(
                word in (parameter.metavar or "") for word in ("FILE", "DIR", "PATH", "URL", ".", "ANSWERS", "STRUCK")
            ):
                continue
            found.add(name)
    assert found == {*FILES, *FOLDERS}


@pytest.mark.parametrize("option", FILES)
def test_a_command_refuses_another_ending_and_names_its_own(option, tmp_path):
    """Before it reads anything: nothing else that is named is there, except the fit of an export."""
    words, own = FILES[option]
    save_fit_result(tmp_path / "fit.json", a_fit())
    for name in ("x.pdf", f"x{own}.gz"):
        done = hangtime_here(*words.split(), name, folder=tmp_path)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
        assert done.stderr.startswith(f"hangtime: {name}: ")
        assert own in done.stderr.removeprefix(f"hangtime: {name}")
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]


@pytest.mark.parametrize("option", FOLDERS)
def test_a_command_refuses_the_name_of_a_file_for_its_folder(option, tmp_path):
    """`--out swing.mcap` of an import made a folder of this name, and the take inside it."""
    words, ending = FOLDERS[option]
    done = hangtime_here(*words.split(), f"x{ending}", folder=tmp_path)
    said = f"hangtime: x{ending}: is the name of a file, and a folder of files is written; give the folder alone, such"
    told = done.stderr.replace(f"{tmp_path}/", "")  # a batch names the whole path
    assert (done.returncode, done.stdout, told) == (2, "", f"{said} as x\n")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_there_may_have_any_name(tmp_path):
    (tmp_path / "x.csv").mkdir()
    check_folder_name(tmp_path / "x.csv", ".csv")
    check_folder_name(Path("x.2"), ".csv")

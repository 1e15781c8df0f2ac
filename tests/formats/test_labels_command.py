"""`hangtime takes labels` lists the markers of a file before any garment is described."""

from __future__ import annotations

import json

import numpy as np
import pytest

from formats.importers.marker_tracks import write_marker_csv
from formats.importers.units import METRES
from tests.fit.here import hangtime_here
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_oddities import GARMENT, hanging


def places(frames=40):
    """Two markers in millimetres; the second is seen in the last ten frames, the third never."""
    where = np.random.default_rng(0).normal(300, 3, (frames, 3, 3))
    where[:-10, 1] = np.nan
    where[:, 2] = np.nan
    where[-10, 1] = [100, 200, -300]
    return where


def test_names_shares_and_first_positions_are_listed(tmp_path):
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(places(), ["left", "right one", "gone"], rate=10.0))
    done = hangtime_here("takes", "labels", "a.c3d", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[0] == "a.c3d: 3 markers, 40 frames, 3.9 s"
    assert lines[1].startswith("left       seen 100 %, first at 0.30")
    assert lines[2] == "right one  seen  25 %, first at 0.100, 0.200, -0.300 m"
    assert lines[3] == "gone       never seen"
    told = json.loads(hangtime_here("takes", "labels", "a.c3d", "--json", folder=tmp_path).stdout)
    assert [(one["name"], one["seen"]) for one in told["markers"]] == [
        ("left", 1.0),
        ("right one", 0.25),
        ("gone", 0.0),
    ]
    np.testing.assert_allclose(told["markers"][1]["first_m"], [0.1, 0.2, -0.3], atol=1e-7)
    assert told["markers"][2]["first_m"] is None


def test_the_listed_names_are_those_that_the_import_looks_for(tmp_path):
    write_marker_csv(tmp_path / "a.csv", hanging(60))
    done = hangtime_here("takes", "labels", "a.csv", folder=tmp_path)
    assert [line.split()[0] for line in done.stdout.splitlines()[1:]] == list(GARMENT.point_names)
    refused = hangtime_here("import", "a.csv", folder=tmp_path)
    assert refused.stderr.endswith("`hangtime swatch` writes one, and `hangtime takes labels` names the markers\n")


def test_a_position_that_is_no_length_of_a_room_is_shown_in_few_digits(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,a_x_m,a_y_m,a_z_m\n0,1e300,2,3\n0.1,1e300,2,3\n")
    done = hangtime_here("takes", "labels", "a.csv", folder=tmp_path)
    assert done.stdout.splitlines()[1] == "a  seen 100 %, first at 1e+300, 2.000, 3.000 m"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["gone.csv"], "hangtime: gone.csv: cannot be read (No such file or directory)"),
        (["."], "hangtime: .: is a folder; give the files in it, as in ./*.csv\n"),
        (
            ["a.mcap"],
            "hangtime: a.mcap: .mcap is not a marker file; `hangtime takes show` shows what a take holds; give ",
        ),
        (["a.npz"], "hangtime: a.npz: .npz is not a marker file; `hangtime import` makes a take of arrays, and "),
        (["a.csv"], "hangtime: a.csv: "),
        (["a.csv", "--unit", "furlong"], "hangtime: "),
    ],
)
def test_what_is_no_marker_file_is_refused_in_one_sentence(tmp_path, words, said):
    for name in ("a.mcap", "a.npz"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "a.csv").write_text("\0")
    done = hangtime_here("takes", "labels", *words, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(said)
    assert done.stderr.count("\n") == 1


def test_several_files_are_listed_and_one_that_is_lost_is_named(tmp_path):
    for name in ("a.csv", "b.csv"):
        write_marker_csv(tmp_path / name, hanging(60))
    (tmp_path / "c.csv").write_text("\0")
    words = ["takes", "labels", "a.csv", "c.csv", "b.csv"]
    done = hangtime_here(*words, folder=tmp_path)
    assert done.returncode == 2
    heads = [line.split(":")[0] for line in done.stdout.splitlines() if " markers, " in line]
    assert heads == ["a.csv", "b.csv"]
    assert "\nlost: c.csv: " in done.stdout
    told = json.loads(hangtime_here(*words, "--json", folder=tmp_path).stdout)
    assert [(one["file"], len(one["markers"])) for one in told["files"]] == [
        ("a.csv", len(GARMENT.point_names)), ("b.csv", len(GARMENT.point_names)),
    ]  # fmt: skip
    assert [one["file"] for one in told["lost"]] == ["c.csv"]


@pytest.mark.parametrize("command", [("takes", "labels"), ("import",)])
def test_the_help_names_every_unit_that_is_read(tmp_path, command):
    shown = " ".join(hangtime_here(*command, "--help", folder=tmp_path).stdout.split())
    assert f"states none: {', '.join(METRES)}" in shown

"""A unit that a file states falsely: `--unit` with `--anyway` overrides it, and the take says so."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from formats.archive import read_take
from formats.descriptions import dump_description
from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import write_marker_csv
from formats.importers.units import GivenUnit, metres_of
from tests.fit.here import hangtime_here
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_oddities import GARMENT, hanging

IMPORT = ("import", "m.csv", "--garment", "g.toml")
SPANS = "its markers span 0.5 m, which m would make 500 m"
OVERRIDDEN = f"the file states its lengths in m, and --unit mm counts; {SPANS}"


@pytest.fixture
def desk(tmp_path):
    """A file whose columns state metres, and whose numbers are millimetres."""
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    write_marker_csv(tmp_path / "m.csv", replace(hanging(), positions=1e3 * hanging().positions))
    return tmp_path


def test_a_false_unit_is_refused_with_the_options_that_override_it(desk):
    done = hangtime_here(*IMPORT, folder=desk)
    assert done.returncode == 2
    assert (
        "are these millimetres that were taken for metres? Check the unit, the garment's size and the names of the "
        "markers; if so, give --unit mm --anyway" in done.stderr
    )
    done = hangtime_here(*IMPORT, "--unit", "mm", folder=desk)
    assert (done.returncode, done.stderr.splitlines()[0]) == (
        2, "hangtime: m.csv: states its lengths in m, not mm: its 1000 is 1000 m, and would be 1 m; leave out --unit, "
        "or give --anyway too, and mm counts",
    )  # fmt: skip


def test_the_given_unit_counts_with_anyway_and_the_take_says_which_was_overridden(desk):
    done = hangtime_here(*IMPORT, "--unit", "mm", "--anyway", "--json", folder=desk)
    assert done.returncode == 0
    assert json.loads(done.stdout)["takes"][0]["file_doubt"] == OVERRIDDEN
    take = read_take(desk / "takes" / "m.mcap")
    assert take.notes["file"] == OVERRIDDEN
    np.testing.assert_allclose(take.points, hanging().positions, atol=1e-5)  # m: a take's digit of a position
    done = hangtime_here(*IMPORT, "--unit", "mm", "--anyway", "--overwrite", folder=desk)
    assert f"Warning: {OVERRIDDEN}\n" in done.stdout


def test_a_unit_that_was_overridden_falsely_is_refused_with_the_simpler_step(tmp_path):
    """The file states millimetres, which they are."""
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    places = 1e3 * hanging().positions
    (tmp_path / "m.c3d").write_bytes(c3d_bytes(places, list(hanging().labels)))
    words = [word.replace("m.csv", "m.c3d") for word in IMPORT]
    done = hangtime_here(*words, "--unit", "m", "--anyway", folder=tmp_path)
    assert done.returncode == 2
    assert (
        "taken for metres? Check the unit, the garment's size and the names of the markers; if so, leave out --unit"
        in (done.stderr)
    )


@pytest.mark.parametrize("kind", ["c3d", "csv"])
def test_a_wrong_given_unit_of_a_file_that_states_none_needs_no_anyway(tmp_path, kind):
    """The advice is followed as it is printed."""
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    tracks = replace(hanging(), positions=1e3 * hanging().positions)
    if kind == "c3d":
        (tmp_path / "m.c3d").write_bytes(c3d_bytes(tracks.positions, list(tracks.labels), units=()))
    else:
        path = write_marker_csv(tmp_path / "m.csv", tracks)
        path.write_text(path.read_text().replace("_m,", ",").replace("_m\n", "\n"))
    words = [word.replace("m.csv", f"m.{kind}") for word in IMPORT]
    done = hangtime_here(*words, "--unit", "cm", folder=tmp_path)
    assert done.returncode == 2
    advice = done.stderr.rpartition("if so, give ")[2].split()
    assert advice == ["--unit", "mm"]
    done = hangtime_here(*words, *advice, folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_labels_are_listed_in_the_given_unit_with_anyway(desk):
    words = ("takes", "labels", "m.csv", "--unit", "mm")
    refused = hangtime_here(*words, folder=desk)
    assert refused.returncode == 2
    assert "leave out --unit, or give --anyway too, and mm counts" in refused.stderr
    done = hangtime_here(*words, "--anyway", "--json", folder=desk)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["file_doubt"].startswith("the file states its lengths in m, and --unit mm counts")
    np.testing.assert_allclose(told["markers"][0]["first_m"], hanging().positions[0, 0], atol=1e-6)


def test_anyway_alone_and_the_unit_that_the_file_states_override_nothing(tmp_path):
    path = write_marker_csv(tmp_path / "m.csv", hanging())
    for unit in (None, "m"):
        assert read_marker_tracks(path, unit, anyway=True).warning == ""
    with pytest.raises(TakeError, match="there is no unit 'ells'"):
        read_marker_tracks(path, "ells", anyway=True)


@pytest.mark.parametrize(
    ("units", "stated"), [(("m",), "m"), (("m", "cm", "m"), "m and cm"), (("cm", "mm", "deg"), "cm")]
)
def test_the_units_of_a_c3d_file_are_overridden_for_each_point(tmp_path, units, stated):
    places = 100.0 + np.arange(30 * 9).reshape(30, 3, 3)
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(places, ["a", "b", "c"], units=units))
    tracks = read_marker_tracks(tmp_path / "a.c3d", "mm", anyway=True)
    np.testing.assert_allclose(tracks.positions, 1e-3 * places, rtol=1e-6)
    assert tracks.warning.startswith(f"the file states its lengths in {stated}, and --unit mm counts; its markers ")


def test_a_unit_is_overridden_once_and_only_with_anyway():
    for anyway, step in ((None, "mend the unit that the file states"), (False, "give --anyway too, and mm counts")):
        with pytest.raises(TakeError, match=f"and would be 1 m; leave out --unit, or {step}$"):
            metres_of("m", GivenUnit("mm", anyway), "a")
    given = GivenUnit("mm", anyway=True)
    assert [metres_of("m", given, "a"), metres_of("metres", given, "a"), metres_of("mm", given, "a")] == [1e-3] * 3
    assert given.overridden == ["m"]

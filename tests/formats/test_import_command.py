"""What `hangtime import` and `hangtime swatch` say, word for word."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from formats.descriptions import dump_description, load_garment
from formats.importers.marker_tracks import write_marker_csv
from tests.fit.here import hangtime_here
from tests.formats.test_command_line import swung_cloth
from tests.formats.test_marker_oddities import GARMENT, hanging

REPLACE = "is already there; give another name, or --overwrite to replace it"


@pytest.fixture
def desk(tmp_path):
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    write_marker_csv(tmp_path / "m.csv", hanging())
    write_marker_csv(tmp_path / "n.CSV", hanging())
    swung_cloth(tmp_path / "r.npz")
    return tmp_path


@pytest.mark.parametrize("count", [0, 1, 5, 6])
def test_markers_that_were_never_seen_are_named_five_at_most(desk, count):
    places = hanging().positions.copy()
    places[:, 4 : 4 + count] = np.nan
    write_marker_csv(desk / "m.csv", replace(hanging(), positions=places))
    names = ", ".join(GARMENT.point_names[4 : 4 + min(count, 5)]) + " and 1 more" * (count > 5)
    unseen = f"Warning: {names} {'was' if count == 1 else 'were'} never seen; bring the whole garment into view, with "
    done = hangtime_here("import", "m.csv", "--garment", "g.toml", "--out", "out", folder=desk)
    assert (done.returncode, done.stderr) == (0, "")
    first, *warnings = done.stdout.splitlines()
    assert first == "out/m.mcap: 30 frames, 0.3 s, its front looks along -y"
    told = [line for line in warnings if "seen" in line]
    assert told == ([f"{unseen}nothing before it"] if count else [])


def test_each_recording_has_its_line_and_those_of_markers_and_cloth_go_together(desk):
    done = hangtime_here("import", "m.csv", "n.CSV", "--garment", "g.toml", folder=desk)
    assert (done.returncode, done.stderr) == (0, "")
    assert [line for line in done.stdout.splitlines() if not line.startswith("Warning: ")] == [
        f"takes/{name}.mcap: 30 frames, 0.3 s, its front looks along -y" for name in "mn"
    ]  # fmt: skip
    done = hangtime_here("import", "r.npz", "--out", "own", folder=desk)
    assert done.stdout.splitlines()[0] == "own/r.mcap: 40 frames, 4.3 s"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("import g.toml", "g.toml: is a description, and no recording; give it as --garment g.toml"),
        ("import r.npz --frames 30", "--frames: is for motion capture, and r.npz is none; leave out --frames, or "
         "import that file by itself"),
        ("import m.csv --garment g.toml --frames 31", "m.csv: has 30 frames, --frames asks for 31; give --frames 30 or "
         "fewer, or leave it out"),
        ("import m.csv --garment g.toml --frames 19", "--frames: a fit needs 20 frames or more, not 19; give 20 or "
         "more, or leave it out"),
        ("import r.npz --hanger m.csv", "m.csv: is no .npz archive; give a .npz with tcp_t, tcp_pose and "
         "tcp_to_corner_m, see docs/reference/file-formats.md"),
        ("swatch s.txt --mass 0.05", "s.txt: a garment is written as TOML; give a name that ends in .toml"),
        ("swatch g.toml --mass 0.05", f"g.toml: {REPLACE}"),
        ("swatch s.toml --mass 0.5 --side 0.25", "--mass, --side: mass_kg = 0.5 makes 8 kg/m2, fabric has 0.02 to 1.5; "
         "were 0.5 ounces meant, mass_kg = 0.0141748 (0.23 kg/m2)? Weigh it and give kilograms, "
         "or --anyway to accept it"),
    ],
)  # fmt: skip
def test_refused_imports_and_descriptions_name_the_next_step(desk, words, sentence):
    before = sorted(path.name for path in desk.iterdir())
    done = hangtime_here(*words.split(), folder=desk)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"hangtime: {sentence}\n")
    assert sorted(path.name for path in desk.iterdir()) == before


def test_a_swatch_has_the_name_of_its_file_and_is_replaced_or_accepted_where_one_says_so(desk):
    done = hangtime_here("swatch", "g.toml", "--mass", "0.02", "--overwrite", folder=desk)
    assert (done.returncode, done.stdout) == (0, "g.toml: 81 markers, 62.5 mm apart\n")
    assert (load_garment(desk / "g.toml").name, load_garment(desk / "g.toml").mass_kg) == ("g", 0.02)
    done = hangtime_here("swatch", "h.TOML", "--mass", "0.5", "--side", "0.25", "--anyway", folder=desk)
    assert (done.returncode, done.stdout) == (0, "h.TOML: 81 markers, 31.2 mm apart\n")

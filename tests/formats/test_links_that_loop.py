"""A link that leads to itself, directly or through another link, is reported as such, and replaced on request."""

from __future__ import annotations

import pytest

from fit.blind.page import check_page_name
from formats.archive import write_take
from formats.descriptions import dump_description
from formats.errors import OutputError
from formats.importers.marker_tracks import write_marker_csv
from formats.outputs import make_output_folder
from formats.unfinished import UnfinishedFile
from formats.whole_files import write_whole
from tests.capture.garment.towel import GARMENT as TOWEL
from tests.capture.garment.towel_scenes import RIG
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take
from tests.formats.test_marker_oddities import GARMENT, hanging

READ = "cannot be read (Too many levels of symbolic links); check the path: a link of it leads to itself"
PLAYED = f"the recording {READ}"
WRITTEN = "(Too many levels of symbolic links); give another path: a link of this one leads to itself"
THERE = "is a link that leads to itself; give another name, or --overwrite to replace it"

RECOVERED = THERE.replace("give another name", "choose another folder with --out")


@pytest.fixture
def desk(tmp_path):
    write_take(tmp_path / "a.mcap", a_take(20))
    write_marker_csv(tmp_path / "m.csv", hanging())
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    for ending in ("csv", "c3d", "mcap", "npz", "png", "toml", "parquet", "recovered.mcap", "oni"):
        (tmp_path / f"self.{ending}").symlink_to(f"self.{ending}")
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    (tmp_path / "towel.toml").write_text(dump_description(TOWEL))
    (tmp_path / "one").symlink_to("two")
    (tmp_path / "two").symlink_to("one")
    return tmp_path


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("import self.csv --garment g.toml", f"self.csv: {READ}"),
        ("import self.c3d --garment g.toml", f"self.c3d: {READ}"),
        ("import self.npz", f"self.npz: {READ}"),
        ("import m.csv --garment self.toml", f"self.toml: {READ}"),
        ("import m.csv --garment g.toml --out one", f"one: cannot be made or written to {WRITTEN}"),
        ("import m.csv --garment g.toml --out one/in", f"one/in: cannot be made or written to {WRITTEN}"),
        ("swatch self.toml --mass 0.05", f"self.toml: {THERE}"),
        ("takes verify self.mcap", f"self.mcap: {READ}"),
        ("takes list one", "one: is a link that leads to itself; give a folder"),
        ("takes show a.mcap --png self.png", f"self.png: {THERE}"),
        ("takes show a.mcap --png one/a.png", f"one/a.png: cannot be written {WRITTEN}"),
        ("takes recover self.mcap --out .", f"self.recovered.mcap: {RECOVERED}"),
        ("takes recover a.mcap --out one", f"one: cannot be made or written to {WRITTEN}"),
        ("takes export a.mcap --to npz --out one", f"one: cannot be made or written to {WRITTEN}"),
        ("takes export a.mcap --to parquet --out self.parquet", f"self.parquet: {THERE}"),
        (
            "record --sensor self.oni --rig rig.toml --garment towel.toml --out n.mcap",
            f"self.oni: the recording {READ}",
        ),
        ("sensor play live:self.oni", f"self.oni: {PLAYED}"),
        ("report one", "one: is a link that leads to itself; give the folder that --out named"),
    ],
)
def test_a_source_or_a_target_that_leads_to_itself_says_so(desk, words, sentence):
    before = sorted(path.name for path in desk.iterdir())
    done = hangtime_here(*words.split(), folder=desk)
    assert done.returncode == 2
    assert sentence in done.stderr + done.stdout
    assert sorted(path.name for path in desk.iterdir()) == before


def test_such_a_link_is_replaced_as_any_other_one_where_that_is_asked_for(desk):
    write_whole(desk / "self.png", b"a")
    write_take(desk / "self.recovered.mcap", a_take(20))
    assert (desk / "self.png").read_bytes() == b"a"
    assert not (desk / "self.recovered.mcap").is_symlink()


def test_a_folder_below_one_is_no_link_to_another_file(desk):
    """The name of an unfinished take may be a link, which is to be removed; here its folder is at fault."""
    with pytest.raises(OSError, match="Too many levels"):
        UnfinishedFile(desk / "one/a.mcap", overwrite=True)
    (desk / "b.mcap.partial").symlink_to("b.mcap.partial")
    with pytest.raises(OutputError, match="is a link to another file"):
        UnfinishedFile(desk / "b.mcap", overwrite=True)


def test_a_folder_whose_path_is_a_broken_link_keeps_its_own_cause(desk):
    (desk / "broken").symlink_to("nowhere")
    with pytest.raises(OutputError, match=r"\(File exists\); give another name: a file, a device, a pipe or a b"):
        make_output_folder(desk / "broken")


def test_a_page_of_a_blind_check_may_be_asked_for_instead_of_one(desk):
    check_page_name(desk / "one", (desk / "set", desk / "two"))

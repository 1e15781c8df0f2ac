"""The configuration: every key is documented, errors name the bad key, the last valid one stays in force."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from capture.appliance.config import load
from capture.appliance.config_tables import Config
from capture.appliance.last_good import copy_of, keep, last_good, load_or_last_good
from formats.descriptions import dump_description
from formats.errors import DescriptionError
from tests.capture.appliance.power_cut import Disk
from tests.capture.appliance.virtual_appliance import RIG
from tests.capture.garment.towel import GARMENT

REFERENCE = (Path(__file__).parents[3] / "docs/reference/appliance.md").read_text()
GOOD = '[sensor]\nrig = "rig.toml"\ngarment = "garment.toml"\n[spool]\nfolder = "takes"\n'


@pytest.fixture
def file(tmp_path):
    (tmp_path / "rig.toml").write_text(dump_description(RIG))
    (tmp_path / "garment.toml").write_text(dump_description(GARMENT))
    (tmp_path / "appliance.toml").write_text(GOOD)
    return tmp_path / "appliance.toml"


def keys():
    for part in msgspec.structs.fields(Config):
        if part.name == "sync":
            continue
        for field in msgspec.structs.fields(part.type):
            yield f"{part.name}.{field.name}", field


@pytest.mark.parametrize(("name", "field"), list(keys()))
def test_every_key_says_what_it_is_and_the_reference_lists_it_with_its_default(name, field):
    (said,) = field.type.__metadata__
    default = "must be given" if field.default is msgspec.NODEFAULT else field.default
    shown = "none" if default in ("", None) else default if default == "must be given" else f"`{default}`"
    assert f"| `{name}` | {shown} | {said.description}" in REFERENCE


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
def test_a_configuration_of_an_editor_of_another_system_is_read(file, encoding):
    plain = load(file).config
    file.write_bytes((f"# R\u00fcck\r\n{GOOD}").encode(encoding))
    assert load(file).config == plain
    file.write_bytes((f"# R\u00fcck\n{GOOD}").encode("cp1252"))
    with pytest.raises(DescriptionError, match=r"is no text in UTF-8 .at line 1.; save it as UTF-8 text"):
        load(file)


def test_relative_paths_start_at_the_files_folder(file):
    config = load(file).config
    assert config.sensor.rig == file.parent / "rig.toml"
    assert config.spool.folder == file.parent / "takes"
    assert config.control.socket == Path("/run/hangtime/control.sock")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[recording]\npre_roll_s = 11.0\n", r"recording.pre_roll_s must be a number at most 10.0 \(got 11\);"),
        ("[recording]\npre_roll_s = 2000\n", r"most 10.0 \(got 2000\); were milliseconds meant\? Mend that setting;"),
        ("[recording]\nlongest_s = 120000.0\n", r"at most 3600.0 \(got 120000\); were milliseconds meant\?"),
        ("[recording]\nlongest_s = 2\n", r"at least 5.0 \(got 2\); were minutes meant\?"),
        ("[recording]\npre_roll_s = nan\n", r"at least 0.0 \(got nan\);"),
        ("[recording]\npre_rol_s = 1.0\n", "unknown field `pre_rol_s` in recording; did you mean `pre_roll_s`"),
        ("[buton]\n", "unknown field `buton`; did you mean `button`"),
        ("[lamp]\nled = 3\n", r"lamp.led must be text \(got 3\);"),
        ("[power]\nalarm = \"\"\n", "a path must be a text that is not empty"),
        ("[power]\nalarm = \"a\\u0000b\"\n", "a path must be a text that is not empty"),
        ("[recording]\nscan_rate_hz = 30.0\nscan_points = 64\n", "have 16.9 million places, at most 1 million"),
        ("[recording\n", "is not valid TOML"),
        (f"a = {2000 * '['}\n", "has too many brackets in each other"),
    ],
)  # fmt: skip
def test_a_bad_configuration_is_refused_by_its_key_and_the_last_good_one_stays(file, text, said):
    good = load_or_last_good(file)
    assert good.refused is None
    file.write_text(GOOD + text)
    with pytest.raises(DescriptionError, match=said):
        load(file)
    found = load_or_last_good(file)
    assert str(file) in str(found.refused)
    assert (found.config, found.rig, found.garment) == (good.config, good.rig, good.garment)


@pytest.mark.parametrize(
    ("number", "said"),
    [("50000000000", r"at most 1000000 \(got 5e\+10\); were bytes meant\?"), ("-1", r"at least 10 \(got -1\);"),
     ("8000000", r"at most 1000000 \(got 8e\+06\); were kB meant\?")],
)  # fmt: skip
def test_room_on_the_disk_in_another_unit_is_refused_with_it(file, number, said):
    file.write_text(f"{GOOD}least_free_mb = {number}\n")
    with pytest.raises(DescriptionError, match=f"spool.least_free_mb must be a whole number {said}"):
        load(file)


def test_a_file_named_relative_to_the_working_folder_means_the_same_when_its_copy_is_in_force(file, monkeypatch):
    """The copy lies in the spool: a socket that is relative to the file must not become one relative to the copy."""
    monkeypatch.chdir(file.parent)
    file.write_text(GOOD.replace('"takes"', "'takes'") + '[control]\nsocket = "control.sock"\n')
    good = load_or_last_good(Path("appliance.toml"))
    file.write_text("[spool]\nfolder = 'takes'\n")
    found = load_or_last_good(Path("appliance.toml"))
    assert found.refused is not None
    assert found.config == good.config
    assert found.config.control.socket == file.parent / "control.sock"
    assert found.config.spool.folder == file.parent / "takes"


def test_a_bad_garment_leaves_the_last_good_one_in_force(file):
    load_or_last_good(file)
    (file.parent / "garment.toml").write_text("mass_kg = -1\n")
    found = load_or_last_good(file)
    assert found.garment == GARMENT
    assert "garment.toml" in str(found.refused)


def test_without_an_earlier_configuration_a_bad_one_is_an_error(file):
    file.write_text(GOOD.replace("rig.toml", "gone.toml"))
    with pytest.raises(DescriptionError, match=r"gone.toml: cannot be read"):
        load_or_last_good(file)


def test_a_configuration_larger_than_the_memory_is_refused_in_one_sentence(file):
    with file.open("wb") as opened:
        opened.truncate(1 << 42)  # a sparse file of 4 TB takes no room on the disk
    with pytest.raises(DescriptionError, match="has more than 1048576 bytes, which no such file has"):
        load_or_last_good(file)


def test_a_last_good_copy_that_was_spoilt_is_not_taken(file):
    load_or_last_good(file)
    kept = copy_of(file)
    kept.write_bytes(kept.read_bytes()[:-30])
    file.write_text(GOOD + "[buton]\n")
    with pytest.raises(DescriptionError, match="buton"):
        load_or_last_good(file)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[spool]\nfolder = 5\n", "a path must be a text that is not empty"),
        ('[spool]\nfolder = ""\n', "a path must be a text that is not empty"),
        ('[spool]\nfolder = "elsewhere"\nleast_free = 3\n', "unknown field `least_free`"),
        ('[spool]\nfolder = "rig.toml"\n', "rig.toml is no folder"),
        ('[spool]\nfolder = "rig.toml/takes"\n', "rig.toml is no folder"),
        ('[spool]\nfolder = "loop"\n', "loop is a link that leads to itself"),
        ("", "appliance.toml: the field `sensor` is missing"),
        ("\0{{{", "is not valid TOML"),
        (None, "is absent; install the appliance (docs/how-to/appliance.md), or give another file with --config"),
    ],
    ids=["number", "empty", "other-and-typo", "file", "below-a-file", "loop", "nothing", "garbage", "gone"],
)  # fmt: skip
def test_the_last_good_one_is_found_without_the_spool_that_the_file_should_name(file, text, said):
    good = load_or_last_good(file)
    (file.parent / "loop").symlink_to("loop")
    if text is None:
        file.unlink()
    else:
        file.write_text(text and GOOD.partition("[spool]")[0] + text)
    found = load_or_last_good(file)
    assert said in str(found.refused)
    assert (found.config, found.rig, found.garment) == (good.config, good.rig, good.garment)


def test_the_copy_lies_in_the_units_folder_of_state(file, monkeypatch, tmp_path):
    monkeypatch.setenv("STATE_DIRECTORY", f"{tmp_path / 'state'}:/var/lib/other")
    load_or_last_good(file)
    assert [path.name for path in (tmp_path / "state").iterdir()] == ["appliance.last-good.json"]
    file.unlink()
    assert load_or_last_good(file).config.spool.folder == file.parent / "takes"


def test_where_nothing_can_be_written_beside_the_file_the_copy_is_in_the_spool(file, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(file))  # a file: no folder can be made of it
    load_or_last_good(file)
    assert (file.parent / "takes/last-good.json").is_file()
    file.write_text(GOOD + "[buton]\n")
    assert load_or_last_good(file).refused is not None


def test_a_configuration_replaces_the_copy_only_once_the_recorder_is_ready_with_it(file):
    first = load_or_last_good(file)
    file.write_text(GOOD + "[recording]\npre_roll_s = 3.0\n")
    second = load_or_last_good(file)
    file.write_text("")
    assert load_or_last_good(file).config == first.config
    keep(second, file)
    assert load_or_last_good(file).config == second.config
    assert last_good(file, DescriptionError("why", where=file, advice="mend it")).refused.what == "why"


def pre_roll_in_force(file):
    try:
        return load_or_last_good(file).config.recording.pre_roll_s
    except DescriptionError:
        return 0.0


def test_every_power_cut_leaves_the_copy_of_before_or_the_new_one_and_no_temporary_file(file, tmp_path, monkeypatch):
    held = load_or_last_good(file)
    copy_of(file).unlink()
    file.write_text("")  # so that only a copy can be in force
    state = tmp_path / "state"
    state.mkdir()
    monkeypatch.setenv("STATE_DIRECTORY", str(state))

    def with_pre_roll(seconds):
        recording = msgspec.structs.replace(held.config.recording, pre_roll_s=seconds)
        return replace(held, config=msgspec.structs.replace(held.config, recording=recording))

    disk = Disk(state)
    with disk.recording(monkeypatch):
        for seconds in (1.0, 2.0, 3.0):
            keep(with_pre_roll(seconds), file)
            disk.promise(seconds)
    cuts = [(moment, word, files) for moment in disk.moments for word, files in moment.cuts()]
    for moment, word, files in cuts:
        left = disk.lay(files, tmp_path / "cut")
        monkeypatch.setenv("STATE_DIRECTORY", str(left))
        promised = float(moment.promises)  # the last one is as long as there were promises
        assert pre_roll_in_force(file) in (promised, promised + 1.0), word
        keep(with_pre_roll(9.0), file)
        assert [path.name for path in left.iterdir()] == ["appliance.last-good.json"], word
    assert len(cuts) >= 15  # as recorded; far fewer would mean that the shim misses calls

"""The settings and the commands of sync."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from capture.appliance.retention import Retention
from capture.appliance.sync_news import SyncNews
from capture.appliance.sync_status import read_status
from capture.errors import SyncError
from capture.sync.settings import SyncSettings
from tests.capture.appliance.spool_takes import record
from tests.fit.here import hangtime_here


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"url": "ftp://server"}, "neither a folder nor a bucket"),
        ({"device": "a/b"}, "give letters, digits"),
        ({"bytes_per_second": 0}, "bytes_per_second is 0; give 1000 to 10000000000 bytes a second, or leave it out$"),
        ({"bytes_per_second": 17}, r"is 17; give 1000 to 10000000000 .*; were kB or MB meant\?"),
        ({"proof_days": 604800}, r"proof_days is 604800; give 0\.01 to 366 days; were seconds meant\?"),
        ({"timeout_s": 300000}, r"timeout_s is 300000; give 1 to 86400 seconds; were milliseconds meant\?"),
        ({"retention": {"quota_bytes": 8}}, r"quota_bytes is 8; give 10000000 to 1000000000000000 bytes or 0; were GB"),
        ({"retention": {"least_free_bytes": 500}}, r"free_bytes is 500; give 1000000 to .*; were MB or GB meant"),
        ({"retention": {"days": 2592000}}, r"days is 2592000; give 0 to 36600 days or inf; were seconds meant\?"),
        ({"retention": {"days": float("nan")}}, "days is no number; give a number of days, or inf"),
        ({"password": "x"}, "unknown field"),
        ({"retention": {"days": -1}}, "days is negative"),
        ({"timeout_s": 0.1}, "give 1 to 86400 seconds"),
    ],
)  # fmt: skip
def test_settings_that_do_not_hold_are_one_sentence(table, words):
    from capture.sync.settings import settings_of

    with pytest.raises(SyncError) as error:
        settings_of(table, where="a.toml")
    assert re.search(words, error.value.what)


def test_the_ends_of_each_range_no_limit_and_nothing_that_stays_are_settings():
    from capture.sync.settings import settings_of

    for table in (
        {"bytes_per_second": 1000, "proof_days": 0.01, "timeout_s": 1}, {"bytes_per_second": 1e10, "proof_days": 366},
        {"retention": {"quota_bytes": 0, "least_free_bytes": 0, "days": 0}},
        {"retention": {"quota_bytes": 10**15, "least_free_bytes": 10**6, "days": float("inf")}},
    ):  # fmt: skip
        assert settings_of(table, where="a.toml")


def test_every_setting_is_documented():
    """Each name of [sync] and of its retention is in the table's docstring and in the reference."""

    guide = (Path(__file__).parents[3] / "docs/reference/sync.md").read_text()
    for struct in (SyncSettings, Retention):
        for field in msgspec.structs.fields(struct):
            assert f"`{field.name}`" in guide, field.name
            assert field.name in struct.__doc__, field.name


def hangtime(*words):
    return hangtime_here(*words, folder=".")


@pytest.mark.parametrize("command", [("takes", "prune"), ("sync", "status")])
def test_a_command_makes_no_folder_where_no_takes_are_and_says_so(tmp_path, command):
    done = hangtime(*command, "--spool", tmp_path / "spoool")
    assert done.returncode == 2
    assert "spoool: is no folder, so that no take is in it; give the folder" in done.stderr
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "loop").symlink_to("loop")
    done = hangtime(*command, "--spool", tmp_path / "loop")
    assert done.returncode == 2
    assert "loop: is a link that leads to itself; give the folder of takes with --spool" in done.stderr


def test_a_take_of_another_name_in_the_spool_is_named(spool, three):
    shown = hangtime("sync", "status", "--spool", spool.folder).stdout
    assert "of the recorder" not in shown
    for name in ("b\nc.mcap", "swing.mcap", "take-12.mcap"):
        (spool.folder / name).write_bytes(b"x")
    told = (
        "3 files here are no takes of the recorder, and nothing sends or removes: b\\nc.mcap, swing.mcap, take-12.mcap"
    )
    for command in (("sync", "status"), ("takes", "prune")):
        assert told in hangtime(*command, "--spool", spool.folder).stdout
    for k in range(2):
        (spool.folder / f"x{k}.mcap").write_bytes(b"x")
    assert "swing.mcap, take-12.mcap and 2 more" in hangtime("sync", "status", "--spool", spool.folder).stdout


def test_the_commands_say_what_stands_and_prune_lets_only_verified_takes_go(tmp_path, spool, three):
    config = tmp_path / "appliance.toml"
    config.write_text(f'[spool]\nfolder = "spool"\n[sync]\nurl = "file://{tmp_path}/server"\ndevice = "box"\n')
    assert "Sync has not run yet. Next: `hangtime sync now`" in hangtime("sync", "status", "--config", config).stdout
    pruned = hangtime("takes", "prune", "--config", config, "--quota-mb", 0)
    assert "0 takes removed" in pruned.stdout
    assert "3 takes are not safe on the server and stay" in pruned.stdout
    done = hangtime("sync", "run", "--config", config)
    assert (done.returncode, done.stderr.count("safe on the server (read back)")) == (0, 3)
    shown = hangtime("sync", "status", "--config", config).stdout
    assert "0 takes wait, 3 safe on the server, last sync: today at" in shown
    assert ", sound." in shown
    assert hangtime("sync", "prove", "--config", config).returncode == 0
    assert (
        "take-000003 is removed from this device"
        in hangtime("takes", "prune", "--config", config, "--quota-mb", 0).stdout
    )


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "appliance.toml: is absent; install the appliance (docs/how-to/appliance.md), or give another file"),
        ("[sync", "is not valid TOML"),
        ("[sync]\nurl = 1\n", "is invalid"),
    ],
    ids=["missing", "no-toml", "wrong-type"],
)  # fmt: skip
def test_a_configuration_that_does_not_hold_is_one_sentence_and_exit_code_2(tmp_path, content, words):
    config = tmp_path / "appliance.toml"
    if content is not None:
        config.write_text(content)
    done = hangtime("sync", "now", "--config", config)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert words in done.stderr


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[sync", "appliance.toml: is not valid TOML"), ("[sync]\nurl = 1\n", "[sync] is invalid"),
        ('[sync]\ncredentials = "gone.toml"\n', "gone.toml: the credentials cannot be read"),
        ('[sync]\nurl = "ftp://x"\n', "neither a folder nor a bucket"),
    ],
    ids=["no-toml", "wrong-type", "no-credentials", "no-store"],
)  # fmt: skip
def test_the_appliances_status_says_why_the_unit_cannot_even_begin(tmp_path, spool, three, content, words):
    """The unit runs `run`; a command that a person tries by hand prints to the person alone."""
    config = tmp_path / "appliance.toml"
    config.write_text('[spool]\nfolder = "spool"\n' + content)
    assert hangtime("sync", "now", "--config", config).returncode == 2
    assert read_status(spool.folder) is None
    for tries in (1, 2):
        assert hangtime("sync", "run", "--config", config).returncode == 2
        status = read_status(spool.folder)
        assert (status.fault.tries, status.waiting) == (tries, 3)
    news = SyncNews(spool.folder)
    news.look()
    assert "takes are not sent" in news.error.what
    assert words in news.error.what
    config.write_text(f'[spool]\nfolder = "spool"\n[sync]\nurl = "file://{tmp_path}/server"\n')
    assert hangtime("sync", "run", "--config", config).returncode == 0
    assert read_status(spool.folder).fault is None


@pytest.mark.parametrize("days", ["inf", "3660", "7305"])
def test_any_number_of_days_is_one_and_nan_is_none(tmp_path, spool, three, days):
    config = tmp_path / "appliance.toml"
    config.write_text(f'[spool]\nfolder = "spool"\n[sync]\nurl = "file://{tmp_path}/server"\nretention.days = {days}\n')
    assert hangtime("sync", "run", "--config", config).returncode == 0
    assert "0 takes removed" in hangtime("takes", "prune", "--config", config, "--keep-days", days).stdout
    assert hangtime("takes", "prune", "--config", config, "--keep-days", "nan").returncode == 2
    assert len(spool.takes()) == 3


@pytest.mark.parametrize("key", ["days", "quota_bytes", "least_free_bytes"])
def test_a_negative_limit_of_retention_is_named_with_its_own_line(tmp_path, key):
    config = tmp_path / "appliance.toml"
    config.write_text(f'[sync]\nurl = "file:///server"\n[sync.retention]\n\n{key} = -1\n')
    said = hangtime("sync", "status", "--config", config).stderr
    assert f"appliance.toml, line 5: [sync] is invalid: retention.{key} is negative; give a number" in said


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--keep-days", 1e308), "--keep-days: it is 1e+308; give 0 to 36600 days or inf"),
        (("--keep-days", 604800), "--keep-days: it is 604800; give 0 to 36600 days or inf; were seconds meant?"),
        (("--quota-mb", 10**30), "--quota-mb: it is 1e+30; give 10 to 1000000000 MB or 0"),
        (("--quota-mb", 1), "--quota-mb: it is 1; give 10 to 1000000000 MB or 0"),
    ],
)
def test_options_of_prune_have_the_ranges_of_the_configuration(tmp_path, spool, three, words, says):
    done = hangtime("takes", "prune", "--spool", spool.folder, *words)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(spool.takes()) == 3


def test_prune_names_the_limit_that_the_takes_exceed(spool, three):
    by_option = hangtime("takes", "prune", "--spool", spool.folder, "--quota-mb", 0).stdout
    assert "these takes exceed what --quota-mb allows: 3 takes are not safe on the server and stay" in by_option


def test_prune_names_a_single_unsafe_take_in_the_singular(spool):
    record(spool, 40)
    told = hangtime("takes", "prune", "--spool", spool.folder, "--quota-mb", 0).stdout
    assert " allows: 1 take is not safe on the server and stays\n" in told


def test_prune_names_a_disk_that_other_files_fill_and_no_takes(tmp_path, spool, three):
    """No disk of these tests has the 1 PB that is asked for; the takes themselves are within their quota."""
    config = tmp_path / "appliance.toml"
    config.write_text(
        f'[spool]\nfolder = "spool"\n[sync]\nurl = "file://{tmp_path}/server"\n'
        "[sync.retention]\nleast_free_bytes = 1000000000000000\n"
    )
    told = hangtime("takes", "prune", "--config", config).stdout
    assert "free, and least_free_bytes asks for 1000000.0 GB: 3 takes are not safe on the server and stay" in told
    assert "exceed" not in told
    assert hangtime("sync", "run", "--config", config).returncode == 0
    told = hangtime("takes", "prune", "--config", config).stdout
    assert told.endswith("free, and least_free_bytes asks for 1000000.0 GB: other files fill it\n")
    assert "exceed" not in told


def test_a_take_that_is_not_what_the_server_verified_any_more_stays_and_is_named(tmp_path, spool, three):
    config = tmp_path / "appliance.toml"
    config.write_text(f'[spool]\nfolder = "spool"\n[sync]\nurl = "file://{tmp_path}/server"\n')
    assert hangtime("sync", "run", "--config", config).returncode == 0
    content = bytearray(three[1].path.read_bytes())
    content[100] ^= 1
    three[1].path.write_bytes(content)
    setup = hangtime("takes", "prune", "--config", config, "--quota-mb", 0).stdout
    assert (
        "take-000002 stays: the file differs from the one that the server verified; replace this device's disk" in setup
    )
    assert [take.sequence for take in spool.takes()] == [2]


def test_an_upload_by_hand_says_that_it_asked_no_server_unless_it_did(tmp_path, spool, three):
    """The first folder holds no take; in the other one a proof is due after the upload, and none the second time."""
    config, said = tmp_path / "appliance.toml", "hangtime sync: no take waits; the server was not asked\n"
    config.write_text(f'[spool]\nfolder = "spool"\n[sync]\nurl = "file://{tmp_path}/server"\n')
    nothing = hangtime("sync", "now", "--config", config, "--spool", tmp_path / "empty")
    assert (nothing.returncode, nothing.stderr) == (0, said)
    first, second = (hangtime("sync", "now", "--config", config) for _ in range(2))
    assert (first.returncode, "was not asked" in first.stderr) == (0, False)
    assert (second.returncode, second.stderr) == (0, said)
    (spool.folder / "sync-status.json").unlink()  # hence a proof is due
    proved = hangtime("sync", "now", "--config", config)
    assert ("was fetched from the server" in proved.stderr, "was not asked" in proved.stderr) == (True, False)

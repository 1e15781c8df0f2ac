"""`hangtime takes recover` as a user meets it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formats.archive import read_take, verify_take, write_take
from formats.chunks import Findings, messages_in
from formats.take_writer import MOST_HEADER_BYTES
from tests.fit.here import hangtime_here
from tests.formats.damage import chunks_of, without_end
from tests.formats.full_disk import no_file_beyond
from tests.formats.test_archive import a_take
from tests.formats.test_command_line import hangtime
from tests.formats.unprivileged import hangtime_unprivileged


def test_recover_makes_a_sound_file_and_names_the_missing_seconds(tmp_path):
    """The third of five blocks is damaged; what is recovered is sound, and still says what is missing."""
    path = write_take(tmp_path / "a.mcap", a_take())
    raw = bytearray(path.read_bytes())
    third = [begin for begin, _, content in chunks_of(bytes(raw)) if content.get("first") == 62]
    raw[third[0] + 200] ^= 1
    path.write_bytes(raw)
    before = read_take(path)
    done = hangtime("takes", "recover", path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{tmp_path}/a.recovered.mcap: 119 frames, missing: 2.03 to 3.10 s\n"
    after = read_take(tmp_path / "a.recovered.mcap")
    assert (after.missing, after.is_complete) == (before.missing, False)
    np.testing.assert_array_equal(after.points, before.points)
    verified = hangtime("takes", "verify", tmp_path / "a.recovered.mcap")
    assert verified.returncode == 0
    assert verified.stdout.endswith("119 frames in 4 blocks; an earlier file had lost 2.03 to 3.10 s\n")
    assert hangtime("takes", "recover", path).returncode == 2, "what is there stays"


def test_recover_makes_room_in_a_full_header_for_what_is_missing(tmp_path):
    """The header has the 2^20 bytes that a reader accepts, and the recovered one names a span more."""
    empty = write_take(tmp_path / "a.mcap", replace(a_take(), notes={"of": "", "long": ""})).read_bytes()
    used = len(next(messages_in(empty, Findings())))
    room = MOST_HEADER_BYTES - used - 4  # the length of a long text takes four bytes more than that of none
    path = write_take(
        tmp_path / "a.mcap", replace(a_take(), notes={"of": "", "long": "é" * (room // 2) + "." * (room % 2)})
    )
    raw = bytearray(path.read_bytes())
    assert len(next(messages_in(bytes(raw), Findings()))) == MOST_HEADER_BYTES
    third = [begin for begin, _, content in chunks_of(bytes(raw)) if content.get("first") == 62]
    raw[third[0] + 200] ^= 1
    path.write_bytes(raw)
    done = hangtime_here("takes", "recover", "a.mcap", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "missing: 2.03 to 3.10 s; its longest note is cut, since a header has no more room" in done.stdout
    after = read_take(tmp_path / "a.recovered.mcap")
    assert len(after.missing) == 1
    assert after.notes["long"].endswith("é [cut]")


def test_recover_goes_on_after_a_file_that_cannot_be_written_and_reports_each(tmp_path):
    for name in "abc":
        (tmp_path / name).mkdir()
        write_take(tmp_path / name / f"{name}.mcap", a_take())
    (tmp_path / "b/b.recovered.mcap").write_text("mine")
    (tmp_path / "a").chmod(0o555)
    words = ("takes", "recover", "a/a.mcap", "b/b.mcap", "c/c.mcap")
    (done,) = hangtime_unprivileged(words, folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, "")
    locked = "choose another folder, or get the permission to write to this one"
    assert done.stdout.splitlines() == [
        f"not written: a/a.recovered.mcap: cannot be written (Permission denied); {locked}",
        "not written: b/b.recovered.mcap: is already there; choose another folder with --out, or --overwrite to "
        "replace it",
        "c/c.recovered.mcap: 150 frames, nothing is missing",
    ]
    assert (tmp_path / "b/b.recovered.mcap").read_text() == "mine"
    assert hangtime_here(*words, "--overwrite", folder=tmp_path).returncode == 0
    assert verify_take(tmp_path / "b/b.recovered.mcap").is_sound


def test_recover_goes_on_within_a_file_of_which_one_take_is_too_large_for_the_disk(tmp_path):
    """The first of two joined takes has more bytes than a file may have here, the second fewer."""
    both = [write_take(tmp_path / f"{k}.mcap", replace(a_take(n), take_id=k)) for k, n in (("a", 150), ("b", 31))]
    (tmp_path / "c.mcap").write_bytes(both[0].read_bytes() + both[1].read_bytes())
    sizes = [path.stat().st_size for path in both]
    with no_file_beyond((sizes[0] + sizes[1]) // 2):
        done = hangtime_here("takes", "recover", "c.mcap", "a.mcap", "b.mcap", folder=tmp_path)
    assert done.returncode == 2
    assert [line.split(":")[0] for line in done.stdout.splitlines()] == [
        "not written", "c.recovered.mcap", "not written", "b.recovered.mcap"
    ]  # fmt: skip
    assert "File too large" in done.stdout


def test_recover_leaves_no_empty_folder_where_the_disk_is_full(tmp_path):
    write_take(tmp_path / "a.mcap", a_take())
    (tmp_path / "mine").mkdir()
    for out in ("new/r", "mine"):
        with no_file_beyond(100):
            done = hangtime_here("takes", "recover", "a.mcap", "--out", out, folder=tmp_path)
        assert (done.returncode, "File too large" in done.stderr) == (2, True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "mine"]


def test_recover_goes_on_after_a_file_of_which_nothing_can_be_read(tmp_path):
    empty, path = tmp_path / "empty.mcap", write_take(tmp_path / "a.mcap", a_take())
    empty.touch()
    done = hangtime("takes", "recover", empty, path)
    assert done.returncode == 2
    assert done.stdout.splitlines() == [
        f"lost: {empty}: is empty; give a take archive", f"{tmp_path}/a.recovered.mcap: 150 frames, nothing is missing"
    ]  # fmt: skip


def test_recover_makes_a_sound_file_of_what_an_interrupted_recording_left(tmp_path):
    raw = write_take(tmp_path / "a.mcap", a_take()).read_bytes()
    (tmp_path / "b.mcap.partial").write_bytes(without_end(raw))
    done = hangtime("takes", "recover", tmp_path / "b.mcap.partial", "--out", tmp_path / "out")
    assert done.stdout == f"{tmp_path}/out/b.recovered.mcap: 150 frames, missing: from 4.97 s on\n"
    assert verify_take(tmp_path / "out/b.recovered.mcap").is_sound


def test_takes_that_would_be_recovered_into_one_file_are_refused_before_any_is_lost(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_take(tmp_path / name / "one.mcap", replace(a_take(), take_id=name))
    both = (tmp_path / "a" / "one.mcap", tmp_path / "b" / "one.mcap")
    done = hangtime("takes", "recover", *both, "--out", tmp_path / "out", "--overwrite")
    assert done.returncode == 2
    assert "two takes would become one.recovered.mcap; recover one of them into another --out" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_take_whose_name_is_too_long_for_another_file_says_what_to_do(tmp_path):
    path = write_take(tmp_path / f"{'n' * 240}.mcap", a_take())
    done = hangtime("takes", "recover", path)
    assert done.returncode == 2
    assert "recovered.mcap: cannot be written (File name too long); choose a shorter name" in (done.stderr)

"""An unfinished take in the way of a new one: `--overwrite` puts aside whatever somebody may still make use of."""

from __future__ import annotations

import pytest

from formats.archive import verify_take, write_take
from formats.descriptions import dump_description
from formats.importers.marker_tracks import write_marker_csv
from tests.formats.bombs import header_of
from tests.formats.damage import chunk_of, chunks_of
from tests.formats.test_archive import a_take
from tests.formats.test_marker_oddities import GARMENT, hanging
from tests.formats.unprivileged import hangtime_unprivileged


def a_block_alone_with_a_flipped_bit(raw):
    """Its checksum fails, so no reader returns it; its frames may still be recovered by hand."""
    _, (begin, end, _), *_ = chunks_of(raw)
    left = bytearray(raw[:end])
    left[begin + 200] ^= 1
    return bytes(left)


def one_of_a_newer_version(raw):
    """Its blocks name their columns in another way."""
    begin = chunks_of(raw)[0][0]
    return raw[:begin] + chunk_of(header_of(raw, format="hangtime-take/3")) + chunk_of({"rows": b"frames"})


@pytest.mark.parametrize(
    "made", [a_block_alone_with_a_flipped_bit, one_of_a_newer_version, lambda raw: b"mine", lambda raw: raw[9:]],
    ids=["damaged", "newer", "words", "without-its-beginning"],
)  # fmt: skip
def test_a_file_that_is_unreadable_now_is_put_aside_as_well(raw, tmp_path, made):
    left = made(raw)
    (tmp_path / "t.mcap.partial").write_bytes(left)
    write_take(tmp_path / "t.mcap", a_take(20))
    assert verify_take(tmp_path / "t.mcap").is_sound
    assert (tmp_path / "t.left-1.mcap.partial").read_bytes() == left


def test_one_that_may_not_be_read_and_written_is_reported_as_such_and_stays(raw, tmp_path):
    """A rename would need no such permission, and would take the file from a recording that somebody else runs."""
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    write_marker_csv(tmp_path / "m.csv", hanging())
    partials = [tmp_path / out / "m.mcap.partial" for out in "abc"]
    for partial, mode in zip(partials, (0o000, 0o200, 0o400), strict=True):
        partial.parent.mkdir()
        partial.write_bytes(raw)
        partial.chmod(mode)
    words = ("import", "m.csv", "--garment", "g.toml", "--out")
    commands = [(*words, out, *option) for option in ((), ("--overwrite",)) for out in "abc"]
    what = "may not be read and written by you, and may be a recording that is still running"
    for command, done in zip(commands, hangtime_unprivileged(*commands, folder=tmp_path), strict=True):
        step = "get the permission to read and write it, or choose another folder with --out"
        assert (done.returncode, done.stderr) == (2, f"hangtime: {command[5]}/m.mcap.partial: {what}; {step}\n")
    for partial in partials:
        partial.chmod(0o600)
        assert partial.read_bytes() == raw
        assert [path.name for path in partial.parent.iterdir()] == [partial.name]

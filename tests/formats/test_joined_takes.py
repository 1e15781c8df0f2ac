"""Files that hold several takes: joined ones, and a page of one within another. None of their frames is lost."""

from __future__ import annotations

import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.archive import read_take, take_of, verify_take, write_take
from formats.fault_words import doubts_of
from formats.take_reader import _Archive, read_every_take
from formats.take_writer import binding_of
from tests.fit.here import hangtime_here
from tests.formats.bombs import BOMBS
from tests.formats.damage import chunk_of, chunks_of, without_end
from tests.formats.test_archive import a_scan, a_take
from tests.formats.test_vectors import HERE as VECTORS


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """The bytes of takes a, of 150 frames in 5 blocks, and b, of 90 in 3, of another garment and with two scans."""
    folder = tmp_path_factory.mktemp("pair")
    other = a_take(90)
    other = replace(
        other, take_id="b", garment=msgspec.structs.replace(other.garment, name="other"),
        scans=(a_scan(0.4, 1), a_scan(0.6, 2)),
    )  # fmt: skip
    return [write_take(folder / f"{take.take_id}.mcap", take).read_bytes() for take in (a_take(), other)]


def recovered(folder, raw, name="c.mcap", *options):
    """Return the output of `recover` for a file of these bytes, as text and as lines."""
    (folder / name).write_bytes(raw)
    done = hangtime_here("takes", "recover", name, *options, folder=folder)
    return done, done.stdout.splitlines()


def assert_same(path, raw):
    found, wanted = read_take(path), take_of(raw, "wanted")
    assert (found.take_id, found.garment, len(found.scans)) == (wanted.take_id, wanted.garment, len(wanted.scans))
    np.testing.assert_array_equal(found.points, wanted.points)


def test_each_of_two_joined_takes_gets_a_file_of_its_own(pair, tmp_path):
    done, lines = recovered(tmp_path, pair[0] + pair[1])
    assert (done.returncode, lines) == (0, [
        "c.recovered.mcap: 150 frames, nothing is missing",
        "c.recovered-2.mcap: 90 frames of another take in this file, b, nothing is missing",
    ])  # fmt: skip
    for name, raw in zip(("c.recovered.mcap", "c.recovered-2.mcap"), pair, strict=True):
        assert_same(tmp_path / name, raw)
        assert verify_take(tmp_path / name).is_sound


def test_commands_say_that_there_is_another_take_and_which_command_gets_it(pair, tmp_path):
    (tmp_path / "c.mcap").write_bytes(pair[0] + pair[1])
    told = "3 blocks of another take in this file; "
    beside = "3 blocks of other takes in its file are left out; `hangtime takes recover` saves each take"
    assert doubts_of(read_take(tmp_path / "c.mcap")) == [beside, f"{len(pair[1])} bytes follow its end"]
    assert doubts_of(take_of(pair[0], "alone")) == []
    gets = "`hangtime takes recover` makes a sound file of each take"
    verified = hangtime_here("takes", "verify", "c.mcap", folder=tmp_path).stdout
    assert verified.startswith(f"damaged     c.mcap: 150 frames in 5 blocks; {told}")
    assert verified.endswith(f"; {gets}\n")
    shown = hangtime_here("takes", "show", "c.mcap", folder=tmp_path).stdout
    assert f"\nother     {told}{gets}\nbehind    {len(pair[1])} bytes follow its end\n" in shown
    listed = hangtime_here("takes", "list", ".", folder=tmp_path).stdout
    assert listed.endswith(f"; {told}{len(pair[1])} bytes follow its end; {gets}\n")
    for words in (("verify", "c.mcap"), ("list", "."), ("show", "c.mcap")):
        document = json.loads(hangtime_here("takes", *words, "--json", folder=tmp_path).stdout)
        assert document.get("takes", [document])[0]["other_takes"] == 1


def test_two_interrupted_takes_joined_are_both_recovered(pair, tmp_path):
    done, lines = recovered(tmp_path, without_end(pair[1]) + without_end(pair[0]), "c.mcap.partial")
    assert (done.returncode, lines) == (0, [
        "c.recovered.mcap: 150 frames, missing: from 4.97 s on",
        "c.recovered-2.mcap: 90 frames of another take in this file, b, missing: from 2.97 s on",
    ])  # fmt: skip


def test_a_page_of_one_take_within_another_becomes_a_file_of_its_frames(pair, tmp_path):
    """Its header and its first block of 31 frames."""
    parts, at = chunks_of(pair[1]), chunks_of(pair[0])[2][1]
    page = pair[1][parts[0][0] : parts[1][1]]
    _, lines = recovered(tmp_path, pair[0][:at] + page + pair[0][at:])
    assert lines[1] == "c.recovered-2.mcap: 31 frames of another take in this file, b, missing: from 1.00 s on"


def test_two_takes_of_one_name_and_one_of_version_1_before_them_are_three_files(pair, tmp_path):
    first = (VECTORS / "version-1.mcap").read_bytes()
    same = write_take(tmp_path / "x.mcap", replace(a_take(60), created="2026-02-02T00:00:00Z")).read_bytes()
    done, lines = recovered(tmp_path, first + pair[0] + same)
    assert done.returncode == 0
    assert [line.split(" ")[1] for line in lines] == ["70", "150", "60"]
    assert len(read_take(tmp_path / "c.recovered-3.mcap").time) == 60


def test_a_take_of_version_1_that_comes_twice_is_one_with_its_scans(tmp_path):
    raw = (VECTORS / "version-1.mcap").read_bytes()
    _, lines = recovered(tmp_path, raw + raw)
    assert lines == ["c.recovered.mcap: 70 frames, nothing is missing"]
    assert verify_take(tmp_path / "c.recovered.mcap").is_sound


def test_a_file_that_is_there_stays_and_none_of_the_others_is_written(pair, tmp_path):
    (tmp_path / "c.recovered-2.mcap").write_text("mine")
    done, _ = recovered(tmp_path, pair[0] + pair[1])
    assert done.returncode == 2
    assert "c.recovered-2.mcap: is already there; choose another folder with --out, or --overwrite" in done.stderr
    assert (tmp_path / "c.recovered-2.mcap").read_text() == "mine"
    assert not (tmp_path / "c.recovered.mcap").exists()
    done, lines = recovered(tmp_path, pair[0] + pair[1], "c.mcap", "--overwrite")
    assert (done.returncode, len(lines)) == (0, 2)
    assert_same(tmp_path / "c.recovered-2.mcap", pair[1])


def test_a_take_that_is_read_is_not_replaced_by_another_one_of_a_joined_file(pair, tmp_path):
    (tmp_path / "c.recovered-2.mcap").write_bytes(pair[0])
    done, _ = recovered(tmp_path, pair[0] + pair[1], "c.mcap", "c.recovered-2.mcap", "--overwrite")
    assert "c.recovered-2.mcap: would replace the take that is read; choose another folder with --out" in done.stdout
    assert (tmp_path / "c.recovered-2.mcap").read_bytes() == pair[0]


def test_where_the_take_that_is_read_has_no_sound_frame_the_other_one_is_recovered(pair, tmp_path):
    """The tables of its blocks have a byte each."""
    broken = pair[0]
    for begin, end, content in reversed(chunks_of(broken)):
        if "table" in content:
            broken = broken[:begin] + chunk_of({**content, "table": b"\x07"}) + broken[end:]
    done, lines = recovered(tmp_path, broken + pair[1])
    assert done.returncode == 2
    assert lines == [
        "lost: c.mcap: holds none of the 150 frames that it had; copy it again from where it was recorded",
        "c.recovered.mcap: 90 frames of another take in this file, b, nothing is missing",
    ]


def test_of_hundreds_of_takes_in_one_file_fifty_are_written(pair, tmp_path):
    done, lines = recovered(tmp_path, BOMBS["thousands of whole takes"](pair[0]), "c.mcap", "--out", "out")
    assert done.returncode == 2
    assert lines[-1] == "lost: c.mcap: holds 1501 takes, of which 50 are read; cut the file into several"
    assert len(list((tmp_path / "out").iterdir())) == 50


def test_blocks_of_version_1_belong_to_the_header_before_them(pair, tmp_path):
    """They name no take: of two joined takes, a lost block of the first one is not filled from the second."""
    first = (VECTORS / "version-1.mcap").read_bytes()
    second = b"".join(
        chunk_of({**content, "take_id": "other"}) if "format" in content else first[begin:end]
        for begin, end, content in chunks_of(first)
    )
    blocks = [(begin, end) for begin, end, content in chunks_of(first) if "first" in content]
    begin, end = blocks[1]
    done, lines = recovered(tmp_path, first[:begin] + first[end:] + second)
    whole = take_of(first, "first")
    assert done.returncode == 0
    assert len(read_take(tmp_path / "c.recovered.mcap").time) < len(whole.time)
    assert not read_take(tmp_path / "c.recovered.mcap").is_complete
    other = read_take(tmp_path / "c.recovered-2.mcap")
    assert (other.take_id, other.is_complete) == ("other", True)
    np.testing.assert_array_equal(other.points, whole.points)
    assert "of another take in this file, other, nothing is missing" in lines[1]


def test_blocks_of_version_1_before_its_first_header_are_read(tmp_path):
    first = (VECTORS / "version-1.mcap").read_bytes()
    begin, end, _ = next(chunk for chunk in chunks_of(first) if "format" in chunk[2])
    (tmp_path / "a.mcap").write_bytes(first[:begin] + first[end:])
    np.testing.assert_array_equal(read_take(tmp_path / "a.mcap").points, take_of(first, "first").points)


def test_two_takes_of_one_header_are_never_mixed_without_a_word(pair, tmp_path):
    moved = write_take(tmp_path / "b.mcap", replace(a_take(), points=a_take().points + 0.01)).read_bytes()
    begin, end, _ = [chunk for chunk in chunks_of(pair[0]) if "table" in chunk[2]][2]
    mixed = "two takes share a header in this file, or one has lost its own, and their seconds may be mixed"
    _, lines = recovered(tmp_path, pair[0][:begin] + pair[0][end:] + moved)
    assert lines == [f"c.recovered.mcap: 150 frames, nothing is missing; {mixed}"]
    assert mixed in hangtime_here("takes", "verify", "c.mcap", folder=tmp_path).stdout
    exported = hangtime_here("takes", "export", "c.recovered.mcap", "--to", "csv", "--out", ".", folder=tmp_path)
    assert exported.stdout == f"c.recovered.csv: 150 frames; {mixed}\n"


def test_a_take_that_may_be_mixed_keeps_the_doubt_of_its_import(tmp_path):
    takes = [replace(a_take(), notes={"file": "has fewer frames than it states"}, points=a_take().points + k * 0.01)
             for k in range(2)]  # fmt: skip
    raw = b"".join(write_take(tmp_path / "a.mcap", take).read_bytes() for take in takes)
    assert doubts_of(take_of(raw, "both"))[:1] == [
        "has fewer frames than it states; two takes share a header in this file, or one has lost its own, and their "
        "seconds may be mixed"
    ]


def of_version_1(count, take_id="one"):
    """The header of a take of version 1, and consecutive blocks, each like the vector's first one."""
    chunks = [content for _, _, content in chunks_of((VECTORS / "version-1.mcap").read_bytes())]
    header = {**next(content for content in chunks if "format" in content), "take_id": take_id}
    block = next(content for content in chunks if "first" in content)
    n, later = block["frames"], 10**7
    return header, [chunk_of({**block, "first": n * k, "start": block["start"] + later * k}) for k in range(count)]


@pytest.mark.parametrize("at", [2, 20, 40])
def test_a_stray_header_takes_no_block_of_version_1_from_the_take_that_goes_on(at):
    header, blocks = of_version_1(40)
    stray, _ = of_version_1(0, "two")
    whole = [chunk_of(header), *blocks]
    found = take_of(b"".join([*whole[:at], chunk_of(stray), *whole[at:]]), "one")
    assert (found.take_id, len(found.time)) == ("one", len(take_of(b"".join(whole), "one").time))


def test_a_header_of_version_1_binds_wherever_its_format_stands():
    header, blocks = of_version_1(2)
    moved = {name: value for name, value in header.items() if name != "format"} | {"format": header["format"]}
    found, wanted = (take_of(b"".join([chunk_of(one), *blocks]), "one") for one in (moved, header))
    assert len(found.time) == len(wanted.time)


@pytest.mark.parametrize("ends", [True, False])
def test_a_scan_of_version_1_belongs_to_the_take_of_the_next_block(ends):
    """A recording writes it before the block of its second; the take before it in the file has no end."""
    chunks = [content for _, _, content in chunks_of((VECTORS / "version-1.mcap").read_bytes())]
    scan = next(content for content in chunks if "surface" in content)
    (one, of_one), (two, of_two) = of_version_1(2), of_version_1(3, "two")
    end = [chunk_of(next(content for content in chunks if "blocks" in content))] if ends else []
    raw = b"".join([chunk_of(one), *of_one, chunk_of(two), chunk_of(scan), *of_two, *end])
    assert len(take_of(raw, "two").scans) == 1
    alone = b"".join([chunk_of(one), *of_one, chunk_of(scan)])
    assert len(take_of(alone, "one").scans) == 1


def frames_of_a_block():
    chunks = [content for _, _, content in chunks_of((VECTORS / "version-1.mcap").read_bytes())]
    return next(content for content in chunks if "first" in content)["frames"]


def end_of_version_1(blocks):
    return chunk_of({"frames": frames_of_a_block() * blocks, "blocks": blocks})


def takes_in(raw, folder):
    (folder / "c.mcap").write_bytes(b"".join(raw))
    return {take.take_id: (take, report) for take, report in read_every_take(folder / "c.mcap").each}


@pytest.mark.parametrize("has_later_header", [True, False])
def test_blocks_behind_an_end_belong_to_no_take_of_version_1_that_has_ended(has_later_header, tmp_path):
    """The first header of the second take is lost; the writer put another one before its end."""
    first = [*raw_of(4), raw_of(4)[0], end_of_version_1(4)]
    (two, of_two) = of_version_1(6, "two")
    later = [chunk_of(two)] if has_later_header else []
    alone, alone_report = takes_in(first, tmp_path)["one"]
    found = takes_in([*first, *of_two, *later, end_of_version_1(6)], tmp_path)
    take, report = found["one"]
    np.testing.assert_array_equal(take.points, alone.points)
    assert (report.blocks, report.missing_frames, report.is_sound) == (4, 0, False)
    if has_later_header:
        assert (found["two"][1].blocks, found["two"][0].is_complete) == (6, True)
        assert report.damaged_blocks == alone_report.damaged_blocks
    else:
        assert set(found) == {"one"}
        assert report.damaged_blocks == alone_report.damaged_blocks + 7


def test_blocks_behind_an_end_that_counts_its_take_whole_do_not_go_on_with_it(tmp_path):
    """The second take has lost its header and as many blocks as the first one has."""
    first, (two, of_two) = [*raw_of(3), raw_of(3)[0], end_of_version_1(3)], of_version_1(8, "two")
    found = takes_in([*first, *of_two[3:], chunk_of(two), end_of_version_1(8)], tmp_path)
    assert (found["one"][1].blocks, found["one"][0].is_complete, found["one"][1].doubts) == (3, True, ())
    assert (found["two"][1].blocks, found["two"][1].missing_frames) == (5, 3 * frames_of_a_block())


def test_blocks_whose_headers_are_lost_go_into_no_take_behind_their_end(tmp_path):
    one, three = [*raw_of(4), raw_of(4)[0], end_of_version_1(4)], of_version_1(5, "three")
    ends = [end_of_version_1(6), end_of_version_1(7)]  # the second one of a take that has lost all else
    raw = [*one, *of_version_1(6)[1], *ends, chunk_of(three[0]), *three[1], end_of_version_1(5)]
    found = takes_in(raw, tmp_path)
    assert {name: report.blocks for name, (_, report) in found.items()} == {"one": 4, "three": 5}
    assert not any(take.missing or report.is_sound or report.doubts for take, report in found.values())


def test_a_recovered_take_keeps_the_doubts_of_its_file(tmp_path):
    raw = b"".join([*raw_of(3), end_of_version_1(3), end_of_version_1(9)])
    _, lines = recovered(tmp_path, raw)
    doubt = "its several ends differ"
    assert lines == [f"c.recovered.mcap: 93 frames, missing: from 21.00 s on; {doubt}"]
    assert doubts_of(read_take(tmp_path / "c.recovered.mcap")) == [doubt]
    told = hangtime_here("takes", "verify", "c.recovered.mcap", folder=tmp_path).stdout
    assert told.count(doubt) == 1
    listed = hangtime_here("takes", "verify", "c.recovered.mcap", "--json", folder=tmp_path).stdout
    (entry,) = json.loads(listed)["takes"]
    assert (entry["state"], entry["doubts"], entry["earlier_doubts"]) == ("sound", [], doubt)
    again = hangtime_here("takes", "recover", "c.recovered.mcap", folder=tmp_path).stdout
    assert again.endswith(f"; reported of the file it was made from: {doubt}\n")
    compared = hangtime_here("compare", "c.recovered.mcap", "c.recovered.recovered.mcap", folder=tmp_path).stderr
    assert compared.count(f": {doubt}.") == 2, "of each, by its file"


def raw_of(count):
    header, blocks = of_version_1(count)
    return [chunk_of(header), *blocks]


def test_a_stray_end_takes_no_block_of_version_1_from_the_take_that_goes_on():
    header, *blocks = raw_of(5)
    found = take_of(b"".join([header, *blocks[:2], end_of_version_1(40), *blocks[2:], header]), "one")
    assert len(found.time) == len(take_of(b"".join([header, *blocks]), "one").time)


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_scan_of_version_1_whose_block_is_lost_stays_with_the_take_before_the_next_header(goes_on, tmp_path):
    chunks = [content for _, _, content in chunks_of((VECTORS / "version-1.mcap").read_bytes())]
    scan = chunk_of(next(content for content in chunks if "surface" in content))
    (one, of_one), (two, of_two) = of_version_1(4), of_version_1(3, "two")
    rest = of_one[2:] if goes_on else of_two  # the other header is a stray one, or that of the next take
    found = takes_in([chunk_of(one), *of_one[:2], scan, chunk_of(two), *rest], tmp_path)
    assert len(found["one"][0].scans) == 1


def test_a_finished_take_with_an_unreadable_header_is_one_damaged_message(raw):
    """It comes before a take of more blocks, which is read instead."""
    lost = b"\x82\xa6format\xafhangtime-take/2"  # a map of two entries, cut behind the first
    take = binding_of(lost)
    parts = [{"take": take, "first": 0, "frames": 1}, {"take": take, "frames": 1, "blocks": 1, "scans": 0}]
    _, sound = _Archive(raw, "sound").first()
    found, report = _Archive(raw[:8] + b"".join(map(chunk_of, [lost, *parts])) + raw[8:], "joined").first()
    assert len(found.time) == sound.frames
    assert (sound.damaged_blocks, report.damaged_blocks, report.other_blocks) == (0, 1, 1)


def test_blocks_of_an_earlier_take_that_memory_did_not_suffice_for_are_not_those_of_the_next(raw):
    archive = _Archive(raw, "a")
    archive._memory.left_out = 3
    _, report = archive.first()
    assert (report.unread_blocks, report.damaged_blocks, report.is_sound) == (0, 0, True)

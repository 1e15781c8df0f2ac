"""The `--json` documents about takes: a program finds every fact under its key."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from formats import telling
from formats.archive import read_take, write_take
from formats.descriptions import dump_description
from formats.importers.marker_tracks import MARKER_SD, write_marker_csv
from formats.importers.swatch_mocap import import_marker_take
from formats.rig import Rig
from formats.take import FrameState
from tests.fit.here import hangtime_here
from tests.formats.damage import chunks_of, without_end
from tests.formats.test_archive import a_scan, a_take
from tests.formats.test_command_line import swung_cloth
from tests.formats.test_marker_oddities import GARMENT as SWATCH
from tests.formats.test_marker_oddities import hanging


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """Takes that are whole, cut off after 4.97 s, without a block of 31 frames, and without one of two scans; no take.

    Ten bytes follow another one, and the notes of the last one doubt its clocks and its number of frames.
    Two recordings of others lie beside them: one of 30 frames in 0.29 s, of which marker 5 was never seen, and one
    whose hanger and points have clocks of their own.
    """
    folder = tmp_path_factory.mktemp("desk")
    raw = write_take(folder / "takes/a.mcap", a_take()).read_bytes()
    (folder / "takes/b.mcap.partial").write_bytes(without_end(raw))
    damaged, third = bytearray(raw), next(at for at, _, told in chunks_of(raw) if told.get("first") == 62)
    damaged[third + 200] ^= 1
    (folder / "takes/c.mcap").write_bytes(damaged)
    scanned = write_take(
        folder / "takes/d.mcap", replace(a_take(), take_id="d", scans=(a_scan(0.4, 1), a_scan(0.6, 2)))
    )
    damaged = bytearray(scanned.read_bytes())
    damaged[next(at for at, _, told in chunks_of(bytes(damaged)) if "surface" in told) + 200] ^= 1
    scanned.write_bytes(damaged)
    (folder / "takes/e.mcap").write_bytes(b"no take")
    write_take(folder / "mended.mcap", read_take(folder / "takes/c.mcap"))
    (folder / "odd").mkdir()
    (folder / "odd/behind.mcap").write_bytes(raw + b"ten bytes!")
    doubts = {"clock": "its clocks differ", "file": "line 406 may be cut off"}
    write_take(folder / "odd/doubted.mcap", replace(a_take(), notes=doubts))
    places = hanging().positions.copy()
    places[:, 5] = np.nan
    write_marker_csv(folder / "m.csv", replace(hanging(), positions=places))
    (folder / "swatch.toml").write_text(dump_description(SWATCH))
    swung_cloth(folder / "r.npz")
    return folder


AFTER, WITHIN = "from 4.97 s on", "2.03 to 3.10 s"
BLOCK, SCAN = "1 block of its file is damaged", "the take lacks 1 scan of the surface"
SOUND = {"take_id": "a", "state": "sound", "is_complete": True, "missing": "", "missing_frames": 0, "missing_scans": 0,
         "unread_blocks": 0, "damaged_blocks": 0, "other_blocks": 0, "other_takes": 0, "trailing_bytes": 0,
         "doubts": [], "earlier_doubts": ""}  # fmt: skip
CUT = {**SOUND, "state": "incomplete", "missing": AFTER, "missing_frames": None, "is_complete": False}
HOLED = {**SOUND, "state": "damaged", "missing": WITHIN, "missing_frames": 31, "damaged_blocks": 1,
         "is_complete": False}  # fmt: skip
SCANNED = {**SOUND, "take_id": "d", "state": "damaged", "damaged_blocks": 1, "missing_scans": 1}
BEHIND = {**SOUND, "state": "damaged", "trailing_bytes": 10}
DOUBTED = {**SOUND, "earlier_doubts": "its clocks differ; line 406 may be cut off"}
LIST = {"duration_s": 149 / 30, "motion": "mixed", "garment": "sheet", "created": "2026-01-01T00:00:00Z", "left": []}
LOST = {"state": "lost", "error": ""}
VERIFY = {"frames": 150, "blocks": 5, "left": []}

# Findings about an imported recording, and what to do.
WORDS = ("words", "advice")
SHORT = ("the take is too short: intervals need 3 half-seconds of motion, and there are 1",
         "swing for five seconds or more, then hold still until the cloth hangs")  # fmt: skip
STILL = ("the hanger moved by 0 mm at most, which shows next to nothing of the cloth",
         "swing it to and fro by the width of a hand or more")  # fmt: skip
UNSEEN = ("row2_column2 was never seen", "bring the whole garment into view, with nothing before it")


@pytest.mark.parametrize(
    ("words", "code", "entries"),
    [
        ("takes list takes", 2, {"takes": [
            {"file": "takes/a.mcap", **LIST, **SOUND},
            {"file": "takes/b.mcap.partial", **LIST, **CUT},
            {"file": "takes/c.mcap", **LIST, **HOLED},
            {"file": "takes/d.mcap", **LIST, **SCANNED},
            {"file": "takes/e.mcap", **LOST},
        ]}),
        ("takes verify takes/a.mcap takes/b.mcap.partial takes/c.mcap takes/d.mcap takes/e.mcap", 2, {"takes": [
            {"file": "takes/a.mcap", **VERIFY, **SOUND},
            {"file": "takes/b.mcap.partial", **VERIFY, **CUT},
            {"file": "takes/c.mcap", **VERIFY, **HOLED, "blocks": 4, "frames": 119},
            {"file": "takes/d.mcap", **VERIFY, **SCANNED},
            {"file": "takes/e.mcap", **LOST},
        ]}),
        ("takes verify takes/a.mcap", 0, {"takes": [{"file": "takes/a.mcap", **VERIFY, **SOUND}]}),
        ("takes list odd", 0, {"takes": [
            {"file": "odd/behind.mcap", **LIST, **BEHIND}, {"file": "odd/doubted.mcap", **LIST, **DOUBTED},
        ]}),
        ("takes verify odd/behind.mcap odd/doubted.mcap", 2, {"takes": [
            {"file": "odd/behind.mcap", **VERIFY, **BEHIND}, {"file": "odd/doubted.mcap", **VERIFY, **DOUBTED},
        ]}),
        ("takes recover takes/c.mcap takes/d.mcap --out sound", 0, {"takes": [
            {"file": "sound/c.recovered.mcap", "frames": 119, **HOLED},
            {"file": "sound/d.recovered.mcap", "frames": 150, **SCANNED},
        ]}),
        ("takes export takes/a.mcap takes/c.mcap takes/d.mcap --to csv --out files", 0, {"files": [
            {"file": "files/a.csv", "frames": 150, "moved": None, **SOUND},
            {"file": "files/c.csv", "frames": 119, "moved": None, **HOLED},
            {"file": "files/d.csv", "frames": 150, "moved": None, **SCANNED},
        ]}),
        ("takes export takes/c.mcap takes/d.mcap --to parquet --out all.parquet", 0, {
            "files": ["all.parquet"], "takes": [
                {"file": "takes/c.mcap", "frames": 119, **HOLED}, {"file": "takes/d.mcap", "frames": 150, **SCANNED},
            ], "incomplete": {"takes/c.mcap": f"is incomplete; missing: {WITHIN}"},
            "doubts": {"takes/c.mcap": [BLOCK], "takes/d.mcap": [BLOCK, SCAN]},
        }),
        ("import m.csv --garment swatch.toml --out in", 0, {"takes": [
            {"file": "in/m.mcap", **SOUND, "take_id": "m", "frames": 30,
             "duration_s": 0.29, "front": "-y", "never_seen": ["row2_column2"],
             "clock": None, "file_doubt": None, "left": [], "findings": [
                 {"name": "too_short", "is_grave": True, **dict(zip(WORDS, SHORT, strict=True))},
                 {"name": "hardly_moved", "is_grave": False, **dict(zip(WORDS, STILL, strict=True))},
                 {"name": "points_never_seen", "is_grave": False, **dict(zip(WORDS, UNSEEN, strict=True))},
             ]},
        ]}),
        ("import r.npz --out own", 0, {"takes": [
            {"file": "own/r.mcap", **SOUND, "take_id": "r", "frames": 40,
             "duration_s": 4.29, "front": None, "never_seen": [],
             "clock": None, "file_doubt": None, "left": [], "findings": [
                 {"name": "hardly_moved", "is_grave": False, **dict(zip(WORDS, STILL, strict=True))},
             ]},
        ]}),
        ("swatch s.toml --mass 0.05 --side 0.4 --markers 5", 0,
         {"file": "s.toml", "markers": 25, "apart_mm": 100.0}),
    ],
    ids=lambda words: words[:20] if isinstance(words, str) else None,
)  # fmt: skip
def test_json_reports_every_fact_of_a_command(desk, words, code, entries):
    done = hangtime_here(*words.split(), "--json", folder=desk)
    told = json.loads(done.stdout)
    faults = [line for line in done.stderr.splitlines() if line.startswith("hangtime: ")]
    assert (done.returncode, len(faults)) == (code, done.stderr.count("\n"))
    named = {"lost"} if "list" in words else {"lost", "incomplete", "damaged"}  # `list` fails for lost takes alone
    wrong = [entry["file"] for entry in told.get("takes", []) if entry.get("state") in named]
    assert [line.split(": ")[1] for line in faults] == (wrong if code else [])
    for entry in told.get("takes", []) if code else []:
        if entry["state"] == "lost":
            assert entry["error"].startswith(f"{entry['file']}: ")
            entry["error"] = ""
    assert bool(told.pop("error", "")) == (code != 0)
    assert _rounded(told) == _rounded(entries)


@pytest.mark.parametrize(("to", "out"), [("csv", "some"), ("parquet", "some.parquet")])
def test_json_has_the_state_of_a_take_of_which_nothing_is_read(desk, to, out):
    e = {"file": "takes/e.mcap", "state": "lost"}
    for words, key in (("show", None), (f"export --to {to} --out lost", "lost"), ("recover --out lost", "takes")):
        done = hangtime_here("takes", *words.split(), "takes/e.mcap", "--json", folder=desk)
        told = json.loads(done.stdout)
        (found,) = told[key] if key else [told]
        assert (done.returncode, found.pop("error")[:35]) == (2, "takes/e.mcap: is not a take archive")
        assert found == e
    words = ("takes", "export", "takes/e.mcap", "takes/a.mcap", "--to", to, "--out", out, "--json")
    (found,) = json.loads(hangtime_here(*words, folder=desk).stdout)["lost"]
    assert {**found, "error": ""} == {**e, "error": ""}


def test_json_has_the_state_of_a_take_of_which_nothing_is_written(desk):
    for words, name in (("export --to csv", "a.csv"), ("recover", "a.recovered.mcap")):
        (desk / "full" / name).mkdir(parents=True)
        done = hangtime_here("takes", *words.split(), "takes/a.mcap", "--out", "full", "--json", folder=desk)
        (found,) = next(iter(json.loads(done.stdout).values()))
        told = f"full/{name}: is a folder; choose another folder with --out"
        assert (done.returncode, done.stderr) == (2, f"hangtime: {told}\n")
        assert (found["state"], found["error"]) == ("not written", told)


@pytest.mark.parametrize(
    "words", ["takes list gone", "takes list takes/a.mcap", "import gone.npz", "swatch s.txt --mass 1"]
)
def test_json_of_a_command_that_fails_has_the_sentence_of_its_error(desk, words):
    done = hangtime_here(*words.split(), "--json", folder=desk)
    assert done.returncode == 2
    assert f"hangtime: {json.loads(done.stdout)['error']}\n" == done.stderr


@pytest.mark.parametrize("words", ["takes show", "swatch s.toml --mass much"])
def test_json_of_a_command_that_is_used_wrongly_has_the_sentence_of_its_error(desk, words):
    done = hangtime_here(*words.split(), "--json", folder=desk)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (2, f"Error: {json.loads(done.stdout)['error']}")


def test_json_of_several_takes_that_are_lost_names_each_file(desk):
    done = hangtime_here("takes", "recover", "gone.mcap", "takes/e.mcap", "--json", folder=desk)
    assert [one["file"] for one in json.loads(done.stdout)["takes"]] == ["gone.mcap", "takes/e.mcap"]


def _rounded(value):
    """Numbers to five places: times are kept to half a microsecond."""
    if isinstance(value, dict):
        return {name: _rounded(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_rounded(inner) for inner in value]
    return round(value, 5) if isinstance(value, float) else value


HINT = "; `hangtime takes recover` makes a sound file"


@pytest.mark.parametrize(
    ("words", "lines"),
    [
        ("takes list takes", [
            "sound       a.mcap: 5.0 s, mixed, sheet, 2026-01-01T00:00:00Z",
            f"incomplete  b.mcap.partial: 5.0 s, mixed, sheet, 2026-01-01T00:00:00Z; missing: {AFTER}",
            f"damaged     c.mcap: 5.0 s, mixed, sheet, 2026-01-01T00:00:00Z; 1 block damaged; missing: {WITHIN}"
            " (31 frames)",
            "damaged     d.mcap: 5.0 s, mixed, sheet, 2026-01-01T00:00:00Z; 1 block damaged; missing: 1 scan of the "
            "surface",
            "lost        takes/e.mcap: is not a take archive; ",
        ]),
        ("takes verify takes/a.mcap takes/d.mcap takes/e.mcap", [
            "sound       takes/a.mcap: 150 frames in 5 blocks",
            f"damaged     takes/d.mcap: 150 frames in 5 blocks, 1 damaged; missing: 1 scan of the surface{HINT}",
            "lost        takes/e.mcap: is not a take archive; ",
        ]),
        ("takes recover takes/c.mcap takes/d.mcap --out told", [
            f"told/c.recovered.mcap: 119 frames, missing: {WITHIN}",
            "told/d.recovered.mcap: 150 frames, nothing is missing; lost: 1 scan of the surface",
        ]),
        ("takes verify mended.mcap", [
            f"sound       mended.mcap: 119 frames in 4 blocks; an earlier file had lost {WITHIN}",
        ]),
        ("takes export takes/a.mcap takes/d.mcap --to npz --out npz", [
            "npz/a.npz: 150 frames", f"npz/d.npz: 150 frames; {BLOCK}; {SCAN}",
        ]),
        ("takes export takes/c.mcap --to parquet --out one.parquet", [
            "one.parquet: 1 take", f"takes/c.mcap is incomplete; missing: {WITHIN}", f"takes/c.mcap: {BLOCK}",
        ]),
        ("takes export takes/c.mcap takes/d.mcap --to parquet --out two.parquet", [
            "two.parquet: 2 takes", f"takes/c.mcap is incomplete; missing: {WITHIN}", f"takes/c.mcap: {BLOCK}",
            f"takes/d.mcap: {BLOCK}", f"takes/d.mcap: {SCAN}",
        ]),
        ("import m.csv --garment swatch.toml --out words", [
            "words/m.mcap: 30 frames, 0.3 s, its front looks along -y",
            *(f"Warning: {'; '.join(both)}" for both in (SHORT, STILL, UNSEEN)),
        ]),
    ],
    ids=lambda words: words[:20] if isinstance(words, str) else None,
)  # fmt: skip
def test_the_same_facts_are_reported_in_words(desk, words, lines):
    told = hangtime_here(*words.split(), folder=desk).stdout.splitlines()
    assert len(told) == len(lines)
    for line, wanted in zip(told, lines, strict=True):
        assert line == wanted or (wanted.startswith("lost") and line.startswith(wanted))


def test_an_imported_take_has_everything_that_the_file_and_its_date_state(desk):
    path = desk / "m.csv"
    os.utime(path, (1.75e9, 1.75e9))
    take = import_marker_take(path, SWATCH)
    assert (take.take_id, take.source, take.garment) == ("m", "m.csv", SWATCH)
    assert take.created == datetime.fromtimestamp(1.75e9, UTC).isoformat()
    assert take.rig == Rig(format="hangtime-rig/1", name="motion capture, z up", gravity=(0.0, 0.0, -1.0))
    assert take.notes == {"markers": "16 of the 16 markers in the file", "front": "-y"}
    np.testing.assert_array_equal(take.held, take.points[:, [0, 3]])
    np.testing.assert_array_equal(take.markers, take.held)
    np.testing.assert_array_equal(take.points_valid, np.arange(16) != np.full((30, 1), 5))
    for sd in (take.points_sd, take.held_sd):
        np.testing.assert_array_equal(sd, MARKER_SD)
    assert (take.state == 0).all()


def test_a_frame_without_a_held_marker_says_so(tmp_path):
    places = hanging().positions.copy()
    places[4, 3] = np.nan
    write_marker_csv(tmp_path / "m.csv", replace(hanging(), positions=places))
    take = import_marker_take(tmp_path / "m.csv", SWATCH)
    assert [int(k) for k in np.flatnonzero(take.state)] == [4]
    assert take.state[4] == FrameState.MARKER_LOST
    np.testing.assert_array_equal(take.held_valid, ~np.isnan(places[:, [0, 3]]).any(2))


def test_a_recovered_take_holds_the_data_of_the_damaged_one(desk):
    hangtime_here("takes", "recover", "takes/c.mcap", "--out", "again", folder=desk)
    left, found = read_take(desk / "takes/c.mcap"), read_take(desk / "again/c.recovered.mcap")
    assert (found.take_id, found.source, found.created, found.notes) == ("a", "test", left.created, {"who": "me"})
    np.testing.assert_array_equal(found.points, left.points)
    assert found.missing == left.missing


def test_facts_of_several_calls_make_one_document_and_words_none(capsys):
    """What is known without words counts; a number that is not finite is null; the next command begins anew."""
    telling.begin()
    telling.ask_json(True)
    telling.ask_json(False)  # another option's default does not take it back
    telling.tell("words", name="a\u202e", share=float("inf"))
    telling.know(parts={"low": (1.5, float("nan"))})
    telling.tell_entry("takes", "words", file="b")
    telling.tell_entry("takes", "words", file="c")
    telling.end()
    told = capsys.readouterr().out
    assert json.loads(told) == {
        "name": "a\u202e", "share": None, "parts": {"low": [1.5, None]}, "takes": [{"file": "b"}, {"file": "c"}],
    }  # fmt: skip
    assert "\\u202e" in told
    telling.end()
    telling.begin()
    telling.tell("in words", name="a")
    telling.tell_entry("takes", "of one", file="b")
    telling.ask_quiet(True)
    telling.tell("in silence")
    telling.begin()
    telling.ask_quiet(False)
    telling.tell("and again")
    assert capsys.readouterr().out.splitlines() == ["in words", "of one", "and again"]

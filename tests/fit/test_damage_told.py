"""Every command that uses a damaged take reports the damage."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fit.batch.garments import Seen, wardrobe_of
from fit.errors import DriveError, FitError, ImpossiblePathError, MismatchError
from fit.export.about import remarks_on_take
from fit.export.kinds import EXPORT_KINDS, Order
from fit.identification.calibrate import calibrate
from fit.identification.request import Plan
from fit.recordings.intact import FRAME_FIELDS, describe_doubts, describe_flaws, describe_missing, naming_damage
from fit.recordings.ready import ready
from fit.virtual_tests.sheet import sheet_of
from formats.archive import read_take, write_take
from formats.fault_words import state_of_take
from formats.results import load_fit_result, save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.scenes import hung, sheet, swing, take_of
from tests.formats.damage import chunks_of
from tests.formats.test_archive import a_scan, a_take

LACKS = "is incomplete (119 frames are left; missing: 2.03 to 3.10 s)"


def with_a_hole():
    """Five seconds at 30 frames a second without frames 62 to 92: from 2.03 s, frame 61, to 3.10 s, frame 93."""
    whole = a_take()
    kept = np.r_[0:62, 93:150]
    arrays = {name: values[kept] for name in FRAME_FIELDS if (values := getattr(whole, name)) is not None}
    missing = ((float(whole.time[61]), float(whole.time[93])),)
    return replace(whole, **arrays, is_complete=False, missing=missing)


@pytest.fixture(scope="module")
def fitted():
    return msgspec.structs.replace(a_fit(), notes=["Another.", *describe_missing([with_a_hole()])])


@pytest.mark.parametrize("kind", ["csv", "table", "newton", "mujoco", "u3m", "blender", "usd-physics"])
def test_every_export_of_a_fit_to_a_damaged_take_says_so(kind, fitted):
    if kind == "usd-physics":
        pytest.importorskip("pxr", reason="usd-core is not installed")
    made = EXPORT_KINDS[kind].make(Order(result=fitted))
    assert LACKS in re.sub(r"[\s#*/]+", " ", next(iter(made.values())).decode())
    sound = EXPORT_KINDS[kind].make(Order(result=a_fit()))
    assert "is incomplete" not in next(iter(sound.values())).decode()


def test_the_fabric_of_a_fit_to_a_damaged_take_says_so(fitted):
    assert sheet_of(fitted).count(LACKS) == 1
    assert "incomplete" not in sheet_of(a_fit())


def test_motion_under_a_damaged_take_says_so():
    take = with_a_hole()
    of_other = msgspec.structs.replace(a_fit(), garment_content="", take_contents=[])
    assert any(LACKS in remark for remark in remarks_on_take(of_other, take))
    assert not any("incomplete" in remark for remark in remarks_on_take(of_other, a_take()))


def test_fits_and_takes_side_by_side_say_which_is_damaged(fitted, tmp_path):
    save_fit_result(tmp_path / "a.json", fitted)
    (tmp_path / "b.mcap").mkdir()  # a folder of results may be named after its take
    save_fit_result(tmp_path / "b.mcap/fit.json", a_fit())
    done = hangtime_here("compare", "a.json", "b.mcap", "--out", "page.html", folder=tmp_path)
    shutil.rmtree(tmp_path / "b.mcap")
    assert done.stderr.count(LACKS) == 1
    assert (tmp_path / "page.html").read_text().count(LACKS) == 1
    write_take(tmp_path / "a.mcap", with_a_hole())
    write_take(tmp_path / "b.mcap", a_take())
    shown = hangtime_here("compare", "a.mcap", "b.mcap", folder=tmp_path).stdout
    assert re.search(r"^missing +2\.03 to 3\.10 s +nothing$", shown, re.MULTILINE)
    assert re.search(r"^length .* 119 frames, 30 a second .* 150 frames, 30 a second$", shown, re.MULTILINE)


def test_takes_list_and_export_say_which_seconds_are_missing(tmp_path):
    write_take(tmp_path / "a.mcap", with_a_hole())
    write_take(tmp_path / "b.mcap", replace(a_take(), take_id="b"))
    first, second = hangtime_here("takes", "list", ".", folder=tmp_path).stdout.splitlines()
    assert first.endswith("; an earlier file had lost 2.03 to 3.10 s")
    assert "missing" not in second
    listed = json.loads(hangtime_here("takes", "list", ".", "--json", folder=tmp_path).stdout)["takes"]
    assert [(one["is_complete"], one["missing"]) for one in listed] == [(False, "2.03 to 3.10 s"), (True, "")]
    exported = ("takes", "export", "a.mcap", "b.mcap", "--overwrite", "--to")
    done = hangtime_here(*exported, "csv", "--out", "out", folder=tmp_path)
    assert done.stdout.splitlines() == [
        "out/a.csv: 119 frames; the take is incomplete; missing: 2.03 to 3.10 s", "out/b.csv: 150 frames"
    ]  # fmt: skip
    told = json.loads(hangtime_here(*exported, "csv", "--out", "out", "--json", folder=tmp_path).stdout)
    assert [(one["is_complete"], one["missing"]) for one in told["files"]] == [(False, "2.03 to 3.10 s"), (True, "")]
    pytest.importorskip("pyarrow")
    done = hangtime_here(*exported, "parquet", "--out", "all.parquet", folder=tmp_path)
    assert done.stdout == "all.parquet: 2 takes\na.mcap is incomplete; missing: 2.03 to 3.10 s\n"


def test_lost_scans_are_reported_by_every_command_of_takes(tmp_path):
    """Two scans, of which the first is lost; no frame is."""
    path = write_take(tmp_path / "a.mcap", replace(a_take(), scans=(a_scan(0.4, 1), a_scan(2.6, 2))))
    raw = path.read_bytes()
    begin, end, _ = next(chunk for chunk in chunks_of(raw) if "surface" in chunk[2])
    path.write_bytes(raw[:begin] + raw[end:])
    for words in (
        ("show", "a.mcap"), ("verify", "a.mcap"), ("list", "."), ("recover", "a.mcap"),
        ("export", "a.mcap", "--to", "npz", "--out", "."),
    ):  # fmt: skip
        assert "1 scan of the surface" in hangtime_here("takes", *words, folder=tmp_path).stdout, words


def test_two_files_of_one_take_are_distinguished_by_their_names(tmp_path):
    raw = write_take(tmp_path / "a.mcap", a_take()).read_bytes()
    for name in ("one", "two"):
        (tmp_path / f"{name}.mcap").write_bytes(raw + b"ten bytes!")
    told = hangtime_here("compare", "one.mcap", "two.mcap", folder=tmp_path).stderr
    for name in ("one", "two"):
        assert told.count(f"Warning: the take {name}.mcap: 10 bytes follow its end.") == 1


def test_a_take_that_another_stands_beside_or_that_its_import_doubts_says_so(tmp_path):
    alone = write_take(tmp_path / "a.mcap", a_take()).read_bytes()
    other = write_take(tmp_path / "b.mcap", replace(a_take(), take_id="b")).read_bytes()
    (tmp_path / "both.mcap").write_bytes(alone + other)
    joined = read_take(tmp_path / "both.mcap")
    beside = "Warning: the take a: 5 blocks of other takes in its file are left out; `hangtime takes"
    assert [doubt.startswith(beside) for doubt in describe_doubts([joined, replace(a_take(), take_id="c")])] == [
        True,
        False,
    ]
    doubted = replace(a_take(), notes={"clock": "its clocks differ", "who": "me", "file": "lacks frames"})
    assert describe_doubts([doubted]) == [
        "Warning: the take a: its clocks differ.", "Warning: the take a: lacks frames."
    ]  # fmt: skip
    of_other = msgspec.structs.replace(a_fit(), garment_content="", take_contents=[])
    assert any(remark.startswith(beside) for remark in remarks_on_take(of_other, joined))
    told = hangtime_here("takes", "export", "both.mcap", "b.mcap", "--to", "csv", "--out", ".", folder=tmp_path).stdout
    assert told.splitlines() == [
        "both.csv: 150 frames; 5 blocks of other takes in its file are left out; "
        f"`hangtime takes recover` saves each take; {len(other)} bytes follow its end",
        "b.csv: 150 frames",
    ]


@pytest.fixture(scope="module")
def odd(tmp_path_factory):
    """Takes that another one follows, that ten bytes follow, without a block of 31 frames, and that its import doubts.

    Beside each lies a folder with a fit to it.
    """
    folder = tmp_path_factory.mktemp("odd")
    alone = write_take(folder / "sound.mcap", a_take()).read_bytes()
    other = write_take(folder / "other.mcap", replace(a_take(), take_id="b")).read_bytes()
    broken, third = bytearray(alone), next(at for at, _, told in chunks_of(alone) if told.get("first") == 62)
    broken[third + 200] ^= 1
    (folder / "other.mcap").unlink()
    for name, raw in {"joined": alone + other, "behind": alone + b"ten bytes!", "broken": bytes(broken)}.items():
        (folder / f"{name}.mcap").write_bytes(raw)
    write_take(folder / "doubted.mcap", replace(a_take(), notes={"file": "line 406 may be cut off"}))
    for path in folder.glob("*.mcap"):
        take = read_take(path)
        fit = msgspec.structs.replace(
            a_fit(), notes=["Another.", *describe_flaws([take])], take_states=[state_of_take(take)]
        )
        save_fit_result(folder / path.stem / "fit.json", fit)
    return folder


NOT_HOLDING = {
    "joined": ["5 blocks of other takes in its file are left out; `hangtime takes recover` saves each take",
               "{behind} bytes follow its end"],
    "behind": ["10 bytes follow its end"],
    "broken": ["1 block of its file is damaged"],
    "doubted": ["line 406 may be cut off"],
    "sound": [],
}  # fmt: skip


def test_every_command_reports_the_same_state_of_a_take(odd):
    names = [f"{name}.mcap" for name in sorted(NOT_HOLDING)]
    told = {
        words: json.loads(hangtime_here(*words.split(), *given, "--json", folder=odd).stdout)
        for words, given in {"compare": names, "takes list": ["."], "takes verify": names}.items()
    }
    shown = [json.loads(hangtime_here("takes", "show", name, "--json", folder=odd).stdout) for name in names]
    states = [msgspec.to_builtins(state_of_take(read_take(odd / name))) for name in names]
    assert [one["state"] for one in states] == ["damaged", "damaged", "sound", "damaged", "sound"]
    of_fits = json.loads(hangtime_here("compare", *sorted(NOT_HOLDING), "--json", folder=odd).stdout)["compared"]
    assert [fit["take_states"] for fit in of_fits] == [[state] for state in states]
    for entries in (told["compare"]["compared"], told["takes list"]["takes"], told["takes verify"]["takes"], shown):
        assert [{key: entry.get(key) for key in states[0]} for entry in entries] == states


def test_takes_and_fits_side_by_side_and_exports_report_everything_that_does_not_hold(odd):
    bytes_behind = (odd / "joined.mcap").stat().st_size - (odd / "sound.mcap").stat().st_size
    for name, doubts in NOT_HOLDING.items():
        doubts = [doubt.format(behind=bytes_behind) for doubt in doubts]
        takes = hangtime_here("compare", "sound.mcap", f"{name}.mcap", folder=odd).stderr.splitlines()
        assert takes == [f"Warning: the take {name}.mcap: {doubt}." for doubt in doubts]
        fits = hangtime_here("compare", "sound", name, folder=odd).stderr.splitlines()
        assert fits[len(fits) - len(doubts) :] == [f"Warning: the take a: {doubt}." for doubt in doubts]
        assert len(fits) == len(doubts) + (name == "broken")
        exported = hangtime_here(
            "takes", "export", f"{name}.mcap", "--to", "csv", "--out", "out", "--overwrite", folder=odd
        ).stdout.rstrip("\n")
        assert exported.endswith("".join(f"; {doubt}" for doubt in doubts) or " frames")
        made = EXPORT_KINDS["csv"].make(Order(result=load_fit_result(odd / name / "fit.json")))
        assert all(doubt in next(iter(made.values())).decode() for doubt in doubts)


def test_a_refused_fit_names_the_damage_that_may_be_its_cause(tmp_path):
    """Of the five blocks of 5 s, only the first is sound, in which the hanger is seen for five frames."""
    time, garment = np.arange(150) / 30, sheet()
    whole = take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None], name="a")
    seen = whole.held_valid.copy()
    seen[5:30] = False
    raw = bytearray(write_take(tmp_path / "a.mcap", replace(whole, held_valid=seen)).read_bytes())
    for begin, end, _ in chunks_of(bytes(raw))[2:-1]:
        raw[(begin + end) // 2] ^= 255
    (tmp_path / "a.mcap").write_bytes(raw)
    names = (
        "the take a is incomplete (missing: 1.00 to 4.97 s) and has 4 damaged blocks, which may be the cause; "
        "copy the file again from where it was recorded, or record again\n"
    )
    for command in ("fit", "diagnose"):
        assert hangtime_here(command, "a.mcap", "--out", "out", folder=tmp_path).stderr.endswith(names), command
    done = hangtime_here("fit", "a.mcap", "--held-out-motion", "twist", "--out", "out", folder=tmp_path)
    assert "no take moves" in done.stderr
    assert done.stderr.endswith(names)


def test_only_a_refusal_that_lost_data_may_cause_names_them():
    hole, of_garment = with_a_hole(), with_a_hole().garment.name
    named = "; the take a is incomplete (missing: 2.03 to 3.10 s), which may be the cause; record again"
    for where, take, told in (
        (hole.take_id, hole, named), ("another take", hole, named), ("--effect", hole, ""),
        (Path("fit.json"), hole, ""), (of_garment, hole, ""), (hole.take_id, a_take(), ""),
    ):  # fmt: skip
        with pytest.raises(DriveError) as error, naming_damage([take]):
            raise DriveError("is too short", where=where, advice="record a longer take")
        assert error.value.words == "is too short; record a longer take" + told, where


@pytest.mark.parametrize("kind", [MismatchError, ImpossiblePathError])
def test_a_refusal_that_lost_frames_do_not_cause_names_none(kind):
    with pytest.raises(kind) as error, naming_damage([with_a_hole()]):
        raise kind("the held ends are 900 mm apart", where=with_a_hole().take_id, advice="check the unit")
    assert error.value.words == "the held ends are 900 mm apart; check the unit"


def test_a_damaged_take_of_a_wrong_garment_is_refused_for_its_garment_alone():
    time, garment = np.arange(150) / 30, sheet()
    whole = take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None])
    hole = replace(whole, is_complete=False, missing=((float(time[-1]), np.inf),))
    wide = [[6 * x, y] for x, y in hole.garment.outline_m]
    of_another = replace(hole, garment=msgspec.structs.replace(hole.garment, outline_m=wide))
    with pytest.raises(MismatchError, match=r"the held ends are \d+ mm apart, .* check the garment's outline") as error:
        ready([of_another], [])
    assert "may be the cause" not in str(error.value)


def test_a_take_too_short_for_intervals_names_its_missing_seconds():
    """A swing of 5 s, of which the first 0.8 s are left."""
    time = np.arange(150) / 30
    garment, kept = sheet(), slice(0, 25)
    whole = take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None])
    arrays = {name: values[kept] for name in FRAME_FIELDS if (values := getattr(whole, name)) is not None}
    left = replace(whole, **arrays, is_complete=False, missing=((float(time[24]), float(time[-1])),))
    with pytest.raises(FitError, match=r"too short: .* longer take; the take .* is incomplete \(missing: 0\.80 to "):
        calibrate([left], [], Plan().request())


def test_a_batch_names_lost_data_where_a_garment_has_too_few_motions():
    seen = Seen(
        name="a", digest="1", kind="sideways", reach=0.1, seconds=2.0, is_calibrated=True, damage="a has a hole"
    )
    for kind in ("sideways", "still"):
        assert wardrobe_of("swatch", [replace(seen, kind=kind)]).missing.endswith("; a has a hole")


def test_a_lost_take_is_said_on_stderr_where_json_is_asked_for(tmp_path):
    """By every command of takes alike."""
    (tmp_path / "a.mcap").write_bytes(b"nothing of a take")
    for words in (("list", "."), ("show", "a.mcap"), ("verify", "a.mcap"), ("recover", "a.mcap")):
        done = hangtime_here("takes", *words, "--json", folder=tmp_path)
        assert done.returncode == 2
        assert json.loads(done.stdout)["error"] in done.stderr, words

"""`hangtime takes` and `hangtime import` as a user meets them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.archive import read_take, write_take
from formats.descriptions import load_garment
from formats.rig import Calibration
from formats.summary import describe, summarise
from tests.fit.here import hangtime_here
from tests.formats.damage import chunks_of, without_end
from tests.formats.test_archive import RIG, a_take
from tests.shared_data import SHARED_DATA

SWUNG = SHARED_DATA / "swung-cloth"


def hangtime(*words):
    return hangtime_here(*words, folder=".")


def swung_cloth(path, frames=40):
    """A small file in the layout of the real recordings; row 0 is the free bottom edge."""
    x, y = np.meshgrid(np.linspace(0, 0.3, 8), np.linspace(0, 0.3, 8))
    rest = np.stack([x.ravel(), y.ravel()], 1)
    points = np.stack([rest[:, 0], 0 * rest[:, 0], rest[:, 1] - 0.05], 1)[None].repeat(frames, 0)
    np.savez(
        path, t=np.arange(frames) * 0.11 - 0.34, points=points, valid=np.ones((frames, 64), bool),
        hanger_corners=points[:, [56, 63]], hanger_corners_seen=points[:, [56, 63]], rest=rest,
    )  # fmt: skip


def test_show_says_what_a_take_holds(tmp_path):
    done = hangtime("takes", "show", write_take(tmp_path / "a.mcap", a_take()))
    assert done.returncode == 0
    assert "4.967 s, 150 frames, 30 a second" in done.stdout
    assert "marker lost in 1 frame\n" in done.stdout


def test_json_of_a_take_is_valid_where_an_axis_was_never_measured(tmp_path):
    """`hangtime calibrate` writes inf there; JSON has no such number, so it is null. The text is as it was."""
    known = Calibration(depth_offset_px=(3.0, 0.0), depth_offset_sd_px=(0.1, np.inf))
    take = replace(a_take(), rig=msgspec.structs.replace(RIG, calibration=known))
    path = write_take(tmp_path / "a.mcap", take)
    done = hangtime("takes", "show", path, "--json")
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout, parse_constant=pytest.fail)
    assert shown["calibration"]["depth_offset_sd_px"] == [0.1, None]
    assert shown["frames"] == 150
    assert "along the one axis that was measured" in hangtime("takes", "show", path).stdout


def test_verify_says_sound_incomplete_damaged_and_lost(tmp_path):
    """The end is cut off; one bit of the third block is turned; nothing is a take."""
    whole = write_take(tmp_path / "a.mcap", a_take())
    raw = bytearray(whole.read_bytes())
    assert hangtime("takes", "verify", whole).returncode == 0
    (tmp_path / "b.mcap").write_bytes(without_end(raw))
    third = [begin for begin, _, content in chunks_of(bytes(raw)) if content.get("first") == 62]
    raw[third[0] + 200] ^= 1
    (tmp_path / "c.mcap").write_bytes(raw)
    (tmp_path / "d.mcap").write_bytes(b"no take")
    done = hangtime("takes", "verify", *sorted(tmp_path.glob("*.mcap")))
    assert done.returncode == 2
    lines = done.stdout.splitlines()
    assert [line.split()[:2] for line in lines] == [
        [word, f"{tmp_path / name}.mcap:"]
        for word, name in (("sound", "a"), ("incomplete", "b"), ("damaged", "c"), ("lost", "d"))
    ]
    assert lines[1].endswith(
        "150 frames in 5 blocks; missing: from 4.97 s on; `hangtime takes recover` makes a sound file"
    )
    assert lines[2].endswith(
        "119 frames in 4 blocks, 1 damaged; missing: 2.03 to 3.10 s (31 frames); "
        "`hangtime takes recover` makes a sound file"
    )


def test_a_swatch_has_as_many_markers_as_the_command_is_reported(tmp_path):
    """5 along each side of 0.4 m are 100 mm apart."""
    done = hangtime("swatch", tmp_path / "s.toml", "--mass", 0.05, "--side", 0.4, "--markers", 5)
    assert done.stdout == f"{tmp_path / 's.toml'}: 25 markers, 100.0 mm apart\n"
    points = load_garment(tmp_path / "s.toml").points
    assert len(points) == 25
    assert points[1].at_m[0] - points[0].at_m[0] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--side", 50), "a side of 50 m and a mass of 0.05 kg; were centimetres or inches meant? Give metres"),
        (("--side", 500), "a side of 500 m and a mass of 0.05 kg; were millimetres meant? Give metres"),
        (("--side", 0.0005), "a side of 0.0005 m and a mass of 0.05 kg; was 0.5 meant? Give metres and kilograms"),
        (("--side", 0.005), "a side of 0.005 m and a mass of 0.05 kg; was 0.5 meant? Give metres and kilograms"),
        (("--side", 1e-9), "a side of 1e-09 m and a mass of 0.05 kg; give metres and kilograms"),
        (("--markers", 100_000), "100000 markers along each side are more than the 2000 that a take holds; give 44"),
        (("--mass", 210), "(got 210); were grams meant, mass_kg = 0.21?"),
    ],
)
def test_a_swatch_in_other_units_is_refused_at_once_with_the_unit_that_was_meant(tmp_path, words, sentence):
    done = hangtime("swatch", tmp_path / "s.toml", "--mass", 0.05, *words)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert not (tmp_path / "s.toml").exists()


@pytest.mark.parametrize("words", [("takes", "show", "gone.mcap"), ("import", "gone.npz", "--out", "takes")])
def test_a_missing_file_gives_one_sentence_and_exit_code_2(tmp_path, words):
    done = hangtime_here(*words, folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("hangtime: gone.")
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("words", [("import", b"r\xff.npz"), ("swatch", b"sw\xff.toml", "--mass", "0.05")])
def test_a_name_that_is_not_utf_8_is_refused_and_nothing_is_written(tmp_path, words):
    swung_cloth(tmp_path / "r.npz")
    (tmp_path / "r.npz").rename(tmp_path / os.fsdecode(b"r\xff.npz"))
    before = os.listdir(tmp_path)
    done = hangtime_here(*map(os.fsdecode, words), folder=tmp_path)
    assert done.returncode == 2
    assert "has a name that is not UTF-8" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert os.listdir(tmp_path) == before


@pytest.mark.slow
def test_a_take_can_be_renamed_to_any_bytes(tmp_path):
    path = write_take(tmp_path / "a.mcap", a_take()).rename(tmp_path / os.fsdecode(b"a\xff.mcap"))
    done = subprocess.run(
        [sys.executable, "-m", "formats.command", "takes", "verify", path], capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"/a\xff.mcap: 150 frames" in done.stdout


def test_import_makes_takes_that_hang(tmp_path):
    """The held corners are the top left and right; gravity is -z; the grid keeps its position on the cloth."""
    swung_cloth(tmp_path / "r.npz")
    assert hangtime("import", tmp_path / "r.npz", "--out", tmp_path / "takes").returncode == 0
    take = read_take(tmp_path / "takes" / "r.mcap")
    assert take.time[0] == 0.0
    assert take.garment.points[0].at_m == pytest.approx((-0.15, -0.3))
    assert take.held[0] == pytest.approx(np.array([[0.0, 0.0, 0.25], [0.3, 0.0, 0.25]]))
    assert take.rig.gravity == (0.0, 0.0, -1.0)


def test_import_replaces_nothing_unless_asked_to(tmp_path):
    swung_cloth(tmp_path / "r.npz")
    swung_cloth(tmp_path / "s.npz")
    out = tmp_path / "takes"
    assert hangtime("import", tmp_path / "r.npz", "--out", out).returncode == 0
    raw = (out / "r.mcap").read_bytes()
    again = hangtime("import", tmp_path / "r.npz", "--out", out)
    assert again.returncode == 2
    assert "r.mcap: is already there" in again.stderr
    assert (out / "r.mcap").read_bytes() == raw
    (out / "garment.toml").write_text("# mine\n" + (out / "garment.toml").read_text())
    assert hangtime("import", tmp_path / "s.npz", "--out", out).returncode == 0
    assert (out / "garment.toml").read_text().startswith("# mine"), "it says the same and stays"
    (out / "garment.toml").write_text("mine")
    other = hangtime("import", tmp_path / "r.npz", "--out", out, "--overwrite")
    assert other.returncode == 0, other.stderr
    assert (out / "garment.toml").read_text().startswith("format")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("import", "r.npz", "./r.npz"), "r.npz: was given twice; give it once"),
        (("import", "r.npz", "--out", "r.npz"), "r.npz: cannot be made"),
        (("swatch", "gone/s.toml", "--mass", 0.1), "gone/s.toml: cannot be written"),
        (("swatch", "r.npz", "--mass", 0.1), "r.npz: is already there"),
    ],
)
def test_a_result_that_cannot_be_written_gives_one_sentence_and_exit_code_2(tmp_path, monkeypatch, words, sentence):
    swung_cloth(tmp_path / "r.npz")
    monkeypatch.chdir(tmp_path)
    done = hangtime(*words)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["r.npz"]


def test_a_take_of_one_frame_and_one_whose_points_were_never_seen_are_shown():
    take = a_take(frames=1)
    assert "length    0 s, 1 frame\n" in describe(summarise(take))
    summary = summarise(take)
    summary["points"] = [summary["points"][0] | {"sd_mm": None, "seen_percent": 0.0}] * 13
    assert "points    13, seen 0 %, never seen" in describe(summary)


def test_import_of_something_else_is_refused(tmp_path):
    np.savez(tmp_path / "x.npz", t=np.arange(3))
    done = hangtime("import", tmp_path / "x.npz", "--out", tmp_path / "takes")
    assert done.returncode == 2
    assert "has no array 'points'" in done.stderr


@pytest.mark.shared_data
@pytest.mark.skipif(not SWUNG.is_dir(), reason=f"no real recordings at {SWUNG}")
def test_real_recordings_can_be_imported(tmp_path):
    files = sorted(SWUNG.glob("*.npz"))
    assert hangtime("import", *files, "--out", tmp_path).returncode == 0
    takes = [read_take(p) for p in sorted(tmp_path.glob("*.mcap"))]
    assert len(takes) == len(files) == 16
    assert all(t.points_valid.mean() > 0.9 for t in takes)


def test_sums_are_rounded_alike_on_one_processor_and_on_all():
    """numpy's BLAS splits a long product over threads, and 200 000 numbers round differently in two halves."""
    program = (
        "import os, sys\n"
        "os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(sys.argv[1])])\n"
        "import formats.command\n"
        "import numpy as np\n"
        "row = np.random.default_rng(0).normal(size=200_000)\n"
        "print(float(row @ row).hex())\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    said = [
        subprocess.run(
            [sys.executable, "-c", program, count], capture_output=True, text=True, check=True, env=environment
        ).stdout
        for count in ("1", "64")
    ]
    assert said[0] == said[1] != ""


def test_list_names_every_take_and_what_is_left_of_it(tmp_path):
    raw = write_take(tmp_path / "a.mcap", a_take()).read_bytes()
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper/b.mcap.partial").write_bytes(without_end(raw))
    (tmp_path / "c.mcap").write_bytes(b"no take")
    done = hangtime("takes", "list", tmp_path)
    assert done.returncode == 2
    assert [line.split()[:2] for line in done.stdout.splitlines()] == [
        ["sound", "a.mcap:"], ["lost", f"{tmp_path}/c.mcap:"], ["incomplete", "deeper/b.mcap.partial:"]
    ]  # fmt: skip
    assert "5.0 s, " in done.stdout


def test_show_draws_the_swing_in_letters_and_as_a_picture(tmp_path):
    """Braille letters of two colours of dots: the held edge swings by 100 mm either way, the lowest point by 200."""
    from PIL import Image

    path = write_take(tmp_path / "a.mcap", a_take())
    done = hangtime("takes", "show", path, "--png", tmp_path / "a.png")
    assert done.returncode == 0, done.stderr
    drawn = [line for line in done.stdout.splitlines() if any("\u2801" <= letter <= "\u28ff" for letter in line)]
    assert len(drawn) == 8
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (960, 540)
        assert len(picture.getcolors(maxcolors=1 << 20)) > 5
    assert done.stdout.endswith(f"Picture: {tmp_path}/a.png\n")
    assert hangtime("takes", "show", path, "--png", tmp_path / "a.png").returncode == 2


def test_nothing_from_a_file_reaches_the_terminal_as_an_escape_sequence(tmp_path):
    """A title that turns the terminal red, in names, notes and the file's own name; the turned direction of writing."""
    evil = "\x1b]0;owned\x07\x9b31m\u202e"
    take = a_take()
    garment = msgspec.structs.replace(take.garment, name=evil)
    take = replace(take, take_id=evil, created=evil, source=evil, notes={evil: evil}, garment=garment,
                   rig=msgspec.structs.replace(take.rig, name=evil))  # fmt: skip
    path = write_take(tmp_path / f"a{evil[1:]}.mcap", take)
    (tmp_path / "bad\x1b[31m.mcap").write_bytes(b"no take")
    for words in (("show", path), ("verify", path, tmp_path / "bad\x1b[31m.mcap"), ("list", tmp_path)):
        told = hangtime("takes", *words, "--json").stdout
        assert not set(told) & set("\x1b\x07\x9b\u202e")
        assert any(text in told for text in (r"\u001b]0;owned\u0007\u009b31m\u202e", r"\u001b[31m"))
        done = hangtime("takes", *words)
        for letter in "\x1b\x07\x9b\u202e":
            assert letter not in done.stdout + done.stderr
        assert "\\x1b" in done.stdout
    made = hangtime("swatch", tmp_path / f"a{evil[1:]}\x1b[2J.toml", "--mass", "0.05")
    assert made.returncode == 0
    assert not set(made.stdout + made.stderr) & set("\x1b\x07\x9b\u202e")
    assert "\\x1b[2J.toml" in made.stdout + made.stderr


def test_a_name_that_is_no_utf8_is_shown_byte_for_byte_and_its_json_is_utf8(tmp_path):
    path = write_take(tmp_path / "a.mcap", a_take()).rename(tmp_path / "a\udcff.mcap")
    command = [sys.executable, "-m", "formats.command", "takes", "verify", path]
    assert b"a\xff.mcap" in subprocess.run(command, capture_output=True, check=True).stdout
    told = json.loads(subprocess.run([*command, "--json"], capture_output=True, check=True).stdout.decode())
    assert any(str(path) in entry.values() for entries in told.values() for entry in entries)


def test_a_sign_that_the_terminals_encoding_lacks_is_shown_by_its_code(tmp_path):
    take = replace(a_take(), garment=msgspec.structs.replace(a_take().garment, name="10\u00b2"))
    path = write_take(tmp_path / "b.mcap", take)
    command = [sys.executable, "-m", "formats.command", "takes", "show", path]
    done = subprocess.run(command, capture_output=True, env={**os.environ, "PYTHONIOENCODING": "ascii"}, check=False)
    assert done.returncode == 0, done.stderr
    assert rb"10\xb2" in done.stdout


def test_as_a_module_the_command_has_its_own_name():
    """A shell completes `hangtime`, and none completes `python -m hangtime`."""
    words = [sys.executable, "-m", "hangtime"]
    shown = subprocess.run([*words, "--show-completion", "bash"], capture_output=True, text=True, check=True).stdout
    assert shown.splitlines()[-1].endswith(" hangtime")


@pytest.mark.slow
def test_as_a_module_the_command_shows_its_own_name():
    words = [sys.executable, "-m", "hangtime", "takes", "--help"]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert told.startswith("Usage: hangtime takes ")


@pytest.mark.parametrize(
    ("shell", "code", "said"),
    [
        ("/bin/zsh", 0, "#compdef"),
        ("/bin/sh", 2, "hangtime: bash, zsh, fish and PowerShell complete commands, and this is sh; run the command"),
    ],
)
def test_a_plain_sh_shows_the_completion_of_its_users_shell_or_says_which_shells_complete(shell, code, said):
    """Its process is a plain `sh`, as a script's is; $SHELL is the shell that somebody types in."""
    words = f"{sys.executable} -m formats.command --show-completion; exit $?"
    done = subprocess.run(["sh", "-c", words], env={**os.environ, "SHELL": shell}, capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    assert (done.stdout if code == 0 else done.stderr).startswith(said)


def test_blocks_of_another_take_in_a_file_are_named_as_such_and_not_as_damaged(tmp_path):
    first, second = (write_take(tmp_path / f"{name}.mcap", replace(a_take(), take_id=name)) for name in ("a", "b"))
    joined = tmp_path / "joined.mcap"
    joined.write_bytes(first.read_bytes() + second.read_bytes())
    done = hangtime("takes", "verify", joined)
    assert done.returncode == 2
    assert "; 5 blocks of another take in this file; " in done.stdout
    assert " blocks," not in done.stdout
    recovered = hangtime("takes", "recover", joined)
    assert recovered.stdout.splitlines()[1].endswith("150 frames of another take in this file, b, nothing is missing")


def test_a_take_is_never_replaced_by_what_is_made_of_it(tmp_path):
    path = write_take(tmp_path / "a.mcap", a_take())
    whole = path.read_bytes()
    (tmp_path / "link.png").symlink_to(path)
    for words in (
        ("show", path, "--png", path), ("show", path, "--png", tmp_path / "link.png"),
        ("export", path, "--to", "parquet", "--out", path),
    ):  # fmt: skip
        done = hangtime("takes", *words, "--overwrite")
        assert done.returncode == 2
        assert "would replace the take that is read; give another name" in done.stderr
        assert path.read_bytes() == whole

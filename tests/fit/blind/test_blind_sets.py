"""Sets of blind cases from generation to report: resumable, sealed, scored on hand-made answers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from fit import runtime
from fit.blind import making
from fit.blind.cases import CREATED, FILES
from fit.blind.judging import judge
from fit.blind.making import LABELS, changed_files, make_set, open_labels, read_manifest
from fit.blind.running import run_set
from fit.blind.scoring import hash_answers, summarise
from fit.errors import FitError
from formats.archive import read_take
from formats.results import load_diagnosis, save_diagnosis
from tests.fit.blind.blind_answers import COARSE, NUMBERS, PLANTED, answer_rightly, diagnosis
from tests.fit.here import hangtime_here


def test_a_set_is_public_files_hashes_and_a_seal(a_set):
    manifest = read_manifest(a_set)
    assert manifest.complete
    assert len(manifest.cases) == 5
    assert len(manifest.files) == 5 * len(FILES)
    assert changed_files(a_set, manifest) == []
    public = (a_set / "manifest.json").read_text() + " ".join(str(p) for p in a_set.rglob("*"))
    for word in ("hem", "time_offset", "null", "single", "seed", "0.1,"):
        assert word not in public
    labels = open_labels(a_set)
    assert sorted(t.kind for t in labels.truths) == ["null", "pair", "single", "single", "unknown"]
    assert sorted(t.id for t in labels.truths) == list(manifest.cases)


def test_the_takes_say_nothing_of_the_label(a_set):
    for truth in open_labels(a_set).truths:
        for path in (a_set / "cases" / truth.id).iterdir():
            take = read_take(path)
            assert (take.source, take.notes, take.created) == ("", {}, CREATED)
            assert take.take_id == f"{truth.id}-{path.stem}"
            assert take.garment.mass_kg == pytest.approx(truth.look.mass)
            assert (take.garment.name, take.rig.name) == ("swatch", "rig")


def test_making_again_makes_only_what_is_missing_or_changed(a_set, tmp_path, monkeypatch):
    import shutil

    folder = tmp_path / "set"
    shutil.copytree(a_set, folder)
    manifest = read_manifest(folder)
    shutil.rmtree(folder / "cases" / manifest.cases[0])
    (folder / "cases" / manifest.cases[1] / FILES[0]).write_bytes(b"changed")
    made = []
    inner = making.write_case
    monkeypatch.setattr(making, "write_case", lambda path, *a, **k: made.append(path.name) or inner(path, *a, **k))
    counts = []
    again = make_set(folder, NUMBERS, PLANTED, 5, side=COARSE, progress=lambda *n: counts.append(n))
    assert sorted(made) == sorted(manifest.cases[:2])
    assert counts == [(3, 5), (4, 5), (5, 5)]
    assert again == manifest  # the same seed makes the same bytes


def test_an_interrupted_set_goes_on(tmp_path, monkeypatch):
    inner, made, few = making.write_case, [], {"single": 2, "null": 1, "pair": 0, "unknown": 0}

    def interrupted(path, *a, **k):
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(path)
        return inner(path, *a, **k)

    monkeypatch.setattr(making, "write_case", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make_set(tmp_path, few, PLANTED, 5, side=COARSE)
    assert not read_manifest(tmp_path).complete
    with pytest.raises(FitError, match="not complete"):
        run_set(tmp_path, tmp_path / "answers")
    sealed = (tmp_path / LABELS).read_bytes()
    monkeypatch.setattr(making, "write_case", inner)
    assert make_set(tmp_path, few, PLANTED, 5, side=COARSE).complete
    assert (tmp_path / LABELS).read_bytes() == sealed


def test_another_set_in_the_same_folder_is_refused(a_set):
    with pytest.raises(FitError, match="holds another set"):
        make_set(a_set, NUMBERS, PLANTED, 6, side=COARSE)
    with pytest.raises(FitError, match="no case to make"):
        make_set(a_set, dict.fromkeys(NUMBERS, 0), PLANTED, 5)


@pytest.mark.slow  # each of them imports Taichi anew; above, the same seed makes the same bytes
def test_two_processes_make_the_same_set(a_set, tmp_path):
    made = make_set(tmp_path, NUMBERS, PLANTED, 5, workers=2, side=COARSE)
    assert made.files == read_manifest(a_set).files


def test_changed_labels_are_noticed(a_set, tmp_path):
    import shutil

    folder = tmp_path / "set"
    shutil.copytree(a_set, folder)
    raw = bytearray((folder / LABELS).read_bytes())
    raw[50] ^= 1
    (folder / LABELS).write_bytes(bytes(raw))
    with pytest.raises(FitError, match="not those of the manifest"):
        open_labels(folder)


# A stand-in for `hangtime diagnose`: notes its words, refuses an option that it does not know and fits that another
# version kept, fails for one case, writes what the test put beside it.
STAND_IN = """
import pathlib, sys
words = sys.argv[1:]
out = pathlib.Path(words[words.index("--out") + 1])
case = pathlib.Path(words[0]).parent.name
here = pathlib.Path(__file__).parent
with (here / "calls.txt").open("a") as file:
    file.write(" ".join(words) + "\\n")
if "--nonsense" in words:
    print("Usage: hangtime diagnose\\n\\nError: No such option: --nonsense", file=sys.stderr)
    sys.exit(2)
if (out / "diagnosis.partial").exists():
    print("hangtime: the kept fits are of another version", file=sys.stderr)
    sys.exit(2)
if case == (here / "fails.txt").read_text():
    print("hangtime: the cloth flew apart", file=sys.stderr)
    sys.exit(2)
(out / "diagnosis.json").write_bytes((here / "answer.json").read_bytes())
sys.exit(4 if "inconclusive" in (here / "answer.json").read_text() else 0)
"""


def test_running_skips_what_is_done_and_records_failures(a_set, tmp_path):
    program, answers = tmp_path / "diagnose.py", tmp_path / "answers"
    program.write_text(STAND_IN)
    cases = read_manifest(a_set).cases
    (tmp_path / "fails.txt").write_text(cases[2])
    save_diagnosis(tmp_path / "answer.json", diagnosis("none"))
    command = [sys.executable, str(program)]
    assert run_set(a_set, answers, command=command, options=["--seed", "4"]) == 1
    calls = (tmp_path / "calls.txt").read_text().splitlines()
    assert len(calls) == 5
    words = calls[0].split()
    assert [w.rsplit("/", 1)[-1] for w in words[:3]] == list(FILES[:3])
    assert words.count("--held-out") == 2
    assert words[-2:] == ["--seed", "4"]
    assert "the cloth flew apart" in (answers / cases[2] / "failure.txt").read_text()
    assert load_diagnosis(answers / cases[0] / "diagnosis.json").verdict == "none"
    assert run_set(a_set, answers, command=command) == 1
    assert len((tmp_path / "calls.txt").read_text().splitlines()) == 5
    (tmp_path / "fails.txt").write_text("nobody")
    assert run_set(a_set, answers, command=command, again=True) == 0
    hash_answers(a_set, answers)


def test_a_diagnosis_that_cannot_decide_is_an_answer_for_all_its_exit_code(a_set, tmp_path):
    program, answers = tmp_path / "diagnose.py", tmp_path / "answers"
    program.write_text(STAND_IN)
    (tmp_path / "fails.txt").write_text("nobody")
    save_diagnosis(tmp_path / "answer.json", diagnosis("inconclusive"))
    assert run_set(a_set, answers, command=[sys.executable, str(program)]) == 0
    assert load_diagnosis(answers / read_manifest(a_set).cases[0] / "diagnosis.json").verdict == "inconclusive"


@pytest.mark.parametrize("takes", [1, 2])
def test_so_many_takes_alone_are_the_first_ones_and_none_is_held_out(a_set, tmp_path, takes):
    program = tmp_path / "diagnose.py"
    program.write_text(STAND_IN)
    (tmp_path / "fails.txt").write_text("nobody")
    save_diagnosis(tmp_path / "answer.json", diagnosis("none"))
    assert run_set(a_set, tmp_path / "answers", command=[sys.executable, str(program)], takes=takes) == 0
    for line in (tmp_path / "calls.txt").read_text().splitlines():
        words = line.split()
        assert [w.rsplit("/", 1)[-1] for w in words[: words.index("--out")]] == list(FILES[:takes])
        assert "--held-out" not in words


# Holds a folder of answers as a run does, says so, and stays.
HOLDER = """
import pathlib, sys, time
from fit.folders import alone, make_folder
with alone(make_folder(pathlib.Path(sys.argv[1]))):
    print("held", flush=True)
    time.sleep(60)
"""


def test_two_runs_do_not_write_the_same_answers_and_a_killed_one_blocks_no_other(a_set, tmp_path):
    program, answers = tmp_path / "diagnose.py", tmp_path / "answers"
    program.write_text(STAND_IN)
    (tmp_path / "fails.txt").write_text("nobody")
    save_diagnosis(tmp_path / "answer.json", diagnosis("none"))
    words = [sys.executable, "-c", HOLDER, str(answers)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(FitError, match="another command writes here"):
            run_set(a_set, answers, command=[sys.executable, str(program)])
        assert not (tmp_path / "calls.txt").exists()
        other.kill()
    assert run_set(a_set, answers, command=[sys.executable, str(program)]) == 0


# Waits until a second one has begun, or for the end of its patience.
MEETING = """
import os, pathlib, sys, time
here = pathlib.Path(__file__).parent
(here / f"begun-{os.getpid()}").touch()
end = time.monotonic() + 600
while len(list(here.glob("begun-*"))) < 2 and time.monotonic() < end:
    time.sleep(0.02)
(here / "threads.txt").write_text(os.environ["HANGTIME_THREADS"])
sys.exit(2 if len(list(here.glob("begun-*"))) > 1 else 0)
"""


def test_diagnoses_run_side_by_side_and_share_the_processors(a_set, tmp_path):
    program = tmp_path / "diagnose.py"
    program.write_text(MEETING)
    counts = []
    failed = run_set(
        a_set, tmp_path / "answers", command=[sys.executable, str(program)], workers=2,
        progress=lambda *numbers: counts.append(numbers),
    )  # fmt: skip
    assert failed == 5  # each met another one
    assert counts == [(n, 5, n) for n in range(6)]
    assert int((tmp_path / "threads.txt").read_text()) == max(1, runtime.available_threads() // 2)


SLEEPING = """
import pathlib, signal, sys, time
def end(*_):
    (pathlib.Path(__file__).parent / "interrupted").touch()
    sys.exit(130)
signal.signal(signal.SIGINT, end)
(pathlib.Path(__file__).parent / "begun").touch()
time.sleep(60)
"""


def test_an_interrupted_run_interrupts_its_diagnoses(a_set, tmp_path, monkeypatch):
    """Ctrl-C in a terminal reaches them by itself; a signal to this process alone does not."""
    program = tmp_path / "diagnose.py"
    program.write_text(SLEEPING)
    monkeypatch.setattr("fit.blind.running.INTERRUPT_PATIENCE", 0.2)
    # What a shell starts in the background ignores Ctrl-C; a terminal's programs do not.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def interrupt():
        while not (tmp_path / "begun").exists():
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            run_set(a_set, tmp_path / "answers", command=[sys.executable, str(program)], workers=2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (tmp_path / "interrupted").exists()
    assert not list((tmp_path / "answers").glob("[!.]*"))


def test_a_program_that_does_not_exist_is_a_failure_not_an_end(a_set, tmp_path):
    assert run_set(a_set, tmp_path / "answers", command=["/nowhere/at/all"]) == 5
    score = summarise(tuple(judge(t, tmp_path / "answers") for t in open_labels(a_set).truths))
    assert {v for row in score.verdicts.values() for v in row} == {"inconclusive"}
    told = next((tmp_path / "answers").glob("*/failure.txt")).read_text()
    assert told.startswith("exit code 127\n")
    assert "/nowhere/at/all" in told


def test_a_case_that_takes_too_long_is_a_failure(a_set, tmp_path):
    program = tmp_path / "diagnose.py"
    program.write_text("import time; time.sleep(60)")
    assert run_set(a_set, tmp_path / "answers", command=[sys.executable, str(program)], limit=0.2) == 5
    case = read_manifest(a_set).cases[0]
    assert (tmp_path / "answers" / case / "failure.txt").read_text() == "exit code 124\ntook longer than 0.2 s"


def test_the_command_line_makes_scores_and_reports(tmp_path):
    def hangtime(*words):
        return hangtime_here("blind", *words, folder=tmp_path)

    made = hangtime("make", "set", "--cases", 1, "--nulls", 1, "--effect", "hem", "--seed", 3, "--side", COARSE,
                    "--noise", 0.006, "--rate", 60)  # fmt: skip
    assert made.returncode == 0, made.stderr
    take = read_take(next((tmp_path / "set/cases").glob("*/take-1.mcap")))
    assert np.diff(take.time) == pytest.approx(1 / 60, abs=1e-5)
    assert np.nanmedian(take.points_sd) > 0.006
    assert "2 cases" in made.stdout
    early = hangtime("score", "set", "answers")
    assert early.returncode == 2
    assert "no answer" in early.stderr
    answer_rightly(tmp_path / "set", tmp_path / "answers")
    scored = hangtime("score", "set", "answers")
    assert scored.returncode == 0, scored.stderr
    assert "false alarms on nulls" in scored.stdout
    assert hangtime("run", "set", "--out", "answers").returncode == 0  # everything is answered: nothing to run
    struck = hangtime("strike", "set", "answers", "--out", "struck", "--least", 99)
    assert struck.returncode == 2
    assert "no case has one effect of 99 times the smallest detectable amplitude" in struck.stderr
    real = hangtime("make", "other", "--real", ".", "--cases", 1, "--noise", 0.001)
    assert real.returncode == 2
    assert "real takes are not simulated; leave out" in real.stderr
    ended = hangtime("report", "set", "answers", "--out", "blind.pdf")
    assert (ended.returncode, (tmp_path / "blind.pdf").exists()) == (2, False)
    assert "blind.pdf: pages are written as HTML; give a name that ends in .html" in ended.stderr
    reported = hangtime("report", "set", "answers", "--out", "blind.html")
    assert reported.returncode == 0, reported.stderr
    assert (tmp_path / "blind.html").exists()
    again = hangtime("report", "set", "answers", "--out", "blind.html")
    assert again.returncode == 2
    assert "blind.html: is already there; give another name, or --overwrite to replace it" in again.stderr
    assert hangtime("report", "set", "answers", "--out", "blind.html", "--overwrite").returncode == 0
    refused = hangtime("make", "set", "--cases", 1, "--effect", "self_contact")
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1


@pytest.mark.parametrize("side", [float("nan"), float("inf"), 0.0, -0.02, 10.0])
def test_a_side_of_no_mesh_is_refused_and_seals_nothing(tmp_path, side):
    """Sheets are 0.30 to 0.45 m wide and high: two sides fit up to about 0.15 m."""
    with pytest.raises(FitError, match=r"--side: a mesh of side .* m does not fit these cases; .* up to 0\.(1|2)"):
        make_set(tmp_path, NUMBERS, PLANTED, 5, side=side)
    assert list(tmp_path.iterdir()) == []


def test_another_side_is_another_set(a_set):
    with pytest.raises(FitError, match="the same numbers, effects, --side, --seed and sensor as before"):
        make_set(a_set, NUMBERS, PLANTED, 5, side=COARSE / 2)


def test_fits_that_another_version_kept_are_no_failure_of_the_diagnosis(a_set, tmp_path):
    program, answers = tmp_path / "diagnose.py", tmp_path / "answers"
    program.write_text(STAND_IN)
    (tmp_path / "fails.txt").write_text("nobody")
    save_diagnosis(tmp_path / "answer.json", diagnosis("none"))
    first = read_manifest(a_set).cases[0]
    (answers / f".{first}.partial" / "diagnosis.partial").mkdir(parents=True)
    assert run_set(a_set, answers, command=[sys.executable, str(program)]) == 0


def test_a_mistyped_option_ends_the_run_and_is_no_answer(a_set, tmp_path):
    program, answers = tmp_path / "diagnose.py", tmp_path / "answers"
    program.write_text(STAND_IN)
    with pytest.raises(FitError, match="--option: No such option: --nonsense"):
        run_set(a_set, answers, command=[sys.executable, str(program)], options=["--nonsense"])
    assert not list(answers.glob("*/failure.txt"))

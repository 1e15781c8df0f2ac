"""Sets of cases from making to the report: resumable, sealed, scored by hand-made answers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time

import msgspec
import pytest

from fit import runtime
from fit.blind import making
from fit.blind.cases import CREATED, FILES, Look
from fit.blind.foreign.engines import OWN
from fit.blind.judging import bin_of, conditions_of, judge
from fit.blind.making import LABELS, changed_files, make_set, open_labels, read_manifest
from fit.blind.page import write_page
from fit.blind.rates import brier, rate_of, wilson
from fit.blind.running import run_set
from fit.blind.scoring import ANSWERS_HASHES, LOOKS, SCORE, hash_answers, score_set, summarise
from fit.errors import FitError
from formats.archive import read_take
from formats.results import (
    Cost,
    Diagnosis,
    EffectFinding,
    Figure,
    Gap,
    Where,
    WhereBin,
    load_diagnosis,
    save_diagnosis,
)

COARSE = 0.1  # m of a triangle: a case in half a second
NUMBERS = {"single": 2, "null": 1, "pair": 1, "unknown": 1}
PLANTED = OWN.plants(["hem", "time_offset"])


def finding(name, amplitude=1.0, least=1.0, closure=0.5, **changes):
    return EffectFinding(**{
        "id": name, "group": name, "tested": True, "amplitude": amplitude, "unit": "1", "minimum_detectable": least,
        "closure": Figure(value=closure), "amplitude_interval": (0.9 * amplitude, 1.1 * amplitude), **changes,
    })  # fmt: skip


def diagnosis(verdict, named=(), effects=(), region="bottom left"):
    return Diagnosis(
        format="hangtime-diagnosis/1", created="2000-01-01T00:00:00Z", take_ids=["a"], held_out_ids=[], verdict=verdict,
        sentence="", named=list(named), gap=Gap(base_mm=Figure(value=5.0), floor_mm=Figure(value=1.0)),
        effects=list(effects), where=Where(
            space=[WhereBin(name=region, value_mm=1.0, share=1.0)], vertices=[], time=[], frequency=[], term=[]
        ), missing_force=None, next_experiment=None, gates=[], cost=Cost(simulations=1, seconds=1.0),
        base_parameters=[], notes=[],
    )  # fmt: skip


@pytest.fixture(scope="module")
def a_set(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blind") / "set"
    make_set(folder, NUMBERS, PLANTED, 5, side=COARSE)
    return folder


def answer_rightly(folder, answers):
    """Answers that know the truth, with amplitudes 20 % too large."""
    for truth in open_labels(folder).truths:
        known = [p for p in truth.planted if p.in_library]
        findings = [finding(p.id, 1.2 * p.amplitude, p.amplitude / 3) for p in known]
        verdict = {"null": "none", "single": "effect", "pair": "several", "unknown": "unknown"}[truth.kind]
        region = known[0].place[0] if known and known[0].place else "top left"
        save_diagnosis(answers / truth.id / "diagnosis.json",
                       diagnosis(verdict, [p.id for p in known], findings, region))  # fmt: skip


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
    inner, made = making.write_case, []

    def interrupted(path, *a, **k):
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(path)
        return inner(path, *a, **k)

    monkeypatch.setattr(making, "write_case", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make_set(tmp_path, NUMBERS, PLANTED, 5, side=COARSE)
    assert not read_manifest(tmp_path).complete
    with pytest.raises(FitError, match="not complete"):
        run_set(tmp_path, tmp_path / "answers")
    sealed = (tmp_path / LABELS).read_bytes()
    monkeypatch.setattr(making, "write_case", inner)
    assert make_set(tmp_path, NUMBERS, PLANTED, 5, side=COARSE).complete
    assert (tmp_path / LABELS).read_bytes() == sealed


def test_another_set_in_the_same_folder_is_refused(a_set):
    with pytest.raises(FitError, match="holds another set"):
        make_set(a_set, NUMBERS, PLANTED, 6, side=COARSE)
    with pytest.raises(FitError, match="no case to make"):
        make_set(a_set, dict.fromkeys(NUMBERS, 0), PLANTED, 5)


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


# A stand-in for `hangtime diagnose`: notes its words, fails for one case, writes what the test put beside it.
STAND_IN = """
import pathlib, sys
words = sys.argv[1:]
out = pathlib.Path(words[words.index("--out") + 1])
case = pathlib.Path(words[0]).parent.name
here = pathlib.Path(__file__).parent
with (here / "calls.txt").open("a") as file:
    file.write(" ".join(words) + "\\n")
if case == (here / "fails.txt").read_text():
    print("hangtime: the cloth flew apart", file=sys.stderr)
    sys.exit(2)
(out / "diagnosis.json").write_bytes((here / "answer.json").read_bytes())
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


# Waits until a second one has begun, or for the end of its patience.
MEETING = """
import os, pathlib, sys, time
here = pathlib.Path(__file__).parent
(here / f"begun-{os.getpid()}").touch()
end = time.monotonic() + 30
while len(list(here.glob("begun-*"))) < 2 and time.monotonic() < end:
    time.sleep(0.02)
(here / "threads.txt").write_text(os.environ["HANGTIME_THREADS"])
sys.exit(2 if time.monotonic() < end else 0)
"""


def test_diagnoses_run_side_by_side_and_share_the_processors(a_set, tmp_path):
    program = tmp_path / "diagnose.py"
    program.write_text(MEETING)
    started, counts = time.monotonic(), []
    failed = run_set(
        a_set, tmp_path / "answers", command=[sys.executable, str(program)], workers=2,
        progress=lambda *numbers: counts.append(numbers),
    )  # fmt: skip
    assert failed == 5
    assert time.monotonic() - started < 30
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
    monkeypatch.setattr("fit.blind.running.PATIENCE", 0.2)
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


def test_a_case_that_takes_too_long_is_a_failure(a_set, tmp_path):
    program = tmp_path / "diagnose.py"
    program.write_text("import time; time.sleep(60)")
    assert run_set(a_set, tmp_path / "answers", command=[sys.executable, str(program)], limit=0.2) == 5
    case = read_manifest(a_set).cases[0]
    assert "took longer than 0.2 s" in (tmp_path / "answers" / case / "failure.txt").read_text()


def test_right_answers_get_full_marks(a_set, tmp_path):
    answer_rightly(a_set, tmp_path)
    score = score_set(a_set, tmp_path)
    assert (score.overall.right_first.k, score.overall.right_first.n) == (2, 2)
    assert (score.overall.false_alarms.k, score.overall.false_alarms.n) == (0, 1)
    assert score.overall.said_unknown.k == 1
    assert score.overall.pair_both_named.k == 1
    assert score.overall.confident_and_wrong.k == 0
    assert score.overall.amplitude_error == pytest.approx(0.2)
    assert score.overall.amplitude_covered.k == 0  # 1.2 a within 10 % does not reach a
    assert score.overall.closure_against_oracle == pytest.approx(1.0)
    assert score.by_size["2 to 4"].right_first.k == 2  # every amplitude is three times the minimum detectable
    for steps in score.by_condition.values():
        assert sum(rates.cases for rates in steps.values()) == 5
        assert sum(rates.right_first.k for rates in steps.values()) == 2
    assert score.overall.brier is None
    assert any("no probabilities" in note for note in score.notes)
    assert (tmp_path / SCORE).exists()
    assert len((tmp_path / ANSWERS_HASHES).read_text().splitlines()) == 5


def test_what_the_sensor_gives_has_steps():
    look = Look(width=0.3, height=0.3, mass=0.02, grid=0, rate=45.0, duration=3.5, noise=1.4e-3, away=0.08,
                tilt=(0.0, 0.0), distance=1.5)  # fmt: skip
    assert conditions_of(look) == {
        "noise": "1 to 2 mm", "points": "corners and centre", "frames": "45 a second", "missing": "above 6 %",
    }  # fmt: skip


def test_every_opening_of_the_seal_is_recorded(a_set, tmp_path):
    answer_rightly(a_set, tmp_path)
    looks = a_set / LOOKS
    before = len(looks.read_text().splitlines()) if looks.exists() else 0
    first, second = score_set(a_set, tmp_path), score_set(a_set, tmp_path)
    lines = [json.loads(line) for line in looks.read_text().splitlines()][before:]
    assert [first.look, second.look] == [before + 1, before + 2]
    assert [line["answers"] for line in lines] == [first.answers, second.answers]
    assert "right group first" in lines[0]["headline"]


def test_the_seal_stays_closed_while_answers_are_missing(a_set, tmp_path, monkeypatch):
    from fit.blind import scoring

    answer_rightly(a_set, tmp_path)
    (tmp_path / read_manifest(a_set).cases[0] / "diagnosis.json").unlink()
    monkeypatch.setattr(scoring, "open_labels", lambda folder: pytest.fail("opened too early"))
    with pytest.raises(FitError, match="1 cases have no answer"):
        score_set(a_set, tmp_path)


def truth_of(a_set, kind):
    return next(t for t in open_labels(a_set).truths if t.kind == kind)


def judged(a_set, tmp_path, kind, said):
    truth = truth_of(a_set, kind)
    save_diagnosis(tmp_path / truth.id / "diagnosis.json", said)
    return judge(truth, tmp_path)


def test_a_named_effect_on_a_null_is_a_false_alarm_and_confident(a_set, tmp_path):
    one = judged(a_set, tmp_path, "null", diagnosis("effect", ["hem"], [finding("hem")]))
    assert one.false_alarm
    assert one.confident_and_wrong
    doubtful = diagnosis("effect", ["hem"], [finding("hem", probability=0.6)])
    assert not judged(a_set, tmp_path, "null", doubtful).confident_and_wrong


def test_another_effect_of_the_same_group_is_credited_but_not_alone(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    said = diagnosis("effect", ["draught"], [finding("draught"), finding(name, group="draught", closure=0.6)])
    one = judged(a_set, tmp_path, "single", said)
    assert one.right_first
    assert not one.right_alone
    assert not one.confident_and_wrong
    assert (one.closure, one.closure_of_oracle) == (0.5, 0.6)
    assert one.amplitude_error is None


def test_of_several_named_effects_the_first_must_be_right(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    both = [finding("draught"), finding(name)]
    assert not judged(a_set, tmp_path, "single", diagnosis("several", ["draught", name], both)).right_first
    assert judged(a_set, tmp_path, "single", diagnosis("several", [name, "draught"], both)).right_first
    assert judged(a_set, tmp_path, "single", diagnosis("ambiguous", ["draught", name], both)).right_first


def test_an_effect_in_third_place_is_among_the_first_three_groups(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    three = [finding("draught"), finding("air_lift"), finding(name)]
    one = judged(a_set, tmp_path, "single", diagnosis("effect", ["draught"], three))
    assert not one.right_first
    assert one.right_in_three
    assert one.confident_and_wrong
    four = [*three[:2], finding("added_mass"), three[2]]
    assert not judged(a_set, tmp_path, "single", diagnosis("effect", ["draught"], four)).right_in_three


def test_simpler_tools_are_judged_by_the_same_answers(a_set, tmp_path):
    """Drag explains more linearly, the truth closes more: the rules may say nothing at all."""
    name = truth_of(a_set, "single").planted[0].id
    both = [finding("air_drag", closure=0.2, explained=0.5), finding(name, closure=0.4, explained=0.3)]
    one = judged(a_set, tmp_path, "single", diagnosis("unknown", [], both))
    assert (one.right_first, one.right_by_screening, one.right_by_closure) == (False, False, True)
    found = summarise((one,)).baselines
    assert found["largest share explained linearly, no refit"].k == 0
    assert found["largest share of the gap closed, no rules"].k == 1


def test_an_effect_of_the_base_model_counts_in_no_rate(a_set, tmp_path):
    name = truth_of(a_set, "single").planted[0].id
    one = judged(a_set, tmp_path, "single", diagnosis("none", effects=[finding(name, tested=False)]))
    score = summarise((one,))
    assert score.in_base_model == 1
    assert score.overall.right_first.n == 0


def test_negative_amplitudes_are_compared_by_size(a_set, tmp_path):
    planted = truth_of(a_set, "single").planted[0]
    found = finding(
        planted.id, -planted.amplitude, amplitude_interval=(-1.3 * planted.amplitude, -0.8 * planted.amplitude)
    )
    one = judged(a_set, tmp_path, "single", diagnosis("effect", [planted.id], [found]))
    assert one.amplitude_error == pytest.approx(0.0)
    assert one.amplitude_covered


def test_wilsons_interval_of_3_in_60_and_of_none():
    """3 of 60: 1.7 to 13.7 %; 0 of 10: 0 to 27.8 % (both from Wilson's formula by hand)."""
    assert wilson(3, 60) == pytest.approx((0.0171, 0.1370), abs=1e-4)
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert rate_of([]).rate is None
    assert str(rate_of([True, False])) == "50 % [9, 91]  1/2"


def test_a_brier_score_of_certainty_and_of_doubt():
    """Sure and right 0; sure and wrong 2; 0.8 for the truth and 0.2 for the rest 0.04 + 0.04."""
    assert brier({"hem": 1.0}, "hem") == 0.0
    assert brier({"hem": 1.0}, "draught") == 2.0
    assert brier({"hem": 0.8}, "hem") == pytest.approx(0.08)
    assert brier({"hem": 0.2}, "") == pytest.approx(0.08)


def test_sizes_fall_into_their_bins():
    assert [bin_of(r) for r in (0.3, 0.5, 1.0, 3.9, 4.0, None)] == [
        "below 0.5", "0.5 to 1", "1 to 2", "2 to 4", "above 4", "not known",
    ]  # fmt: skip


def test_the_report_is_one_file_with_nothing_from_outside(a_set, tmp_path):
    answer_rightly(a_set, tmp_path)
    with pytest.raises(FitError, match="not scored"):
        write_page(tmp_path, tmp_path / "page.html")
    score = score_set(a_set, tmp_path)
    text = write_page(tmp_path, tmp_path / "page.html").read_text()
    assert text.startswith("<!doctype html>")
    for word in ("http", "src=", "<script", "<link"):
        assert word not in text
    for word in ("false alarms on nulls", "time_offset", "always air_drag", "chance", "no probabilities"):
        assert word in text
    sure = tuple(msgspec.structs.replace(j, probability=0.9 if j.named else None) for j in score.cases)
    (tmp_path / SCORE).write_bytes(msgspec.json.encode(msgspec.structs.replace(score, cases=sure)))
    assert "<svg" in write_page(tmp_path, tmp_path / "page.html").read_text()


def test_the_command_line_makes_scores_and_reports(tmp_path):
    def hangtime(*words):
        return subprocess.run(
            [sys.executable, "-m", "formats.command", "blind", *map(str, words)], capture_output=True, text=True,
            cwd=tmp_path,
        )  # fmt: skip

    made = hangtime("make", "set", "--cases", 1, "--nulls", 1, "--effect", "hem", "--seed", 3, "--side", COARSE)
    assert made.returncode == 0, made.stderr
    assert "2 cases" in made.stdout
    early = hangtime("score", "set", "answers")
    assert early.returncode == 2
    assert "no answer" in early.stderr
    answer_rightly(tmp_path / "set", tmp_path / "answers")
    scored = hangtime("score", "set", "answers")
    assert scored.returncode == 0, scored.stderr
    assert "false alarms on nulls" in scored.stdout
    assert hangtime("run", "set", "--out", "answers").returncode == 0  # everything is answered: nothing to run
    reported = hangtime("report", "set", "answers", "--out", "blind.html")
    assert reported.returncode == 0, reported.stderr
    assert (tmp_path / "blind.html").exists()
    refused = hangtime("make", "set", "--cases", 1, "--effect", "self_contact")
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1

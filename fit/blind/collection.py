"""A folder of blind cases: making it, running the diagnosis on it, both resumable.

DIR/cases/<id>/take-1.mcap ... held-out-2.mcap    public; ids are random and their order says nothing
DIR/manifest.json                                 hash of every public file and of the sealed labels
DIR/sealed/labels.bin, DIR/sealed/key             the labels, encrypted, and the key: keep them apart
ANSWERS/<id>/diagnosis.json                       what the diagnosis said
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fit.blind import sealing
from fit.blind.cases import Description, Label, as_record, draw_description, draw_label, make_takes
from fit.blind.plants import PLANTS, STRANGERS
from fit.errors import BlowUpError, FitError
from formats.archive import write_take

Progress = Callable[[int, int, str], None]

ATTEMPTS = 5  # descriptions that are tried before a case is given up


def draw_labels(cases: int, nulls: int, pairs: int, strangers: int, rng: np.random.Generator) -> list[Label]:
    """Draw labels: effects in turn so that all are met equally often, then shuffled."""
    names, odd = list(PLANTS), list(STRANGERS)
    singles = [names[k % len(names)] for k in rng.permutation(max(cases, len(names)))[:cases]]
    labels = [draw_label("single", n, rng) for n in singles]
    labels += [draw_label("null", "", rng) for _ in range(nulls)]
    for _ in range(pairs):
        labels.append(draw_label("pair", "+".join(rng.choice(names, 2, replace=False)), rng))
    labels += [draw_label("stranger", odd[k % len(odd)], rng) for k in range(strangers)]
    return [labels[k] for k in rng.permutation(len(labels))]


def make(folder: Path, labels: list[Label], seed: int, progress: Progress) -> None:
    """Make a collection, or what is missing of it.

    Raises:
        FitError: the folder holds another collection.
    """
    rng = np.random.default_rng([seed, 1])
    plan = [(f"{rng.integers(16**10):010x}", draw_description(rng), label) for label in labels]
    wanted = {"format": "hangtime-blind/1", "seed": seed, "cases": sorted(case for case, _, _ in plan)}
    manifest = folder / "manifest.json"
    if manifest.exists():
        kept = json.loads(manifest.read_text())
        if {k: kept.get(k) for k in wanted} != wanted:
            raise FitError("holds another collection", where=folder, advice="choose an empty folder")
    (folder / "sealed").mkdir(parents=True, exist_ok=True)
    key_file, sealed_file = folder / "sealed" / "key", folder / "sealed" / "labels.bin"
    if not key_file.exists():
        key_file.write_bytes(sealing.new_key())
        key_file.chmod(0o600)
    made: dict[str, dict[str, object]] = {}
    hashes: dict[str, str] = {}
    for count, (case, about, label) in enumerate(sorted(plan, key=lambda item: item[0])):
        progress(count, len(plan), case)
        files = _make_case(folder / "cases" / case, case, about, label)
        made[case] = as_record(label)
        hashes.update({f"{case}/{f.name}": sealing.hash_of(f) for f in files})
    sealed_file.write_bytes(sealing.seal(json.dumps(made, sort_keys=True).encode(), key_file.read_bytes()))
    whole = {**wanted, "files": hashes, "labels_sha256": sealing.hash_of(sealed_file)}
    partial = manifest.with_suffix(".writing")
    partial.write_text(json.dumps(whole, indent=1, sort_keys=True) + "\n")
    partial.replace(manifest)
    progress(len(plan), len(plan), "done")


def _make_case(folder: Path, case: str, about: Description, label: Label) -> list[Path]:
    done = folder / "about.json"
    if not done.exists():
        folder.mkdir(parents=True, exist_ok=True)
        for attempt in range(ATTEMPTS):
            tried = Description(**{**asdict(about), "seed": (about.seed + attempt) % 2**31})
            try:
                training, held_out = make_takes(case, tried, label)
            except BlowUpError:
                if attempt == ATTEMPTS - 1:
                    raise
                continue
            break
        for number, take in enumerate(training):
            write_take(folder / f"take-{number + 1}.mcap", take)
        for number, take in enumerate(held_out):
            write_take(folder / f"held-out-{number + 1}.mcap", take)
        public = {k: v for k, v in asdict(about).items() if k != "seed"}
        done.write_text(json.dumps(public) + "\n")
    return sorted(folder.iterdir())


def run(folder: Path, answers: Path, progress: Progress, options: list[str], workers: int) -> None:
    """Diagnose every case that has no answer yet, each in a process of its own; one that fails is `inconclusive`.

    workers: how many at a time, each on its share of the processors.

    Raises:
        FitError: the folder holds no collection.
    """
    cases = case_ids(folder)
    share = max(len(os.sched_getaffinity(0)) // workers, 1)
    environment = {**os.environ, "HANGTIME_THREADS": str(share)}

    def answer(case: str) -> str:
        out = answers / case
        if (out / "diagnosis.json").exists() or (out / "failed.txt").exists():
            return case
        out.mkdir(parents=True, exist_ok=True)
        words = [sys.executable, "-m", "formats.command", "diagnose"]
        words += [str(p) for p in sorted((folder / "cases" / case).glob("take-*.mcap"))]
        for path in sorted((folder / "cases" / case).glob("held-out-*.mcap")):
            words += ["--held-out", str(path)]
        done = subprocess.run(
            [*words, "--out", str(out), *options], capture_output=True, text=True, env=environment, check=False
        )
        # A diagnosis that was interrupted is no answer; it goes on from its checkpoint the next time.
        if done.returncode and done.returncode not in {130, -2, -15}:
            (out / "failed.txt").write_text(done.stderr[-2000:])
        return case

    with ThreadPoolExecutor(workers) as pool:
        for count, case in enumerate(pool.map(answer, cases)):
            progress(count + 1, len(cases), case)


def case_ids(folder: Path) -> list[str]:
    """Return the ids of a collection.

    Raises:
        FitError: there is none, or a file is not what it was when it was made.
    """
    manifest = folder / "manifest.json"
    if not manifest.exists():
        raise FitError("holds no blind cases", where=folder, advice="make them with `hangtime blind make`")
    kept = json.loads(manifest.read_text())
    for name, wanted in kept["files"].items():
        path = folder / "cases" / name
        if not path.exists() or sealing.hash_of(path) != wanted:
            raise FitError("is not the file that was made", where=path, advice="make the collection again")
    return list(kept["cases"])


def open_labels(folder: Path) -> dict[str, Label]:
    """Open the seal and return the label of each case.

    Raises:
        FitError: labels or key are missing or do not match the manifest.
    """
    sealed_file, key_file = folder / "sealed" / "labels.bin", folder / "sealed" / "key"
    if not sealed_file.exists() or not key_file.exists():
        raise FitError("labels or key are missing", where=folder / "sealed", advice="bring both back to score")
    if sealing.hash_of(sealed_file) != json.loads((folder / "manifest.json").read_text())["labels_sha256"]:
        raise FitError("is not what was published", where=sealed_file, advice="make the collection again")
    plain = json.loads(sealing.unseal(sealed_file.read_bytes(), key_file.read_bytes(), sealed_file))
    return {
        case: Label(record["kind"], tuple(record["names"]), tuple(record["amplitudes"]))
        for case, record in plain.items()
    }

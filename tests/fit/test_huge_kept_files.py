"""A file far larger than the memory, in place of one that a run keeps, ends in one sentence or is made again."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from fit.blind.making import LABELS, MANIFEST, MANIFEST_FORMAT, SEALED_KEY
from fit.blind.seal import load_key, sha256_of
from fit.errors import FitError
from fit.gap.checkpoint import SPENT, Checkpoint
from fit.gap.fitting import Fitted
from fit.identification.saved_search import SavedSearch
from fit.kernel_cache.index import INDEX
from fit.kernel_cache.notes import note_kernels
from tests.fit.here import hangtime_here

HUGE = 300 << 30  # bytes; a sparse file of it takes no room on the disk


def made_huge(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.truncate(HUGE)
    return path


@pytest.mark.parametrize(
    ("name", "command"), [("manifest.json", "run"), ("manifest.json", "score"), ("score.json", "report")]
)
def test_a_huge_file_of_a_blind_set_is_refused_in_one_sentence(tmp_path, name, command):
    folder = tmp_path / "set"
    made_huge(folder / name)
    if command == "report":
        (folder / MANIFEST).write_text(json.dumps(
            {"format": MANIFEST_FORMAT, "sealed": "", "cases": [], "files": {}, "complete": True}
        ))  # fmt: skip
    options = ["--out", str(tmp_path / "blind.html")] if command == "report" else []
    run = hangtime_here("blind", command, *[str(folder)] * (1 if command == "run" else 2), *options, folder=tmp_path)
    assert run.returncode == 2
    assert f"{name}: cannot be read (the file has 322.1 GB, and one of its kind 134.2 MB at most)" in " ".join(
        run.stderr.split()
    )


def test_huge_labels_keys_and_answers_are_refused(tmp_path):
    for path in (tmp_path / LABELS, tmp_path / "cases/a/take-1.mcap"):
        with pytest.raises(FitError, match=r"has 322\.1 GB, which no take or answer has"):
            sha256_of(made_huge(path))
    with pytest.raises(FitError, match="holds no key"):
        load_key(made_huge(tmp_path / SEALED_KEY))


def test_a_pipe_in_place_of_a_public_file_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "take-1.mcap")
    with pytest.raises(FitError, match="is no file"):
        sha256_of(tmp_path / "take-1.mcap")


def test_a_huge_saved_search_is_refused(tmp_path):
    saved = SavedSearch(made_huge(tmp_path / "search.json"), {})
    with pytest.raises(FitError, match="the saved search cannot be read"):
        saved.read()


def test_huge_files_of_a_checkpoint_are_made_again_and_its_key_is_refused(tmp_path):
    made_huge(tmp_path / SPENT)
    kept = Checkpoint(tmp_path, {})
    made_huge(tmp_path / "draws.npy")
    assert kept.recall_vectors("draws", lambda: np.ones((1, 2))).tolist() == [[1.0, 1.0]]
    with (tmp_path / "more.npy").open("wb") as file:  # sound but for its size, which NumPy would believe
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (HUGE // 8,)})
        file.truncate(HUGE)
    assert kept.recall_vectors("more", lambda: np.zeros((1, 1))).tolist() == [[0.0]]
    made_huge(tmp_path / "key.json")
    with pytest.raises(FitError, match="the kept fits cannot be read"):
        Checkpoint(tmp_path, {})


def test_a_pipe_in_place_of_a_kept_fit_is_not_waited_for(tmp_path):
    kept = Checkpoint(tmp_path, {})
    one = Fitted(np.ones(1), np.zeros(1), (), np.ones(2), np.ones((2, 1)), np.ones(1), True)
    for name in ("draws.npy", "fit.npz"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(OSError, match="is no place for a file"):  # said by the write, after the fits
        kept.recall_vectors("draws", lambda: np.ones((1, 2)))
    with pytest.raises(OSError, match="is no place for a file"):
        kept.recall(["fit"], lambda: [one])


def test_a_huge_index_of_kernels_is_not_noted(tmp_path):
    made_huge(tmp_path / INDEX)
    with pytest.raises(OSError, match=r"the file has 322.1 GB"):  # which `mended_cache` passes over
        note_kernels(tmp_path)

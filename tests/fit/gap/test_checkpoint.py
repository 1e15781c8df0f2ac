"""Saved fits of an interrupted diagnosis."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.errors import FitError
from fit.gap.checkpoint import Checkpoint
from fit.gap.fitting import Fitted, Pinned
from tests.formats.full_disk import no_file_beyond


def test_kept_fits_of_other_takes_are_refused(tmp_path):
    Checkpoint(tmp_path / "p", {"takes": ["a"]})
    with pytest.raises(FitError, match="other takes or options"):
        Checkpoint(tmp_path / "p", {"takes": ["b"]})
    Checkpoint(tmp_path / "q", {"takes": ["a"], "physics": "old"})
    with pytest.raises(FitError, match="another version of Hangtime"):
        Checkpoint(tmp_path / "q", {"takes": ["a"], "physics": "new"})
    (tmp_path / "p" / "key.json").write_text("{")
    with pytest.raises(FitError, match="cannot be read"):
        Checkpoint(tmp_path / "p", {"takes": ["a"]})


def test_kept_fits_that_a_power_cut_left_empty_or_cut_short_are_made_again(tmp_path):
    kept = Checkpoint(tmp_path / "p", {})
    one = Fitted(np.ones(1), np.zeros(1), (), np.ones(2), np.ones((2, 1)), np.ones(1), True)
    assert kept.recall(["fit"], lambda: [one])[0] is one
    assert kept.recall_vectors("places", lambda: np.ones((2, 3))).shape == (2, 3)
    whole = (tmp_path / "p/fit.npz").read_bytes()
    for damaged in (b"", whole[:100], whole[:-30]):
        (tmp_path / "p/fit.npz").write_bytes(damaged)
        (tmp_path / "p/places.npy").write_bytes(damaged)
        assert kept.recall(["fit"], lambda: [one])[0] is one
        assert kept.recall_vectors("places", lambda: np.zeros((1, 3))).shape == (1, 3)


def test_a_size_that_the_held_edge_decided_is_kept_with_a_fit(tmp_path):
    kept = Checkpoint(tmp_path / "p", {})
    free = Fitted(
        np.array([3.0]), np.array([0.2, 0.0]), ("hem", "air_drag"), np.array([1.0, -1.0]), np.array([[4.0], [5.0]]),
        np.array([0.7]), False,
    )  # fmt: skip
    decided = Pinned(np.array([0.5, 0.0]), np.array([0.1, np.inf]), 7.0)
    pinned = dataclasses.replace(free, pinned=decided, is_converged=True)
    kept.recall(["free", "pinned"], lambda: [free, pinned])
    again, other = kept.recall(["free", "pinned"], list)
    assert again.pinned is None
    for name in ("vector", "amplitudes", "residual", "jacobian", "deviation"):
        assert np.array_equal(getattr(again, name), getattr(free, name)), name
    assert (again.active, again.is_converged) == (("hem", "air_drag"), False)
    assert other.pinned.amplitudes.tolist() == [0.5, 0.0]
    assert other.pinned.sd.tolist() == [0.1, np.inf]
    assert other.pinned.trust == 7.0
    assert other.is_converged


def test_vectors_of_more_than_a_mebibyte_are_kept_too(tmp_path):
    kept, made = Checkpoint(tmp_path / "p", {}), np.arange(200_000.0)[None]
    assert kept.recall_vectors("places", lambda: made) is made
    assert np.array_equal(kept.recall_vectors("places", lambda: np.zeros((1, 1))), made)


def test_simulations_and_seconds_are_summed_over_interrupted_processes(tmp_path, monkeypatch):
    """7 simulations in 5 s until the first process saves a fit, then 3 in 2 s of the second one: 10 in 7 s."""
    now = [100.0]
    monkeypatch.setattr("fit.gap.checkpoint.clock.monotonic", lambda: now[0])
    one = Fitted(np.ones(1), np.zeros(1), (), np.ones(2), np.ones((2, 1)), np.ones(1), True)
    first = Checkpoint(tmp_path / "p", {}, lambda: 7)
    assert first.spent == (7, 0.0)
    now[0] = 105.0
    first.recall(["fit"], lambda: [one])
    now[0] = 900.0
    second = Checkpoint(tmp_path / "p", {}, lambda: 3)
    now[0] = 902.0
    assert second.spent == (10, 7.0)
    assert Checkpoint(None, {}, lambda: 3).spent == (3, 0.0)


def test_a_folder_whose_key_a_kill_left_empty_is_begun_anew(tmp_path):
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "key.json").touch()
    Checkpoint(tmp_path / "p", {"takes": ["a"]})
    with pytest.raises(FitError, match="other takes or options"):
        Checkpoint(tmp_path / "p", {"takes": ["b"]})


def test_a_file_where_the_folder_should_be_is_refused(tmp_path):
    (tmp_path / "diagnosis.partial").touch()
    with pytest.raises(FitError, match=r"diagnosis\.partial: is a file"):
        Checkpoint(tmp_path / "diagnosis.partial", {})


def test_a_fit_that_a_full_disk_cannot_hold_leaves_no_part_of_it(tmp_path):
    """A fit takes about 2 kB."""
    kept = Checkpoint(tmp_path / "p", {})
    one = Fitted(np.ones(1), np.zeros(1), (), np.ones(2), np.ones((2, 1)), np.ones(1), True)
    with no_file_beyond(500), pytest.raises(OSError, match="File too large") as full:
        kept.recall(["fit"], lambda: [one])
    assert full.value.filename == str(tmp_path / "p" / "fit.npz")
    assert [path.name for path in (tmp_path / "p").iterdir()] == ["key.json"]

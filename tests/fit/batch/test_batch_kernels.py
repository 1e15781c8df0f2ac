"""A worker notes the kernels that it compiled at its end, although its threads still talk to the scheduler."""

from __future__ import annotations

import contextlib
import json
import threading

import pytest

from fit.kernel_cache import place
from fit.kernel_cache.index import INDEX, sizes_of_kernels
from fit.kernel_cache.notes import NOTED
from tests.fit.batch.night import SHORT, make_takes, said, start


class Taichi:
    """A Taichi that counts how often it wrote its kernels."""

    resets = 0

    def reset(self):
        self.resets += 1


@pytest.fixture
def beside_a_thread():
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    yield
    end.set()
    thread.join()


@pytest.mark.parametrize(
    ("is_counted", "running", "resets"), [(False, 0, 0), (True, 0, 1), (True, 1, 0)], ids=["other", "idle", "at work"]
)
def test_kernels_are_noted_beside_other_threads_only_where_none_of_them_simulates(
    beside_a_thread, tmp_path, monkeypatch, is_counted, running, resets
):
    monkeypatch.setattr(place._Work, "is_counted", is_counted)
    monkeypatch.setattr(place._Work, "running", running)
    taichi = Taichi()
    place._note_own_kernels(taichi, tmp_path, 0.0)
    assert taichi.resets == resets


def test_work_counts_while_it_lasts_also_where_it_fails(monkeypatch):
    monkeypatch.setattr(place._Work, "is_counted", False)
    with contextlib.suppress(ValueError), place.at_work():
        assert (place._Work.is_counted, place._Work.running) == (True, 1)
        raise ValueError
    assert (place._Work.is_counted, place._Work.running) == (True, 0)


@pytest.mark.slow  # a worker compiles every kernel
def test_every_kernel_of_a_batch_is_noted_when_its_worker_has_ended(tmp_path):
    make_takes(tmp_path, 1)
    cache = tmp_path / "kernels"
    process = start("batch", ".", "--out", "out", "--workers", 1, "--dashboard-port", 0, *SHORT, folder=tmp_path,
                    TI_OFFLINE_CACHE_FILE_PATH=str(cache))  # fmt: skip
    assert process.wait(600) == 0, said(tmp_path)
    kernels = sizes_of_kernels((cache / INDEX).read_bytes())
    assert kernels
    assert sorted(json.loads((cache / NOTED).read_bytes())) == sorted(kernels)

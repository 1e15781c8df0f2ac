"""A scheduler that is lost while a worker waits to store a finished result costs no result."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from fit.batch.cluster import Workers
from fit.batch.jobs import result_name
from fit.batch.runner import run, survey
from fit.batch.store import open_store
from fit.identification.request import Plan
from tests.fit.batch.night import (
    HANGS,
    PROGRAMS,
    free_port,
    is_listening,
    kill,
    make_takes,
    running,
    scheduler_at,
    wait_for,
)
from tests.fit.batch.waiting_worker import finish_and_wait

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.slow
@pytest.mark.parametrize("nanny", [(), ("--no-nanny",)], ids=["nanny", "alone"])
def test_a_result_that_waits_for_room_is_stored_after_its_scheduler_was_killed(tmp_path, nanny):
    """Dask lets a worker end its work for half a minute; there is room at once."""
    (tmp_path / "out").mkdir()
    takes = make_takes(tmp_path, 1)
    found = survey(open_store(str(takes)), open_store(str(tmp_path / "out")), Plan())
    found.work = finish_and_wait
    (job,) = found.jobs
    port, told = free_port(), []
    address = f"tcp://127.0.0.1:{port}"
    dask = (PROGRAMS / "dask", "worker", address, "--nthreads", 1, "--no-dashboard", *nanny)
    batch = threading.Thread(target=run, args=(found, Workers(scheduler=address)), kwargs={"say": told.append})
    with running(*scheduler_at(port)) as scheduler, running(*dask, PYTHONPATH=str(ROOT)):
        wait_for(lambda: is_listening(port))
        batch.start()
        wait_for(lambda: any("cannot be written; make room. Waiting" in line for line in told))
        kill(scheduler.pid)
        scheduler.wait()
        (tmp_path / "out/room").touch()
        wait_for(lambda: (tmp_path / "out" / result_name(job.key)).exists())
    wait_for(lambda: "The scheduler was lost; 1 job left. Waiting for it to come back." in told)
    with running(*scheduler_at(port)), running(*dask, PYTHONPATH=str(ROOT)):
        batch.join(HANGS)
    assert not found.waiting
    assert told[-1] == "Connected again."
    assert (tmp_path / "out/made").read_text() == "made\n"

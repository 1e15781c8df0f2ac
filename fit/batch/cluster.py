"""Workers of a batch: processes of this machine, or a running dask cluster.

On this machine everything stays on the loopback interface. Scheduler and workers communicate over TLS with a temporary
certificate. Dask runs any code that it receives, so no other user of the machine may connect.
"""

from __future__ import annotations

import contextlib
import json
import logging
import re
import signal
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fit.batch.room import Room
from fit.errors import BatchError, UnreachableError
from fit.runtime import start_tracker
from formats.interrupts import held

# s that one attempt to reach a scheduler may take. Our choice: half and double change only how late a lost scheduler
# is told.
CONNECT = 5.0
SCHEDULER_RETRY = 2.0  # s between attempts; our choice: nobody waits for longer once the other side is back
WAITS = "hangtime-waits"  # topic of a worker's messages on waiting
STAGES = "hangtime-stages"  # topic of a worker's messages on the stage and share of a diagnosis, with the job's key
# characters of a scheduler file at most. Our choice: a scheduler file is a short JSON object, and a longer file is
# another one.
LONGEST_FILE = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Location of the workers; `scheduler`: address or scheduler file of a running cluster, None for this machine."""

    scheduler: str | None = None
    count: int | None = None  # processes on this machine; None: one per core; no more than jobs and room (`room`)
    dashboard_port: int = 8787  # dask's own default
    patience: float = 600.0  # s of waiting for a lost scheduler, an unreachable bucket or the first worker

    def at_most(self, jobs: int, room: Room) -> tuple[Workers, str]:
        """Return the location with no more workers than jobs and room here, and why there are fewer than asked."""
        count, why = room.at_most(self.count, jobs)
        return replace(self, count=count), why


@contextlib.contextmanager
def connect(workers: Workers) -> Iterator[Any]:
    """Yield a dask client of this machine's workers, or of the cluster once its scheduler answers.

    Raises:
        BatchError: dask is not installed, the scheduler's address is malformed or needs certificates that are not
            set, or no scheduler answers for as long as patience lasts.
    """
    try:
        import distributed
    except ModuleNotFoundError as error:
        raise BatchError(
            f"{error.name} is not installed", where="batch", advice="in Hangtime's checkout: pip install -e '.[batch]'"
        ) from error
    # A batch handles lost workers itself and reports the important ones, so dask's messages are off.
    for name in ("distributed", "distributed.client", "distributed.nanny", "distributed.scheduler"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    client: Any = None
    try:
        if workers.scheduler is None:
            with _undisturbed():
                client = _local(distributed, workers)
        else:
            client = _remote(distributed, workers)
        yield client
    finally:
        with contextlib.suppress(Exception):  # closing a broken cluster may fail in any way
            cluster = client.cluster
            client.close(timeout=CONNECT)
            if cluster is not None:
                cluster.close(timeout=CONNECT)


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Context in which Ctrl-C is deferred, and blocked in threads and processes that start inside. For the main thread.

    A half-started cluster cannot be closed. A terminal sends Ctrl-C to all processes of a command, but the command
    itself ends its workers.

    Raises:
        KeyboardInterrupt: Ctrl-C came inside.
    """
    start_tracker()  # its own start would let signals through again, before the first worker's
    with held():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # threads and processes inherit it
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def has_workers(client: Any) -> bool:
    """Return whether the scheduler has any worker; other checks detect a scheduler that does not answer."""
    try:
        return bool(client.sync(client.scheduler.ncores, callback_timeout=CONNECT))
    except Exception:  # a connection breaks in many ways
        return True


def _local(distributed: Any, workers: Workers) -> Any:
    with warnings.catch_warnings():
        # If the port is in use, dask chooses another one, which the dashboard's address shows.
        warnings.filterwarnings("ignore", message=r"Port \d+ is already in use", category=UserWarning)
        cluster = distributed.LocalCluster(
            n_workers=workers.count,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            protocol="tls://",
            security=distributed.Security.temporary(),
            dashboard_address=f"127.0.0.1:{workers.dashboard_port}",
            worker_dashboard_address=None,
            silence_logs=logging.CRITICAL,
        )
    return distributed.Client(cluster)


def _address_in(path: Path) -> str:
    """Return the address in a scheduler file.

    Raises:
        BatchError: the file is no scheduler file.
    """
    try:
        if not path.is_file():
            raise ValueError("the path is a pipe, a device or a folder")
        with path.open("rb") as file:  # UTF-8 with or without a mark, or UTF-16
            return str(json.loads(file.read(LONGEST_FILE))["address"])
    except (ValueError, KeyError, TypeError) as error:
        raise BatchError(
            "is no scheduler file", where=path, advice="give the file that dask scheduler --scheduler-file wrote"
        ) from error


def _remote(distributed: Any, workers: Workers) -> Any:
    address = str(workers.scheduler)
    if re.fullmatch(r"[^/]+:\d+", address) and not Path(address).exists():
        raise BatchError(
            "is neither an address nor a scheduler file",
            where=address,
            advice=f"write tcp://{address} or tls://{address}",
        )
    deadline = time.monotonic() + workers.patience
    while True:
        try:
            if "://" not in address:
                if not Path(address).exists():
                    raise OSError(f"there is no file {address}")
                return distributed.Client(_address_in(Path(address)), timeout=CONNECT)
            return distributed.Client(address, timeout=CONNECT)
        except TypeError as error:
            if not address.startswith("tls://"):
                raise
            raise BatchError(
                "TLS needs certificates, and none are set",
                where=address,
                advice="set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, ...__CLIENT__CERT and ...__CLIENT__KEY",
            ) from error
        except (OSError, TimeoutError, ValueError, AssertionError) as error:  # the last: dask's thread did not begin
            if time.monotonic() >= deadline or (isinstance(error, ValueError) and "://" in address):
                kind = BatchError if isinstance(error, ValueError) else UnreachableError
                raise kind(
                    f"no scheduler answers there ({str(error).splitlines()[0] if str(error) else 'timed out'})",
                    where=address,
                    advice="start it and run the batch again: finished takes are kept",
                ) from error
        time.sleep(SCHEDULER_RETRY)

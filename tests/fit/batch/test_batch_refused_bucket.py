"""A bucket that refuses results is noticed before the first fit, at the price of two requests."""

from __future__ import annotations

import contextlib
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from fit.batch import runner
from fit.batch.store import TRIAL, open_store, try_writing
from fit.errors import BatchError, UnreachableError
from formats.archive import write_take
from formats.store_address import is_out_of_reach
from tests.fit.batch.night import SHORT, free_port, keys_for, serving
from tests.fit.batch.test_night_of_diagnoses import a_take
from tests.fit.here import hangtime_here

DENIED = b"<?xml version='1.0'?><Error><Code>AccessDenied</Code><Message>Access Denied</Message></Error>"
EMPTY = b"<?xml version='1.0'?><ListBucketResult><Name>b</Name><KeyCount>0</KeyCount></ListBucketResult>"
# The library removes by POST /BUCKET?delete.
REMOVED = f"<?xml version='1.0'?><DeleteResult><Deleted><Key>night/{TRIAL}</Key></Deleted></DeleteResult>".encode()
KEPT = (
    f"<?xml version='1.0'?><DeleteResult><Error><Key>night/{TRIAL}</Key><Code>AccessDenied</Code>"
    "<Message>Access Denied</Message></Error></DeleteResult>"
).encode()
BODIES = {"GET": EMPTY, "POST": REMOVED}


@contextlib.contextmanager
def answering(keeps=b"", **refused):
    """An S3 server without objects; it refuses the named methods with these statuses. Yield the requests.

    keeps: its answer to a removal
    """
    requests = []

    class Answers(BaseHTTPRequestHandler):
        def answer(self):
            requests.append((self.command, self.path))
            self.rfile.read(int(self.headers.get("Content-Length") or 0))
            status = refused.get(self.command, 404 if self.command == "HEAD" else 200)
            usual = keeps if self.command == "POST" and keeps else BODIES.get(self.command, b"")
            body = DENIED if status >= 400 else usual
            self.send_response(status)
            self.send_header("ETag", '"e"')
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body if self.command != "HEAD" else b"")

        do_GET = do_PUT = do_POST = do_HEAD = answer  # noqa: N815

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Answers)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in keys_for(server.server_port).items():
            patch.setenv(name, value)
        try:
            yield requests
        finally:
            server.shutdown()
            thread.join()
            server.server_close()


@pytest.mark.parametrize(
    ("refused", "told"),
    [({"PUT": 403}, "cannot be written"), ({"POST": 403}, "cannot be removed"), ({"keeps": KEPT}, "cannot be removed")],
    ids=["write", "remove", "remove-this"],
)
def test_a_bucket_that_refuses_results_ends_a_batch_before_its_first_fit(tmp_path, monkeypatch, refused, told):
    """A worker removes the reason of an earlier failure, so the keys must allow that too."""
    monkeypatch.setattr(runner, "connect", lambda here: pytest.fail("a worker was started"))
    (tmp_path / "takes").mkdir()
    write_take(tmp_path / "takes/a.mcap", a_take("a"))
    with answering(**refused) as requests:
        done = hangtime_here("batch", "takes", "--out", "s3://b/night", "--workers", 1, *SHORT, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert f"s3://b/night/{TRIAL}: {told} (the server says AccessDenied: Access Denied)" in done.stderr
    assert [one for one, _ in requests if one in ("PUT", "POST")] == ["PUT", "POST"][: 1 + ("PUT" not in refused)]


def test_the_trial_costs_two_requests_and_leaves_nothing(tmp_path):
    with answering() as requests:
        try_writing(open_store("s3://b/night"))
    assert requests == [("PUT", f"/b/night/{TRIAL}"), ("POST", "/b?delete")]
    port = free_port()
    (tmp_path / "b").mkdir()
    with serving(tmp_path, port), pytest.MonkeyPatch.context() as patch:
        for name, value in keys_for(port).items():
            patch.setenv(name, value)
        store = open_store("s3://b/night")
        try_writing(store)
        assert store.names("", "") == []


@pytest.mark.parametrize(
    ("status", "kind"),
    [(403, BatchError), (404, BatchError), (501, BatchError), (429, UnreachableError), (503, UnreachableError),
     (507, UnreachableError)],
)  # fmt: skip
def test_a_server_that_is_busy_or_full_is_tried_later_and_one_that_refuses_is_not(status, kind):
    """The real library's error, without its own retries."""
    obstore = pytest.importorskip("obstore")
    with answering(PUT=status):
        store = open_store("s3://b/night")
        store._store = type(store._store).from_url("s3://b/night", retry_config={"max_retries": 0})
        with pytest.raises(BatchError) as caught:
            try_writing(store)
    assert type(caught.value) is kind
    assert is_out_of_reach(obstore.exceptions.GenericError(f"status code: {status} Reason")) is (kind is not BatchError)

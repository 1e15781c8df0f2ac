"""Folder and bucket fulfil one contract; the bucket is a real server on the loopback interface."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fit.batch.runner import survey
from fit.batch.store import Bucket, Folder, open_store
from fit.batch.summary import rows_of, write_summary
from fit.batch.worker import run_job
from fit.errors import BatchError
from fit.identification.request import Plan
from tests.fit.batch.night import free_port, keys_for, kill, make_takes, serving

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The folder of an S3 server; its address and keys are in the environment."""
    root, port = tmp_path_factory.mktemp("s3"), free_port()
    (root / "takes").mkdir()
    with serving(root, port), pytest.MonkeyPatch.context() as patch:
        for name, value in keys_for(port).items():
            patch.setenv(name, value)
        yield root


@pytest.fixture(params=["folder", "bucket"])
def store(request, tmp_path):
    if request.param == "folder":
        return open_store(f"file://{tmp_path}/with%20space")
    request.getfixturevalue("server")
    return open_store(f"s3://takes/{request.node.name.split('[')[0]}/")


def test_a_written_file_is_listed_and_read_back(store):
    assert store.names("fits", ".json") == []
    for name in ("fits/b.json", "fits/a.json", "fits/deep/c.json", "fits/a.txt", "other/d.json"):
        store.write(name, name.encode())
    assert store.names("fits", ".json") == ["fits/a.json", "fits/b.json", "fits/deep/c.json"]
    assert len(store.names("", ".json")) == 4
    assert store.read("fits/deep/c.json") == b"fits/deep/c.json"


def test_the_second_writer_wins_and_what_is_removed_is_gone(store):
    store.write("fits/a.json", b"first, and longer")
    store.write("fits/a.json", b"second")
    assert store.has("fits/a.json")
    assert store.read("fits/a.json") == b"second"
    store.remove("fits/a.json")
    store.remove("fits/a.json")
    assert not store.has("fits/a.json")


def test_a_missing_file_is_one_sentence_with_its_path(store):
    with pytest.raises(BatchError, match=r"fits/gone\.json: cannot be read"):
        store.read("fits/gone.json")


def test_a_wrong_key_is_one_sentence(server, monkeypatch):
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "wrong")
    advice = "check the address, the network and the access keys"
    with pytest.raises(BatchError, match=f"cannot be listed .*{advice}") as told:
        open_store("s3://takes").names("", ".mcap")
    assert told.value.exit_code == 2


def test_the_variables_of_the_printed_file_are_all_that_opens_a_bucket(server, monkeypatch):
    (block,) = re.findall(r"```ini\n(.*?)```", (ROOT / "docs/how-to/fit-over-night.md").read_text(), re.DOTALL)
    names = set(re.findall(r"\bAWS_[A-Z_]+(?==)", block))
    values = {name: os.environ[name] for name in names}
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        monkeypatch.delenv(name)
    for name, value in values.items():
        monkeypatch.setenv(name, value)
    open_store("s3://takes").write("printed.txt", b"")
    assert open_store("s3://takes").names("", "printed.txt") == ["printed.txt"]


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BatchError, match="cannot be written"):
        open_store(str(tmp_path / "file")).write("fits/a.json", b"")


def test_what_cannot_be_removed_is_one_sentence_and_nothing_is_below_a_file(tmp_path):
    store = open_store(str(tmp_path))
    (tmp_path / "failed").touch()
    store.remove("failed/a.json")
    (tmp_path / "fits/a.json").mkdir(parents=True)
    with pytest.raises(BatchError, match=r"a\.json: cannot be removed \(Is a directory\); "):
        store.remove("fits/a.json")


def test_addresses_lead_to_folders_and_buckets(tmp_path):
    assert isinstance(open_store("takes"), Folder)
    assert open_store("takes").path("a") == Path.cwd() / "takes" / "a"
    assert isinstance(open_store("s3://takes/night"), Bucket)
    with pytest.raises(BatchError, match="neither a folder nor a bucket"):
        open_store("http://example.org")


def test_a_writer_killed_at_any_moment_leaves_whole_files_only(tmp_path):
    """Two contents of 4 MB in turns, killed after a few of them: a reader gets one or the other."""
    code = f"""
from fit.batch.store import open_store
store = open_store({str(tmp_path)!r})
while True:
    for letter in b"ab":
        store.write("fits/a.json", bytes([letter]) * 4_000_000)
        print(flush=True)
"""
    for writes in (1, 2, 5):
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as writer:
            for _ in range(writes):
                writer.stdout.readline()
            kill(writer.pid)
        content = (tmp_path / "fits/a.json").read_bytes()
        assert len(content) == 4_000_000
        assert len(set(content)) == 1
    assert open_store(str(tmp_path)).names("", ".json") == ["fits/a.json"]


def test_takes_of_a_bucket_are_fitted_into_a_bucket_once(server, tmp_path):
    folder = make_takes(tmp_path, 1)
    takes, results = open_store("s3://takes/night"), open_store("s3://takes/results")
    takes.write("monday/swing0.mcap", (folder / "swing0.mcap").read_bytes())
    plan = Plan(method="kinect-skirt", iterations=4, spacing=0.1)
    found = survey(takes, results, plan)
    (job,) = found.waiting
    found.outcomes[job.key] = run_job(job)
    write_summary(rows_of(found, results), results, plan)
    assert survey(takes, results, plan).waiting == []
    # What the server holds on its disk is what a reader of the bucket gets.
    (kept,) = (server / "takes/results/fits").glob("*.json")
    assert kept.name == f"{job.key}.json"
    assert b"monday/swing0.mcap" in (server / "takes/results/summary.html").read_bytes()

"""Keys of the server never reach messages, files, process lists, the environment or core dumps."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import trustme

from capture.errors import SyncError
from capture.sync.credentials import Credentials, find_credentials
from capture.sync.settings import load_settings
from formats.store_address import without_secrets
from formats.whole_files import LARGEST_STATE
from tests.capture.appliance.spool_takes import record
from tests.capture.sync.servers import KEY, SECRET

ROOT = Path(__file__).parents[3]


@pytest.fixture
def box(tmp_path, spool):
    """A configuration whose keys are the canary, and two takes."""
    for k in range(2):
        record(spool, 40, seed=k)
    keys = tmp_path / "keys.toml"
    keys.touch(0o600)
    keys.write_text(f'access_key_id = "{KEY}"\nsecret_access_key = "{SECRET}"\n')

    def written(server, authority, *, credentials="keys.toml", more=""):
        config = tmp_path / "appliance.toml"
        named = f'credentials = "{credentials}"\n' if credentials else ""
        config.write_text(
            f'[spool]\nfolder = "spool"\n[sync]\nurl = "s3://{server.bucket}"\nendpoint = "https://127.0.0.1:{server.port}"\n'
            f'region = "us-east-1"\nca = "{authority.ca}"\ndevice = "box"\n{named}{more}'
        )
        return config

    return written


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_settings_and_keys_of_an_editor_of_another_system_are_read(tmp_path, encoding):
    for name, text in (("keys.toml", f'access_key_id = "{KEY}"\n'), ("box.toml", '[sync]\nurl = "s3://b\u00fc"\n')):
        (tmp_path / name).touch(0o600)
        (tmp_path / name).write_bytes(text.encode(encoding))
    assert find_credentials(tmp_path / "keys.toml").values == {"access_key_id": KEY}
    assert load_settings(tmp_path / "box.toml").settings.url == "s3://b\u00fc"


def run(config, command="now", **environment):
    return subprocess.run(
        [sys.executable, "-m", "capture.sync", command, "--config", str(config)], capture_output=True, text=True,
        cwd=ROOT, env={**os.environ, **environment}, check=False,
    )  # fmt: skip


def holds_canary(folder):
    return [path for path in folder.rglob("*") if path.is_file() and SECRET.encode() in path.read_bytes()]


@pytest.mark.parametrize(
    "fault", ["", "403", *(pytest.param(one, marks=pytest.mark.slow) for one in ("500", "reset before"))]
)
def test_the_canary_is_in_no_message_and_no_file(far, box, tmp_path, spool, fault):
    server, proxy, authority = far
    proxy.fault = lambda method, path: fault
    done = run(box(proxy, authority))
    assert done.returncode == (75 if fault else 0), done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.startswith("take-000001: ")
    for text in (done.stdout, done.stderr):
        assert SECRET not in text
        assert KEY not in text
    assert holds_canary(spool.folder) == []
    assert holds_canary(server.root) == []


def test_the_canary_is_in_no_process_list_and_no_environment_and_no_core(far, box, tmp_path):
    """The server is silent while the running process is inspected; then it is ended by SIGABRT, which dumps core."""
    _, proxy, authority = far
    proxy.fault = lambda method, path: "silent"
    config = box(proxy, authority)
    process = subprocess.Popen(
        ["bash", "-c", 'ulimit -c unlimited; exec "$0" -m capture.sync now --config "$1"', sys.executable, str(config)],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, stderr=subprocess.PIPE,
    )  # fmt: skip
    while not proxy.done:
        assert process.poll() is None, process.stderr.read()
    place = Path(f"/proc/{process.pid}")
    assert SECRET.encode() not in (place / "cmdline").read_bytes()
    assert SECRET.encode() not in (place / "environ").read_bytes()
    limits = (place / "limits").read_text()
    assert limits.split("Max core file size")[1].split()[:2] == ["0", "0"]
    # The kernel gives the files of a process that may not be dumped to root (`man 5 proc`).
    assert (place / "status").stat().st_uid == 0
    process.send_signal(6)
    process.communicate()
    assert [path for path in tmp_path.rglob("core*") if path.is_file()] == []


def test_keys_of_systemd_come_before_those_of_a_file(tmp_path, monkeypatch):
    keys = tmp_path / "keys.toml"
    keys.touch(0o600)
    keys.write_text('access_key_id = "x"\nsecret_access_key = "wrong"\n')
    assert find_credentials(keys).values == {"access_key_id": "x", "secret_access_key": "wrong"}
    (tmp_path / "store_access_key_id").write_text(f"{KEY}\n")
    (tmp_path / "store_secret_access_key").write_text(f"{SECRET}\n")
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    assert find_credentials(keys).values == {"access_key_id": KEY, "secret_access_key": SECRET}


@pytest.mark.slow
def test_a_server_accepts_the_keys_of_systemd_before_those_of_a_file(far, box, tmp_path, spool):
    """The file holds a wrong key; systemd's credentials are one file a key."""
    _, proxy, authority = far
    (tmp_path / "keys.toml").write_text('access_key_id = "x"\nsecret_access_key = "wrong"\n')
    given = tmp_path / "credentials"
    given.mkdir()
    (given / "store_access_key_id").write_text(f"{KEY}\n")
    (given / "store_secret_access_key").write_text(f"{SECRET}\n")
    done = run(box(proxy, authority), CREDENTIALS_DIRECTORY=str(given))
    assert done.returncode == 0, done.stderr
    (spool.folder / "receipts/take-000001.json").unlink()
    assert "the server does not accept the keys" in run(box(proxy, authority)).stderr


def test_keys_are_read_from_a_pipe_such_as_a_shell_makes():
    """`credentials = "/dev/fd/63"` of a shell's <(...), through which a keeper of secrets hands them."""
    reader, writer = os.pipe()
    os.write(writer, f'access_key_id = "{KEY}"\nsecret_access_key = "{SECRET}"\n'.encode())
    os.close(writer)
    try:
        found = find_credentials(Path(f"/dev/fd/{reader}"))
    finally:
        os.close(reader)
    assert found.values == {"access_key_id": KEY, "secret_access_key": SECRET}


def test_a_servers_authority_is_read_from_a_pipe_such_as_a_shell_makes(tmp_path):
    """`ca = "/dev/fd/63"` of a shell's <(...), and no more of it than a certificate has."""
    config = tmp_path / "appliance.toml"
    config.write_text('[spool]\nfolder = "spool"\n[sync]\nurl = "s3://takes"\nca = "/dev/stdin"\ndevice = "box"\n')
    refused = b"authority cannot be read (the file has more than 1.0 MB, and one of its kind 1.0 MB at most)"
    for content, code in ((trustme.CA().cert_pem.bytes(), 0), (bytes(LARGEST_STATE + 1), 2)):
        done = subprocess.run(
            [sys.executable, "-m", "capture.sync", "now", "--config", str(config)], capture_output=True, input=content,
            cwd=ROOT, check=False,
        )  # fmt: skip
        assert (done.returncode, refused in done.stderr) == (code, code == 2), done.stderr


def test_keys_that_others_may_read_are_refused(tmp_path):
    keys = tmp_path / "keys.toml"
    keys.write_text(f'secret_access_key = "{SECRET}"\n')
    keys.chmod(0o640)
    with pytest.raises(SyncError, match=r"others may read these credentials; chmod 600"):
        find_credentials(keys)


@pytest.mark.parametrize("content", [f'secret_access_key = "{SECRET}', f"{SECRET} = = 1", f"secret = ['{SECRET}']"])
def test_keys_that_are_not_toml_are_refused_without_being_quoted(tmp_path, content):
    keys = tmp_path / "keys.toml"
    keys.touch(0o600)
    keys.write_text(content)
    with pytest.raises(SyncError) as raised:
        find_credentials(keys)
    assert SECRET not in str(raised.value)
    assert raised.value.__cause__ is None
    assert "keys.toml" in str(raised.value)


def test_addresses_are_shown_without_user_password_and_query():
    """As Azure's shared signatures and other people's habits put them there."""
    shown = without_secrets("GET https://me:hunter22@store.example/x?sig=abc%2B&sv=1 in 3 ms, s3://k:s@takes/a")
    assert shown == "GET https://store.example/x in 3 ms, s3://takes/a"


def test_a_key_in_any_text_is_hidden_and_does_not_show_in_a_debugger():
    keys = Credentials({"secret_access_key": SECRET, "region": "eu"})
    assert keys.hide(f"a {SECRET} b eu") == "a *** b eu"
    assert SECRET not in repr(keys)

"""Addresses of stores that a library would misread, and servers' own reasons."""

from __future__ import annotations

import os
import re
import socket
import ssl
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from formats import command
from formats.errors import AddressError
from formats.store_address import advice_on, first_line, folder_of, is_out_of_reach, open_bucket
from tests.capture.sync.servers import Authority
from tests.fit.here import hangtime_here

SKEWED = (
    "Generic S3 error: Server returned non-2xx status code: 403 Forbidden: <?xml version='1.0'?>\n<Error>"
    "<Code>RequestTimeTooSkewed</Code><Message>The difference between the request time and the server's time is too "
    "large.</Message></Error>"
)


@pytest.mark.parametrize("name", ["AWS_ENDPOINT_URL", "AWS_ENDPOINT"])
def test_a_servers_address_without_its_scheme_is_named(monkeypatch, name):
    """The library ends with a panic of its own."""
    monkeypatch.setenv(name, "127.0.0.1:9")
    with pytest.raises(AddressError, match=rf"{name} lacks http:// or https:// \(it is 127\.0\.0\.1:9\)"):
        open_bucket("s3://bkt/takes", extra="batch")


@pytest.mark.parametrize(
    "address",
    ["http://", "http://127.0.0.1:port", "http://127.0.0.1:99999", "http://[::1",
     "http://\u00fc.example", "https://:9", "http://a b"],
)  # fmt: skip
def test_a_servers_address_that_ends_in_a_panic_of_the_library_is_refused(monkeypatch, address):
    monkeypatch.setenv("AWS_ENDPOINT_URL", address)
    with pytest.raises(AddressError, match="AWS_ENDPOINT_URL is no server's address"):
        open_bucket("s3://bkt/takes", extra="batch")


@pytest.mark.parametrize(
    ("url", "name", "own"),
    [("gs://b/x", "AWS_ENDPOINT_URL", "GOOGLE_BASE_URL"), ("az://b/x", "AWS_ENDPOINT_URL_S3", "AZURE_STORAGE_ENDPOINT"),
     ("s3://b/x", "GOOGLE_BASE_URL", "AWS_ENDPOINT")],
)  # fmt: skip
def test_only_the_settings_of_a_store_itself_are_judged(monkeypatch, url, name, own):
    pytest.importorskip("obstore")
    others = "AZURE_KEY" if url.startswith("s3") else "AWS_SESSION_TOKEN"
    for setting, value in ((name, "of another store"), (others, "key\n"), ("AZURE_STORAGE_ACCOUNT_NAME", "a")):
        monkeypatch.setenv(setting, value)
    open_bucket(url, extra="batch")
    monkeypatch.setenv(own, "h:9")
    with pytest.raises(AddressError, match=f"{own} lacks http:// or https://"):
        open_bucket(url, extra="batch")


@pytest.mark.parametrize("address", ["http://127.0.0.1:9", "https://s3.example.org/below", "http://[::1]:9000"])
def test_servers_addresses_with_port_path_and_six_byte_groups_are_taken(monkeypatch, address):
    pytest.importorskip("obstore")
    monkeypatch.setenv("AWS_ENDPOINT_URL", address)
    open_bucket("s3://bkt/takes", extra="batch", client={"allow_http": True})


@pytest.mark.parametrize("name", ["AWS_ACCESS_KEY_ID", "AWS_SESSION_TOKEN", "AWS_ENDPOINT_URL"])
def test_a_key_with_a_line_break_is_named_and_not_shown(monkeypatch, name):
    monkeypatch.setenv(name, "secret\n")
    with pytest.raises(AddressError, match=f"{name} holds a line break") as caught:
        open_bucket("s3://bkt/takes", extra="batch")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("s3://bkt/run?sig=hidden", "s3://bkt/run?...: has a ? in it, where an address ends; choose a name without ?, "
         "and set keys in the environment"),
        ("gs://", "gs://: names no bucket; write gs://BUCKET/NAME"),
        ("s3:///run", "s3:///run: names no bucket; write s3://BUCKET/NAME"),
        ("s3://bkt#1/run", "s3://bkt#1/run: 'bkt#1' is no bucket's name; write the name with letters, digits, dots and "
         "hyphens"),
        ("s3://b b/run", "s3://b b/run: 'b b' is no bucket's name; write the name with letters, digits, dots and "
         "hyphens"),
        ("abfs://box@account/run", "abfs://account/run: 'account' is no server of a storage account; write "
         "abfs://CONTAINER@ACCOUNT.dfs.core.windows.net/NAME"),
        ("s3://bkt/run%231", "s3://bkt/run%231: has %23 in it, which would be another character in the bucket; choose "
         "a name without %23"),
        ("s3://bkt/../run", "s3://bkt/../run: has . or .. as a part of its path, which a bucket does not have; write "
         "the whole name"),
        ("s3://bkt/./run", "s3://bkt/./run: has . or .. as a part of its path, which a bucket does not have; write the "
         "whole name"),
        ("s3://bkt:80/run", "s3://bkt:80/run: has a port, a user or a password before the bucket's name; write "
         "s3://BUCKET/NAME"),
        ("gs://user:hidden@bkt/run", "gs://bkt/run: has a port, a user or a password before the bucket's name; write "
         "gs://BUCKET/NAME"),
        ("s3://bkt/ru\x7fn", "s3://bkt/ru\\x7fn: has a line break or another control character in it; write the "
         "address again"),
    ],
)  # fmt: skip
def test_values_that_the_library_would_leave_out_or_change_are_refused(url, words):
    """It writes to `run`, or to `run` of the bucket itself, or says so in words of its own."""
    with pytest.raises(AddressError) as caught:
        open_bucket(url, extra="batch")
    assert str(caught.value) == words


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (
            {"aws_endpoint": "h:9"},
            "aws_endpoint lacks http:// or https:// (it is h:9); write the server's whole address",
        ),
        ({"ENDPOINT": "https://u:p@"}, "ENDPOINT is no server's address (it is 'https://'); write http(s)://NAME:PORT"),
        ({"endpoint": "http://h:0"}, "endpoint is no server's address (it is 'http://h:0'); write http(s)://NAME:PORT"),
        ({"key": "a\tb"}, "key holds a line break or another control character; set it again, without that character"),
        (
            {"key": "a\x7fb"},
            "key holds a line break or another control character; set it again, without that character",
        ),
    ],
)
def test_a_setting_that_ends_the_library_is_refused_by_its_name(config, words):
    with pytest.raises(AddressError) as caught:
        open_bucket("s3://bkt/run", extra="batch", config=config)
    assert str(caught.value) == f"s3://bkt/run: {words}"


@pytest.mark.parametrize(
    ("url", "folder"),
    [
        ("file:///srv/my%20takes", "/srv/my takes"), ("file:///srv/run#1?", "/srv/run#1?"),
        ("file://localhost/srv", "/srv"), ("takes/new", "takes/new"), ("c:/x", "c:/x"), ("s3://b/x", None),
        ("gs://b", None), ("az://b/x", None), ("abfs://b@a/x", None), ("abfss://b@a/x", None), ("s3a://b/x", None),
    ],
)  # fmt: skip
def test_an_address_leads_to_a_folder_or_to_a_bucket(url, folder):
    found = folder_of(url)
    assert (found if found is None else str(found)) == folder


def test_an_address_of_another_computers_folder_is_refused():
    with pytest.raises(AddressError) as caught:
        folder_of("file://host/takes")
    assert str(caught.value) == (
        "file://host/takes: file:// leads to no other computer, and host stands where one is named; write file:///... "
        "with three slashes, and mount the folder of another computer"
    )


@pytest.fixture
def asked(monkeypatch):
    """The requests to a server without TLS that refuses each, with keys for it in the environment."""
    paths = []

    class Refusing(BaseHTTPRequestHandler):
        def do_PUT(self):
            paths.append(self.path)
            self.rfile.read(int(self.headers["Content-Length"]))
            answer = b"<Error><Code>AccessDenied</Code></Error>"
            self.send_response(403)
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, *words):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Refusing) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}).start()
        settings = {"ENDPOINT_URL": f"http://127.0.0.1:{server.server_port}", "REGION": "r", "ACCESS_KEY_ID": "a"}
        for name, value in (settings | {"SECRET_ACCESS_KEY": "b"}).items():
            monkeypatch.setenv(f"AWS_{name}", value)
        yield paths
        server.shutdown()


def test_a_name_with_a_hash_is_written_where_it_says(asked, monkeypatch):
    obstore = pytest.importorskip("obstore")
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    store = open_bucket("s3://bkt/run#1", extra="batch", retries=0)
    with pytest.raises(obstore.exceptions.BaseError) as caught:
        obstore.put(store, "a.json", b"", use_multipart=False)
    assert asked == ["/bkt/run%231/a.json"]
    assert not is_out_of_reach(caught.value)


def test_a_server_without_tls_that_is_not_allowed_is_no_server_that_does_not_answer(asked):
    obstore = pytest.importorskip("obstore")
    store = open_bucket("s3://bkt/run", extra="batch", retries=0)
    with pytest.raises(obstore.exceptions.GenericError) as caught:
        obstore.put(store, "a.json", b"", use_multipart=False)
    told = first_line(caught.value)
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+ is an address without TLS, to which nothing is sent unasked", told)
    assert advice_on(caught.value) == "set AWS_ALLOW_HTTP=true if the server has no TLS, else write https://"
    assert (asked, is_out_of_reach(caught.value)) == ([], False)


@pytest.mark.parametrize(
    ("url", "settings", "words"),
    [
        ("s3://b/x", {"AWS_ALLOW_HTTP": "yes please"}, "AWS_ALLOW_HTTP is 'yes please', and has to be true or false; "
         "set it to true or false, or leave it out"),
        ("s3://b/x", {"AWS_TIMEOUT": "soon"}, "AWS_TIMEOUT is 'soon', and has to be a length of time; set it to one "
         "such as 30s, or leave it out"),
        ("s3://b/x", {"AWS_CONDITIONAL_PUT": "maybe"}, "AWS_CONDITIONAL_PUT is 'maybe', and has to be one of its "
         "values; set it to one of them, or leave it out"),
        ("az://c/x", {}, "an address in Azure needs the name of a storage account, and none is set; set "
         "AZURE_STORAGE_ACCOUNT_NAME, and AZURE_STORAGE_ACCOUNT_KEY for its key"),
        ("az://c/x", {"AZURE_STORAGE_ACCOUNT_NAME": "a", "AZURE_STORAGE_ACCOUNT_KEY": "!!"}, "the key of the storage "
         "account is not in base64; copy AZURE_STORAGE_ACCOUNT_KEY again, all of it"),
        ("gs://b/x", {"GOOGLE_SERVICE_ACCOUNT": "/absent"}, "the file of Google's service account cannot be opened: "
         "/absent: No such file or directory; set GOOGLE_SERVICE_ACCOUNT to its path"),
        ("gs://b/x", {"GOOGLE_SERVICE_ACCOUNT_KEY": "{"}, "the service account for Google is invalid; give "
         "its JSON file in GOOGLE_SERVICE_ACCOUNT"),
    ],
)  # fmt: skip
def test_a_setting_that_the_library_refuses_is_named_in_our_words(monkeypatch, url, settings, words):
    pytest.importorskip("obstore")
    for name in [name for name in os.environ if name.startswith(("AWS_", "AZURE_", "GOOGLE_"))]:
        monkeypatch.delenv(name)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(AddressError) as caught:
        open_bucket(url, extra="batch")
    assert str(caught.value) == f"{url}: {words}"


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("Generic GCS error: Error performing token request: Error performing GET http://metadata.google.internal/x in "
         "2s - HTTP error: error sending request", "set GOOGLE_SERVICE_ACCOUNT"),
        ("Generic S3 error: Error performing PUT http://169.254.169.254/latest/api/token in 9s - HTTP error: error "
         "sending request", "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"),
    ],
)  # fmt: skip
def test_keys_that_are_not_set_are_no_server_that_does_not_answer(text, advice):
    obstore = pytest.importorskip("obstore")
    error = obstore.exceptions.GenericError(text)
    assert first_line(error) == "no keys are set, and this computer has none as a machine of the cloud"
    assert (advice_on(error), is_out_of_reach(error)) == (advice, False)


def test_per_cent_and_an_account_stay_where_they_mean_themselves():
    pytest.importorskip("obstore")
    open_bucket("s3://bkt/100 %", extra="batch")
    open_bucket("abfs://box@account.dfs.core.windows.net/run", extra="batch", config={"account_key": "AAAA"})


def test_a_bucket_with_one_slash_is_no_folder():
    with pytest.raises(AddressError, match="'s3:/bkt/run' lacks a // behind s3:; write s3://BUCKET/NAME"):
        folder_of("s3:/bkt/run")
    assert str(folder_of("./s3:/bkt")) == "s3:/bkt"


def test_a_server_that_does_not_answer_is_named_with_the_cause():
    obstore = pytest.importorskip("obstore")
    with socket.socket() as held:  # bound and not listening: nobody answers there
        held.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{held.getsockname()[1]}"
        config = {"endpoint": address, "region": "r", "access_key_id": "a", "secret_access_key": "b"}
        store = open_bucket("s3://bkt/x", extra="batch", config=config, client={"allow_http": True}, retries=0)
        with pytest.raises(obstore.exceptions.GenericError) as caught:
            list(obstore.list(store))
    assert first_line(caught.value) == f"{address} does not answer: Connection refused"
    assert is_out_of_reach(caught.value)
    assert not is_out_of_reach(OSError("Connection refused"))
    assert not is_out_of_reach(obstore.exceptions.GenericError("Server returned non-2xx status code: 403"))


def test_a_panic_of_a_library_is_one_sentence(monkeypatch, tmp_path):
    """The real one, which `open_bucket` keeps from happening."""
    obstore = pytest.importorskip("obstore")
    store = pytest.importorskip("obstore.store").S3Store("b", endpoint="http://", region="r", skip_signature=True)
    monkeypatch.setattr(command, "whole", lambda name: lambda **_: list(obstore.list(store)))
    done = hangtime_here("batch", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("hangtime: a library failed (request ")
    assert len(done.stderr.splitlines()) == 1


def listed(address):
    """The error of a list that is asked of a server."""
    obstore = pytest.importorskip("obstore")
    config = {"endpoint": address, "region": "r", "access_key_id": "a", "secret_access_key": "b"}
    store = open_bucket("s3://bkt/x", extra="batch", config=config, retries=0)
    with pytest.raises(obstore.exceptions.GenericError) as caught:
        list(obstore.list(store))
    return caught.value


def test_a_server_without_tls_at_an_https_address_is_named_and_not_waited_for(asked):
    address = os.environ["AWS_ENDPOINT_URL"].replace("http:", "https:")
    error = listed(address)
    assert first_line(error) == f"{address} answers, and not in TLS"
    assert advice_on(error) == (
        "write http:// for https:// in the server's address and set AWS_ALLOW_HTTP=true, or give its port with TLS"
    )
    assert (asked, is_out_of_reach(error)) == ([], False)


def test_a_certificate_of_an_unknown_authority_is_named_and_not_waited_for(tmp_path):
    authority = Authority.make(tmp_path)
    with ThreadingHTTPServer(("127.0.0.1", 0), BaseHTTPRequestHandler) as server:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(authority.certificate, authority.key)
        server.socket = context.wrap_socket(server.socket, server_side=True)
        server.handle_error = lambda *_: None
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}).start()
        address = f"https://127.0.0.1:{server.server_port}"
        error = listed(address)
        server.shutdown()
    assert first_line(error) == f"{address} has a certificate that is not trusted: UnknownIssuer"
    assert advice_on(error).startswith("add the authority of its certificate to those that this computer trusts")
    assert not is_out_of_reach(error)


@pytest.mark.parametrize(
    ("reason", "advice"),
    [("Expired", "set this computer's clock"), ("ExpiredContext {", "set this computer's clock"),
     ("NotValidYet", "set this computer's clock"), ("NotValidForName", "write the name in the address"),
     ("Other(\n OtherError(\n CaUsedAsEndEntity", "add the authority of its certificate")],
)  # fmt: skip
def test_each_fault_of_a_certificate_has_its_step(reason, advice):
    assert advice_on(OSError(f"error: InvalidCertificate(\n   {reason}")).startswith(advice)


@pytest.mark.parametrize("value", [" http://h:9", "http://h:9 ", "\u00a0http://h:9"])
def test_a_space_around_a_setting_is_named_and_no_lack_of_a_scheme(monkeypatch, value):
    monkeypatch.setenv("AWS_ENDPOINT_URL", value)
    with pytest.raises(AddressError) as caught:
        open_bucket("s3://bkt/takes", extra="batch")
    assert str(caught.value) == (
        f"s3://bkt/takes: AWS_ENDPOINT_URL begins or ends with a space (it is {value!r}); set it again, without that "
        "space"
    )
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://h:9")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", f"secret{value[-1]} ")
    with pytest.raises(AddressError, match="AWS_SECRET_ACCESS_KEY begins or ends with a space; set") as caught:
        open_bucket("s3://bkt/takes", extra="batch")
    assert "secret " not in str(caught.value)


def test_a_setting_of_a_servers_address_is_checked_as_well():
    with pytest.raises(AddressError, match="endpoint lacks http://"):
        open_bucket("s3://bkt/takes", extra="batch", config={"endpoint": "example.org"})


def test_the_servers_own_reason_and_what_follows_from_it():
    error = OSError(SKEWED)
    assert first_line(error).startswith("the server says RequestTimeTooSkewed: The difference between")
    assert advice_on(error) == "set this computer's clock (timedatectl set-ntp true)"
    assert advice_on(OSError("no route")) == "check the address, the network and the access keys"
    assert first_line(OSError("<Code>AccessDenied</Code>")) == "the server says AccessDenied"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "OSError"),
        ("  first \nsecond", "first"),
        ("<Code>Busy</Code> <Message>Slow down: https://u:p@h/x?sig=abc</Message>", "the server says Busy: Slow down: "
         "https://h/x"),
        ("Generic S3 error: Error performing GET https://h:9/x?list in 3s - HTTP error: error sending request",
         "https://h:9 does not answer"),
        ('Error performing PUT http://u:p@h/x - HTTP error\nsource: "failed to lookup address information: Name or '
         'service not known"', "http://h does not answer: Name or service not known"),
        ("HTTP error without an address", "HTTP error without an address"),
        ("x" * 201, "x" * 200),
        ("s3://key:secret@bucket/run?token=1#part: gone", "s3://bucket/run: gone"),
        ("s3://bucket/run#1: gone", "s3://bucket/run#1: gone"),
    ],
)  # fmt: skip
def test_an_error_of_a_library_is_its_first_line_without_secrets(text, told):
    assert first_line(OSError(text)) == told

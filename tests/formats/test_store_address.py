"""Addresses of stores that a library would misread, and servers' own reasons."""

from __future__ import annotations

import pytest

from formats.errors import AddressError
from formats.store_address import advice_on, first_line, open_bucket

SKEWED = (
    "Generic S3 error: Server returned non-2xx status code: 403 Forbidden: <?xml version='1.0'?>\n<Error>"
    "<Code>RequestTimeTooSkewed</Code><Message>The difference between the request time and the server's time is too "
    "large.</Message></Error>"
)


def test_an_address_with_a_hash_is_refused_where_it_would_be_cut_off():
    with pytest.raises(AddressError, match="has a # in it"):
        open_bucket("s3://bkt/run#1", extra="batch")


@pytest.mark.parametrize("name", ["AWS_ENDPOINT_URL", "AWS_ENDPOINT"])
def test_a_servers_address_without_its_scheme_is_named(monkeypatch, name):
    """The library ends with a panic of its own."""
    monkeypatch.setenv(name, "127.0.0.1:9")
    with pytest.raises(AddressError, match=rf"{name} lacks http:// or https:// \(it is 127\.0\.0\.1:9\)"):
        open_bucket("s3://bkt/takes", extra="batch")


def test_a_setting_of_a_servers_address_is_looked_at_as_well():
    with pytest.raises(AddressError, match="endpoint lacks http://"):
        open_bucket("s3://bkt/takes", extra="batch", config={"endpoint": "example.org"})


def test_the_servers_own_reason_and_what_follows_from_it():
    error = OSError(SKEWED)
    assert first_line(error).startswith("the server says RequestTimeTooSkewed: The difference between")
    assert "set this computer's clock" in advice_on(error)
    assert "check the address" in advice_on(OSError("no route"))
    assert first_line(OSError("<Code>AccessDenied</Code>")) == "the server says AccessDenied"

"""The book of faults: what the status shows, and what the journal gets."""

from __future__ import annotations

import logging

import pytest

from capture.appliance.faults import FaultBook
from capture.appliance.log import LOG
from firmware_host.errors import ButtonError, LampError, SensorStalledError


@pytest.fixture
def journal():
    """Lines of the log with their levels, as journald gets them."""
    lines = []

    class Keep(logging.Handler):
        def emit(self, record):
            lines.append((record.levelname, record.getMessage()))

    keep, level = Keep(), LOG.level
    LOG.addHandler(keep)
    LOG.setLevel(logging.INFO)
    yield lines
    LOG.removeHandler(keep)
    LOG.setLevel(level)


def test_the_journal_gets_each_fault_once_when_it_begins_and_its_end(journal):
    """A button that is searched for every 2 s is one line, not one every 2 s."""
    book, gone = FaultBook(), ButtonError("there is no input device", where="/dev/input", advice="check its overlay")
    assert [book.set("button", gone, now) for now in (1.0, 3.0, 5.0)] == [True, False, False]
    assert journal == [("WARNING", "/dev/input: there is no input device; check its overlay")]
    assert book.all[0].since_s == 1.0
    assert book.clear("button")
    assert not book.clear("button")
    assert journal[1:] == [("INFO", "over: /dev/input: there is no input device")]


def test_a_fault_that_blocks_is_an_error_and_stands_first(journal):
    book = FaultBook()
    book.set("lamp", LampError("there is no LED 'x'", where="leds", advice="choose one of y"), 1.0)
    book.set("sensor", SensorStalledError("no frame for 5.0 s", where="openni2:", advice="replug it"), 2.0, blocks=True)
    assert [level for level, _ in journal] == ["WARNING", "ERROR"]
    assert [fault.name for fault in book.all] == ["sensor", "lamp"]
    assert [fault.name for fault in book.blocking] == ["sensor"]

"""End of a batch: after a number of hours, or at a time of day that is the same for every retry."""

from __future__ import annotations

import time

import pytest

from fit.batch.ending import ending_of, next_time


@pytest.fixture(autouse=True)
def berlin(monkeypatch):
    """Summer time from 2026-03-29 to 2026-10-25, at two o'clock."""
    with monkeypatch.context() as patch:
        patch.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
        time.tzset()
        yield
    time.tzset()


def at(text):
    """Seconds since 1970 of a local time."""
    return time.mktime(time.strptime(text, "%Y-%m-%d %H:%M"))


@pytest.mark.parametrize(
    ("now", "until", "hours"),
    [
        ("2026-07-03 22:00", "07:00", 9),
        ("2026-07-03 22:00", "7:00", 9),
        ("2026-07-04 05:00", "07:00", 2),
        ("2026-07-04 07:00", "07:00", 24),
        ("2026-07-04 06:59", "07:00", 1 / 60),
        ("2026-12-31 22:00", "07:00", 9),
        ("2026-03-28 22:00", "07:00", 8),
        ("2026-10-24 22:00", "07:00", 10),
        ("2026-07-03 22:00", "23:59", 119 / 60),
        ("2026-07-03 22:00", "00:00", 2),
    ],
)
def test_the_next_time_of_the_day_is_so_many_hours_away(now, until, hours):
    assert next_time(until, at(now)) - at(now) == pytest.approx(3600 * hours)


def test_a_night_ends_with_the_earlier_of_its_hours_and_its_time_of_the_day():
    clock = {"running": 0.0, "wall": at("2026-07-03 22:00")}
    clocks = {"running": lambda: clock["running"], "wall": lambda: clock["wall"]}
    assert ending_of(8.0, "07:00", **clocks).hours_end == 8 * 3600
    ending = ending_of(10.0, "07:00", **clocks)
    assert not ending.is_over
    assert not ending.is_near(8.9 * 3600)
    assert ending.is_near(9.0 * 3600)
    clock["wall"] = at("2026-07-04 07:00")  # it slept: its own clock stood still
    assert ending.is_over
    assert not ending_of(10.0, None, **clocks).is_over
    assert not ending_of(None, None, **clocks).is_over


def test_a_bucket_is_given_up_for_the_night_only_by_a_night_that_has_an_end():
    assert not ending_of(None, None).is_near(1e9)

"""Implausible numbers of a cloth, hanger or camera are refused by every command, and accepted with --anyway."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.archive import write_take
from formats.descriptions import dump_description
from formats.rig import Hanger
from tests.fit.here import hangtime_here
from tests.formats.test_archive import GARMENT, RIG, a_take

GRAMS = msgspec.structs.replace(GARMENT, mass_kg=1000 * GARMENT.mass_kg)
HANGER = Hanger(marker="fiducial", marker_size_m=0.06, marker_distance_m=0.3, held_m=((-0.2, 0.1, 0), (0.2, 0.1, 0)))
WITH_HANGER = msgspec.structs.replace(RIG, hanger=HANGER)
MILLIMETRES = msgspec.structs.replace(
    RIG, hanger=msgspec.structs.replace(HANGER, marker_size_m=60.0, marker_distance_m=300.0)
)


@pytest.fixture
def folder(tmp_path):
    """A garment in grams, a rig in millimetres, and a take of both; what is sound has its plain name."""
    for name, description in (
        ("garment", GARMENT),
        ("rig", WITH_HANGER),
        ("grams", GRAMS),
        ("millimetres", MILLIMETRES),
    ):
        (tmp_path / f"{name}.toml").write_text(dump_description(description))
    take = replace(a_take(3), garment=GRAMS)
    (tmp_path / "takes").mkdir()
    write_take(tmp_path / "takes/grams.mcap", take)
    slow = a_take(3)
    write_take(tmp_path / "takes/slow.mcap", replace(slow, time=np.arange(3.0)))
    np.savetxt(tmp_path / "markers.csv", np.zeros((20, 4)), delimiter=",", header="t,a_x,a_y,a_z")
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        ("swatch", "new.toml", "--mass", 40),
        ("import", "markers.csv", "--garment", "grams.toml"),
        ("markers", "print", "--rig", "millimetres.toml"),
        ("calibrate", "--sensor", "absent.oni", "--rig", "millimetres.toml"),
        ("record", "--sensor", "absent.oni", "--rig", "rig.toml", "--garment", "grams.toml", "--out", "take.mcap"),
        (
            "record",
            "--sensor",
            "absent.oni",
            "--rig",
            "millimetres.toml",
            "--garment",
            "garment.toml",
            "--out",
            "a.mcap",
        ),
        ("fit", "takes/grams.mcap"),
        ("fit", "takes/slow.mcap"),
        ("diagnose", "takes/grams.mcap"),
        ("diagnose", "takes/slow.mcap"),
    ],
    ids=lambda words: " ".join(map(str, words[:2])),
)
def test_every_command_names_the_unit_that_was_probably_meant_and_its_way_to_accept_it(words, folder):
    refused = hangtime_here(*words, folder=folder)
    assert refused.returncode == 2
    assert "or --anyway to accept it" in refused.stderr
    assert any(hint in refused.stderr for hint in ("grams meant", "millimetres", "its times are frame numbers"))
    accepted = hangtime_here(*words, "--anyway", folder=folder)
    assert "--anyway" not in accepted.stderr  # other errors do not matter here
    assert "Traceback" not in accepted.stderr


def test_a_night_leaves_an_implausible_take_out_until_it_is_asked_to_accept_it(folder):
    """It is kept as no failure, so that the same command with --anyway fits it; three frames then are too few."""
    from fit.batch.jobs import digest_of, failure_name, key_of
    from fit.batch.runner import survey
    from fit.batch.store import open_store
    from fit.batch.worker import run_job
    from fit.identification.request import Plan

    takes, results, plan = (
        open_store(str(folder / "takes")),
        open_store(str(folder / "out")),
        Plan(method="kinect-skirt", iterations=1),
    )
    (refused,) = [run_job(job) for job in survey(takes, results, plan).jobs if job.take == "grams.mcap"]
    assert refused.state == "refused"
    assert "--anyway" in refused.sentence
    (accepted,) = [run_job(job) for job in survey(takes, results, plan, anyway=True).jobs if job.take == "grams.mcap"]
    assert accepted.state == "failed"
    assert "the take has 3 frames" in accepted.sentence
    assert accepted.key == refused.key == key_of(digest_of(takes.read("grams.mcap")), plan, survey_physics())
    assert results.has(failure_name(accepted.key))


def survey_physics():
    from fit.provenance import physics_version

    return physics_version()

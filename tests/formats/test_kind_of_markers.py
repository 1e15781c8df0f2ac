"""Markers on a skirt count as silhouette points until its file states their kind, and the import warns of that."""

from __future__ import annotations

import msgspec
import pytest

from formats.importers.marker_tracks import write_marker_csv
from formats.importers.swatch_mocap import import_marker_take
from formats.judgement import judge
from formats.summary import describe, summarise
from tests.formats.test_marker_oddities import GARMENT, hanging

SKIRT = msgspec.structs.replace(GARMENT, kind="skirt")
ADVICE = 'in format = "hangtime-garment/2" state points_are = "material" for markers, and import again'


@pytest.mark.parametrize(
    ("garment", "is_reported", "tracked"),
    [
        (SKIRT, True, "points that count as silhouette points: the garment file states no points_are"),
        (msgspec.structs.replace(SKIRT, format="hangtime-garment/2", points_are="material"), False,
         "material points, which stay on the cloth"),
        (msgspec.structs.replace(SKIRT, format="hangtime-garment/2", points_are="silhouette"), False,
         "points of a silhouette, which slide over the cloth"),
        (GARMENT, False, "material points, which stay on the cloth"),
    ],
    ids=["skirt", "material", "silhouette", "swatch"],
)  # fmt: skip
def test_markers_of_no_stated_kind_are_reported(tmp_path, garment, is_reported, tracked):
    take = import_marker_take(write_marker_csv(tmp_path / "a.csv", hanging()), garment)
    told = [(one.words, one.advice, one.is_grave) for one in judge(take) if one.name == "points_of_no_kind"]
    words = "its points count as silhouette points, as its garment file states no points_are"
    assert told == ([(words, ADVICE, False)] if is_reported else [])
    assert f"tracked   {tracked}" in describe(summarise(take)).splitlines()

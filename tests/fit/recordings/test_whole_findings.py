"""Complete findings on a camera's faults: every field, their order, and the clause on them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.recordings.camera_findings import camera_clause
from tests.fit.recordings.test_findings_by_hand import found, late, leaning, no_kind, outline  # noqa: F401


def test_everything_that_a_camera_made_is_reported_whole_and_in_the_order_in_which_it_was_taken_out():
    """Each finding has its takes, figure, interval, unit, sentence, and whether it was left; all at once, of one take.

    Points lie 5 mm beside their places, half of them seen, with noise of nothing.
    """
    one = late(0.05, share=0.8, share_interval=(0.7, 0.9), deviation=0.03, scale=0.02, scale_interval=(0.015, 0.025))
    for name, value in (
        ("gaps", [(1.0, 1.5)]), ("seen_points", np.zeros((10, 4, 3))), ("valid", np.tile([True, False], (10, 2))),
        ("points", np.tile([0.003, 0.0, 0.004], (10, 4, 1))),
    ):  # fmt: skip
        setattr(one, name, value)
    more = {
        "skewed": 10, "edge": SimpleNamespace(down=0.004, out=-0.003), "offsets": SimpleNamespace(rms=0.009),
        "is_placed": True, "outline": outline(by_pose=0.03, half=0.001), "lean": leaning(0.02, 0.01),
    }  # fmt: skip
    for name, value in more.items():
        setattr(one.camera, name, value)
    left = late(0.03, is_retimed=False, name="b")
    border = np.hypot(1, 2) / 3e3
    expected = [
        ("hanger_gap", 0.5, None, "s", False, "In a the hanger's path is lost once, up to 0.50 s, first at 1.00 s. "
         "Both sides are used. The cloth is judged again once it has forgotten the motion in the gap."),
        ("latency", 0.05, (0.04, 0.06), "s", False, "The points' stamps are 0.050 s late [0.040 to 0.060 s] in a, as "
         "the held row shows against the hanger's path. This is corrected."),
        ("publish_time", 0.8, (0.7, 0.9), "1", False, "Stamps say when a frame was published. Stamps are late by a "
         "share of the interval's excess over the usual one: 0.80 [0.70 to 0.90]. This is corrected."),
        ("frame_shifts", 0.03, None, "s", True, "In each frame the held row is off as if the stamp were wrong by "
         "another 30 ms rms. Stamps are not changed for it; frames are moved back across the cloth where that is "
         "certain."),
        ("latency", 0.03, (0.02, 0.04), "s", True, "The held row is 0.030 s late [0.020 to 0.040 s] against the "
         "hanger's path. This was left in: the cause may be a clock, a tracker that lags, or the hanger."),
        ("skewed_grids", 0.05, None, "1", False, "10 of 200 grids (5 %) lie askew on the silhouette by more than 4 "
         "degrees. These grids are left out."),
        ("held_edge", 0.005, None, "m", False, "The held edge is taken from the top row of the points at rest, 4 mm "
         "lower and 3 mm further in than the hanger's path has it. The edge is as long as on the flat cloth."),
        ("frame_offsets", 0.009, None, "m", False, "While the hanger moves, whole frames are off across the cloth by 9 "
         "mm rms, as the held row shows, on which no physics acts. These frames are moved back by this shift."),
        ("sliding_points", 0.005, None, "m", False, "Points of a silhouette slide over the cloth, here by 5 mm rms. "
         "Each point got the material position at its distance from the held edge. 50 % of these positions are "
         "seen."),
        ("eaten_border", 0.006, (0.006 - border, 0.006 + border), "m", False, "The silhouette ends inside the cloth: "
         "by 10.0 mm [9.0 to 11.0] at the bottom and 4.0 mm [3.0 to 5.0] at each side. Positions beyond it count as "
         "unseen."),
        ("eaten_by_pose", 0.03, (0.029, 0.031), "m", False, "The silhouette's length depends on pose: the silhouette "
         "loses 30 mm per unit of lean [29 to 31]. Positions beyond it count as unseen."),
        ("depth_scale", 0.02, (0.015, 0.025), "1", True, "The held row travels 2.0 % [1.5 to 2.5] farther than the "
         "hanger, away from the camera and back: depths and path differ in scale. This was left in."),
        ("lean", 0.02, (0.01, 0.03), "rad", True, "At rest the cloth leans out of the vertical by 1.1 degrees [0.6 to "
         "1.7]. Gravity or the camera is tilted, or a draught is steady. This was left in."),
    ]  # fmt: skip
    told = found(one, left)
    assert [(f.name, f.unit, f.is_left, f.sentence) for f in told] == [
        (name, unit, is_left, sentence) for name, _, _, unit, is_left, sentence in expected
    ]
    for finding, (_, figure, interval, *_) in zip(told, expected, strict=True):
        assert finding.figure == pytest.approx(figure)
        assert finding.interval == (None if interval is None else pytest.approx(interval))
        assert finding.take_ids == (["b"] if finding.figure == 0.03 and finding.name == "latency" else ["a"])
        assert not finding.is_fault
    assert camera_clause(told) == (
        " Corrected before anything was fitted: stamps 0.050 s late [0.040 to 0.060 s]; time stamps that are late by "
        "0.80 of the excess of the frame interval; 5 % skewed grids; a held edge 5 mm from where the path has it; "
        "whole frames that are off by 9 mm rms; points that slide over the cloth, by 5 mm rms; a border eroded by 6.0 "
        "mm, the mean of its three sides; an outline that depends on pose, by 30 mm per unit of lean."
    )

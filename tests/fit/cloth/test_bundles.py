"""What the rollout kernel is given goes by names alone."""

from __future__ import annotations

import inspect

import pytest

from fit import runtime
from fit.cloth import bundles
from fit.cloth.bundles import Grip, Kind, Points, by_name

PLAIN = Kind(
    lanes=1, face_forces=(), fibre_nodes=(4, 4), bend_lengths=(4,), handles=2, with_twist=False, is_crossed=False,
    with_bends=False, with_added_mass=False, with_viscosity=False, with_contact=False,
)  # fmt: skip
GIVEN = (
    bundles.Motion, bundles.Membrane, bundles.Strains, bundles.Stencils, bundles.Facing, bundles.Touch, Grip, Points,
    bundles.Pull, bundles.Candidates, bundles.Clock, bundles.Results,
)  # fmt: skip


def test_the_kernels_64_parameters_are_the_fields_of_twelve_bundles():
    """64 are as many as Taichi takes; the kernel is built here, and compiled nowhere."""
    runtime.start()
    from fit.cloth.rollout import make_rollout

    fields = [name for bundle in GIVEN for name in bundle._fields]
    assert len(fields) == 64
    assert sorted(inspect.signature(make_rollout(PLAIN)).parameters) == sorted(fields)


def test_a_field_that_two_bundles_hold_is_refused():
    grip, points = Grip(held=1, shares=2, path=3, settle_damping=4.0), Points(5, 6, 7)
    assert by_name([grip, points])["point_nodes"] == 6
    with pytest.raises(ValueError, match="two bundles hold held, path, settle_damping, shares"):
        by_name([grip, points, grip])

"""Arguments of the rollout kernel are passed by name only."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from fit import runtime
from fit.cloth import bundles
from fit.cloth.bundles import Grip, Kind, Points, by_name
from fit.cloth.contact import Contact
from fit.cloth.material import Material
from fit.cloth.model import ClothModel
from fit.effects import find_effects
from fit.recordings.recording import prepare
from tests.fit.scenes import as_rows, sheet, take_of

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


def test_a_candidates_numbers_stand_under_their_names():
    """Warp, down the cloth, is e^(1/2) times as stiff as the mean, weft as much less; gravity is doubled and tilted."""
    material = Material(
        areal_density=0.3, stretch_stiffness=200.0, shear_stiffness=20.0, bending_stiffness=3e-5,
        membrane_damping_time=1e-5, bending_damping_time=2e-3, velocity_damping=0.7, stretch_ratio=1.0,
        bending_ratio=-1.0, stiffening=4.0, tilt_x=0.1, tilt_y=-0.2, viscosity_time=3e-4, gravity_log=np.log(2.0),
    )  # fmt: skip
    still = prepare(take_of(sheet(), np.arange(20) / 30, np.zeros((20, 3))))
    model = ClothModel(still, find_effects(["bending_hysteresis", "self_contact"]), contact=Contact(thickness=1e-3))
    found = bundles.Row(*model.kernel_rows(as_rows([material]), np.array([[2e-4, 5e-3]]))[0])
    g, root = 2 * 9.80665, np.exp(0.5)
    sideways = np.sin(0.1), np.sin(-0.2)
    expected = bundles.Row(
        stretch_down=200.0 * root, stretch_across=200.0 / root, shear=20.0, bending_down=3e-5 / root,
        bending_across=3e-5 * root, bending_mixed=3e-5, membrane_time=1e-5, bending_time=2e-3, velocity_damping=0.7,
        stiffening=4.0, gravity_x=g * sideways[0], gravity_y=g * sideways[1],
        gravity_z=-g * np.sqrt(1 - sideways[0] ** 2 - sideways[1] ** 2), friction_limit=2e-4, viscosity_time=3e-4,
        thickness=6e-3, density=0.3, shear_down=0.0, shear_across=0.0,
    )  # fmt: skip
    assert found._asdict() == pytest.approx(expected._asdict())

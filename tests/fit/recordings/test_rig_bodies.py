"""Walls, poles and balls of a rig: their positions, their contact with cloth, and refused requests."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.engines import BlenderEngine
from fit.errors import FitError
from fit.identification.calibrate import Model
from fit.identification.request import request_of
from fit.methods import KINECT_SKIRT, SI
from fit.recordings.recording import prepare
from formats.rig import RigBody
from tests.fit.scenes import hung, material, shared, sheet, swing, take_of

TIME = np.arange(0, 3, 1 / 30)
POLE = RigBody(kind="capsule", at_m=(-0.4, 0.07, -0.35), to_m=(0.4, 0.07, -0.35), radius_m=0.03)


@shared
def a_take(*bodies, gravity=(0.0, 0.0, -1.0)):
    """A sheet of 0.40 m x 0.45 m swung by 80 mm through its plane, near the bodies."""
    garment, path = sheet(), swing(TIME)
    take = take_of(garment, TIME, path, hung(garment, TIME) + path[:, None])
    return dataclasses.replace(
        take, rig=msgspec.structs.replace(take.rig, format="hangtime-rig/2", gravity=gravity, bodies=bodies)
    )


def test_bodies_stand_where_the_rig_says_in_the_world():
    """Seen by a level sensor, gravity along its y: what is 0.5 m below and 2 m away is at y = 2, z = -0.5."""
    wall = RigBody(kind="plane", at_m=(0.0, 0.5, 2.0), normal=(0.0, 0.0, -3.0))
    ball = RigBody(kind="sphere", at_m=(0.1, 0.5, 2.0), radius_m=0.2)
    pole = RigBody(kind="capsule", at_m=(0.1, 0.5, 2.0), to_m=(0.1, 0.9, 2.0), radius_m=0.03)
    garment, away = sheet(), np.array([0.0, 1.0, 0.0])
    take = dataclasses.replace(a_take(wall, ball, pole, gravity=(0.0, 1.0, 0.0)))
    seen = hung(garment, TIME)[..., [0, 2, 1]] * [1.0, -1.0, 1.0]  # the sheet as that sensor sees it, 1 m away
    take = dataclasses.replace(take, points=seen + away[[0, 2, 1]], held=take.held[..., [0, 2, 1]] + away[[0, 2, 1]])
    wall_at, ball_at, pole_at = prepare(take).bodies
    place = np.array([[0.1, 2.0, -0.5], [0.1, 1.0, -0.5], [0.1, 2.0, -1.2]])
    assert wall_at.distance(place) == pytest.approx([0.0, 1.0, 0.0])
    assert ball_at.distance(place) == pytest.approx([-0.2, 0.8, 0.5])
    assert pole_at.distance(place) == pytest.approx([-0.03, 0.97, 0.27])


@pytest.mark.slow
def test_cloth_swings_against_a_pole_of_its_rig_and_not_through_it():
    """Without the pole the sheet goes through it, nodes more than 10 mm deep; with it, less than 1 mm."""
    inside = {}
    for name, take in (("free", a_take()), ("stopped", a_take(POLE))):
        recording = prepare(take)
        simulator = Simulator(recording)
        moved = simulator.run(material(take.garment, velocity_damping=1.0), shapes=True)
        (pole,) = prepare(a_take(POLE)).bodies
        inside[name] = -float(pole.distance(moved.shapes[0].astype(float)).min())
    assert inside["free"] > 0.01
    assert inside["stopped"] < 1e-3


REQUEST = request_of(SI, [], iterations=1, seed=0, spacing=Resolution().spacing)


def test_the_cloth_of_a_fit_to_a_take_beside_a_pole_touches_it_and_other_cloth_nothing():
    """`tests/fit/cloth/test_contact_in_motion.py` says what comes of it; to compile contact takes seconds."""
    recordings = prepare(a_take()), prepare(a_take(POLE))
    free, stopped = (engine.simulator for engine in Model(list(recordings), REQUEST).engines)
    assert (free.contact.bodies, stopped.contact.bodies) == ((), recordings[1].bodies)
    kinds = [cloth.groups(material(sheet()), None, shapes=False)[1][0].touches for cloth in (free, stopped)]
    assert kinds == [False, True]


@pytest.mark.slow
def test_a_fit_to_a_take_beside_a_pole_simulates_the_pole():
    free, stopped = (Model([prepare(take)], REQUEST).error_before.mean_m for take in (a_take(), a_take(POLE)))
    assert abs(free - stopped) > 1e-3


def test_a_body_in_the_hangers_path_is_refused():
    """The hanger swings 76 mm forward: 26 mm into a wall that is 50 mm away."""
    wall = RigBody(kind="plane", at_m=(0.0, 0.05, 0.0), normal=(0.0, -1.0, 0.0))
    with pytest.raises(FitError, match=r"comes \d\d mm into the rig's body 2, a plane; check where it stands"):
        prepare(a_take(POLE, wall))


def test_blender_is_given_no_bodies():
    with pytest.raises(FitError, match="Blender's cloth is given no bodies"):
        BlenderEngine(prepare(a_take(POLE)), KINECT_SKIRT, (), Simulator(prepare(a_take())).resolution)

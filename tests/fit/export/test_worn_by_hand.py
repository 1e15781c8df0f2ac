"""What a garment on a figure is simulated with and what is said of it, with a simulator that holds the cloth still."""

from __future__ import annotations

from types import SimpleNamespace
from typing import ClassVar

import msgspec
import numpy as np
import pytest

from fit.cloth import material as mat
from fit.errors import BlowUpError, FitError
from fit.export import worn as worn_module
from fit.export.fabric import fabric_of
from fit.export.new_motion import hung_still
from fit.export.worn import FigureOrder, _less_damped, _remarks, _shortened, _stretched, worn
from fit.figure.dressmaking import plain_skirt, sewn_skirt
from fit.figure.gait import ARM_OUT, walk
from fit.figure.parts import TOUCHING_PARTS
from fit.figure.wearing import Trouble
from tests.fit.export.exported import a_fit

QUADS = np.array([[0, 1, 2, 3]])
REST = np.array([[0.0, 0.0], [0.1, 0.0], [0.0, -0.1], [0.1, -0.1]])
IDENTITY = SimpleNamespace(apply=lambda places: places)


class Still:
    """A simulator of four nodes that stay where they are; it records what it was asked."""

    made: ClassVar[dict] = {}
    shapes = np.repeat(np.column_stack([REST[:, 0], 0 * REST[:, 0], REST[:, 1]])[None], 60, 0)[None]

    def __init__(self, recording, effects, **more):
        self.mesh = SimpleNamespace(area=0.48, rest=REST)
        self.surface = SimpleNamespace(quads=QUADS, samples=IDENTITY)
        Still.made = {"recording": recording, "effects": [e.name for e in effects], **more}

    def run(self, row, amplitudes, *, shapes, progress):
        Still.made |= {"row": row, "amplitudes": amplitudes}
        return SimpleNamespace(shapes=self.shapes, points=np.zeros((1, 60, 4, 3)))


@pytest.fixture
def still(monkeypatch):
    """The trouble that is seen can be set."""
    seen = SimpleNamespace(
        depths=np.full((60, len(TOUCHING_PARTS)), -0.003), through=np.zeros((60, len(TOUCHING_PARTS)), bool)
    )

    def wear(recording, figure, seconds, fps):
        Still.worn = recording, figure, seconds, fps
        still = SimpleNamespace(time=np.arange(60) / 30, held=recording.held)
        return SimpleNamespace(recording=still, support="support", contact="contact")

    patches = {
        "Simulator": Still, "wear": wear, "divided": lambda mesh, spacing: (IDENTITY, QUADS),
        "looked_at": lambda surface, shapes, time, bodies, motion: Trouble(seen.depths, seen.through),
        "crossings": lambda surface, nodes: 0,
    }  # fmt: skip
    for name, value in patches.items():
        monkeypatch.setattr(worn_module, name, value)
    return seen


def test_a_skirt_of_the_fabric_has_its_weight_and_its_stiffness_in_both_layers(still):
    """0.2 kg/m^2 on a front of 0.24 m^2: 96 g of front and back on the mesh's 0.48 m^2."""
    result = a_fit(effects={"air_drag": 1.3, "time_offset": 0.02})
    made = worn(result, None, FigureOrder(), 2.0)
    (row,) = Still.made["row"]
    assert row[mat.DENSITY] == pytest.approx(0.2)
    assert row[[mat.STRETCH, mat.SHEAR, mat.BENDING]] == pytest.approx([100.0, 30.0, 1.4e-5])
    assert (Still.made["effects"], Still.made["amplitudes"].tolist()) == (["air_drag"], [[1.3]])
    assert Still.made["resolution"].spacing == 0.03
    assert (Still.made["support"], Still.made["contact"]) == ("support", "contact")
    _, figure, seconds, fps = Still.worn
    assert (seconds, fps) == (2.0, 30.0)
    assert made.name == "skirt of the fabric"
    assert made.triangles.tolist() == [[0, 2, 3], [0, 3, 1]]
    assert made.figure.names == figure.names
    assert made.remarks == (
        "The skirt crosses itself in none of 60 frames.", "Cloth and body stay at least 3.0 mm apart.",
    )  # fmt: skip
    worn(result, None, FigureOrder(), 2.0, spacing=0.05)
    assert Still.made["resolution"].spacing == 0.05


def test_a_sheet_that_is_both_layers_shares_what_it_bears_among_them(still):
    """Half of the weight, the stretch, shear and bending stiffness; times stay."""
    both = msgspec.structs.replace(plain_skirt(0.2), layers=2)
    worn(a_fit(layers=2), both, FigureOrder(), 2.0)
    (row,) = Still.made["row"]
    assert row[mat.DENSITY] == pytest.approx(0.1)
    assert row[[mat.STRETCH, mat.SHEAR, mat.BENDING]] == pytest.approx([50.0, 15.0, 0.7e-5])
    assert row[[mat.BENDING_TIME, mat.VELOCITY]] == pytest.approx([2e-3, 0.5])


def test_a_t_shirts_bending_is_damped_for_two_milliseconds_at_most_and_a_skirts_as_in_the_fit(still):
    result = a_fit(values={"bending_damping_time": 8e-3})
    skirt = worn(result, None, FigureOrder(), 2.0)
    assert Still.made["row"][0, mat.BENDING_TIME] == pytest.approx(8e-3)
    assert len(skirt.remarks) == 2
    still.depths, still.through = np.full((60, 13), -0.003), np.zeros((60, 13), bool)
    shirt = worn(result, None, FigureOrder(wear="t-shirt"), 2.0)
    assert Still.made["row"][0, mat.BENDING_TIME] == pytest.approx(2e-3)
    assert shirt.remarks[0] == "Bending damps over 2 ms here and over 8 ms in the fit: its steps are longer."
    assert shirt.remarks[1].startswith("The T-shirt crosses itself in none")
    worn(a_fit(values={"bending_damping_time": 1e-3}), None, FigureOrder(wear="t-shirt"), 2.0)
    assert Still.made["row"][0, mat.BENDING_TIME] == pytest.approx(1e-3)


def test_the_part_that_goes_through_the_cloth_and_its_frame_are_named(still):
    still.through[45, TOUCHING_PARTS.index("left_shank")] = True
    with pytest.raises(FitError, match=r"walks through the cloth with its left shank in frame 45, at 1\.50 s") as told:
        worn(a_fit(), None, FigureOrder(), 2.0)
    assert told.value.advice == "let it move slower, or give a wider skirt"


def test_cloth_that_blows_up_on_the_figure_is_refused(still, monkeypatch):
    for shapes in (np.where(np.arange(60)[:, None, None] == 59, np.nan, Still.shapes), None):
        monkeypatch.setattr(Still, "shapes", shapes)
        with pytest.raises(BlowUpError, match="the skirt on the figure blew up; use a coarser mesh"):
            worn(a_fit(), None, FigureOrder(), 2.0)


@pytest.mark.parametrize(
    ("changes", "seconds", "reason"),
    [
        ({"kind": "run"}, 4.0, "no figure moves by 'run'"), ({"wear": "hat"}, 4.0, "no figure wears 'hat'"),
        ({"height": 0.79}, 4.0, "nobody is 0.79 m tall"), ({"height": 2.31}, 4.0, "nobody is 2.31 m tall"),
        ({}, 1.9, "2 to 20 s"), ({}, 20.1, "2 to 20 s"), ({"speed": 3.0}, 4.0, "nobody walks at 3 m/s"),
        ({"height": 0.8}, 2.0, ""), ({"height": 2.3}, 20.0, ""),
    ],
)  # fmt: skip
def test_a_figure_is_as_tall_and_walks_as_long_as_people_do(changes, seconds, reason):
    if not reason:
        FigureOrder(**changes).check(seconds)
        return
    with pytest.raises(FitError, match=reason):
        FigureOrder(**changes).check(seconds)


def test_a_figures_joints_are_those_of_its_walk():
    made = FigureOrder(speed=0.9, height=1.8).skeleton(2.0)
    assert made.joints["left_knee"] == pytest.approx(walk(2.0, 0.9, 1.8, ARM_OUT).joints["left_knee"])


def test_a_motion_that_ends_a_frame_before_what_was_asked_is_remarked_on(tmp_path):
    order = FigureOrder(bvh=tmp_path / "a.bvh")
    assert _shortened(order, 4.0, 3.99) == ()
    assert _shortened(order, 4.0, 3.9) == (
        "a.bvh ends early: the motion lasts 3.9 s, its lead included, and not 4 s.",
    )  # fmt: skip
    assert _shortened(FigureOrder(), 4.0, 2.0) == ()
    assert _less_damped(2e-3, 2e-3) == ()


def test_strains_are_the_largest_of_any_side_and_frame_and_of_all_but_a_hundredth_of_a_frames_sides():
    """Of a hundred quads in a row of 0.1 m each, one is drawn out to 0.13 m in one frame, and all to 0.105 in another.

    Their other sides stay. The largest is 30 %. The 0.99 quantile of a frame's 200 sides is 5 % in the second.
    """
    count = 100
    rest = np.stack([np.repeat(0.1 * np.arange(count + 1), 2), np.tile([0.0, -0.1], count + 1)], 1)
    quads = np.array([[2 * k, 2 * k + 2, 2 * k + 1, 2 * k + 3] for k in range(count)])
    flat = np.column_stack([rest[:, 0], 0 * rest[:, 0], rest[:, 1]])
    one, all_of_them = flat.copy(), flat.copy()
    one[102:, 0] += 0.03
    all_of_them[:, 0] *= 1.05
    simulator = SimpleNamespace(surface=SimpleNamespace(quads=quads, samples=IDENTITY), mesh=SimpleNamespace(rest=rest))
    most, mostly = _stretched(simulator, np.stack([one, all_of_them, flat]))
    assert (most, mostly) == pytest.approx((0.3, 0.05))
    assert _stretched(simulator, 0.9 * flat[None])[1] == 0.0


def test_strains_of_fifteen_percent_are_remarked_on_beyond_that():
    assert len(_remarks("skirt", [0], -0.001, (0.15, 0.1))) == 2
    (_, _, far) = _remarks("skirt", [0, 2, 3], 0.0014, (0.22, 0.08))
    assert far.startswith("The skirt is stretched by up to 22 %, and 99 % of it by 8 % at most.")
    assert _remarks("skirt", [0, 2, 3], 0.0014, (0.0, 0.0)) == (
        "The skirt crosses itself in 2 of 3 frames, at 5 places in all.",
        "Cloth and body overlap by up to 1.4 mm; more than 12 mm are refused.",
    )


def test_a_skirt_goes_on_a_figure_as_it_hangs(still):
    """The recording that is put on is of the sewn garment, at rest and as wide as it is."""
    worn(a_fit(), None, FigureOrder(), 2.0)
    recording, *_ = Still.worn
    closed = sewn_skirt(plain_skirt(fabric_of(a_fit())["areal_density"].value))[0]
    assert recording.garment == hung_still(closed, "x").garment
    assert recording.held(np.zeros(1)).reshape(2, 3) == pytest.approx(np.array([[-0.2, 0, 0], [0.2, 0, 0]]), abs=1e-9)

"""The synthetic cloth has the given weight and stiffness, and refuses impossible values."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_host.synthetic.cloth import ClothPhysics, _Cloth, simulate
from firmware_host.synthetic.scene import demo_garment
from formats.errors import HangtimeError
from formats.garment import Garment
from formats.nature import AIR_DENSITY

TWO_SECONDS = np.arange(0.0, 2.0, 1 / 30)


def square() -> Garment:
    """0.4 m by 0.4 m and 40 g: on a square grid every cell is a square."""
    outline = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4))
    return Garment(
        format="hangtime-garment/1",
        name="square",
        kind="swatch",
        mass_kg=0.04,
        outline_m=outline,
        held="edge",
        points=(),
    )


def still_bar(time: np.ndarray) -> np.ndarray:
    return np.tile([[-0.2, -0.18, 1.6], [0.2, -0.18, 1.6]], (len(time), 1, 1))


def thread_energy(cloth: _Cloth, deformation: np.ndarray) -> float:
    """Energy of all threads and diagonals [J] when the flat cloth is deformed by a 2 x 2 matrix."""
    x = cloth.rest.reshape(-1, 2) @ deformation.T
    (begin, end), length, stiffness = cloth.threads
    return float((0.5 * stiffness * (np.linalg.norm(x[end] - x[begin], axis=1) - length) ** 2).sum())


def test_the_demo_skirt_weighs_35_grams_with_and_without_a_hem_of_10_grams() -> None:
    plain, hemmed = (_Cloth(demo_garment(), ClothPhysics(), {"hem": hem}, 18, 17).mass for hem in (0.0, 0.02))
    assert plain.sum() == pytest.approx(0.035, rel=1e-12)
    assert hemmed.sum() == pytest.approx(0.035, rel=1e-12)
    # 0.02 kg/m along 0.5 m is 10 g; the other 25 of 35 g stay spread as before.
    assert hemmed[-1].sum() == pytest.approx(0.010 + plain[-1].sum() * 25 / 35, rel=1e-9)


@pytest.mark.parametrize("nodes", [9, 17])
def test_a_square_cloth_resists_shear_with_40_newtons_per_metre_on_any_grid(nodes: int) -> None:
    cloth = _Cloth(square(), ClothPhysics(), {}, nodes, nodes)
    gamma = 1e-5
    sheared = thread_energy(cloth, np.array([[1.0, gamma / 2], [gamma / 2, 1.0]]))
    # 1/2 G gamma^2 times 0.16 m^2.
    assert 2 * sheared / 0.16 / gamma**2 == pytest.approx(40.0, rel=1e-3)


@pytest.mark.parametrize(("degrees", "share"), [(90.0, 1.0), (30.0, (0.05 + 0.95 * 0.5**1.5) * 0.5**2)])
def test_the_drag_on_a_flat_sheet_in_a_uniform_wind_is_the_law_of_its_module(degrees: float, share: float) -> None:
    """The sheet moves at 3 m/s at an angle to its plane; the sine of 30 degrees is 0.5."""
    cloth = _Cloth(square(), ClothPhysics(), {"air_drag": 1.2}, 9, 9)
    cloth.hang(still_bar(np.zeros(1))[0])
    angle = np.radians(degrees)
    cloth.v[:] = 3.0 * np.array([[np.cos(angle)], [0.0], [np.sin(angle)]])
    force = 4 * cloth._drag_of_cells()  # each of a cell's four corners takes as much
    whole = 0.5 * AIR_DENSITY * 1.2 * 0.16 * 3.0**2  # N, on 0.16 m^2 across the wind
    assert force.sum(axis=1) == pytest.approx([0.0, 0.0, -share * whole], rel=1e-9, abs=1e-12)
    assert force[2] == pytest.approx(-share * whole / 64, rel=1e-9)  # 8 x 8 cells of one size


@pytest.mark.parametrize("nodes", [9, 17])
def test_a_square_cloth_resists_stretch_with_threads_and_diagonals_together(nodes: int) -> None:
    cloth = _Cloth(square(), ClothPhysics(), {}, nodes, nodes)
    strain = 1e-5
    stretched = thread_energy(cloth, np.diag([1.0 + strain, 1.0]))
    # Threads 300 N/m and, as the cells are squares, the diagonals' 40 N/m on top.
    assert 2 * stretched / 0.16 / strain**2 == pytest.approx(340.0, rel=1e-3)


def test_the_settled_skirt_hangs_still_to_a_tenth_of_a_millimetre_for_two_seconds() -> None:
    nodes = simulate(demo_garment(), still_bar, TWO_SECONDS, physics=ClothPhysics(), effects={}, rows=8, columns=7)
    assert np.abs(nodes - nodes[0]).max() < 1e-4


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ({"hem": 1.0}, "hem cannot have the amplitude 1; choose 0 to 0.056 kg/m"),
        ({"hem": -0.01}, "hem cannot have the amplitude -0.01"),
        ({"air_drag": -1.0}, "air_drag cannot have the amplitude -1"),
        ({"air_drag": float("nan")}, "air_drag cannot have the amplitude nan"),
        ({"wind": 1.0}, "the synthetic cloth has no effect 'wind'"),
    ],
)
def test_an_effect_that_no_cloth_can_have_is_refused(effects: dict[str, float], words: str) -> None:
    # 80 % of 35 g along 0.5 m of hem is 0.056 kg/m.
    with pytest.raises(HangtimeError, match=words):
        simulate(demo_garment(), still_bar, TWO_SECONDS, physics=ClothPhysics(), effects=effects)


def test_a_time_that_is_not_a_number_is_refused() -> None:
    with pytest.raises(HangtimeError, match="frame times: not all are finite"):
        simulate(demo_garment(), still_bar, TWO_SECONDS * np.nan, physics=ClothPhysics(), effects={})

"""The synthetic cloth agrees with closed forms: its frequency, drag, hem and held edge."""

from __future__ import annotations

from collections.abc import Callable
from math import factorial

import numpy as np
import pytest

from firmware_host.synthetic.cloth import ClothPhysics, simulate
from firmware_host.synthetic.motion import HANGER_MOTIONS, hanger_pose
from firmware_host.synthetic.world import make_world
from formats.garment import Garment

WIDTH, HEIGHT = 0.2, 0.45  # m
TIME = np.arange(0.0, 3.5, 0.01)
# A heavy sheet hung by its edge, first mode: 2.4048 / 2 sqrt(g / L), from J0(2.4048) = 0 (D. Bernoulli, 1733).
HANGING_SHEET = 1.2024 * np.sqrt(9.80665 / HEIGHT) / (2 * np.pi)  # 0.893 Hz


def sheet() -> Garment:
    outline = ((-WIDTH / 2, 0.0), (WIDTH / 2, 0.0), (WIDTH / 2, -HEIGHT), (-WIDTH / 2, -HEIGHT))
    mass = 0.173 * WIDTH * HEIGHT
    return Garment(
        format="hangtime-garment/1",
        name="sheet",
        kind="swatch",
        mass_kg=mass,
        outline_m=outline,
        held="edge",
        points=(),
    )


def nudge(distance: float) -> Callable[[np.ndarray], np.ndarray]:
    """The bar moves away by `distance` metres within half a second."""

    def ends(time: np.ndarray) -> np.ndarray:
        s = np.clip(time / 0.5, 0, 1)
        z = 1.6 + distance * s**3 * (10 - 15 * s + 6 * s * s)
        return np.stack([np.stack([np.full_like(time, side), 0 * time, z], 1) for side in (-WIDTH / 2, WIDTH / 2)], 1)

    return ends


def first_mode(nodes: np.ndarray, distance: float) -> np.ndarray:
    """Share of the first mode, J0(2.4048 sqrt(s)) with s from the free edge, in the swing after the nudge [m]."""
    s = 1 - np.linspace(0, 1, nodes.shape[1])
    shape = sum((-1) ** k / factorial(k) ** 2 * (2.4048**2 * s / 4) ** k for k in range(12))
    weight = np.ones(len(s))
    weight[[0, -1]] = 0.5
    away = nodes[..., 2].mean(axis=2) - 1.6 - distance
    return (away * shape * weight).sum(axis=1) / (shape**2 * weight).sum()


def frequency(wave: np.ndarray) -> float:
    """Frequency [Hz] from the rising zero crossings after the nudge."""
    t, w = TIME[TIME > 0.6], wave[TIME > 0.6]
    i = np.flatnonzero((w[:-1] < 0) & (w[1:] >= 0))
    crossings = t[i] - w[i] * 0.01 / (w[i + 1] - w[i])
    return float(1 / np.diff(crossings).mean())


def swing(distance: float, effects: dict[str, float], time: np.ndarray = TIME) -> np.ndarray:
    return simulate(sheet(), nudge(distance), time, physics=ClothPhysics(), effects=effects, rows=12, columns=5)


@pytest.fixture(scope="module")
def small_swing() -> np.ndarray:
    return swing(0.01, {})


BEGIN = TIME[:61]  # s; the nudge, and a tenth more


@pytest.fixture(scope="module")
def begun_swing() -> np.ndarray:
    return swing(0.01, {}, BEGIN)


@pytest.mark.slow
def test_a_hanging_sheet_swings_at_bernoullis_frequency(small_swing: np.ndarray) -> None:
    # Eleven rows of cells and a bending stiffness of 3e-5 N m move it by less than 3 %.
    assert frequency(first_mode(small_swing, 0.01)) == pytest.approx(HANGING_SHEET, rel=0.03)


def test_the_cloth_hangs_still_before_the_motion_begins(begun_swing: np.ndarray) -> None:
    np.testing.assert_allclose(begun_swing[0, :, :, 2], 1.6, atol=1e-3)
    # Under its own weight of 1.7 N/m^2 it stretches by 1.7 * 0.45^2 / 2 / 300 = 0.57 mm.
    assert begun_swing[0, -1, 2, 1] == pytest.approx(HEIGHT + 0.57e-3, abs=0.4e-3)


def test_the_held_edge_follows_the_bar_exactly(begun_swing: np.ndarray) -> None:
    ends = nudge(0.01)(BEGIN)
    # Frames fall between two steps of a third of a millisecond or less.
    np.testing.assert_allclose(begun_swing[:, 0, 0], ends[:, 0], atol=1e-5)
    np.testing.assert_allclose(begun_swing[:, 0, -1], ends[:, 1], atol=1e-5)


@pytest.mark.slow
def test_air_drag_takes_more_than_a_tenth_of_the_swing() -> None:
    free, dragged = first_mode(swing(0.08, {}), 0.08), first_mode(swing(0.08, {"air_drag": 1.2}), 0.08)
    after = TIME > 1.5
    assert np.abs(dragged[after]).max() < 0.9 * np.abs(free[after]).max()


def test_drag_of_amplitude_zero_changes_nothing(begun_swing: np.ndarray) -> None:
    same = swing(0.01, {"air_drag": 0.0, "hem": 0.0}, BEGIN)
    np.testing.assert_array_equal(same[::10], begun_swing[::10])


@pytest.mark.slow
def test_a_heavy_hem_swings_more_slowly(small_swing: np.ndarray) -> None:
    # Towards a mass on a thread, sqrt(g / L) / (2 pi) = 0.743 Hz, that is 17 % below the even sheet.
    heavy = frequency(first_mode(swing(0.01, {"hem": 0.02}), 0.01))
    light = frequency(first_mode(small_swing, 0.01))
    assert 0.83 * light < heavy < 0.985 * light


@pytest.mark.parametrize("motion", sorted(HANGER_MOTIONS))
def test_a_motion_starts_and_ends_at_rest_and_stays_within_a_hands_speed(motion: str) -> None:
    time = np.arange(0, 8, 1 / 500)
    pose = hanger_pose(motion, time, seed=3, seconds=8.0)
    still = (time < 1.0) | (time > 0.65 * 8)
    assert np.abs(pose.displacement[still]).max() == 0.0
    speed = np.linalg.norm(np.diff(pose.displacement, axis=0), axis=1) * 500
    assert 0.02 < speed.max() < 1.5
    # Continuous acceleration: between two instants 2 ms apart it changes by a small part of its largest value.
    acceleration = np.diff(pose.displacement, 2, axis=0) * 500**2
    assert np.abs(np.diff(acceleration, axis=0)).max() < 0.15 * np.abs(acceleration).max()


def test_another_seed_is_another_hand_of_a_millimetre() -> None:
    time = np.arange(1.6, 4.8, 1 / 100)
    one, other = (hanger_pose("swing", time, seed, 8.0).displacement for seed in (1, 2))
    # Two independent jitters of 1 mm in all three axes together differ by 1.4 mm rms.
    assert np.sqrt(((one - other) ** 2).sum(axis=1).mean()) == pytest.approx(1.4e-3, rel=0.3)


@pytest.mark.slow
def test_a_skirt_of_felt_comes_to_rest_where_a_plain_one_still_swings() -> None:
    """Damped at 3.5 and 0.25 1/s: after a second exp(-1.6) is left of what the plain one keeps."""
    left = {}
    for fabric in ("plain", "felt"):
        world = make_world(motion="swing", effect="none", amplitude=None, seconds=5.0, seed=1, fabric=fabric)
        late = world.points[-15:]
        left[fabric] = float(np.ptp(late, axis=0).max())
    assert left["felt"] < 0.5 * left["plain"]

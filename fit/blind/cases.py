"""Cases of the blind check: three takes to fit and two held-out takes of one cloth, whose truth is withheld.

One random stream draws the look of a case: size, weight, points, rate, noise, gaps, length, camera. Another stream
draws its truth. So a look is independent of the truth. A null has no library effect, no air and no friction: linear
damping and random stiffness only.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from fit.blind.boundary import real_ends
from fit.blind.engine import SAMPLES_A_SECOND, Cloth
from fit.blind.foreign.engines import OWN_GENERATOR, Generator
from fit.blind.hands import HELD_OUT, TRAINING, move
from fit.blind.plants import UNKNOWNS, Plant, Planted, with_plants
from fit.blind.sensing import (
    HELD_SHARE,
    SLOW_PART,
    SPARE,
    gaps,
    reported_points,
    scaled,
    sensor_frame,
    slow_noise,
)
from fit.errors import BlowUpError
from formats.archive import write_take
from formats.arrays import Floats
from formats.garment import Garment, TrackedPoint
from formats.rig import Rig
from formats.take import Take

Kind = Literal["single", "null", "pair", "unknown"]

FILES = tuple(f"take-{k + 1}.mcap" for k in range(len(TRAINING))) + tuple(
    f"held-out-{k + 1}.mcap" for k in range(len(HELD_OUT))
)
PERFECT_SENSOR: Mapping[str, float] = {}
CREATED = "2000-01-01T00:00:00Z"  # creation time of every take, as true times would reveal the order of generation


class Look(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Public properties of a case, drawn independently of the planted effects.

    - `width`, `height`, `distance` [m]
    - `mass` [kg]
    - `grid`: points per side, 0 for corners and centre
    - `rate` [1/s]
    - `duration` [s]
    - `noise` [m]: white deviation per axis
    - `away`: share of the time in which a point is not seen
    - `tilt` [rad]: of the sensor
    """

    width: float
    height: float
    mass: float
    grid: int
    rate: float
    duration: float
    noise: float
    away: float
    tilt: tuple[float, float]
    distance: float

    def features(self) -> list[float]:
        """Return all properties of a look as numbers."""
        return [self.width, self.height, self.mass, self.grid, self.rate, self.duration, self.noise, self.away,
                *self.tilt, self.distance]  # fmt: skip


class Truth(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Full truth of a case: its label, its cloth [SI], its look and the seed of its other random numbers."""

    id: str
    kind: Kind
    planted: tuple[Planted, ...]
    stretch: float
    shear: float
    bending: float
    damping: float
    look: Look
    seed: int


def draw_truth(
    case_id: str,
    kind: Kind,
    plants: tuple[Plant, ...],
    seed: tuple[int, ...],
    sensor: Mapping[str, float] = PERFECT_SENSOR,
) -> Truth:
    """Draw one case: its planted effects, cloth, look and seed.

    - `plants`: planted effects: one for a single or unknown, two for a pair, none for a null
    - `sensor`: fields of the look with given values
    """
    looks, truths = (np.random.default_rng([*seed, stream]) for stream in (1, 2))
    look = msgspec.structs.replace(draw_look(looks), **sensor)
    cloth = draw_cloth(truths, look)
    return Truth(
        id=case_id, kind=kind, planted=tuple(plant.draw(truths, cloth) for plant in plants), stretch=cloth.stretch,
        shear=cloth.shear, bending=cloth.bending, damping=cloth.damping, look=look, seed=int(truths.integers(2**31)),
    )  # fmt: skip


def draw_look(rng: np.random.Generator) -> Look:
    """Draw the look of a case."""
    width, height = rng.uniform(0.30, 0.45, 2)
    density = _log_uniform(rng, 0.1, 0.35)  # kg/m^2, apparel
    return Look(
        width=float(width), height=float(height), mass=float(density * width * height),
        grid=int(rng.choice([9, 9, 8, 0])), rate=float(rng.choice([30, 45, 60])),
        duration=float(np.round(rng.uniform(3.2, 4.0), 2)), noise=float(_log_uniform(rng, 0.5e-3, 3e-3)),
        away=float(rng.uniform(0, 0.1)), tilt=(float(rng.uniform(-0.08, 0.08)), float(rng.uniform(-0.03, 0.03))),
        distance=float(rng.uniform(1.2, 1.8)),
    )  # fmt: skip


def draw_cloth(rng: np.random.Generator, look: Look) -> Cloth:
    """Draw base stiffness and damping of apparel; shear stiffness stays well below stretch stiffness."""
    stretch, shear = _log_uniform(rng, 100, 600), _log_uniform(rng, 10, 80)
    while shear > stretch / 4:
        stretch, shear = _log_uniform(rng, 100, 600), _log_uniform(rng, 10, 80)
    return Cloth(
        width=look.width, height=look.height, density=look.mass / (look.width * look.height), stretch=stretch,
        shear=shear, bending=_log_uniform(rng, 3e-6, 1e-4), damping=float(rng.uniform(0.3, 1.5)),
    )  # fmt: skip


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def plan(
    numbers: dict[Kind, int], plants: tuple[Plant, ...], seed: int, unknowns: tuple[Plant, ...] = UNKNOWNS,
    sensor: Mapping[str, float] = PERFECT_SENSOR,
) -> list[Truth]:  # fmt: skip
    """Draw all cases of a set in random order: every effect equally often, pairs of two different ones.

    - `numbers`: of singles, nulls, pairs and unknowns
    - `unknowns`: the effects outside the library to choose from
    - `sensor`: fields of every look with given values; all other properties of the cases are independent of them
    """
    rng = np.random.default_rng([seed, 0])
    wanted: list[tuple[Kind, tuple[Plant, ...]]] = [("null", ())] * numbers["null"]
    wanted += [("single", (plant,)) for plant in rounds(rng, plants, numbers["single"])]
    wanted += [("unknown", (plant,)) for plant in rounds(rng, unknowns, numbers["unknown"])]
    for _ in range(numbers["pair"]):
        first, second = rng.choice(len(plants), 2, replace=False)
        wanted.append(("pair", (plants[first], plants[second])))
    order = rng.permutation(len(wanted))
    names = drawn_names(rng, len(wanted))
    return [
        draw_truth(name, wanted[k][0], wanted[k][1], (seed, number), sensor)
        for number, (name, k) in enumerate(zip(names, order, strict=True))
    ]


def drawn_names(rng: np.random.Generator, count: int) -> list[str]:
    """Draw distinct random names of cases."""
    names: list[str] = []
    while len(names) < count:
        name = rng.bytes(4).hex()
        names += [name] * (name not in names)
    return names


def rounds(rng: np.random.Generator, plants: tuple[Plant, ...], count: int) -> list[Plant]:
    """Return every plant equally often, with the remainder drawn without replacement."""
    drawn: list[Plant] = []
    while len(drawn) < count:
        drawn += [plants[k] for k in rng.permutation(len(plants))]
    return drawn[:count]


def write_case(
    folder: Path, truth: Truth, *, side: float | None = None, generator: Generator = OWN_GENERATOR
) -> list[Path]:
    """Simulate a case and write its takes; the folder appears atomically.

    Raises:
        BlowUpError: the simulation does not stay finite even with a quarter of the step.
        FitError: the generator's engine is not there.
    """
    with whole_case(folder) as partial:
        for name, take in zip(FILES, make_takes(truth, side=side, generator=generator), strict=True):
            write_take(partial / name, take)
    return [folder / name for name in FILES]


@contextmanager
def whole_case(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder for a case, which becomes `folder` when the case is complete."""
    partial = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    yield partial
    shutil.rmtree(folder, ignore_errors=True)
    partial.replace(folder)


def make_takes(truth: Truth, *, side: float | None = None, generator: Generator = OWN_GENERATOR) -> list[Take]:
    """Simulate a case and return its takes, three for training and two held out; side [m]: of the generator's mesh."""
    look, rng = truth.look, np.random.default_rng(truth.seed)
    cloth = _cloth(truth)
    garment = _garment(look)
    flat = np.array([p.at_m for p in garment.points])
    measured = [move(rng, k, look.duration, look.width, look.height, truth.damping) for k in TRAINING + HELD_OUT]
    after = round(SPARE * SAMPLES_A_SECOND)
    driven = [real_ends(ends, truth.planted, k) for k, ends in enumerate(measured)]
    driven = [np.concatenate([ends, np.repeat(ends[-1:], after, 0)]) for ends in driven]
    length = (len(driven[0]) - 1) / SAMPLES_A_SECOND
    for share in (1.0, 0.5, 0.25):
        try:
            points = generator.points(cloth, np.stack(driven), length, flat, side=side or generator.side, share=share)
            break
        except BlowUpError:
            if share == 0.25:
                raise
    return [
        _take(truth, garment, f"{truth.id}-{FILES[k].removesuffix('.mcap')}", ends, points[k], rng)
        for k, ends in enumerate(measured)
    ]


def _cloth(truth: Truth) -> Cloth:
    look = truth.look
    cloth = Cloth(
        width=look.width, height=look.height, density=look.mass / (look.width * look.height), stretch=truth.stretch,
        shear=truth.shear, bending=truth.bending, damping=truth.damping,
    )  # fmt: skip
    return with_plants(cloth, truth.planted)


def _garment(look: Look) -> Garment:
    half, low = look.width / 2, -look.height
    outline = ((-half, 0.0), (half, 0.0), (half, low), (-half, low))
    if look.grid:
        places = [
            (f"row{r}_col{c}", (float(x), float(y)))
            for r, y in enumerate(np.linspace(0, low, look.grid))
            for c, x in enumerate(np.linspace(-half, half, look.grid))
        ]
    else:
        corners = ("top_left", "top_right", "bottom_right", "bottom_left")
        places = [*zip(corners, outline, strict=True), ("centre", (0.0, low / 2))]
    return Garment(
        format="hangtime-garment/1", name="swatch", kind="swatch", mass_kg=look.mass, outline_m=outline, held="edge",
        points=tuple(TrackedPoint(name=name, at_m=at) for name, at in places),
    )  # fmt: skip


def _take(truth: Truth, garment: Garment, name: str, ends: Floats, points: Floats, rng: np.random.Generator) -> Take:
    """Convert motion in the world frame into a take in the sensor's frame, with noise and gaps."""
    look = truth.look
    time = np.arange(int(look.duration * look.rate) + 1) / look.rate
    time = time[time <= look.duration]
    flat = np.array([p.at_m for p in garment.points])
    seen = reported_points(points, time, flat, truth.planted)
    held = np.stack([np.interp(time, np.arange(len(ends)) / SAMPLES_A_SECOND, column) for column in ends.T], 1)
    rotation, away = sensor_frame(look.tilt), np.array([0.0, -look.height / 2, look.distance])
    seen, held = seen @ rotation.T + away, held.reshape(-1, 2, 3) @ rotation.T + away
    for one in truth.planted:
        if one.id == "depth_scale":
            share = one.components["points"] or one.components["scene"]
            seen = scaled(seen, share, look.distance)
            held = scaled(held, one.components["scene"], look.distance)
    seen += look.noise * (rng.normal(size=seen.shape) + SLOW_PART * slow_noise(rng, seen.shape, look.rate))
    held = held + HELD_SHARE * look.noise * rng.normal(size=held.shape)
    valid = gaps(rng, (len(time), len(flat)), look.away)
    seen[~valid] = np.nan
    total = look.noise * np.sqrt(1 + SLOW_PART**2)
    down = rotation @ [0.0, 0.0, -1.0]
    return Take(
        take_id=name, created=CREATED, garment=garment,
        rig=Rig(format="hangtime-rig/1", name="rig", gravity=(float(down[0]), float(down[1]), float(down[2]))),
        time=time, held=held, held_valid=np.ones((len(time), 2), bool),
        held_sd=np.full(held.shape, HELD_SHARE * look.noise), points=seen, points_valid=valid,
        points_sd=np.full(seen.shape, total), state=np.zeros(len(time), np.uint16), markers=held.copy(),
    )  # fmt: skip

"""One blind case: cloth, hand, sensor noise and takes, drawn independently of what is planted.

Noise of every point: white, and slow with a correlation time of 0.3 s at a third of its size; a few points drop out.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from fit.blind.engine import SAMPLES, Drive, Plan, simulate
from fit.blind.motions import HELD_OUT, TRAINING, HandMotion
from fit.blind.plants import PLANTS, STRANGERS, Case
from fit.blind.sheet import Sheet, build_sheet
from formats.garment import Garment, TrackedPoint
from formats.rig import Rig
from formats.take import Take

Floats = NDArray[np.float64]

SPACING = 0.03  # m: the diagnosis' own mesh has 0.05 m
SENSOR_DISTANCE = 1.5  # m along y
SLOW_SHARE, SLOW_TIME = 1 / 3, 0.3  # of the white noise; s
HELD_SD = 2e-4  # m


@dataclass(frozen=True)
class Description:
    """What everybody may know of a case; nothing in it depends on the label."""

    width: float
    height: float
    density: float
    layout: str
    seconds: float
    rate: float
    noise: float
    dropout: float
    seed: int


@dataclass(frozen=True)
class Label:
    """What is planted: names and amplitudes; kind is `null`, `single`, `pair` or `stranger`."""

    kind: str
    names: tuple[str, ...] = ()
    amplitudes: tuple[float, ...] = ()


def draw_description(rng: np.random.Generator) -> Description:
    """Draw the public side of a case."""
    return Description(
        width=float(rng.uniform(0.3, 0.42)), height=float(rng.uniform(0.3, 0.45)),
        density=float(np.exp(rng.uniform(np.log(0.1), np.log(0.35)))),
        layout=str(rng.choice(["9x9", "8x8", "5"], p=[0.5, 0.3, 0.2])), seconds=float(rng.uniform(3.0, 3.8)),
        rate=float(rng.choice([30.0, 40.0, 60.0])), noise=float(np.exp(rng.uniform(np.log(0.0005), np.log(0.003)))),
        dropout=float(rng.uniform(0, 0.1)), seed=int(rng.integers(2**31)),
    )  # fmt: skip


def draw_label(kind: str, name: str, rng: np.random.Generator) -> Label:
    """Draw amplitudes; `name` is one effect, two joined by `+`, or empty for a null."""
    names = tuple(n for n in name.split("+") if n)
    known = {**PLANTS, **STRANGERS}
    sizes = tuple(float(known[n].typical * np.exp(rng.uniform(np.log(0.5), np.log(3.0)))) for n in names)
    return Label(kind, names, sizes)


def make_takes(case_id: str, about: Description, label: Label) -> tuple[list[Take], list[Take]]:
    """Simulate a case; return training and held-out takes.

    Raises:
        BlowUpError: the generator's cloth became unstable.
    """
    rng = np.random.default_rng(about.seed)
    sheet = build_sheet(about.width, about.height, SPACING, rng)
    plan = _fabric(about, rng)
    places = _places(about)
    time = np.arange(0.0, about.seconds, 1 / about.rate)
    motions = [make(rng) for make in (*TRAINING, *HELD_OUT)]
    true_paths = [_path(sheet, m, about.seconds) for m in motions]
    # Everything above is drawn before the label acts, so that it does not depend on it.
    case = Case(
        sheet, plan, list(true_paths), [time.copy() for _ in motions], places, np.random.default_rng(about.seed + 1)
    )
    for name, amplitude in zip(label.names, label.amplitudes, strict=True):
        {**PLANTS, **STRANGERS}[name].apply(case, amplitude)
    drives = [Drive(p, t) for p, t in zip(case.paths, case.times, strict=True)]
    points = simulate(sheet, case.plan, drives, places)
    takes = []
    noise = np.random.default_rng(about.seed + 2)
    for number, (true, path) in enumerate(zip(points, true_paths, strict=True)):
        seen = true
        for observe in case.observers:
            seen = observe(seen, time)
        ends = _at(path[:, [0, -1]], time) * case.hanger_scale
        takes.append(_take(f"{case_id}-{number + 1}", about, time, ends, seen, noise))
    return takes[: len(TRAINING)], takes[len(TRAINING) :]


def _fabric(about: Description, rng: np.random.Generator) -> Plan:
    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    stretch, bending = log(100, 600), log(3e-6, 8e-5)
    return Plan(
        warp=stretch, weft=stretch, shear=log(10, 80), poisson=float(rng.uniform(0, 0.25)), bending=(bending, bending),
        density=about.density, damping=float(rng.uniform(0.3, 1.5)),
    )  # fmt: skip


def _places(about: Description) -> Floats:
    half = about.width / 2
    if about.layout == "5":
        return np.array([[-half, 0], [half, 0], [half, -about.height], [-half, -about.height], [0, -about.height / 2]])
    side = int(about.layout[0])
    y, x = np.meshgrid(np.linspace(0, -about.height, side), np.linspace(-half, half, side), indexing="ij")
    return np.stack([x.ravel(), y.ravel()], 1)


def _path(sheet: Sheet, motion: HandMotion, seconds: float) -> Floats:
    """Path of the held nodes in front of a sensor at the origin that looks along y, (samples, held, 3)."""
    t = np.arange(0.0, seconds + 0.3, 1 / SAMPLES)
    arm = np.stack([sheet.rest[sheet.top, 0], 0 * sheet.rest[sheet.top, 0], 0 * sheet.rest[sheet.top, 0]], 1)
    yaw, roll = motion.yaw(t)[:, None], motion.roll(t)[:, None]
    x = arm[None, :, 0]
    turned = np.stack([x * np.cos(yaw) * np.cos(roll), x * np.sin(yaw) * np.cos(roll), x * np.sin(roll) + 0 * yaw], 2)
    middle = motion.displacement(t) + np.array([0.0, SENSOR_DISTANCE, 0.2])
    return np.asarray(middle[:, None] + turned)


def _at(path: Floats, time: Floats) -> Floats:
    stamps = np.arange(len(path)) / SAMPLES
    flat = path.reshape(len(path), -1)
    return np.stack([np.interp(time, stamps, column) for column in flat.T], 1).reshape(len(time), *path.shape[1:])


def _take(name: str, about: Description, time: Floats, ends: Floats, true: Floats, rng: np.random.Generator) -> Take:
    white = rng.normal(0, about.noise, true.shape)
    keep = np.exp(-1 / about.rate / SLOW_TIME)
    slow = np.zeros_like(true)
    slow[0] = rng.normal(0, 1, true.shape[1:])
    for k in range(1, len(slow)):
        slow[k] = keep * slow[k - 1] + np.sqrt(1 - keep**2) * rng.normal(0, 1, true.shape[1:])
    seen = rng.random(true.shape[:2]) >= about.dropout
    points = np.where(seen[..., None], true + white + SLOW_SHARE * about.noise * slow, np.nan)
    half = about.width / 2
    count = true.shape[1]
    garment = Garment(
        format="hangtime-garment/1", name="swatch", kind="swatch", mass_kg=about.density * about.width * about.height,
        outline_m=((-half, 0.0), (half, 0.0), (half, -about.height), (-half, -about.height)), held="edge",
        points=tuple(
            TrackedPoint(name=f"p{k}", at_m=(float(x), float(y))) for k, (x, y) in enumerate(_places(about))
        ),
    )  # fmt: skip
    held = ends + rng.normal(0, HELD_SD, ends.shape)
    return Take(
        take_id=name, created=datetime(2026, 1, 1, tzinfo=UTC).isoformat(),
        rig=Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 0.0, -1.0)), garment=garment, time=time, held=held,
        held_valid=np.ones((len(time), 2), bool), held_sd=np.full((len(time), 2, 3), HELD_SD), points=points,
        points_valid=seen, points_sd=np.full((len(time), count, 3), about.noise), state=np.zeros(len(time), np.uint16),
        markers=held,
    )  # fmt: skip


def as_record(label: Label) -> dict[str, object]:
    """Return a label as plain values."""
    return dataclasses.asdict(label)

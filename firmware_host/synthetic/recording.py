"""Make a sensor recording without a sensor, with its truth beside it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from firmware_host.errors import RecordingError, SensorAddressError
from firmware_host.oni_writer import OniWriter
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import CAMERA, FPS, RIG
from firmware_host.synthetic.world import FIRST_STAMP, TYPICAL, Progress, World, make_world
from formats.descriptions import dump_description


def make_recording(
    out: Path, name: str, *, motion: str = "swing", effect: str = "air_drag", amplitude: float | None = None,
    seconds: float = 8.0, seed: int = 1, garment: str = "skirt", progress: Progress = lambda stage, share: None,
) -> list[Path]:  # fmt: skip
    """Write NAME.oni, NAME.truth.npz, rig.toml and garment.toml into a folder and return their paths.

    Raises:
        RecordingError: the folder cannot be written; SensorAddressError: no such motion, effect or garment.
    """
    if garment not in GARMENTS:
        raise SensorAddressError(
            f"the synthetic world has no garment {garment!r}", advice=f"choose of {', '.join(GARMENTS)}"
        )
    worn = GARMENTS[garment]()
    world = make_world(
        motion=motion, effect=effect, amplitude=amplitude, seconds=seconds, seed=seed, garment=worn,
        progress=lambda stage, share: progress(stage, 0.3 * share),
    )  # fmt: skip
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"cannot be made ({error.strerror})", where=out, advice="choose another folder") from error
    recording, partial = out / f"{name}.oni", out / f"{name}.oni.partial"
    try:
        _write_frames(partial, world, progress)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    partial.replace(recording)
    truth = out / f"{name}.truth.npz"
    meta = {
        "motion": motion,
        "effect": effect,
        "amplitude": TYPICAL[effect] if amplitude is None else amplitude,
        "seconds": seconds,
        "seed": seed,
        "garment": garment,
    }
    np.savez_compressed(
        truth, time=world.time + FIRST_STAMP, markers=world.hanger.markers, held=world.hanger.held, points=world.points,
        grid=world.nodes.astype(np.float32), meta=json.dumps(meta),
    )  # fmt: skip
    rig, description = out / "rig.toml", out / "garment.toml"
    rig.write_text(dump_description(RIG))
    description.write_text(dump_description(worn))
    return [recording, truth, rig, description]


def _write_frames(path: Path, world: World, progress: Progress) -> None:
    renderer = world.renderer()
    with OniWriter(path, CAMERA, fps=FPS) as writer:
        for number, stamp in enumerate(world.time):
            depth, colour = world.frame(number, renderer)
            time_us = round(1e6 * (stamp + FIRST_STAMP))
            writer.write_depth(time_us, depth)
            writer.write_colour(time_us, colour)
            progress("camera", 0.3 + 0.7 * (number + 1) / len(world.time))

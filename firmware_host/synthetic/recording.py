"""Write a synthetic sensor recording and its true positions."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import numpy as np

from firmware_host.errors import SensorAddressError
from firmware_host.oni_writer import OniWriter
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.motion import START
from firmware_host.synthetic.scene import CAMERA, FPS, RIG
from firmware_host.synthetic.world import FIRST_STAMP, TYPICAL, Progress, World, make_world
from formats.descriptions import dump_description
from formats.outputs import check_stem, output_folder, refuse_to_replace, unwritable, write_bytes, write_text


def make_recording(
    out: Path, name: str, *, motion: str = "swing", effect: str = "air_drag", amplitude: float | None = None,
    # Seconds; our choice: as `hangtime sensor synthesise` has it
    seconds: float = 8.0, seed: int = 1, garment: str = "skirt", fabric: str = "plain",
    progress: Progress = lambda stage, share: None,
    overwrite: bool = False, rest: float = START,
) -> list[Path]:  # fmt: skip
    """Write NAME.oni, NAME.truth.npz, rig.toml and garment.toml into a folder and return their paths.

    Raises:
        RecordingError: the recording cannot be written; SensorAddressError: no such motion, effect, garment or fabric.
        OutputError: the name is invalid for files; the folder or a file cannot be written; or a file exists with other
            content and must not be overwritten.
    """
    check_stem(name)
    if garment not in GARMENTS:
        raise SensorAddressError(
            f"the synthetic world has no garment {garment!r}",
            where="--garment",
            advice=f"choose one of {', '.join(GARMENTS)}",
        )
    worn = GARMENTS[garment]()
    recording, truth, rig, description = paths = [
        out / f"{name}.oni", out / f"{name}.truth.npz", out / "rig.toml", out / "garment.toml"
    ]  # fmt: skip
    described = {rig: dump_description(RIG), description: dump_description(worn)}
    for path in paths:
        refuse_to_replace(path, described.get(path), overwrite=overwrite)
    with output_folder(out, ".oni"):
        world = make_world(
            motion=motion, effect=effect, amplitude=amplitude, seconds=seconds, seed=seed, garment=worn, fabric=fabric,
            rest=rest, progress=lambda stage, share: progress(stage, 0.3 * share),
        )  # fmt: skip
        partial = recording.with_name(recording.name + ".partial")
        meta = {
            "motion": motion,
            "effect": effect,
            "amplitude": TYPICAL[effect] if amplitude is None else amplitude,
            "seconds": seconds,
            "rest": rest,
            "seed": seed,
            "garment": garment,
            "fabric": fabric,
        }
        try:
            _write_frames(partial, world, progress)
            write_bytes(truth, _truth(world, meta))
            for path, text in described.items():
                write_text(path, text)
            partial.replace(recording)
        except BaseException as error:
            with contextlib.suppress(OSError):  # the first error is reported
                partial.unlink(missing_ok=True)
            if isinstance(error, OSError):
                raise unwritable(recording, error) from error
            raise
    return paths


def _truth(world: World, meta: dict[str, object]) -> bytes:
    content = io.BytesIO()
    np.savez_compressed(
        content, time=world.time + FIRST_STAMP, markers=world.hanger.markers, held=world.hanger.held,
        points=world.points, grid=world.nodes.astype(np.float32), meta=json.dumps(meta),
    )  # fmt: skip
    return content.getvalue()


def _write_frames(path: Path, world: World, progress: Progress) -> None:
    renderer = world.renderer()
    with OniWriter(path, CAMERA, fps=FPS) as writer:
        for number, stamp in enumerate(world.time):
            depth, colour = world.frame(number, renderer)
            time_us = round(1e6 * (stamp + FIRST_STAMP))
            writer.write_depth(time_us, depth)
            writer.write_colour(time_us, colour)
            progress("camera", 0.3 + 0.7 * (number + 1) / len(world.time))

"""Export of moving cloth as Alembic, written by Blender's Python.

PyPI has no maintained library that writes Alembic, but Blender, on PyPI as `bpy`, does. Blender receives the triangles
and their vertices at an even rate. The file has z up, metres, and a sample a frame.
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np

from fit.errors import FitError
from fit.export.moving import Moving
from fit.foreign.process import BLENDER, WORKER_FOLDER

WRITER = WORKER_FOLDER / "alembic_writer.py"
LONGEST_RUN = 900.0  # s that Blender may take; our choice: a program that hangs must end; half and double untried


def check_blender() -> None:
    """Check that there is a Blender that writes Alembic, which is worth asking before a garment is simulated.

    Raises:
        FitError: there is none.
    """
    if not BLENDER.is_installed():
        absent = BLENDER.absent()
        raise FitError(
            f"Alembic is written by Blender, and {absent.what}", where=BLENDER.python,
            advice=f"{absent.advice}; or take --to usd, which Houdini, Maya, Unreal and Blender open",
        )  # fmt: skip


def alembic(moving: Moving) -> bytes:
    """Return an Alembic file of a motion at an even rate.

    Raises:
        FitError: there is no Blender for Python, or it could not write the file.
    """
    check_blender()
    with tempfile.TemporaryDirectory(prefix="hangtime-alembic-") as name:
        folder = Path(name)
        np.savez(
            folder / "job.npz", places=moving.places, triangles=moving.triangles, rest=moving.rest, fps=moving.rate
        )
        try:
            done = subprocess.run(
                [BLENDER.python, WRITER, folder / "job.npz", folder / "cloth.abc"], capture_output=True, text=True,
                timeout=LONGEST_RUN,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise FitError("Blender did not end", where=BLENDER.python, advice="give a shorter take") from None
        if done.returncode != 0 or not (folder / "cloth.abc").exists():
            raise FitError(
                f"Blender could not write Alembic: {(done.stderr.strip().splitlines() or ['no reason given'])[-1]}",
                where=BLENDER.python, advice="take --to usd instead",
            )  # fmt: skip
        return (folder / "cloth.abc").read_bytes()

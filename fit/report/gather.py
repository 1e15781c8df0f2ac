"""Gather what a report shows: simulate the takes once more before, after and with the named effect, shapes kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.cloth.effect import amplitudes_of, parameter_names
from fit.cloth.simulator import Simulator
from fit.engines import OWN, find_engine
from fit.engines.plain_grid import plain_grid
from fit.gap.diagnosis import Findings
from fit.identification.request import Request
from fit.methods import find_method
from fit.recordings.recording import Recording, prepare_together
from fit.report import ReportMotion, write_report
from formats.arrays import Floats
from formats.fit_records import FitResult
from formats.take import Take


def write_fit_report(
    path: Path, result: FitResult, training: list[Take], held_out: list[Take], request: Request
) -> Path:
    """Write the report of a fit and return its path."""
    initial = np.array([p.initial for p in result.parameters])
    fitted = np.array([p.fitted for p in result.parameters])
    count = len(request.method.parameters)
    motions = []
    for recording, is_held_out in _both(*prepare_together(training, held_out)):
        if request.engine != OWN:
            motions.append(_motion_of_engine(recording, is_held_out, request, np.stack([initial, fitted])))
            continue
        simulator = Simulator(recording, request.effects, resolution=request.resolution)
        density = recording.garment.mass_kg / float(simulator.mesh.area)
        vectors = np.stack([initial, fitted])
        materials = request.method.to_materials(vectors[:, :count], density)
        done = simulator.run(materials, vectors[:, count:], shapes=True)
        motions.append(
            _motion(recording, is_held_out, simulator.mesh.triangles, done.points, done.shapes, ("before", "after"))
        )
    write_report(path, fit=result, diagnosis=None, motions=motions)
    return path


def write_diagnosis_report(
    path: Path,
    findings: Findings,
    fitted: FitResult | None,
) -> Path:
    """Write the report of a diagnosis, with the fit beside it where there is one, and return its path.

    Cloth moves under the pull of the diagnosis. `before` is the model with default parameters. `after` is the fit with
    its effects, or the diagnosis' base fit if no fit of our own engine exists. `with_effect` is the base model refitted
    with the effect that the verdict names.
    """
    motions = []
    is_named = bool(findings.diagnosis.named) and findings.best is not None
    off = amplitudes_of(findings.effects)
    for recording, is_held_out in _both(findings.takes.training, findings.takes.held_out):
        simulator = Simulator(recording, findings.effects, resolution=findings.resolution)
        density = recording.garment.mass_kg / float(simulator.mesh.area)
        rows, amplitudes, names = [], [off, off], ["before", "after"]
        if fitted is not None and fitted.engine == OWN:
            method = find_method(fitted.method)
            values = np.array([[p.initial for p in fitted.parameters], [p.fitted for p in fitted.parameters]])
            rows += list(method.to_materials(values[:, : len(method.parameters)], density))
            names_of_all = [name for effect in findings.effects for name in parameter_names(effect)]
            amplitudes[1] = np.array([fitted.effects.get(name, 0.0) for name in names_of_all])
        else:
            rows += list(findings.model.to_materials(np.stack([findings.model.initial, findings.base.vector]), density))
        if is_named and findings.best is not None:
            rows += list(findings.model.to_materials(findings.best.vector[None], density))
            amplitudes.append(findings.best.amplitudes)
            names.append("with_effect")
        pull = findings.frequency
        done = simulator.run(np.array(rows), np.array(amplitudes), observer_hz=pull, shapes=True)
        motion = _motion(recording, is_held_out, simulator.mesh.triangles, done.points, done.shapes, tuple(names))
        motions.append(replace(motion, pull_hz=pull))
    write_report(path, fit=fitted, diagnosis=findings.diagnosis, motions=motions)
    return path


def _both(training: list[Recording], held_out: list[Recording]) -> list[tuple[Recording, bool]]:
    """Held-out takes first: their errors are the ones that count."""
    return [(r, True) for r in held_out] + [(r, False) for r in training]


def _motion_of_engine(recording: Recording, is_held_out: bool, request: Request, vectors: Floats) -> ReportMotion:
    """Motion of an engine that gives points only."""
    engine = find_engine(request.engine)(recording, request.method, request.effects, request.resolution)
    grid = plain_grid(recording.garment, request.resolution.spacing)
    return _motion(recording, is_held_out, grid.triangles, engine.points(vectors), None, ("before", "after"))


def _motion(
    recording: Recording, is_held_out: bool, triangles: NDArray[np.signedinteger], points: Floats,
    shapes: NDArray[np.float32] | None, names: tuple[str, ...],
) -> ReportMotion:  # fmt: skip
    runs: dict[str, Any] = {}
    for k, name in enumerate(names):
        if np.isfinite(points[k]).all():
            runs[name] = points[k]
            if shapes is not None:
                runs["mesh_" + name] = shapes[k].astype(float)
    return ReportMotion(
        take_id=recording.take_id,
        is_held_out=is_held_out,
        time=recording.time,
        real=recording.points,
        point_names=tuple(p.name for p in recording.garment.points),
        triangles=triangles.astype(np.int64),
        held=recording.held(recording.time).reshape(-1, 2, 3),
        **runs,
    )

"""Collect a report's data: simulate every run of the report once more on the takes, with the cloth's shapes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.cloth.effect import amplitudes_of, parameter_names
from fit.cloth.simulator import Simulator
from fit.engines import OWN_ENGINE, find_engine
from fit.engines.plain_grid import plain_grid
from fit.gap.diagnosis import Findings
from fit.identification.request import Request
from fit.methods import find_method
from fit.observer.residuals import has_static
from fit.recordings.ready import Ready
from fit.recordings.recording import Recording
from fit.report.kept import created_of, load_motions, save_motions
from fit.report.motion import ReportMotion, Run
from fit.report.origin import Origin, origin_of
from fit.report.page import write_report
from formats.arrays import Floats, Singles
from formats.fit_records import FitResult
from formats.take import Take


def write_fit_report(
    path: Path, result: FitResult, prepared: Ready, request: Request, first: Take | None = None, command: str = ""
) -> Path:
    """Write the report of a fit with its motion file, and return the report's path.

    - first: the take whose garment and sensor the page describes
    - command: command line of the fit, for the page
    """
    initial = np.array([p.initial for p in result.parameters])
    fitted = np.array([p.fitted for p in result.parameters])
    count = len(request.method.parameters)
    names, vectors = ("before", "after"), np.stack([initial, fitted])
    motions = []
    for recording, is_held_out in _both(prepared):
        if request.engine != OWN_ENGINE:
            motions.append(_motion_of_engine(recording, is_held_out, request, vectors))
            continue
        simulator = Simulator(recording, request.effects, resolution=request.resolution)
        density = recording.garment.mass_kg / float(simulator.mesh.area)
        materials = request.method.to_materials(vectors[:, :count], density)
        done = simulator.run(materials, vectors[:, count:], shapes=True)
        triangles = simulator.mesh.triangles
        motions.append(_motion(recording, is_held_out, triangles, _runs(names, done.points, done.shapes)))
    origin = origin_of(prepared, first, command)
    return _written(path, result, None, motions, origin)


def write_diagnosis_report(
    path: Path,
    findings: Findings,
    fitted: FitResult | None,
    first: Take | None = None,
    command: str = "",
) -> Path:
    """Write the report of a diagnosis, with the fit if there is one, and return its path.

    Cloth moves under the pull of the diagnosis. The run `base` is the fitted base model, and `with_effect` its refit
    with the effect that the verdict names. The run `fit` is the fit with its effects, if one by our own engine exists.

    - first: the take whose garment and sensor the page describes
    - command: command line of the diagnosis, for the page
    """
    motions = []
    off = amplitudes_of(findings.effects)
    best = findings.best if findings.diagnosis.named else None
    for recording, is_held_out in _both(findings.takes):
        simulator = Simulator(recording, findings.effects, resolution=findings.resolution)
        density = recording.garment.mass_kg / float(simulator.mesh.area)
        rows, amplitudes, names = [findings.model.to_materials(findings.base.vector[None], density)], [off], ["base"]
        if best is not None:
            rows.append(findings.model.to_materials(best.vector[None], density))
            amplitudes.append(best.amplitudes)
            names.append("with_effect")
        if fitted is not None and fitted.engine == OWN_ENGINE:
            method = find_method(fitted.method)
            values = np.array([[p.fitted for p in fitted.parameters]])
            rows.append(method.to_materials(values[:, : len(method.parameters)], density))
            all_names = [name for effect in findings.effects for name in parameter_names(effect)]
            amplitudes.append(np.array([fitted.effects.get(name, 0.0) for name in all_names]))
            names.append("fit")
        pull = findings.frequency
        done = simulator.run(np.concatenate(rows), np.array(amplitudes), observer_hz=pull, shapes=True)
        runs = _runs(tuple(names), done.points, done.shapes)
        motions.append(_motion(recording, is_held_out, simulator.mesh.triangles, runs, pull))
    origin = origin_of(findings.takes, first, command)
    return _written(path, fitted, findings, motions, origin)


def _written(
    path: Path, fitted: FitResult | None, findings: Findings | None, motions: list[ReportMotion], origin: Origin
) -> Path:
    """Store the motion, and write the page from the stored motion, so that `hangtime report` gives the same page."""
    diagnosis = findings.diagnosis if findings is not None else None
    created = created_of(fitted, diagnosis)
    save_motions(path, motions, origin, created)
    kept, known = load_motions(path, created)
    return write_report(path, fit=fitted, diagnosis=diagnosis, motions=kept, origin=known)


def draw_left(path: Path, findings: Findings, *, overwrite: bool = False) -> None:
    """Draw the residuals of the named model, or else of the base model, on the first judged take.

    Raises:
        ModuleNotFoundError: Pillow is not installed.
        OutputError: the file is there and is not to be overwritten, or cannot be written.
    """
    from fit.report.residual_picture import draw_residuals

    recording = (findings.takes.held_out or findings.takes.training)[0]
    best = findings.best if findings.diagnosis.named and findings.best is not None else findings.base
    simulator = Simulator(recording, findings.effects, resolution=findings.resolution)
    density = recording.garment.mass_kg / float(simulator.mesh.area)
    rows = findings.model.to_materials(best.vector[None], density)
    done = simulator.run(rows, best.amplitudes[None], observer_hz=findings.frequency)
    made = _motion(recording, True, simulator.mesh.triangles, {"base": Run(points=done.points[0])})
    title = f"{recording.take_id}, {' and '.join(best.active).replace('_', ' ') or 'base model'}"
    draw_residuals(recording, made.compared("base"), path, title, overwrite=overwrite)


def _both(takes: Ready) -> list[tuple[Recording, bool]]:
    """Return all takes, held-out takes first, because their errors count."""
    return [(r, True) for r in takes.held_out] + [(r, False) for r in takes.training]


def _motion_of_engine(recording: Recording, is_held_out: bool, request: Request, vectors: Floats) -> ReportMotion:
    """Return the motion of an engine that returns points only."""
    engine = find_engine(request.engine)(recording, request.method, request.effects, request.resolution)
    grid = plain_grid(recording.garment, request.resolution.spacing)
    return _motion(recording, is_held_out, grid.triangles, _runs(("before", "after"), engine.points(vectors), None))


def _runs(names: Sequence[str], points: Floats, shapes: Singles | None) -> dict[str, Run]:
    """Return the runs that did not blow up."""
    return {
        name: Run(points=points[k], mesh=None if shapes is None else shapes[k].astype(float))
        for k, name in enumerate(names)
        if np.isfinite(points[k]).all()
    }


def _motion(
    recording: Recording, is_held_out: bool, triangles: NDArray[np.signedinteger], runs: dict[str, Run],
    pull_hz: float = 0.0,
) -> ReportMotion:  # fmt: skip
    return ReportMotion(
        take_id=recording.take_id,
        is_held_out=is_held_out,
        time=recording.time,
        real=recording.points,
        point_names=tuple(p.name for p in recording.garment.points),
        runs=runs,
        triangles=triangles.astype(np.int64),
        pull_hz=pull_hz,
        held=recording.held(recording.time).reshape(-1, 2, 3),
        free=recording.judged,
        is_material=has_static(recording),
        outline=np.array(recording.garment.outline_m),
    )

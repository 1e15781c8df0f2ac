"""A made-up fit result, diagnosis and motion for tests of the report."""

from __future__ import annotations

import numpy as np

from fit.report.motion import ReportMotion, Run
from formats.diagnosis_records import (
    Cost,
    Diagnosis,
    EffectFinding,
    Figure,
    Gap,
    Gate,
    MissingForce,
    NextExperiment,
    VertexResidual,
    Where,
    WhereBin,
)
from formats.fit_records import ErrorFigure, FitError, FitParameter, FitResult

POINTS = ("top_left", "top_right", "bottom_right", "bottom_left", "centre")
WIDTH, HEIGHT, SIDE = 0.44, 0.40, 17  # m, m, vertices along a side


def sheet(time, lag, gain):
    """Vertices of a swung sheet [m], (frames, SIDE * SIDE, 3): lower parts follow the hanger later and farther."""
    across, down = np.meshgrid(np.linspace(-WIDTH / 2, WIDTH / 2, SIDE), np.linspace(0, HEIGHT, SIDE))
    x, d = across.ravel(), down.ravel()
    ramp = np.clip(time / 1.0, 0, 1)[:, None]
    turn = 2 * np.pi * 0.8 * (time[:, None] - lag * d / HEIGHT) + 0.5 * x
    y = ramp * (0.12 + gain * d) * np.sin(turn) + 0.012 * np.cos(24 * x) * d / HEIGHT
    z = -np.sqrt(np.maximum(d**2 - (0.6 * ramp * gain * d) ** 2, 0.2 * d**2)) + 0 * turn
    return np.stack([x + 0 * y, y, 1.4 + z], axis=2)


def triangles():
    """Two triangles a cell, (triangles, 3)."""
    found = []
    for row in range(SIDE - 1):
        for column in range(SIDE - 1):
            a = row * SIDE + column
            found += [(a, a + SIDE, a + 1), (a + 1, a + SIDE, a + SIDE + 1)]
    return np.array(found)


OUTLINE = np.array([(-WIDTH / 2, 0), (WIDTH / 2, 0), (WIDTH / 2, -HEIGHT), (-WIDTH / 2, -HEIGHT)])


def motion(
    take_id="swing-01", is_held_out=False, seconds=6.0, noise=0.003, names=("fit", "base", "with_effect"), **more
):
    """A motion whose model lags most in its first run, less in the second, and hardly in the third."""
    time = np.arange(0, seconds, 1 / 30)
    corners = [0, SIDE - 1, SIDE * SIDE - 1, SIDE * (SIDE - 1), SIDE * (SIDE // 2) + SIDE // 2]
    real = sheet(time, 0.16, 0.5)[:, corners] + np.random.default_rng(4).normal(0, noise, (len(time), 5, 3))
    real[40:52, 2] = np.nan  # a corner hidden behind a fold
    meshes = [sheet(time, lag, gain) for lag, gain in ((0.05, 0.85), (0.12, 0.62), (0.155, 0.51))]
    runs = {name: Run(points=mesh[:, corners], mesh=mesh) for name, mesh in zip(names, meshes, strict=False)}
    given = {
        "take_id": take_id, "is_held_out": is_held_out, "time": time, "real": real, "point_names": POINTS,
        "runs": runs, "triangles": triangles(), "held": sheet(time, 0.16, 0.5)[:, [0, SIDE - 1]],
        "free": np.array([False, False, True, True, True]), "outline": OUTLINE,
    }  # fmt: skip
    return ReportMotion(**{**given, **more})


def fit_result():
    """The paper's figures and Table 2."""
    time = np.arange(0, 4, 1 / 30)
    before, after = 0.1276 + 0.07 * np.sin(5 * time), 0.0467 + 0.02 * np.sin(5 * time)

    def figure(mean, largest, frames):
        return ErrorFigure(mean_m=mean, max_m=largest, per_frame_m=frames.tolist(), time_s=time.tolist())

    table = (
        ("mass", 1.0, 1.7, 0.15, 10.0, False), ("struct", 30.0, 61.2, 5.0, 80.0, True),
        ("bend", 20.0, 8.4, 0.1, 150.0, True), ("spring", 3.0, 11.9, 0.0, 25.0, None),
        ("air", 5.0, 3.3, 1.0, 10.0, True), ("velocity", 0.95, 0.983, 0.9, 1.0, True),
    )  # fmt: skip
    units = {"mass": "x weighed", "velocity": "per frame"}
    parameters = [
        FitParameter(
            name=name, unit=units.get(name, "Blender"), initial=initial, fitted=fitted, minimum=low, maximum=high,
            interval_low=None if known is None else max(low, 0.8 * fitted),
            interval_high=None if known is None else min(high, 1.2 * fitted),
            is_identified=known, note="Only ratios to the density are." if name == "mass" else "",
        )
        for name, initial, fitted, low, high, known in table
    ]  # fmt: skip
    return FitResult(
        format="hangtime-fit/1", created="2026-03-01T12:00:00Z", take_ids=["swing-01"], held_out_ids=["swing-02"],
        method="kinect-skirt", search="annealing", seed=7, parameters=parameters,
        error=FitError(
            train_before=figure(0.1276, 0.2290, before), train_after=figure(0.0467, 0.0807, after),
            held_out_before=figure(0.131, 0.24, before), held_out_after=figure(0.0512, 0.11, after),
        ),
        effects={"hem": 0.012}, history=[0.1276 / (1 + 0.005 * t) for t in range(351)],
        simulations=368, seconds=41.0, notes=["Gamma is our choice."],
    )  # fmt: skip


def diagnosis(**changes):
    """A diagnosis that names air drag."""

    def bins(**values):
        whole = sum(v * v for v in values.values())
        return [WhereBin(name=name, value_mm=v, share=v * v / whole) for name, v in values.items()]

    def finding(name, probability, amplitude, ends, closed, p, least, **more):
        return EffectFinding(
            id=name, group=more.get("group", name), tested=True, probability=probability, amplitude=amplitude,
            amplitude_interval=ends, unit=more.get("unit", "1"), closure=Figure(value=closed[0], interval=closed[1:]),
            p_value=p, minimum_detectable=least, explained=0.4, absorbed=more.get("absorbed", 0.2),
            note=more.get("note", ""),
        )  # fmt: skip

    given = {
        "format": "hangtime-diagnosis/1", "created": "2026-03-01T12:10:00Z", "take_ids": ["swing-01"],
        "held_out_ids": ["swing-02"], "verdict": "effect",
        "sentence": "The model lacks air drag. The base model misses by 12.3 mm on motion not used for fitting; the "
        "sensor's noise alone is 4.1 mm. With air drag (1.31 [1.02 to 1.60]) it misses by 5.2 mm: "
        "87 % of the gap is closed.",
        "named": ["air_drag"],
        "gap": Gap(
            base_mm=Figure(value=12.3, interval=(11.2, 13.5)), with_effect_mm=Figure(value=5.2, interval=(4.8, 5.7)),
            floor_mm=Figure(value=4.1, interval=(3.8, 4.4)),
            closure=Figure(value=0.87, interval=(0.79, 0.93)), is_held_out=True,
        ),
        "effects": [
            finding("air_drag", 0.94, 1.31, (1.02, 1.60), (0.87, 0.79, 0.93), 2e-7, 0.11,
                    note="best effect in 99 % of bootstrap draws"),
            finding("hem", 0.03, 0.004, (-0.001, 0.009), (0.08, -0.02, 0.15), 0.21, 0.012, unit="kg/m"),
            finding("time_offset", None, -0.0021, (-0.006, 0.002), (0.01, -0.03, 0.05), 0.64, 0.004,
                    unit="s", absorbed=0.7),
            EffectFinding(
                id="clip_slip", group="clip_slip", tested=False, probability=None,
                amplitude=0.0, amplitude_interval=None,
                unit="m", closure=None, p_value=None, minimum_detectable=None, explained=None, absorbed=None,
                note="not built yet",
            ),
        ],
        "where": Where(
            space=bins(**{"bottom left": 16.2, "bottom right": 15.1, "middle centre": 9.0, "top left": 4.2}),
            vertices=[
                VertexResidual(at_m=at, value_mm=value)
                for at, value in (
                    ((-0.22, 0.0), 4.2), ((0.22, 0.0), 4.4), ((0.22, -0.4), 15.1),
                    ((-0.22, -0.4), 16.2), ((0.0, -0.2), 9.0)
                )
            ],
            time=bins(**{"hanger speeding up": 11.0, "hanger slowing down": 14.0, "ring-down, hanger at rest": 7.0}),
            frequency=bins(**{"0 to 0.3 Hz": 2.1, "0.3 to 0.7 Hz": 4.0, "0.7 to 1.5 Hz": 10.4, "1.5 to 3 Hz": 4.8}),
            term=bins(**{"sideways (x)": 2.0, "to and from the sensor (y)": 11.5, "vertical (z)": 3.9}),
        ),
        "missing_force": MissingForce(
            normal_share=0.83, odd_share=0.61, even_share=0.07, amplitude_exponent=2.0,
            spatial_share={"top": 0.08, "middle": 0.27, "bottom": 0.65},
            sentence="It acts along the cloth's normal, takes energy out, and grows with the square of the speed.",
        ),
        "next_experiment": NextExperiment(
            id="S3", motion="a faster swing", separates=["air_drag", "velocity_damping"], sigmas_next=8.4,
            sigmas_now=2.1,
            sentence="Swing twice as fast: air drag grows with the square of the speed, damping does not.",
        ),
        "gates": [
            Gate(name="length", passed=True, figure=6.0, limit=3.0, unit="s",
                 sentence="The shortest take lasts 6.0 s."),
            Gate(name="base fit", passed=False, figure=8.1, limit=5.0, unit="%",
                 sentence="The best two of 4 starts of the base fit end 8.1 % apart in cost."),
        ],
        "cost": Cost(simulations=912, seconds=103.0), "base_parameters": fit_result().parameters[1:3], "notes": [],
    }  # fmt: skip
    return Diagnosis(**{**given, **changes})

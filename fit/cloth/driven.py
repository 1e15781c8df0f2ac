"""Moving bodies in the kernel: pose and velocity of each body at a step (memory layout: `fit.cloth.nearby`).

Poses are linear between the instants of a `BodyMotion`. Their rates are those of centre and axes. So the point with
coordinates p along a body's axes has the velocity dc/dt + sum_k p_k da_k/dt.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.nearby import BODY, INSTANT, POSE, RATE, WAY_NOW, bodies_at, numbers_at, ways_at


@ti.func
def drive(b, groups, time, moving, whole: ti.template(), alone: ti.template()):
    """Set the poses of a group's bodies for `time` [s]; moving: 1, or 0 for bodies at rest."""
    samples, count, bodies, instants = whole[0], whole[1], whole[2], whole[5]
    spacing = alone[numbers_at(samples, count) + INSTANT]
    standing, ways = bodies_at(samples, count, groups, bodies, b), ways_at(samples, count, groups, bodies, b)
    table = ways_at(samples, count, groups, bodies, groups)
    poses = table + instants
    place = ti.min(time / spacing, ti.cast(instants - 1, ti.f32))
    before = ti.min(ti.cast(place, ti.i32), instants - 2)
    part = place - ti.cast(before, ti.f32)
    alone[ways + WAY_NOW] = alone[table + before] + part * (alone[table + before + 1] - alone[table + before])
    for body in range(bodies):
        for k in range(POSE):
            at = poses + POSE * (bodies * before + body) + k
            step = alone[at + POSE * bodies] - alone[at]
            alone[standing + BODY * body + k] = alone[at] + part * step
            alone[standing + BODY * body + RATE + k] = moving * step / spacing

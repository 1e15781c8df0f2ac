"""Taichi kernel of whole rollouts: many candidates in parallel, one per SIMD lane.

One step of symplectic leapfrog (kick, then drift; Hairer, Lubich & Wanner, "Geometric Numerical Integration",
section I.3), for node positions x [m] and velocities v [m/s]:

    v <- ((1 - c dt/2) v + dt (f/m + g + pull)) / (1 + c dt/2)        x <- x + dt v

The rounding error of x + dt v is stored after the positions in x, and added to the next step's dt v. This is
compensated summation (Hairer, Lubich & Wanner, section VIII.5). Without it, short steps far from the origin would be
lost.

The force f is the sum of
    the cloth's resistance: membrane, St. Venant-Kirchhoff, orthotropic, no Poisson coupling (fit.cloth.forces);
               plate bending (fit.cloth.moments); damping of both
    effects    forces on the surface around each node from the chosen effects (fit.effects); mass m_a that is added to
               the normal motion, (m + m_a n n') a = F, so a = (F - n (n.F) m_a/(m + m_a)) / m
    contact    with itself and with bodies (fit.cloth.contact)
pull is the observer's (fit.observer.residuals): w^2 (y - x) + 2 zeta w (ydot - v), spread from the tracked points.
While the cloth settles (fit.cloth.support), c is at least the settling's damping, and the first targets pull.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import functools
import math

import taichi as ti

from fit.cloth.bundles import (
    COUNTS,
    ROW,
    BendLaw,
    Candidates,
    Clock,
    Facing,
    Family,
    Grip,
    Kind,
    Law,
    Membrane,
    Motion,
    Place,
    Points,
    Pull,
    Results,
    Row,
    Stencils,
    Strains,
    Touch,
)
from fit.cloth.forces import fibres, find_normals, push_fibres, shearing
from fit.cloth.lanes import within
from fit.cloth.moments import bending
from fit.cloth.touching import touching
from fit.runtime import TASK

# Of the settling time: initial part in which the first observed shape pulls. Our choice: 0.32 s, after which the cloth
# hangs freely for 1.28 s (`fit.cloth.support`). Half and double were not tried.
SETTLE_PULLED = 0.2
# 1/s^2; our choice: at 8 Hz, 2e-6 of the initial distance remain after 0.32 s. At 4 Hz, 0.3 % remain.
SETTLE_GAIN = (2 * math.pi * 8.0) ** 2
SETTLE_PULL_DAMPING = 2 * math.sqrt(SETTLE_GAIN)  # 1/s, critical


@functools.cache
def make_rollout(kind: Kind):
    """Build the rollout kernel of one kind; its parameters are the fields of the bundles in `fit.cloth.bundles`.

    Taichi's kernels have 64 parameters at most.
    """
    vec = ti.types.vector(kind.lanes, ti.f32)
    lanes_1d = ti.types.ndarray(dtype=vec, ndim=1)
    lanes_2d = ti.types.ndarray(dtype=vec, ndim=2)
    lanes_3d = ti.types.ndarray(dtype=vec, ndim=3)
    lanes_4d = ti.types.ndarray(dtype=vec, ndim=4)
    floats_1d = ti.types.ndarray(dtype=ti.f32, ndim=1)
    floats_2d = ti.types.ndarray(dtype=ti.f32, ndim=2)
    integers_1d = ti.types.ndarray(dtype=ti.i32, ndim=1)
    integers_2d = ti.types.ndarray(dtype=ti.i32, ndim=2)
    face_forces = kind.face_forces

    @ti.func
    def copied(number):
        """Return a copy of a number in a local variable, because an array element would be read again at every use."""
        return number

    @ti.func
    def push_faces(
        b, home, count, nodes: ti.template(), facing: ti.template(), candidates: ti.template()
    ):  # fmt: skip
        """Add the forces of the effects on the surface around each node."""
        for i in range(count):
            k = within(home + 3 * i)
            for m in ti.static(range(len(face_forces))):
                a0, a1, a2 = candidates.amplitude[b, face_forces[m][0]], vec(0.0), vec(0.0)
                if ti.static(face_forces[m][1] > 1):
                    a1 = candidates.amplitude[b, face_forces[m][0] + 1]
                if ti.static(face_forces[m][1] > 2):
                    a2 = candidates.amplitude[b, face_forces[m][0] + 2]
                t0, t1, t2 = face_forces[m][2](
                    a0, a1, a2, nodes.v[k], nodes.v[k + 1], nodes.v[k + 2],
                    facing.normal[k], facing.normal[k + 1], facing.normal[k + 2], facing.faced_area[b * count + i],
                )  # fmt: skip
                nodes.f[k], nodes.f[k + 1], nodes.f[k + 2] = nodes.f[k] + t0, nodes.f[k + 1] + t1, nodes.f[k + 2] + t2

    @ti.func
    def pull_at_points(
        b, home, sample, part, gain, damping, moving, nodes: ti.template(), points: ti.template(), puller: ti.template()
    ):  # fmt: skip
        """Compute the pull's acceleration at each tracked point; part: interpolation factor between two targets."""
        for p in range(puller.pull.shape[1]):
            believed = (1.0 - part) * puller.trust[sample, p] + part * puller.trust[sample + 1, p]
            for c in ti.static(range(3)):
                y = (1.0 - part) * puller.targets[sample, p, c] + part * puller.targets[sample + 1, p, c]
                dy = (1.0 - part) * puller.targets[sample, p, c + 3] + part * puller.targets[sample + 1, p, c + 3]
                puller.pull[b, p, c] = believed * (gain * y + damping * moving * dy)
            for n in range(points.point_first[p], points.point_first[p + 1]):
                w, i = believed * points.point_weights[n, 0], home + points.point_nodes[n]
                for c in ti.static(range(3)):
                    puller.pull[b, p, c] = puller.pull[b, p, c] - w * (gain * nodes.x[i + c] + damping * nodes.v[i + c])

    @ti.func
    def handled(h, row, c, grip: ti.template()):
        """Return one coordinate of held node h at a step, as the handles prescribe it."""
        place = grip.shares[h, 0] * grip.path[row, c]
        for k in ti.static(range(1, kind.handles)):
            place = place + grip.shares[h, k] * grip.path[row, c + 3 * k]
        return place

    @ti.func
    def hold(home, row, last_row, lost, nodes: ti.template(), grip: ti.template(), per_second, bend_time):
        """Overwrite the held nodes' positions and velocities with those that the handles prescribe."""
        for h in range(grip.held.shape[0]):
            i = within(home + grip.held[h])
            for c in ti.static(range(3)):
                place = handled(h, row, c, grip)
                speed = (place - handled(h, last_row, c, grip)) * per_second
                nodes.v[i + c], nodes.x[i + c], nodes.x[within(lost + i) + c] = speed, place, vec(0.0)
                if ti.static(not kind.with_bends):
                    nodes.ahead[i + c] = place + bend_time * speed

    @ti.kernel
    def rollout(
        x: lanes_1d,
        v: lanes_1d,
        ahead: lanes_1d,
        f: lanes_1d,
        pull: lanes_3d,
        fibre_at: integers_1d,
        fibre_weights: floats_1d,
        down_entry: ti.i32,
        fibre_area: floats_1d,
        fibres_across: ti.i32,
        shear_across: integers_1d,
        shear_down: integers_1d,
        between: floats_1d,
        shear_area: floats_1d,
        slopes: lanes_1d,
        slopes_ahead: lanes_1d,
        strains: lanes_1d,
        shear_strains: lanes_1d,
        stress: lanes_1d,
        fibre_lags: lanes_1d,
        shear_lags: lanes_1d,
        lag_kept: floats_1d,
        bend_first: integers_1d,
        bend_nodes: integers_1d,
        bend_weights: floats_1d,
        bend_kind: integers_1d,
        bend_centre: integers_1d,
        bend_root: floats_1d,
        bend_counts: integers_1d,
        twist_scales: floats_1d,
        twist_centre: integers_1d,
        twist_root: floats_1d,
        cells: integers_2d,
        basis: floats_2d,
        normal: lanes_1d,
        faced_area: lanes_1d,
        rest_curvature: lanes_1d,
        friction: lanes_1d,
        added_mass: lanes_1d,
        contact_whole: integers_1d,
        contact_memory: lanes_1d,
        contact_alone: floats_1d,
        held: integers_1d,
        shares: floats_2d,
        path: lanes_2d,
        point_first: integers_1d,
        point_nodes: integers_1d,
        point_weights: floats_2d,
        pull_points: integers_2d,
        pull_weights: floats_2d,
        targets: lanes_3d,
        trust: lanes_2d,
        material: lanes_2d,
        inverse_mass: lanes_1d,
        amplitude: lanes_2d,
        frame_step: integers_2d,
        frame_lag: floats_2d,
        counts: integers_2d,
        time_step: floats_1d,
        settle_damping: ti.f32,
        gain: ti.f32,
        damping: ti.f32,
        seen: lanes_4d,
        shapes: lanes_4d,
    ):
        # The bundles are rebuilt by field name, so that no later code depends on the order of parameters.
        nodes = ti.static(Motion(x=x, v=v, ahead=ahead, f=f))
        cloth = ti.static(
            Membrane(
                fibre_at=fibre_at, fibre_weights=fibre_weights, down_entry=down_entry, fibre_area=fibre_area,
                fibres_across=fibres_across, shear_across=shear_across, shear_down=shear_down, between=between,
                shear_area=shear_area,
            )
        )  # fmt: skip
        memory = ti.static(
            Strains(
                slopes=slopes, slopes_ahead=slopes_ahead, strains=strains, shear_strains=shear_strains, stress=stress,
                fibre_lags=fibre_lags, shear_lags=shear_lags, lag_kept=lag_kept,
            )
        )  # fmt: skip
        stencils = ti.static(
            Stencils(
                bend_first=bend_first, bend_nodes=bend_nodes, bend_weights=bend_weights, bend_kind=bend_kind,
                bend_centre=bend_centre, bend_root=bend_root, bend_counts=bend_counts, twist_scales=twist_scales,
                twist_centre=twist_centre, twist_root=twist_root,
            )
        )  # fmt: skip
        facing = ti.static(
            Facing(
                cells=cells, basis=basis, normal=normal, faced_area=faced_area, rest_curvature=rest_curvature,
                friction=friction,
            )
        )  # fmt: skip
        touch = ti.static(
            Touch(contact_whole=contact_whole, contact_memory=contact_memory, contact_alone=contact_alone)
        )  # fmt: skip
        grip = ti.static(Grip(held=held, shares=shares, path=path, settle_damping=settle_damping))
        points = ti.static(Points(point_first=point_first, point_nodes=point_nodes, point_weights=point_weights))
        puller = ti.static(
            Pull(
                pull=pull, pull_points=pull_points, pull_weights=pull_weights, targets=targets, trust=trust, gain=gain,
                damping=damping,
            )
        )  # fmt: skip
        candidates = ti.static(
            Candidates(material=material, amplitude=amplitude, inverse_mass=inverse_mass, added_mass=added_mass)
        )  # fmt: skip
        clock = ti.static(Clock(time_step=time_step, frame_step=frame_step, frame_lag=frame_lag, counts=counts))
        results = ti.static(Results(seen=seen, shapes=shapes))

        groups, count = clock.time_step.shape[0], puller.pull_points.shape[0]
        lost = 3 * count * groups
        fibre_count, bend_count = cloth.fibre_area.shape[0], stencils.bend_centre.shape[0]
        shear_count = cloth.shear_area.shape[0]
        for task in range(groups * TASK):
            if task % TASK == 0:
                b = task // TASK
                home, first_fibre, first_shear = 3 * count * b, fibre_count * b, shear_count * b
                first_slope, first_bend = 3 * first_fibre, bend_count * b
                if ti.static(kind.with_twist):
                    first_bend = (bend_count + stencils.twist_centre.shape[0]) * b
                first_twist, first_crossed = first_bend + bend_count, shear_count * groups + 2 * first_shear
                place = ti.static(
                    Place(
                        home=home, first_fibre=first_fibre, first_slope=first_slope, first_shear=first_shear,
                        first_crossed=first_crossed, first_bend=first_bend, first_twist=first_twist,
                    )
                )  # fmt: skip
                across = ti.static(Family(start=0, end=cloth.fibres_across, entry=0, sample_nodes=kind.fibre_nodes[0]))
                down = ti.static(
                    Family(
                        start=cloth.fibres_across, end=fibre_count, entry=cloth.down_entry,
                        sample_nodes=kind.fibre_nodes[1],
                    )
                )  # fmt: skip
                frames, settle_steps = clock.counts[b, COUNTS.frames], clock.counts[b, COUNTS.settle_steps]
                first_path, first_target = clock.counts[b, COUNTS.first_path], clock.counts[b, COUNTS.first_target]
                steps_per_target = clock.counts[b, COUNTS.steps_per_target]
                dt, last_step, zero = clock.time_step[b], clock.frame_step[b, frames - 1], vec(0.0)
                first_frame, end_frame = clock.counts[b, COUNTS.first_frame], clock.counts[b, COUNTS.end_frame]
                step, pulled_until = (
                    clock.counts[b, COUNTS.first_step],
                    ti.cast(settle_steps * (SETTLE_PULLED - 1.0), ti.i32),
                )
                for frame in range(first_frame, end_frame):
                    while step < clock.frame_step[b, frame]:
                        is_settling = step < 0
                        now = ti.max(step, 0)
                        rate = candidates.material[b, ROW.velocity_damping]
                        pull_gain, pull_damping, moving = puller.gain, puller.damping, 1.0
                        if is_settling:
                            rate = ti.max(rate, grip.settle_damping)
                            pull_gain, pull_damping = SETTLE_GAIN, SETTLE_PULL_DAMPING
                            moving = 0.0  # at rest: the slope of a spline's end is mostly noise
                            if step >= pulled_until:
                                pull_gain = 0.0  # from the observed folds into the model's own equilibrium
                        per_step = 0.0  # there is no step before the first
                        if step > -settle_steps:
                            per_step = 1.0 / dt
                        delay = candidates.material[b, ROW.membrane_time] * per_step
                        bend_time = candidates.material[b, ROW.bending_time]
                        stiffening = candidates.material[b, ROW.stiffening]
                        kept = memory.lag_kept[b]
                        lag_gain = candidates.material[b, ROW.viscosity_time] * (1.0 - memory.lag_kept[b]) * per_step
                        friction_limit = candidates.material[b, ROW.friction_limit]
                        law = ti.static(Law(delay=delay, stiffening=stiffening, kept=kept, lag_gain=lag_gain))
                        bend_law = ti.static(BendLaw(bend_time=bend_time, friction_limit=friction_limit, dt=dt))
                        stiffness = ti.static(Row(*[copied(candidates.material[b, k]) for k in range(len(ROW))]))
                        fibres(
                            place, across, nodes, cloth, memory, stiffness.stretch_across, law, kind, kind.with_twist
                        )  # fmt: skip
                        fibres(place, down, nodes, cloth, memory, stiffness.stretch_down, law, kind, False)
                        if ti.static(kind.needs_normals):
                            find_normals(place, count * b, count, nodes, facing, zero)
                        if ti.static(len(face_forces) > 0):
                            push_faces(b, home, count, nodes, facing, candidates)
                        shearing(place, cloth, memory, stencils, facing, stiffness, law, bend_law, kind)
                        push_fibres(place, across, nodes, cloth, memory)
                        push_fibres(place, down, nodes, cloth, memory)
                        bending(place, nodes, stencils, facing, stiffness, bend_law, kind, memory.slopes)
                        if ti.static(kind.with_contact):
                            touching(
                                b, home, count, groups, nodes.x, nodes.v, nodes.f, touch.contact_whole,
                                touch.contact_memory, touch.contact_alone, stiffness.thickness, stiffness.density,
                                ti.cast(now, ti.f32) * dt, moving, kind.lanes,
                            )  # fmt: skip
                        give = 1.0 / (1.0 + 0.5 * dt * rate)
                        keep, push = give * (1.0 - 0.5 * dt * rate), give * dt
                        fall0, fall1 = push * stiffness.gravity_x, push * stiffness.gravity_y
                        fall2 = push * stiffness.gravity_z
                        if pull_gain > 0.0:
                            sample = now // steps_per_target
                            part = ti.cast(now - sample * steps_per_target, ti.f32) / ti.cast(steps_per_target, ti.f32)
                            pull_at_points(
                                b, home, first_target + sample, part, pull_gain, pull_damping, moving,
                                nodes, points, puller,
                            )  # fmt: skip
                        for i in range(count):
                            m, j = count * b + i, within(home + 3 * i)
                            light = push * candidates.inverse_mass[m]
                            a0, a1, a2 = light * f[j] + fall0, light * f[j + 1] + fall1, light * f[j + 2] + fall2
                            if ti.static(kind.with_added_mass):
                                n0, n1, n2 = facing.normal[j], facing.normal[j + 1], facing.normal[j + 2]
                                ratio = candidates.added_mass[m] * candidates.inverse_mass[m]
                                less = (a0 * n0 + a1 * n1 + a2 * n2) * ratio / (1.0 + ratio)
                                a0, a1, a2 = a0 - less * n0, a1 - less * n1, a2 - less * n2
                            if pull_gain > 0.0:
                                p, q, r = pull_points[i, 0], pull_points[i, 1], pull_points[i, 2]
                                wp, wq, wr = pull_weights[i, 0], pull_weights[i, 1], pull_weights[i, 2]
                                a0 = a0 + push * (wp * pull[b, p, 0] + wq * pull[b, q, 0] + wr * pull[b, r, 0])
                                a1 = a1 + push * (wp * pull[b, p, 1] + wq * pull[b, q, 1] + wr * pull[b, r, 1])
                                a2 = a2 + push * (wp * pull[b, p, 2] + wq * pull[b, q, 2] + wr * pull[b, r, 2])
                            s0, s1, s2 = keep * v[j] + a0, keep * v[j + 1] + a1, keep * v[j + 2] + a2
                            x0, x1, x2, n = x[j], x[j + 1], x[j + 2], within(lost + j)
                            d0, d1, d2 = dt * s0 + x[n], dt * s1 + x[n + 1], dt * s2 + x[n + 2]
                            y0, y1, y2 = x0 + d0, x1 + d1, x2 + d2
                            x[n], x[n + 1], x[n + 2] = d0 - (y0 - x0), d1 - (y1 - x1), d2 - (y2 - x2)
                            v[j], v[j + 1], v[j + 2] = s0, s1, s2
                            x[j], x[j + 1], x[j + 2] = y0, y1, y2
                            if ti.static(not kind.with_bends):
                                ahead[j], ahead[j + 1], ahead[j + 2] = (
                                    y0 + bend_time * s0, y1 + bend_time * s1, y2 + bend_time * s2
                                )  # fmt: skip
                            if step + 1 < last_step:  # the last forces are returned
                                f[j], f[j + 1], f[j + 2] = zero, zero, zero
                        if ti.static(kind.handles > 0):
                            row, last_row = first_path + ti.max(step + 1, 0), first_path + now
                            hold(home, row, last_row, lost, nodes, grip, 1.0 / dt, bend_time)
                        step += 1
                    lag = clock.frame_lag[b, frame]
                    for p in range(pull.shape[1]):
                        for c in ti.static(range(3)):
                            results.seen[b, frame, p, c] = vec(0.0)
                        for n in range(point_first[p], point_first[p + 1]):
                            w, i = point_weights[n, 0], home + point_nodes[n]
                            for c in ti.static(range(3)):
                                results.seen[b, frame, p, c] = results.seen[b, frame, p, c] + w * (
                                    x[i + c] + lag * v[i + c]
                                )
                    if results.shapes.shape[1] > 1:  # an array of one frame means that shapes are not requested
                        for i in range(count):
                            for c in ti.static(range(3)):
                                j = home + 3 * i + c
                                results.shapes[b, frame, i, c] = x[j] + lag * v[j]

    return rollout

"""Whole rollouts of many cloths at once, candidates side by side in SIMD lanes, in one Taichi kernel.

One step of symplectic leapfrog (kick, then drift; Hairer, Lubich & Wanner, "Geometric Numerical Integration",
section I.3), for node positions x [m] and velocities v [m/s]:

    v <- ((1 - c dt/2) v + dt (f/m + g + pull)) / (1 + c dt/2)        x <- x + dt v

What rounding loses of x + dt v is kept, behind the places in x, and added to the next step's dt v (compensated
summation; Hairer, Lubich & Wanner, section VIII.5): short steps far from the origin would else stand still.
f is the sum of
    what the cloth resists with: membrane, St. Venant-Kirchhoff, orthotropic, no Poisson coupling (fit.cloth.forces);
               plate bending (fit.cloth.moments); damping of both
    effects    forces on the surface around each node from the chosen effects (fit.effects); mass m_a that is added to
               the normal motion, (m + m_a n n') a = F, so a = (F - n (n.F) m_a/(m + m_a)) / m
    contact    with itself and with bodies (fit.cloth.contact)
pull is the observer's (fit.observer.residuals): w^2 (y - x) + 2 zeta w (ydot - v), spread from the tracked points.
While the cloth settles (fit.cloth.support), c is at least the settling's, and the pull that of its beginning.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import functools
import math

import taichi as ti

from fit.cloth.forces import fibres, find_normals, push_fibres, shearing
from fit.cloth.lanes import within
from fit.cloth.moments import bending
from fit.cloth.touching import touching

SETTLE_PULLED = 0.2  # of settling, its beginning: the observed first shape pulls
SETTLE_GAIN = (2 * math.pi * 8.0) ** 2  # 1/s^2: 8 Hz, so that 0.32 s leave 2e-6 of the way from where the cloth began
SETTLE_PULL_DAMPING = 2 * math.sqrt(SETTLE_GAIN)  # 1/s, critical
TASK = 512  # Taichi hands out loops in tasks of at least 512 iterations; one task per group of lanes


@functools.cache
def make_rollout(
    lanes: int,
    face_forces: tuple,
    *,
    fibre_nodes: tuple[int, int],
    bend_lengths: tuple[int, ...],
    handles: int,
    with_twist: bool,
    is_crossed: bool,
    with_bends: bool,
    with_added_mass: bool,
    with_viscosity: bool,
    with_contact: bool,
):
    """Build the rollout kernel for `lanes` candidates per group and these effects.

    face_forces: per effect (first column of its amplitude, number of components, force), where force is a
    `ti.func(a0, a1, a2, vx, vy, vz, nx, ny, nz, area) -> (fx, fy, fz)`;
    fibre_nodes: nodes of every fibre sample across, and down; bend_lengths: of the stencils of second derivatives; both
    may be `fit.cloth.lines.IN_LINES`; with_twist: whether mixed ones come from the slopes across;
    is_crossed: whether threads of both families cross the elements;
    handles: vectors that the held nodes follow, 0 where nothing is held;
    with_bends: rest curvature and friction in bending; with_added_mass: inertia of the air along the normal;
    with_viscosity: of stretch and shear; with_contact: the cloth touches itself or bodies.

    Taichi's kernels have 64 arguments at most. counts, (groups, 5): frames, steps of settling, where the group's path
    and its targets begin, steps between two targets.
    """
    vec = ti.types.vector(lanes, ti.f32)
    lanes_1d = ti.types.ndarray(dtype=vec, ndim=1)
    lanes_2d = ti.types.ndarray(dtype=vec, ndim=2)
    lanes_3d = ti.types.ndarray(dtype=vec, ndim=3)
    lanes_4d = ti.types.ndarray(dtype=vec, ndim=4)
    floats_1d = ti.types.ndarray(dtype=ti.f32, ndim=1)
    floats_2d = ti.types.ndarray(dtype=ti.f32, ndim=2)
    integers_1d = ti.types.ndarray(dtype=ti.i32, ndim=1)
    integers_2d = ti.types.ndarray(dtype=ti.i32, ndim=2)
    needs_normals = with_bends or with_added_mass or len(face_forces) > 0

    @ti.func
    def push_faces(
        b,
        home,
        nodes,
        v: ti.template(),
        f: ti.template(),
        normal: ti.template(),
        area: ti.template(),
        amplitude: ti.template(),
    ):
        """Forces of the effects on the surface around each node."""
        for i in range(nodes):
            k = within(home + 3 * i)
            for m in ti.static(range(len(face_forces))):
                a0, a1, a2 = amplitude[b, face_forces[m][0]], vec(0.0), vec(0.0)
                if ti.static(face_forces[m][1] > 1):
                    a1 = amplitude[b, face_forces[m][0] + 1]
                if ti.static(face_forces[m][1] > 2):
                    a2 = amplitude[b, face_forces[m][0] + 2]
                t0, t1, t2 = face_forces[m][2](
                    a0, a1, a2, v[k], v[k + 1], v[k + 2], normal[k], normal[k + 1], normal[k + 2], area[b * nodes + i]
                )
                f[k], f[k + 1], f[k + 2] = f[k] + t0, f[k + 1] + t1, f[k + 2] + t2

    @ti.func
    def pull_at_points(
        b,
        home,
        sample,
        part,
        gain,
        damping,
        moving,
        x: ti.template(),
        v: ti.template(),
        pull: ti.template(),
        first: ti.template(),
        nodes: ti.template(),
        weights: ti.template(),
        targets: ti.template(),
        trust: ti.template(),
    ):
        for p in range(pull.shape[1]):
            believed = (1.0 - part) * trust[sample, p] + part * trust[sample + 1, p]
            for c in ti.static(range(3)):
                y = (1.0 - part) * targets[sample, p, c] + part * targets[sample + 1, p, c]
                dy = (1.0 - part) * targets[sample, p, c + 3] + part * targets[sample + 1, p, c + 3]
                pull[b, p, c] = believed * (gain * y + damping * moving * dy)
            for n in range(first[p], first[p + 1]):
                w, i = believed * weights[n, 0], home + nodes[n]
                for c in ti.static(range(3)):
                    pull[b, p, c] = pull[b, p, c] - w * (gain * x[i + c] + damping * v[i + c])

    @ti.func
    def handled(h, row, c, shares: ti.template(), path: ti.template()):
        """Where the handles put a held node at a step, one coordinate."""
        place = shares[h, 0] * path[row, c]
        for k in ti.static(range(1, handles)):
            place = place + shares[h, k] * path[row, c + 3 * k]
        return place

    @ti.func
    def hold(
        home,
        row,
        last_row,
        lost,
        x: ti.template(),
        v: ti.template(),
        ahead: ti.template(),
        held: ti.template(),
        shares: ti.template(),
        path: ti.template(),
        per_second,
        bend_time,
    ):
        """Put held nodes, which moved freely with the rest, where their handles are, with the handles' speed."""
        for h in range(held.shape[0]):
            i = within(home + held[h])
            for c in ti.static(range(3)):
                place = handled(h, row, c, shares, path)
                speed = (place - handled(h, last_row, c, shares, path)) * per_second
                v[i + c], x[i + c], x[within(lost + i) + c] = speed, place, vec(0.0)
                if ti.static(not with_bends):
                    ahead[i + c] = place + bend_time * speed

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
        groups, nodes = time_step.shape[0], pull_points.shape[0]
        lost = 3 * nodes * groups
        fibre_count, bend_count = fibre_area.shape[0], bend_centre.shape[0]
        for task in range(groups * TASK):
            if task % TASK == 0:
                b = task // TASK
                home, first_fibre, first_shear = 3 * nodes * b, fibre_count * b, shear_area.shape[0] * b
                place, first_bend = 3 * first_fibre, bend_count * b
                if ti.static(with_twist):
                    first_bend = (bend_count + twist_centre.shape[0]) * b
                frames, settle_steps = counts[b, 0], counts[b, 1]
                first_path, first_target, steps_per_target = counts[b, 2], counts[b, 3], counts[b, 4]
                dt, last_step, zero = time_step[b], frame_step[b, frames - 1], vec(0.0)
                step, pulled_until = -settle_steps, ti.cast(settle_steps * (SETTLE_PULLED - 1.0), ti.i32)
                for frame in range(frames):
                    while step < frame_step[b, frame]:
                        is_settling = step < 0
                        now = ti.max(step, 0)
                        rate = material[b, 8]
                        pull_gain, pull_damping, moving = gain, damping, 1.0
                        if is_settling:
                            rate = ti.max(rate, settle_damping)
                            pull_gain, pull_damping = SETTLE_GAIN, SETTLE_PULL_DAMPING
                            moving = 0.0  # at rest: the slope of a spline's end is mostly noise
                            if step >= pulled_until:
                                pull_gain = 0.0  # from the observed folds into the model's own equilibrium
                        per_step = 0.0  # there is no step before the first
                        if step > -settle_steps:
                            per_step = 1.0 / dt
                        fibre_delay, bend_time, stiffening = material[b, 6] * per_step, material[b, 7], material[b, 9]
                        kept, lag_gain = lag_kept[b], material[b, 14] * (1.0 - lag_kept[b]) * per_step
                        fibres(
                            home, first_fibre, 0, fibres_across, 0, x, ahead, slopes, slopes_ahead, strains, stress,
                            fibre_at, fibre_weights, fibre_area, material[b, 1], fibre_delay, stiffening,
                            fibre_nodes[0], with_twist, with_viscosity, fibre_lags, kept, lag_gain,
                        )  # fmt: skip
                        fibres(
                            home, first_fibre, fibres_across, fibre_count, down_entry, x, ahead, slopes, slopes_ahead,
                            strains, stress, fibre_at, fibre_weights, fibre_area, material[b, 0], fibre_delay,
                            stiffening, fibre_nodes[1], False, with_viscosity, fibre_lags, kept, lag_gain,
                        )  # fmt: skip
                        if ti.static(needs_normals):
                            find_normals(home, nodes * b, nodes, x, normal, faced_area, cells, basis, zero)
                        if ti.static(len(face_forces) > 0):
                            push_faces(b, home, nodes, v, f, normal, faced_area, amplitude)
                        shearing(
                            place, first_shear, slopes, slopes_ahead, shear_strains, stress,
                            shear_across, shear_down, between,
                            shear_area, material[b, 2], fibre_delay, with_viscosity, shear_lags, kept, lag_gain,
                            with_twist, twist_scales, twist_centre, twist_root, material[b, 5], bend_time,
                            with_bends, home, first_bend + bend_count,
                            normal, rest_curvature, friction, material[b, 13], dt,
                            is_crossed, shear_area.shape[0] * groups + 2 * first_shear,
                            material[b, 18], material[b, 17], stiffening,
                        )  # fmt: skip
                        push_fibres(
                            home, place, 0, fibres_across, 0, stress, f, fibre_at, fibre_weights, fibre_nodes[0]
                        )
                        push_fibres(
                            home, place, fibres_across, fibre_count, down_entry, stress, f,
                            fibre_at, fibre_weights, fibre_nodes[1],
                        )  # fmt: skip
                        bending(
                            home, first_bend, x, ahead, f, bend_first, bend_nodes, bend_weights, bend_kind,
                            bend_centre, bend_root, bend_counts, bend_lengths,
                            material[b, 3], material[b, 4], material[b, 5], bend_time,
                            with_bends, normal, rest_curvature, friction, material[b, 13], dt,
                            place, slopes,
                        )  # fmt: skip
                        if ti.static(with_contact):
                            touching(
                                b, home, nodes, groups, x, v, f, contact_whole, contact_memory,
                                contact_alone, material[b, 15], material[b, 16], lanes,
                            )  # fmt: skip
                        give = 1.0 / (1.0 + 0.5 * dt * rate)
                        keep, push = give * (1.0 - 0.5 * dt * rate), give * dt
                        fall0, fall1, fall2 = push * material[b, 10], push * material[b, 11], push * material[b, 12]
                        if pull_gain > 0.0:
                            sample = now // steps_per_target
                            part = ti.cast(now - sample * steps_per_target, ti.f32) / ti.cast(steps_per_target, ti.f32)
                            pull_at_points(
                                b,
                                home,
                                first_target + sample,
                                part,
                                pull_gain,
                                pull_damping,
                                moving,
                                x,
                                v,
                                pull,
                                point_first,
                                point_nodes,
                                point_weights,
                                targets,
                                trust,
                            )
                        for i in range(nodes):
                            m, j = nodes * b + i, within(home + 3 * i)
                            light = push * inverse_mass[m]
                            a0, a1, a2 = light * f[j] + fall0, light * f[j + 1] + fall1, light * f[j + 2] + fall2
                            if ti.static(with_added_mass):
                                n0, n1, n2 = normal[j], normal[j + 1], normal[j + 2]
                                ratio = added_mass[m] * inverse_mass[m]
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
                            if ti.static(not with_bends):
                                ahead[j], ahead[j + 1], ahead[j + 2] = (
                                    y0 + bend_time * s0, y1 + bend_time * s1, y2 + bend_time * s2
                                )  # fmt: skip
                            if step + 1 < last_step:  # the last forces are handed back
                                f[j], f[j + 1], f[j + 2] = zero, zero, zero
                        if ti.static(handles > 0):
                            row, last_row = first_path + ti.max(step + 1, 0), first_path + now
                            hold(home, row, last_row, lost, x, v, ahead, held, shares, path, 1.0 / dt, bend_time)
                        step += 1
                    lag = frame_lag[b, frame]
                    for p in range(pull.shape[1]):
                        for c in ti.static(range(3)):
                            seen[b, frame, p, c] = vec(0.0)
                        for n in range(point_first[p], point_first[p + 1]):
                            w, i = point_weights[n, 0], home + point_nodes[n]
                            for c in ti.static(range(3)):
                                seen[b, frame, p, c] = seen[b, frame, p, c] + w * (x[i + c] + lag * v[i + c])
                    if shapes.shape[1] > 1:  # room for one frame alone: they are not wanted
                        for i in range(nodes):
                            for c in ti.static(range(3)):
                                j = home + 3 * i + c
                                shapes[b, frame, i, c] = x[j] + lag * v[j]

    return rollout

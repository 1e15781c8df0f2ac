"""Whole rollouts of many cloths at once, candidates side by side in SIMD lanes, in one Taichi kernel.

One step of symplectic leapfrog (kick, then drift; Hairer, Lubich & Wanner, "Geometric Numerical Integration",
section I.3), for node positions x [m] and velocities v [m/s]:

    v <- ((1 - c dt/2) v + dt (f/m + g + pull)) / (1 + c dt/2)        x <- x + dt v

f is the sum of
    what the cloth resists with (fit.cloth.forces): membrane, St. Venant-Kirchhoff, orthotropic, no Poisson coupling;
               plate bending; Kelvin-Voigt damping of both
    effects    forces on the surface around each node from the chosen effects (fit.effects); mass m_a that is added to
               the normal motion, (m + m_a n n') a = F, so a = (F - n (n.F) m_a/(m + m_a)) / m
pull is the observer's (fit.gap.observer): w^2 (y - x) + 2 zeta w (ydot - v), spread from the tracked points.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import functools

import taichi as ti

from fit.cloth.forces import bending, fibre_slopes, fibres, find_normals, push_fibres, shearing, twisting

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
    with_bends: bool,
    with_added_mass: bool,
):
    """Build the rollout kernel for `lanes` candidates per group and these effects.

    face_forces: per effect (first column of its amplitude, number of components, force), where force is a
    `ti.func(a0, a1, a2, vx, vy, vz, nx, ny, nz, area) -> (fx, fy, fz)`;
    fibre_nodes: nodes of every fibre sample across, and down; bend_lengths: of every second derivative, by its kind;
    with_twist: whether mixed ones come from the slopes across;
    handles: vectors that the held nodes follow, 0 where nothing is held;
    with_bends: rest curvature and friction in bending; with_added_mass: inertia of the air along the normal.
    """
    vec = ti.types.vector(lanes, ti.f32)
    lanes_2d = ti.types.ndarray(dtype=vec, ndim=2)
    lanes_3d = ti.types.ndarray(dtype=vec, ndim=3)
    lanes_4d = ti.types.ndarray(dtype=vec, ndim=4)
    floats_1d = ti.types.ndarray(dtype=ti.f32, ndim=1)
    floats_2d = ti.types.ndarray(dtype=ti.f32, ndim=2)
    floats_3d = ti.types.ndarray(dtype=ti.f32, ndim=3)
    integers_1d = ti.types.ndarray(dtype=ti.i32, ndim=1)
    integers_2d = ti.types.ndarray(dtype=ti.i32, ndim=2)
    needs_normals = with_bends or with_added_mass or len(face_forces) > 0

    @ti.func
    def push_faces(
        b,
        v: ti.template(),
        f: ti.template(),
        normal: ti.template(),
        area: ti.template(),
        amplitude: ti.template(),
    ):
        """Forces of the effects on the surface around each node."""
        for i in range(f.shape[1]):
            for m in ti.static(range(len(face_forces))):
                a0, a1, a2 = amplitude[b, face_forces[m][0]], vec(0.0), vec(0.0)
                if ti.static(face_forces[m][1] > 1):
                    a1 = amplitude[b, face_forces[m][0] + 1]
                if ti.static(face_forces[m][1] > 2):
                    a2 = amplitude[b, face_forces[m][0] + 2]
                t0, t1, t2 = face_forces[m][2](
                    a0, a1, a2, v[b, i, 0], v[b, i, 1], v[b, i, 2],
                    normal[b, i, 0], normal[b, i, 1], normal[b, i, 2], area[b, i],
                )  # fmt: skip
                f[b, i, 0], f[b, i, 1], f[b, i, 2] = f[b, i, 0] + t0, f[b, i, 1] + t1, f[b, i, 2] + t2

    @ti.func
    def pull_at_points(
        b,
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
                pull[b, p, c] = vec(believed * (gain * y + damping * moving * dy))
            for n in range(first[p], first[p + 1]):
                w, i = believed * weights[n, 0], nodes[n]
                for c in ti.static(range(3)):
                    pull[b, p, c] = pull[b, p, c] - w * (gain * x[b, i, c] + damping * v[b, i, c])

    @ti.func
    def hold(
        b,
        row,
        x: ti.template(),
        v: ti.template(),
        held: ti.template(),
        shares: ti.template(),
        path: ti.template(),
        per_second,
    ):
        for h in range(held.shape[0]):
            i = held[h]
            for c in ti.static(range(3)):
                place = shares[h, 0] * path[row, c]
                for k in ti.static(range(1, handles)):
                    place = place + shares[h, k] * path[row, c + 3 * k]
                v[b, i, c] = (place - x[b, i, c]) * per_second
                x[b, i, c] = place

    @ti.kernel
    def rollout(
        x: lanes_3d,
        v: lanes_3d,
        f: lanes_3d,
        pull: lanes_3d,
        fibre_at: integers_1d,
        fibre_weights: floats_2d,
        fibre_area: floats_1d,
        fibres_across: ti.i32,
        shear_across: integers_2d,
        shear_down: integers_2d,
        shear_weights: floats_2d,
        shear_area: floats_1d,
        slopes: lanes_3d,
        rates: lanes_3d,
        stress: lanes_3d,
        bend_first: integers_1d,
        bend_nodes: integers_1d,
        bend_weights: floats_2d,
        bend_kind: integers_1d,
        bend_centre: integers_1d,
        bend_root: floats_1d,
        bend_counts: integers_1d,
        twist_weights: floats_2d,
        twist_centre: integers_1d,
        twist_root: floats_1d,
        cells: integers_2d,
        basis: floats_2d,
        normal: lanes_3d,
        faced_area: lanes_2d,
        rest_curvature: lanes_2d,
        friction: lanes_2d,
        added_mass: lanes_2d,
        held: integers_1d,
        shares: floats_2d,
        path: lanes_2d,
        path_first: integers_1d,
        point_first: integers_1d,
        point_nodes: integers_1d,
        point_weights: floats_2d,
        pull_points: integers_2d,
        pull_weights: floats_2d,
        targets: floats_3d,
        trust: floats_2d,
        target_first: integers_1d,
        target_every: integers_1d,
        material: lanes_2d,
        inverse_mass: lanes_2d,
        amplitude: lanes_2d,
        frame_step: integers_2d,
        frame_lag: floats_2d,
        frame_count: integers_1d,
        time_step: floats_1d,
        settle: integers_1d,
        settle_damping: ti.f32,
        gain: ti.f32,
        damping: ti.f32,
        seen: lanes_4d,
        shapes: lanes_4d,
        keep_shapes: ti.i32,
    ):
        groups = x.shape[0]
        for task in range(groups * TASK):
            if task % TASK == 0:
                b = task // TASK
                dt, settle_steps, steps_per_target = time_step[b], settle[b], target_every[b]
                settle_gain = 355.0  # (2 pi 3 Hz)^2: the first half of settling is drawn to the observed first shape
                settle_pull_damping = 37.7
                step = -settle_steps
                for frame in range(frame_count[b]):
                    while step < frame_step[b, frame]:
                        is_settling = step < 0
                        now = ti.max(step, 0)
                        rate = material[b, 8]
                        pull_gain, pull_damping, moving = gain, damping, 1.0
                        if is_settling:
                            rate = rate + settle_damping
                            pull_gain, pull_damping = settle_gain, settle_pull_damping
                            moving = 0.0  # at rest: the slope of a spline's end is mostly noise
                            if step >= -settle_steps // 2:
                                pull_gain = 0.0  # from the observed folds into the model's own equilibrium
                        zero = vec(0.0)
                        for i in range(f.shape[1]):
                            for c in ti.static(range(3)):
                                f[b, i, c] = zero
                        stretch, stretch_across, shear = material[b, 0], material[b, 1], material[b, 2]
                        bend, bend_across, twist = material[b, 3], material[b, 4], material[b, 5]
                        fibre_time, bend_time, stiffening = material[b, 6], material[b, 7], material[b, 9]
                        fibre_slopes(b, x, slopes, fibre_at, fibre_weights, fibres_across, fibre_nodes)
                        fibre_slopes(b, v, rates, fibre_at, fibre_weights, fibres_across, fibre_nodes)
                        fibres(
                            b, 0, fibres_across, slopes, rates, stress, fibre_area,
                            stretch_across, fibre_time, stiffening,
                        )  # fmt: skip
                        fibres(
                            b, fibres_across, fibre_area.shape[0], slopes, rates, stress, fibre_area,
                            stretch, fibre_time, stiffening,
                        )  # fmt: skip
                        shearing(
                            b, slopes, rates, stress, shear_across, shear_down, shear_weights, shear_area,
                            shear, fibre_time,
                        )  # fmt: skip
                        if ti.static(needs_normals):
                            find_normals(b, x, normal, faced_area, cells, basis, zero)
                        if ti.static(len(face_forces) > 0):
                            push_faces(b, v, f, normal, faced_area, amplitude)
                        if ti.static(with_twist):
                            twisting(
                                b, slopes, rates, stress, shear_across, twist_weights, twist_centre, twist_root,
                                twist, bend_time, normal, rest_curvature, friction, material[b, 13], dt, with_bends,
                            )  # fmt: skip
                        push_fibres(b, stress, f, fibre_at, fibre_weights, fibres_across, fibre_nodes)
                        bending(
                            b, x, v, f, bend_first, bend_nodes, bend_weights, bend_kind, bend_centre, bend_root,
                            bend_counts, bend_lengths, bend, bend_across, twist, bend_time,
                            normal, rest_curvature, friction, material[b, 13], dt, with_bends, slopes, rates,
                        )  # fmt: skip
                        keep = 1.0 - 0.5 * dt * rate
                        give = 1.0 / (1.0 + 0.5 * dt * rate)
                        if pull_gain > 0.0:
                            sample = now // steps_per_target
                            part = ti.cast(now - sample * steps_per_target, ti.f32) / ti.cast(steps_per_target, ti.f32)
                            pull_at_points(
                                b,
                                target_first[b] + sample,
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
                        for i in range(f.shape[1]):
                            a0 = f[b, i, 0] * inverse_mass[b, i] + material[b, 10]
                            a1 = f[b, i, 1] * inverse_mass[b, i] + material[b, 11]
                            a2 = f[b, i, 2] * inverse_mass[b, i] + material[b, 12]
                            if ti.static(with_added_mass):
                                n0, n1, n2 = normal[b, i, 0], normal[b, i, 1], normal[b, i, 2]
                                ratio = added_mass[b, i] * inverse_mass[b, i]
                                less = (a0 * n0 + a1 * n1 + a2 * n2) * ratio / (1.0 + ratio)
                                a0, a1, a2 = a0 - less * n0, a1 - less * n1, a2 - less * n2
                            if pull_gain > 0.0:
                                j, k, m = pull_points[i, 0], pull_points[i, 1], pull_points[i, 2]
                                wj, wk, wm = pull_weights[i, 0], pull_weights[i, 1], pull_weights[i, 2]
                                a0 = a0 + (wj * pull[b, j, 0] + wk * pull[b, k, 0] + wm * pull[b, m, 0])
                                a1 = a1 + (wj * pull[b, j, 1] + wk * pull[b, k, 1] + wm * pull[b, m, 1])
                                a2 = a2 + (wj * pull[b, j, 2] + wk * pull[b, k, 2] + wm * pull[b, m, 2])
                            s0 = (keep * v[b, i, 0] + dt * a0) * give
                            s1 = (keep * v[b, i, 1] + dt * a1) * give
                            s2 = (keep * v[b, i, 2] + dt * a2) * give
                            v[b, i, 0], v[b, i, 1], v[b, i, 2] = s0, s1, s2
                            x[b, i, 0] = x[b, i, 0] + dt * s0
                            x[b, i, 1] = x[b, i, 1] + dt * s1
                            x[b, i, 2] = x[b, i, 2] + dt * s2
                        if ti.static(handles > 0):
                            # Held nodes moved freely with the rest; put them where their handles are after this step.
                            for h in range(held.shape[0]):
                                i = held[h]
                                for c in ti.static(range(3)):
                                    x[b, i, c] = x[b, i, c] - dt * v[b, i, c]
                            hold(b, path_first[b] + ti.max(step + 1, 0), x, v, held, shares, path, 1.0 / dt)
                        step += 1
                    lag = frame_lag[b, frame]
                    for p in range(pull.shape[1]):
                        for c in ti.static(range(3)):
                            seen[b, frame, p, c] = vec(0.0)
                        for n in range(point_first[p], point_first[p + 1]):
                            w, i = point_weights[n, 0], point_nodes[n]
                            for c in ti.static(range(3)):
                                seen[b, frame, p, c] = seen[b, frame, p, c] + w * (x[b, i, c] + lag * v[b, i, c])
                    if keep_shapes == 1:
                        for i in range(x.shape[1]):
                            for c in ti.static(range(3)):
                                shapes[b, frame, i, c] = x[b, i, c] + lag * v[b, i, c]

    return rollout

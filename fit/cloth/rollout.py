"""Whole rollouts of many cloths at once, candidates side by side in SIMD lanes, in one Taichi kernel.

One step of symplectic leapfrog (kick, then drift; Hairer, Lubich & Wanner, "Geometric Numerical Integration",
section I.3), for node positions x [m] and velocities v [m/s]:

    v <- ((1 - c dt/2) v + dt (f/m + g + pull)) / (1 + c dt/2)        x <- x + dt v

f is the sum of
    membrane   St. Venant-Kirchhoff, orthotropic, without Poisson coupling: with Fu, Fv the columns of the
               deformation gradient, tensions S11 = k_u E11 (1 + a |E11|) of E11 = (Fu.Fu - 1)/2, S22 alike, S12 = G
               Fu.Fv,
               each plus Kelvin-Voigt damping time x stiffness x strain rate; force on the corners from P = [Fu Fv] S
    bending    -B W'(W x - kappa_0 sqrt(area) n), the gradient of the plate energy (fit.cloth.mesh), with Kelvin-Voigt
               damping and, where an effect asks for it, a rest curvature kappa_0 and Dahl friction along the normal n
    effects    forces on faces from the chosen effects (fit.effects); mass m_a that is added to the normal motion,
               (m + m_a n n') a = F, so a = (F - n (n.F) m_a/(m + m_a)) / m
pull is the observer's (fit.gap.observer): w^2 (y - x) + 2 zeta w (ydot - v), spread from the tracked points.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import functools

import taichi as ti

from fit.effects.bending_hysteresis import REFERENCE_CURVATURE

TASK = 512  # Taichi hands out loops in tasks of at least 512 iterations; one task per group of lanes


@functools.cache
def make_rollout(lanes: int, face_forces: tuple, with_bends: bool, with_added_mass: bool):
    """Build the rollout kernel for `lanes` candidates per group and these effects.

    face_forces: per effect (first column of its amplitude, number of components, force), where force is a
    `ti.func(a0, a1, a2, vx, vy, vz, nx, ny, nz, area) -> (fx, fy, fz)`;
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
    needs_normals = with_bends or with_added_mass

    @ti.func
    def membrane(
        b,
        x: ti.template(),
        v: ti.template(),
        f: ti.template(),
        triangles: ti.template(),
        inverse: ti.template(),
        area: ti.template(),
        stretch,
        stretch_across,
        shear,
        time,
        stiffening,
        amplitude: ti.template(),
    ):
        for e in range(triangles.shape[0]):
            i, j, k = triangles[e, 0], triangles[e, 1], triangles[e, 2]
            b00, b01, b10, b11 = inverse[e, 0], inverse[e, 1], inverse[e, 2], inverse[e, 3]
            a = area[e]
            xi0, xi1, xi2 = x[b, i, 0], x[b, i, 1], x[b, i, 2]
            p0, p1, p2 = x[b, j, 0] - xi0, x[b, j, 1] - xi1, x[b, j, 2] - xi2
            q0, q1, q2 = x[b, k, 0] - xi0, x[b, k, 1] - xi1, x[b, k, 2] - xi2
            vi0, vi1, vi2 = v[b, i, 0], v[b, i, 1], v[b, i, 2]
            vj0, vj1, vj2 = v[b, j, 0], v[b, j, 1], v[b, j, 2]
            vk0, vk1, vk2 = v[b, k, 0], v[b, k, 1], v[b, k, 2]
            u0, u1, u2 = b00 * p0 + b10 * q0, b00 * p1 + b10 * q1, b00 * p2 + b10 * q2
            w0, w1, w2 = b01 * p0 + b11 * q0, b01 * p1 + b11 * q1, b01 * p2 + b11 * q2
            r0, r1, r2 = vj0 - vi0, vj1 - vi1, vj2 - vi2
            s0, s1, s2 = vk0 - vi0, vk1 - vi1, vk2 - vi2
            du0, du1, du2 = b00 * r0 + b10 * s0, b00 * r1 + b10 * s1, b00 * r2 + b10 * s2
            dw0, dw1, dw2 = b01 * r0 + b11 * s0, b01 * r1 + b11 * s1, b01 * r2 + b11 * s2
            e11 = 0.5 * (u0 * u0 + u1 * u1 + u2 * u2 - 1.0)
            e22 = 0.5 * (w0 * w0 + w1 * w1 + w2 * w2 - 1.0)
            s11 = stretch_across * (e11 + stiffening * ti.abs(e11) * e11 + time * (u0 * du0 + u1 * du1 + u2 * du2))
            s22 = stretch * (e22 + stiffening * ti.abs(e22) * e22 + time * (w0 * dw0 + w1 * dw1 + w2 * dw2))
            s12 = shear * (
                u0 * w0 + u1 * w1 + u2 * w2 + time * (u0 * dw0 + u1 * dw1 + u2 * dw2 + w0 * du0 + w1 * du1 + w2 * du2)
            )
            g0, g1, g2 = s11 * u0 + s12 * w0, s11 * u1 + s12 * w1, s11 * u2 + s12 * w2
            h0, h1, h2 = s12 * u0 + s22 * w0, s12 * u1 + s22 * w1, s12 * u2 + s22 * w2
            fj0, fj1, fj2 = -a * (b00 * g0 + b01 * h0), -a * (b00 * g1 + b01 * h1), -a * (b00 * g2 + b01 * h2)
            fk0, fk1, fk2 = -a * (b10 * g0 + b11 * h0), -a * (b10 * g1 + b11 * h1), -a * (b10 * g2 + b11 * h2)
            fi0, fi1, fi2 = -fj0 - fk0, -fj1 - fk1, -fj2 - fk2
            if ti.static(len(face_forces) > 0):
                n0, n1, n2 = p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0
                length = ti.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-20
                n0, n1, n2 = n0 / length, n1 / length, n2 / length
                c0, c1, c2 = (vi0 + vj0 + vk0) / 3.0, (vi1 + vj1 + vk1) / 3.0, (vi2 + vj2 + vk2) / 3.0
                for m in ti.static(range(len(face_forces))):
                    a0, a1, a2 = amplitude[b, face_forces[m][0]], vec(0.0), vec(0.0)
                    if ti.static(face_forces[m][1] > 1):
                        a1 = amplitude[b, face_forces[m][0] + 1]
                    if ti.static(face_forces[m][1] > 2):
                        a2 = amplitude[b, face_forces[m][0] + 2]
                    t0, t1, t2 = face_forces[m][2](a0, a1, a2, c0, c1, c2, n0, n1, n2, 0.5 * length)
                    fi0, fi1, fi2 = fi0 + t0 / 3.0, fi1 + t1 / 3.0, fi2 + t2 / 3.0
                    fj0, fj1, fj2 = fj0 + t0 / 3.0, fj1 + t1 / 3.0, fj2 + t2 / 3.0
                    fk0, fk1, fk2 = fk0 + t0 / 3.0, fk1 + t1 / 3.0, fk2 + t2 / 3.0
            # Load, add, store: `+=` on memory would be an atomic, three times slower.
            f[b, i, 0], f[b, i, 1], f[b, i, 2] = f[b, i, 0] + fi0, f[b, i, 1] + fi1, f[b, i, 2] + fi2
            f[b, j, 0], f[b, j, 1], f[b, j, 2] = f[b, j, 0] + fj0, f[b, j, 1] + fj1, f[b, j, 2] + fj2
            f[b, k, 0], f[b, k, 1], f[b, k, 2] = f[b, k, 0] + fk0, f[b, k, 1] + fk1, f[b, k, 2] + fk2

    @ti.func
    def find_normals(b, x: ti.template(), normal: ti.template(), triangles: ti.template()):
        """Area-weighted unit normals of the nodes."""
        for i in range(normal.shape[1]):
            for c in ti.static(range(3)):
                normal[b, i, c] = vec(0.0)
        for e in range(triangles.shape[0]):
            i, j, k = triangles[e, 0], triangles[e, 1], triangles[e, 2]
            p0, p1, p2 = x[b, j, 0] - x[b, i, 0], x[b, j, 1] - x[b, i, 1], x[b, j, 2] - x[b, i, 2]
            q0, q1, q2 = x[b, k, 0] - x[b, i, 0], x[b, k, 1] - x[b, i, 1], x[b, k, 2] - x[b, i, 2]
            n0, n1, n2 = p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0
            for corner in ti.static(range(3)):
                m = triangles[e, corner]
                normal[b, m, 0] = normal[b, m, 0] + n0
                normal[b, m, 1] = normal[b, m, 1] + n1
                normal[b, m, 2] = normal[b, m, 2] + n2
        for i in range(normal.shape[1]):
            n0, n1, n2 = normal[b, i, 0], normal[b, i, 1], normal[b, i, 2]
            length = ti.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-20
            normal[b, i, 0], normal[b, i, 1], normal[b, i, 2] = n0 / length, n1 / length, n2 / length

    @ti.func
    def bending(
        b,
        x: ti.template(),
        v: ti.template(),
        f: ti.template(),
        bends: ti.template(),
        weights: ti.template(),
        kinds: ti.template(),
        roots: ti.template(),
        stiffness,
        stiffness_across,
        stiffness_twist,
        time,
        normal: ti.template(),
        rest: ti.template(),
        friction: ti.template(),
        friction_limit,
        dt,
    ):
        for e in range(bends.shape[0]):
            i, j, k, m = bends[e, 0], bends[e, 1], bends[e, 2], bends[e, 3]
            wi, wj, wk, wm = weights[e, 0], weights[e, 1], weights[e, 2], weights[e, 3]
            modulus = stiffness
            if kinds[e] == 0:
                modulus = stiffness_across
            elif kinds[e] == 2:
                modulus = stiffness_twist
            along = vec(0.0)  # moment along the normal from rest curvature and friction
            if ti.static(with_bends):
                change = vec(0.0)
                for c in ti.static(range(3)):
                    rate = wi * v[b, i, c] + wj * v[b, j, c] + wk * v[b, k, c] + wm * v[b, m, c]
                    change = change + rate * normal[b, j, c]
                change = change / roots[e] * dt
                # Dahl, exponent 1, integrated exactly over a change of one sign:
                # M -> s + (M - s) exp(-|dkappa| / kappa_ref), s = sign(dkappa) M_max
                goal = ti.select(change > 0.0, friction_limit, -friction_limit)
                fade = ti.exp(-ti.abs(change) / REFERENCE_CURVATURE)
                friction[b, e] = goal + (friction[b, e] - goal) * fade
                along = roots[e] * (friction[b, e] - modulus * rest[b, e])
            for c in ti.static(range(3)):
                curl = wi * x[b, i, c] + wj * x[b, j, c] + wk * x[b, k, c] + wm * x[b, m, c]
                rate = wi * v[b, i, c] + wj * v[b, j, c] + wk * v[b, k, c] + wm * v[b, m, c]
                moment = modulus * (curl + time * rate)
                if ti.static(with_bends):
                    moment = moment + along * normal[b, j, c]
                f[b, i, c] = f[b, i, c] - wi * moment
                f[b, j, c] = f[b, j, c] - wj * moment
                f[b, k, c] = f[b, k, c] - wk * moment
                f[b, m, c] = f[b, m, c] - wm * moment

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
        nodes: ti.template(),
        weights: ti.template(),
        targets: ti.template(),
        trust: ti.template(),
    ):
        for p in range(nodes.shape[0]):
            i, j, k = nodes[p, 0], nodes[p, 1], nodes[p, 2]
            wi, wj, wk = weights[p, 0], weights[p, 1], weights[p, 2]
            believed = (1.0 - part) * trust[sample, p] + part * trust[sample + 1, p]
            for c in ti.static(range(3)):
                y = (1.0 - part) * targets[sample, p, c] + part * targets[sample + 1, p, c]
                dy = (1.0 - part) * targets[sample, p, c + 3] + part * targets[sample + 1, p, c + 3]
                here = wi * x[b, i, c] + wj * x[b, j, c] + wk * x[b, k, c]
                speed = wi * v[b, i, c] + wj * v[b, j, c] + wk * v[b, k, c]
                pull[b, p, c] = believed * (gain * (y - here) + damping * (moving * dy - speed))

    @ti.func
    def hold(
        b,
        step,
        x: ti.template(),
        v: ti.template(),
        held: ti.template(),
        fraction: ti.template(),
        path: ti.template(),
        per_second,
    ):
        for h in range(held.shape[0]):
            i = held[h]
            s = fraction[h]
            for c in ti.static(range(3)):
                place = (1.0 - s) * path[b, step, c] + s * path[b, step, c + 3]
                v[b, i, c] = (place - x[b, i, c]) * per_second
                x[b, i, c] = place

    @ti.kernel
    def rollout(
        x: lanes_3d,
        v: lanes_3d,
        f: lanes_3d,
        pull: lanes_3d,
        triangles: integers_2d,
        inverse: floats_2d,
        area: floats_1d,
        bends: integers_2d,
        bend_weights: floats_2d,
        bend_kind: integers_1d,
        bend_root: floats_1d,
        normal: lanes_3d,
        rest_curvature: lanes_2d,
        friction: lanes_2d,
        added_mass: lanes_2d,
        held: integers_1d,
        fraction: floats_1d,
        path: lanes_3d,
        point_nodes: integers_2d,
        point_weights: floats_2d,
        pull_points: integers_2d,
        pull_weights: floats_2d,
        targets: floats_3d,
        trust: floats_2d,
        steps_per_target: ti.i32,
        material: lanes_2d,
        inverse_mass: lanes_2d,
        amplitude: lanes_2d,
        frame_step: integers_1d,
        frame_lag: floats_1d,
        dt: ti.f32,
        settle_steps: ti.i32,
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
                frames = frame_step.shape[0]
                settle_gain = 355.0  # (2 pi 3 Hz)^2: the first half of settling is drawn to the observed first shape
                settle_pull_damping = 37.7
                step = -settle_steps
                for frame in range(frames):
                    while step < frame_step[frame]:
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
                        for i in range(f.shape[1]):
                            for c in ti.static(range(3)):
                                f[b, i, c] = vec(0.0)
                        membrane(
                            b,
                            x,
                            v,
                            f,
                            triangles,
                            inverse,
                            area,
                            material[b, 0],
                            material[b, 1],
                            material[b, 2],
                            material[b, 6],
                            material[b, 9],
                            amplitude,
                        )
                        if ti.static(needs_normals):
                            find_normals(b, x, normal, triangles)
                        bending(
                            b,
                            x,
                            v,
                            f,
                            bends,
                            bend_weights,
                            bend_kind,
                            bend_root,
                            material[b, 3],
                            material[b, 4],
                            material[b, 5],
                            material[b, 7],
                            normal,
                            rest_curvature,
                            friction,
                            material[b, 13],
                            dt,
                        )
                        keep = 1.0 - 0.5 * dt * rate
                        give = 1.0 / (1.0 + 0.5 * dt * rate)
                        if pull_gain > 0.0:
                            sample = now // steps_per_target
                            part = ti.cast(now - sample * steps_per_target, ti.f32) / ti.cast(steps_per_target, ti.f32)
                            pull_at_points(
                                b,
                                sample,
                                part,
                                pull_gain,
                                pull_damping,
                                moving,
                                x,
                                v,
                                pull,
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
                        # Held nodes moved freely with the rest; put them where the hanger is after this step.
                        for h in range(held.shape[0]):
                            i = held[h]
                            for c in ti.static(range(3)):
                                x[b, i, c] = x[b, i, c] - dt * v[b, i, c]
                        hold(b, ti.max(step + 1, 0), x, v, held, fraction, path, 1.0 / dt)
                        step += 1
                    lag = frame_lag[frame]
                    for p in range(point_nodes.shape[0]):
                        i, j, k = point_nodes[p, 0], point_nodes[p, 1], point_nodes[p, 2]
                        wi, wj, wk = point_weights[p, 0], point_weights[p, 1], point_weights[p, 2]
                        for c in ti.static(range(3)):
                            seen[b, frame, p, c] = (
                                wi * (x[b, i, c] + lag * v[b, i, c])
                                + wj * (x[b, j, c] + lag * v[b, j, c])
                                + wk * (x[b, k, c] + lag * v[b, k, c])
                            )
                    if keep_shapes == 1:
                        for i in range(x.shape[1]):
                            for c in ti.static(range(3)):
                                shapes[b, frame, i, c] = x[b, i, c] + lag * v[b, i, c]

    return rollout

"""The generator's cloth: velocity Verlet in double precision, every law its own.

    v <- e^(-c dt/2) v + dt/2 a(x, v);   x <- x + dt v;   v <- (v + dt/2 a(x, v)) e^(-c dt/2)

Membrane: orthotropic St. Venant-Kirchhoff with Poisson coupling, S11 = k1 (E11 + nu E22), S22 = k2 (E22 + nu E11),
S12 = 2 G E12, on an irregular mesh (`fit.blind.sheet`). Source: J. Bonet, R. Wood, "Nonlinear Continuum Mechanics for
Finite Element Analysis" (2008), section 6.4; the integrator: W. Swope et al., J. Chem. Phys. 76 (1982).
Air: f = 1/2 rho c(alpha) A |v_n| v_n with c(alpha) = c (1.15 - 0.3 sin alpha), a plate that stalls, and a skin
friction of 2 %; Hoerner, "Fluid-Dynamic Drag" (1965), section 3.6.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import taichi as ti

PARAMETERS = (
    "warp", "weft", "poisson", "shear", "stiffening", "membrane_viscosity", "bending_viscosity", "damping",
    "friction", "drag", "lift", "wake", "gx", "gy", "gz", "wx", "wy", "wz", "magnet", "mx", "my", "mz", "wall",
    "wall_y",
)  # fmt: skip
TASK = 512  # Taichi hands out loops in tasks of at least 512 iterations
AIR = 1.2  # kg/m^3
YIELD_CURVATURE = 6.0  # 1/m at which threads begin to slide
WAKE_TIME = 0.25  # s that the air remembers
MAGNET_REACH = 0.08  # m

_d1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
_d2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
_d3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
_d4 = ti.types.ndarray(dtype=ti.f64, ndim=4)
_i1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
_i2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.func
def _forces(
    t: ti.i32, x: ti.template(), v: ti.template(), f: ti.template(), normal: ti.template(), slide: ti.template(),
    triangles: ti.template(), inverse: ti.template(), area: ti.template(), hinges: ti.template(),
    weights: ti.template(), stiffness: ti.template(), rest: ti.template(), scale: ti.template(), p: ti.template(),
    with_bends: ti.i32,
):  # fmt: skip
    for i in range(f.shape[1]):
        for c in ti.static(range(3)):
            f[t, i, c] = 0.0
            normal[t, i, c] = 0.0
    for e in range(triangles.shape[0]):
        i, j, k = triangles[e, 0], triangles[e, 1], triangles[e, 2]
        xi = ti.Vector([x[t, i, 0], x[t, i, 1], x[t, i, 2]])
        q1 = ti.Vector([x[t, j, 0], x[t, j, 1], x[t, j, 2]]) - xi
        q2 = ti.Vector([x[t, k, 0], x[t, k, 1], x[t, k, 2]]) - xi
        vi = ti.Vector([v[t, i, 0], v[t, i, 1], v[t, i, 2]])
        vj = ti.Vector([v[t, j, 0], v[t, j, 1], v[t, j, 2]])
        vk = ti.Vector([v[t, k, 0], v[t, k, 1], v[t, k, 2]])
        b00, b01, b10, b11 = inverse[e, 0], inverse[e, 1], inverse[e, 2], inverse[e, 3]
        fu, fw = b00 * q1 + b10 * q2, b01 * q1 + b11 * q2
        du, dw = b00 * (vj - vi) + b10 * (vk - vi), b01 * (vj - vi) + b11 * (vk - vi)
        tau = p[t, 5]
        e1 = 0.5 * (fu.dot(fu) - 1.0) + tau * fu.dot(du)
        e2 = 0.5 * (fw.dot(fw) - 1.0) + tau * fw.dot(dw)
        e3 = 0.5 * fu.dot(fw) + 0.5 * tau * (fu.dot(dw) + fw.dot(du))
        s1 = p[t, 1] * (e1 + p[t, 2] * e2) * (1.0 + p[t, 4] * ti.max(e1, 0.0))
        s2 = p[t, 0] * (e2 + p[t, 2] * e1) * (1.0 + p[t, 4] * ti.max(e2, 0.0))
        s3 = 2.0 * p[t, 3] * e3
        g, h = s1 * fu + s3 * fw, s3 * fu + s2 * fw
        fj = -area[e] * (b00 * g + b01 * h)
        fk = -area[e] * (b10 * g + b11 * h)
        fi = -fj - fk
        doubled = q1.cross(q2)
        size = doubled.norm() + 1e-15
        n = doubled / size
        wind = ti.Vector([p[t, 15], p[t, 16], p[t, 17]])
        mean = (vi + vj + vk) / 3.0
        air = ti.Vector([0.0, 0.0, 0.0])
        if p[t, 9] > 0.0:
            along = mean.dot(n)
            sine = ti.abs(along) / (mean.norm() + 1e-9)
            air += -0.5 * AIR * p[t, 9] * (1.15 - 0.3 * sine) * ti.abs(along) * along * n
            skin = mean - along * n
            air += -0.5 * AIR * 0.02 * skin.norm() * skin
        if wind.norm() > 0.0:
            still = mean.dot(n)
            relative = (mean - wind).dot(n)
            air += -0.5 * AIR * 1.1 * (ti.abs(relative) * relative - ti.abs(still) * still) * n
        if p[t, 10] > 0.0:
            along = mean.dot(n)
            air += -0.5 * AIR * p[t, 10] * (mean - along * n).norm() * along * n
        push = air * 0.5 * size / 3.0
        for c in ti.static(range(3)):
            f[t, i, c] = f[t, i, c] + fi[c] + push[c]
            f[t, j, c] = f[t, j, c] + fj[c] + push[c]
            f[t, k, c] = f[t, k, c] + fk[c] + push[c]
            normal[t, i, c] = normal[t, i, c] + doubled[c]
            normal[t, j, c] = normal[t, j, c] + doubled[c]
            normal[t, k, c] = normal[t, k, c] + doubled[c]
    for i in range(f.shape[1]):
        n = ti.Vector([normal[t, i, 0], normal[t, i, 1], normal[t, i, 2]]).normalized(1e-15)
        for c in ti.static(range(3)):
            normal[t, i, c] = n[c]
    for e in range(hinges.shape[0]):
        i, j, k, m = hinges[e, 0], hinges[e, 1], hinges[e, 2], hinges[e, 3]
        a, b, c4, d = weights[e, 0], weights[e, 1], weights[e, 2], weights[e, 3]
        bent = ti.Vector([0.0, 0.0, 0.0])
        n = ti.Vector([0.0, 0.0, 0.0])
        for c in ti.static(range(3)):
            here = a * x[t, i, c] + b * x[t, j, c] + c4 * x[t, k, c] + d * x[t, m, c]
            rate = a * v[t, i, c] + b * v[t, j, c] + c4 * v[t, k, c] + d * v[t, m, c]
            bent[c] = stiffness[t, e] * here + p[t, 6] * rate
            n[c] = normal[t, i, c] + normal[t, j, c]
        if with_bends == 1:
            n = n.normalized(1e-15)
            lift = ti.Vector([0.0, 0.0, 0.0])
            for c in ti.static(range(3)):
                lift[c] = a * x[t, i, c] + b * x[t, j, c] + c4 * x[t, k, c] + d * x[t, m, c]
            curvature = lift.dot(n) / scale[e]
            if p[t, 8] > 0.0:
                # Prandtl: elastic up to the yield moment, then sliding
                gap = ti.max(ti.min(curvature - slide[t, e], YIELD_CURVATURE), -YIELD_CURVATURE)
                slide[t, e] = curvature - gap
                bent += scale[e] * p[t, 8] * gap / YIELD_CURVATURE * n
            bent -= stiffness[t, e] * scale[e] * rest[t, e] * n
        for c in ti.static(range(3)):
            f[t, i, c] = f[t, i, c] - a * bent[c]
            f[t, j, c] = f[t, j, c] - b * bent[c]
            f[t, k, c] = f[t, k, c] - c4 * bent[c]
            f[t, m, c] = f[t, m, c] - d * bent[c]


@ti.kernel
def swing(
    x: _d3, v: _d3, f: _d3, normal: _d3, slide: _d2, memory: _d2, triangles: _i2, inverse: _d2, area: _d1,
    hinges: _i2, weights: _d2, stiffness: _d2, rest: _d2, scale: _d1, mass: _d2, added: _d2, p: _d2,
    top: _i1, path: _d4, samples_per_second: ti.f64, is_held: _i1,
    point_nodes: _i2, point_weights: _d2, frame_times: _d2, seen: _d4,
    dt: ti.f64, settle: ti.i32, steps: ti.i32, with_bends: ti.i32, with_extras: ti.i32,
):  # fmt: skip
    """Run takes side by side; (takes, ...) arrays, names as in `fit.blind.engine`."""
    for task in range(x.shape[0] * TASK):
        if task % TASK == 0:
            t = task // TASK
            frame = 0
            _forces(t, x, v, f, normal, slide, triangles, inverse, area, hinges, weights, stiffness, rest, scale, p,
                    with_bends)  # fmt: skip
            for step in range(-settle, steps):
                now = ti.max(step, 0) * dt
                rate = p[t, 7]
                if step < 0:
                    rate = 6.0
                fade = ti.exp(-0.5 * rate * dt)
                for half in ti.static(range(2)):
                    for i in range(x.shape[1]):
                        a = ti.Vector([f[t, i, 0], f[t, i, 1], f[t, i, 2]]) / mass[t, i]
                        a += ti.Vector([p[t, 12], p[t, 13], p[t, 14]])
                        n = ti.Vector([normal[t, i, 0], normal[t, i, 1], normal[t, i, 2]])
                        vel = ti.Vector([v[t, i, 0], v[t, i, 1], v[t, i, 2]])
                        if with_extras == 1:
                            if p[t, 18] > 0.0:
                                away = ti.Vector([p[t, 19], p[t, 20], p[t, 21]]) - ti.Vector(
                                    [x[t, i, 0], x[t, i, 1], x[t, i, 2]]
                                )
                                a += p[t, 18] * away / MAGNET_REACH * ti.exp(-away.dot(away) / MAGNET_REACH**2)
                            if p[t, 22] > 0.0 and x[t, i, 1] > p[t, 23]:
                                a[1] -= p[t, 22] * (x[t, i, 1] - p[t, 23]) + 40.0 * vel[1]
                            if p[t, 11] > 0.0:
                                a -= p[t, 11] * (vel.dot(n) - memory[t, i]) / WAKE_TIME * n
                        carried = added[t, i] / (mass[t, i] + added[t, i])
                        a -= carried * a.dot(n) * n
                        if ti.static(half == 0):
                            vel = fade * vel + 0.5 * dt * a
                        else:
                            vel = fade * (vel + 0.5 * dt * a)
                            if with_extras == 1:
                                memory[t, i] += dt / WAKE_TIME * (vel.dot(n) - memory[t, i])
                        for c in ti.static(range(3)):
                            if is_held[i] == 0:
                                v[t, i, c] = vel[c]
                                if ti.static(half == 0):
                                    x[t, i, c] = x[t, i, c] + dt * vel[c]
                    if ti.static(half == 0):
                        place = ti.min((now + dt if step >= 0 else 0.0) * samples_per_second, path.shape[1] - 1.001)
                        s = ti.cast(place, ti.i32)
                        r = place - s
                        for h in range(top.shape[0]):
                            for c in ti.static(range(3)):
                                goal = (1.0 - r) * path[t, s, h, c] + r * path[t, s + 1, h, c]
                                v[t, top[h], c] = (goal - x[t, top[h], c]) / dt
                                x[t, top[h], c] = goal
                        _forces(t, x, v, f, normal, slide, triangles, inverse, area, hinges, weights, stiffness, rest,
                                scale, p, with_bends)  # fmt: skip
                while frame < frame_times.shape[1] and step >= 0 and frame_times[t, frame] <= now + dt:
                    lag = ti.max(frame_times[t, frame], 0.0) - (now + dt)
                    for k in range(point_nodes.shape[0]):
                        for c in ti.static(range(3)):
                            total = 0.0
                            for corner in ti.static(range(3)):
                                node = point_nodes[k, corner]
                                total += point_weights[k, corner] * (x[t, node, c] + lag * v[t, node, c])
                            seen[t, frame, k, c] = total
                    frame += 1

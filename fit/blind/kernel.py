"""The generator's step: velocity Verlet with exact damping in each half kick, one Taichi kernel for a batch of takes.

    v <- e^(-c dt/2) v + dt/2 a,    x <- x + dt v,    a <- F(x, v) / m,    v <- e^(-c dt/2) (v + dt/2 a)

Source: L. Verlet's method in the form of W. C. Swope et al., J. Chem. Phys. 76, 637 (1982), with the linear damping c
split off exactly (G. Strang, SIAM J. Numer. Anal. 5 (1968)).

F per triangle of rest area A, deformation gradient columns u, w, their unit normal n, J = |u x w|:
    ground     mu/2 (|u|^2 + |w|^2 - 2 J) + (lambda + mu)/2 (J - 1)^2       compressible neo-Hookean, Poisson coupling
    fibres     k_1/2 (|w| - 1)^2 + k_2/2 (|u| - 1)^2, cubic stiffening and Kelvin-Voigt where planted
Source: J. Bonet & R. D. Wood, "Nonlinear Continuum Mechanics for Finite Element Analysis" (2008), section 6.4; fibres:
G. A. Holzapfel, T. C. Gasser, R. W. Ogden, J. Elasticity 61 (2000), section 5.
F per hinge: `fit.blind.sheet`; friction in bending as two Jenkins elements in parallel (W. D. Iwan, J. Appl. Mech. 33
(1966), section 2). Air: a plate's normal coefficient C_N = c 0.505 / (0.222 + 0.283 / sin(angle of attack))
(S. F. Hoerner, "Fluid-Dynamic Drag" (1965), chapter 3), lift with Polhamus' cos^2 (E. C. Polhamus, NASA TN D-3767
(1966)). Forces of `fit.blind.plants` that no library knows act on triangles and nodes in the same pass.
"""

# mypy: ignore-errors
# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import taichi as ti

TASK = 512  # Taichi hands out loops in tasks of at least 512 iterations; one task per take
AIR_DENSITY = 1.2041  # kg/m^3, dry air at 20 degC and 101.325 kPa
GRAVITY = 9.80665  # m/s^2
SKIN_FRICTION = 0.02  # of the normal coefficient, along the cloth

# Columns of `numbers`, one row per take.
NAMES = (
    "gravity_x", "gravity_y", "gravity_z", "damping", "mu", "lam", "fibre_warp", "fibre_weft", "stiffening",
    "stretch_time", "bend_viscosity", "friction", "drag", "lift", "wind_x", "wind_y", "wind_z", "gust_phase", "wake",
    "wake_time", "added_mass", "bob_mass", "bob_length", "bob_node", "thread", "thread_node", "thread_x", "thread_y",
    "thread_z", "thread_length", "magnet", "magnet_x", "magnet_y", "magnet_z", "magnet_reach",
)  # fmt: skip
(
    GX, GY, GZ, DAMPING, MU, LAM, WARP, WEFT, STIFFENING, STRETCH_TIME, VISCOSITY, FRICTION, DRAG, LIFT, WX, WY, WZ,
    GUST, WAKE, WAKE_TIME, ADDED, BOB, BOB_LENGTH, BOB_NODE, THREAD, THREAD_NODE, TX, TY, TZ, THREAD_LENGTH, MAGNET,
    MX, MY, MZ, REACH,
) = range(len(NAMES))  # fmt: skip
FIRST_YIELD, SECOND_YIELD = 4.0, 16.0  # 1/m of hinge curvature at which the two friction elements slide
HINGE_SHARE = 2.25  # friction moment of a hinge per moment of the sheet, mean of bending about warp and weft
BOB_STIFFNESS = 25.0  # N/m of the string that a corner weight hangs on

f1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
f4 = ti.types.ndarray(dtype=ti.f64, ndim=4)
i1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.func
def at(a: ti.template(), b, i):
    """Return row i of take b as a vector."""
    return ti.Vector([a[b, i, 0], a[b, i, 1], a[b, i, 2]])


@ti.func
def put(a: ti.template(), b, i, value):
    """Store a vector in row i of take b."""
    a[b, i, 0], a[b, i, 1], a[b, i, 2] = value[0], value[1], value[2]


@ti.func
def add(a: ti.template(), b, i, value):
    """Add a vector to row i of take b."""
    # Load, add, store: `+=` on memory would be an atomic.
    a[b, i, 0], a[b, i, 1], a[b, i, 2] = a[b, i, 0] + value[0], a[b, i, 1] + value[1], a[b, i, 2] + value[2]


@ti.func
def plate(speed, along_normal, coefficient):
    """Normal force per area [Pa] of a plate in a flow of this speed and normal component [m/s]."""
    attack = ti.abs(along_normal) / (speed + 1e-12)
    return 0.5 * AIR_DENSITY * coefficient * speed * along_normal * 0.505 / (0.222 * attack + 0.283)


@ti.func
def on_triangles(b, now, dt, x: ti.template(), v: ti.template(), f: ti.template(), normal: ti.template(),
                 wake: ti.template(), triangles: ti.template(), inverse: ti.template(), area: ti.template(),
                 p: ti.template()):  # fmt: skip
    """Add the membrane's and the air's forces of every triangle."""
    mu, lam, warp, weft = p[b, MU], p[b, LAM], p[b, WARP], p[b, WEFT]
    stiffening, time = p[b, STIFFENING], p[b, STRETCH_TIME]
    has_air = p[b, DRAG] > 0 or p[b, LIFT] > 0 or p[b, WAKE] > 0
    wind = ti.Vector([p[b, WX], p[b, WY], p[b, WZ]]) * (1.0 + 0.15 * ti.sin(1.9 * now + p[b, GUST]))
    wind_speed = wind.norm()
    for e in range(triangles.shape[0]):
        i, j, k = triangles[e, 0], triangles[e, 1], triangles[e, 2]
        b00, b01, b10, b11 = inverse[e, 0], inverse[e, 1], inverse[e, 2], inverse[e, 3]
        xi = at(x, b, i)
        q, r = at(x, b, j) - xi, at(x, b, k) - xi
        u, w = b00 * q + b10 * r, b01 * q + b11 * r
        cross = u.cross(w)
        jacobian = ti.sqrt(cross.dot(cross)) + 1e-12
        n = cross / jacobian
        pressure = (lam + mu) * (jacobian - 1.0) - mu
        wn, nu = w.cross(n), n.cross(u)
        lu, lw = ti.sqrt(u.dot(u)), ti.sqrt(w.dot(w))
        eu, ew = lu - 1.0, lw - 1.0
        su, sw = weft * eu, warp * ew
        if stiffening > 0:
            au, aw = stiffening * ti.abs(eu), stiffening * ti.abs(ew)
            su, sw = su * (1.0 + au + 0.5 * au * au), sw * (1.0 + aw + 0.5 * aw * aw)
        if time > 0:
            vi = at(v, b, i)
            vq, vr = at(v, b, j) - vi, at(v, b, k) - vi
            su = su + time * weft * (b00 * vq + b10 * vr).dot(u) / lu
            sw = sw + time * warp * (b01 * vq + b11 * vr).dot(w) / lw
        pu = mu * u + pressure * wn + (su / lu) * u
        pw = mu * w + pressure * nu + (sw / lw) * w
        a = area[e]
        fj, fk = -a * (b00 * pu + b01 * pw), -a * (b10 * pu + b11 * pw)
        fi = -fj - fk
        if has_air or wind_speed > 0:
            vc = (at(v, b, i) + at(v, b, j) + at(v, b, k)) / 3.0
            vn, speed = vc.dot(n), vc.norm()
            along = vc - vn * n
            air = -plate(speed, vn, p[b, DRAG]) * n - 0.5 * AIR_DENSITY * SKIN_FRICTION * p[b, DRAG] * speed * along
            air += -0.5 * AIR_DENSITY * p[b, LIFT] * vn * along.dot(along) / (speed + 1e-12) * n
            if wind_speed > 0:
                # drag in moving air less drag in still air, which is planted apart
                flow = wind - vc
                air += (plate(flow.norm(), flow.dot(n), 1.2) + plate(speed, vn, 1.2)) * n
            if p[b, WAKE] > 0:
                lagging = wake[b, e] + (vn - wake[b, e]) * dt / p[b, WAKE_TIME]
                wake[b, e] = lagging
                air += -p[b, WAKE] * (vn - lagging) * n
            share = air * (a * jacobian / 3.0)
            fi, fj, fk = fi + share, fj + share, fk + share
        add(f, b, i, fi)
        add(f, b, j, fj)
        add(f, b, k, fk)
        if p[b, ADDED] > 0:
            for c in ti.static(range(3)):
                add(normal, b, triangles[e, c], a * n)


@ti.func
def on_hinges(b, x: ti.template(), v: ti.template(), f: ti.template(), slip: ti.template(), hinges: ti.template(),
              cotangents: ti.template(), hinge_area: ti.template(), bending: ti.template(), curl: ti.template(),
              p: ti.template()):  # fmt: skip
    """Add the bending forces of every hinge."""
    viscosity, friction = p[b, VISCOSITY], p[b, FRICTION]
    for h in range(hinges.shape[0]):
        i, j, k, m = hinges[h, 0], hinges[h, 1], hinges[h, 2], hinges[h, 3]
        ci, cj, ck, cm = cotangents[h, 0], cotangents[h, 1], cotangents[h, 2], cotangents[h, 3]
        xi, xj, xk, xm = at(x, b, i), at(x, b, j), at(x, b, k), at(x, b, m)
        s = ci * xi + cj * xj + ck * xk + cm * xm
        moment = bending[h] / hinge_area[h] * s
        if viscosity > 0:
            rate = ci * at(v, b, i) + cj * at(v, b, j) + ck * at(v, b, k) + cm * at(v, b, m)
            moment += viscosity / hinge_area[h] * rate
        if friction > 0 or curl[h] != 0:
            edge = xj - xi
            n = edge.cross(xk - xi).normalized() - edge.cross(xm - xi).normalized()
            n = n / (n.norm() + 1e-12)
            extra = -bending[h] * curl[h]
            if friction > 0:
                kappa = 3.0 * s.dot(n) / hinge_area[h]
                change = kappa - slip[b, h, 2]
                most = 0.5 * HINGE_SHARE * friction
                first = ti.max(-most, ti.min(most, slip[b, h, 0] + most / FIRST_YIELD * change))
                second = ti.max(-most, ti.min(most, slip[b, h, 1] + most / SECOND_YIELD * change))
                slip[b, h, 0], slip[b, h, 1], slip[b, h, 2] = first, second, kappa
                extra += first + second
            moment += (extra / 3.0) * n
        add(f, b, i, -ci * moment)
        add(f, b, j, -cj * moment)
        add(f, b, k, -ck * moment)
        add(f, b, m, -cm * moment)


@ti.func
def on_nodes(b, x: ti.template(), v: ti.template(), f: ti.template(), bob: ti.template(), spot: ti.template(), dt,
             p: ti.template()):  # fmt: skip
    """Forces that no library knows: a weight on a string, a thread to the room, a magnet behind the cloth."""
    if p[b, BOB] > 0:
        node = ti.cast(p[b, BOB_NODE], ti.i32)
        place, speed = at(bob, b, 0), at(bob, b, 1)
        apart = place - at(x, b, node)
        length = apart.norm() + 1e-9
        pull = ti.max(0.0, BOB_STIFFNESS * (length - p[b, BOB_LENGTH])) / length * apart
        speed += dt * (ti.Vector([p[b, GX], p[b, GY], p[b, GZ]]) - pull / p[b, BOB])
        put(bob, b, 0, place + dt * speed)
        put(bob, b, 1, speed)
        add(f, b, node, pull)
    if p[b, THREAD] > 0:
        node = ti.cast(p[b, THREAD_NODE], ti.i32)
        apart = ti.Vector([p[b, TX], p[b, TY], p[b, TZ]]) - at(x, b, node)
        length = apart.norm() + 1e-9
        add(f, b, node, p[b, THREAD] * ti.max(0.0, length - p[b, THREAD_LENGTH]) / length * apart)
    if p[b, MAGNET] > 0:
        pole, reach = ti.Vector([p[b, MX], p[b, MY], p[b, MZ]]), p[b, REACH]
        for i in range(x.shape[1]):
            if spot[i] > 0:
                apart = (pole - at(x, b, i)) / reach
                near = 1.0 + apart.dot(apart)
                add(f, b, i, p[b, MAGNET] * spot[i] / (near * near) * apart)


@ti.kernel
def rollout(
    x: f3, v: f3, f: f3, acceleration: f3, normal: f3, wake: f2, slip: f3, bob: f3, triangles: i2, inverse: f2,
    area: f1, hinges: i2, cotangents: f2, hinge_area: f1, bending: f1, curl: f1, mass: f1, air_mass: f1, spot: f1,
    held: i1, fraction: f1, path: f3, p: f2, dt: ti.f64, settle_steps: ti.i32, settle_damping: ti.f64, every: ti.i32,
    point_nodes: i2, point_weights: f2, seen: f4, shapes: f4, keep_shapes: ti.i32,
):  # fmt: skip
    """Settle, then run every take; one task each."""
    for task in range(x.shape[0] * TASK):
        if task % TASK == 0:
            b = task // TASK
            gravity = ti.Vector([p[b, GX], p[b, GY], p[b, GZ]])
            steps = (seen.shape[1] - 1) * every
            for step in range(-settle_steps, steps + 1):
                now = ti.cast(ti.max(step, 0), ti.f64) * dt
                damping = p[b, DAMPING]
                if step < 0:
                    damping += settle_damping
                kept = ti.exp(-0.5 * damping * dt)
                for i in range(x.shape[1]):
                    speed = kept * at(v, b, i) + 0.5 * dt * at(acceleration, b, i)
                    put(v, b, i, speed)
                    put(x, b, i, at(x, b, i) + dt * speed)
                for h in range(held.shape[0]):
                    i = held[h]
                    for c in ti.static(range(3)):
                        here = ti.max(step, 0)
                        place = (1.0 - fraction[h]) * path[b, here, c] + fraction[h] * path[b, here, c + 3]
                        was = ti.max(step - 1, 0)
                        before = (1.0 - fraction[h]) * path[b, was, c] + fraction[h] * path[b, was, c + 3]
                        x[b, i, c] = place
                        v[b, i, c] = (place - before) / dt
                for i in range(x.shape[1]):
                    put(f, b, i, mass[i] * gravity)
                if p[b, ADDED] > 0:
                    for i in range(x.shape[1]):
                        put(normal, b, i, 0.0 * gravity)
                on_triangles(b, now, dt, x, v, f, normal, wake, triangles, inverse, area, p)
                on_hinges(b, x, v, f, slip, hinges, cotangents, hinge_area, bending, curl, p)
                on_nodes(b, x, v, f, bob, spot, dt, p)
                for i in range(x.shape[1]):
                    a = at(f, b, i) / mass[i]
                    if p[b, ADDED] > 0:
                        n = at(normal, b, i).normalized()
                        air = p[b, ADDED] * air_mass[i]
                        a -= air / (mass[i] + air) * a.dot(n) * n
                    put(acceleration, b, i, a)
                    put(v, b, i, kept * (at(v, b, i) + 0.5 * dt * a))
                for h in range(held.shape[0]):
                    put(acceleration, b, held[h], 0.0 * gravity)
                if step >= 0 and step % every == 0:
                    sample = step // every
                    for m in range(point_nodes.shape[0]):
                        for c in ti.static(range(3)):
                            seen[b, sample, m, c] = (
                                point_weights[m, 0] * x[b, point_nodes[m, 0], c]
                                + point_weights[m, 1] * x[b, point_nodes[m, 1], c]
                                + point_weights[m, 2] * x[b, point_nodes[m, 2], c]
                            )
                    if keep_shapes == 1:
                        for i in range(x.shape[1]):
                            for c in ti.static(range(3)):
                                shapes[b, sample, i, c] = x[b, i, c]
                                shapes[b, sample, i, c + 3] = v[b, i, c]

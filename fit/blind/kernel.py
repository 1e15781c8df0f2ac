"""Taichi kernel of the generator: velocity Verlet with exact damping in each half kick, takes in SIMD lanes.

    v <- e^(-c dt/2) v + dt/2 a,    x <- x + dt v,    a <- F(x, v) / m,    v <- e^(-c dt/2) (v + dt/2 a)

Source: L. Verlet's method in the form of W. C. Swope et al., J. Chem. Phys. 76, 637 (1982), with the linear damping c
split off exactly (G. Strang, SIAM J. Numer. Anal. 5 (1968)).

F per triangle of rest area A, deformation gradient columns u, w, their unit normal n, J = |u x w|:
    ground     mu/2 (|u|^2 + |w|^2 - 2 J) + (lambda + mu)/2 (J - 1)^2       compressible neo-Hookean, Poisson coupling
    fibres     k_1/2 (|w| - 1)^2 + k_2/2 (|u| - 1)^2, cubic stiffening and Kelvin-Voigt where planted
Source: J. Bonet & R. D. Wood, "Nonlinear Continuum Mechanics for Finite Element Analysis" (2008), section 6.4; fibres:
G. A. Holzapfel, T. C. Gasser, R. W. Ogden, J. Elasticity 61 (2000), section 5. F per hinge: `fit.blind.sheet`; friction
in bending as two Jenkins elements in parallel (W. D. Iwan, J. Appl. Mech. 33 (1966), section 2). Air: a plate's normal
coefficient C_N = c 0.505 / (0.222 + 0.283 / sin(angle of attack)) (S. F. Hoerner, "Fluid-Dynamic Drag" (1965), chapter
3), lift with Polhamus' cos^2 (E. C. Polhamus, NASA TN D-3767 (1966)). Forces of `fit.blind.plants` outside the library
act on triangles and nodes in the same pass.

Takes of one cloth are SIMD lanes; a property of the cloth is one number for all of them. Arrays of vectors are flat,
three rows a node. Taichi would compute an element's offset in an array of several dimensions at every access.
"""

# mypy: ignore-errors
# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import taichi as ti

from fit.runtime import TASK

TAKE_LANES = 8  # takes per SIMD vector; a case has five
BLIND_AIR = 1.2041  # kg/m^3, dry air at 20 degC; formats.nature has 1.204; existing cases keep this value
# Of the normal coefficient, along the cloth. Our choice: both sides of a laminar plate of 0.5 m have 0.012 of it at
# 1 m/s (1.328 / sqrt(Re), H. Blasius 1908), and 0.017 at 0.5 m/s. Half and double were not tried.
SKIN_FRICTION = 0.02

# Entries of `numbers`, the same for every take of a cloth.
NUMBER_NAMES = (
    "gravity_x", "gravity_y", "gravity_z", "damping", "mu", "lam", "fibre_warp", "fibre_weft", "stiffening",
    "stretch_time", "bend_viscosity", "friction", "drag", "lift", "wind_x", "wind_y", "wind_z", "gust_phase", "wake",
    "wake_time", "added_mass", "bob_mass", "bob_length", "bob_node", "thread", "thread_node", "thread_length",
    "magnet", "magnet_reach",
)  # fmt: skip
(
    GX, GY, GZ, DAMPING, MU, LAM, WARP, WEFT, FIBRE_STIFFENING, STRETCH_TIME, BEND_VISCOSITY, FRICTION, DRAG, LIFT,
    WX, WY, WZ, GUST, WAKE, WAKE_TIME, ADDED, BOB, BOB_LENGTH, BOB_NODE, THREAD, THREAD_NODE, THREAD_LENGTH, MAGNET,
    REACH,
) = range(len(NUMBER_NAMES))  # fmt: skip
TIED, POLE = 0, 3  # rows of `poles` [m], per take: fixed end of a thread, position of a magnet
# 1/m of hinge curvature at which the two friction elements slide. Our choice: a factor of 4 apart, so that
# threads slip one after the other and no loop is the library's. Half and double were not tried.
FIRST_YIELD, SECOND_YIELD = 4.0, 16.0
# Friction moment of a hinge per moment of the sheet, derived from the hinges of `fit.blind.sheet`. Bent about one axis
# they need 1.8 times the sheet's, about the other 3 times. This is the harmonic mean.
HINGE_SHARE = 2.25
# N/m of the string that a corner weight hangs on. Our choice: 5 g stretch it by 2 mm, and at half by 4 mm. Double was
# not tried.
BOB_STIFFNESS = 25.0

vec = ti.types.vector(TAKE_LANES, ti.f64)
v1 = ti.types.ndarray(dtype=vec, ndim=1)
v2 = ti.types.ndarray(dtype=vec, ndim=2)
v3 = ti.types.ndarray(dtype=vec, ndim=3)
f1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
i1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i2 = ti.types.ndarray(dtype=ti.i32, ndim=2)

# Lists of three are vectors in space, because Taichi's own vectors are SIMD lanes.


@ti.func
def at(a: ti.template(), i):
    """Return row i of a flat array as a vector."""
    return [a[3 * i], a[3 * i + 1], a[3 * i + 2]]


@ti.func
def put(a: ti.template(), i, w: ti.template()):
    """Store a vector in row i."""
    a[3 * i], a[3 * i + 1], a[3 * i + 2] = w[0], w[1], w[2]


@ti.func
def add(a: ti.template(), i, w: ti.template()):
    """Add a vector to row i."""
    # Load, add, store: `+=` on memory would be an atomic.
    a[3 * i], a[3 * i + 1], a[3 * i + 2] = a[3 * i] + w[0], a[3 * i + 1] + w[1], a[3 * i + 2] + w[2]


@ti.func
def dot(p: ti.template(), q: ti.template()):
    """Return p . q."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@ti.func
def cross(p: ti.template(), q: ti.template()):
    """Return p x q."""
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


@ti.func
def less(p: ti.template(), q: ti.template()):
    """Return p - q."""
    return [p[0] - q[0], p[1] - q[1], p[2] - q[2]]


@ti.func
def sum_of(k, p: ti.template(), m, q: ti.template()):
    """Return k p + m q."""
    return [k * p[0] + m * q[0], k * p[1] + m * q[1], k * p[2] + m * q[2]]


@ti.func
def length_of(p: ti.template()):
    """Return |p|."""
    return ti.sqrt(dot(p, p))


@ti.func
def magnitude(a):
    """Return the absolute value, which Taichi lacks for SIMD vectors."""
    return ti.max(a, 0.0 - a)


@ti.func
def plate(speed, along_normal, coefficient):
    """Normal force per area [Pa] of a plate in a flow of this speed and normal component [m/s]."""
    attack = magnitude(along_normal) / (speed + 1e-12)
    return (0.5 * BLIND_AIR * 0.505 * coefficient) * speed * along_normal / (0.222 * attack + 0.283)


@ti.func
def on_triangles(home, first, now, dt, x: ti.template(), v: ti.template(), f: ti.template(), normal: ti.template(),
                 wake: ti.template(), triangles: ti.template(), inverse: ti.template(), area: ti.template(),
                 p: ti.template()):  # fmt: skip
    """Add the membrane's and the air's forces of every triangle; first: the group's first triangle."""
    mu, lam, warp, weft = p[MU], p[LAM], p[WARP], p[WEFT]
    stiffening, time, drag = p[FIBRE_STIFFENING], p[STRETCH_TIME], p[DRAG]
    has_air = drag > 0 or p[LIFT] > 0 or p[WAKE] > 0
    gust = 1.0 + 0.15 * ti.sin(1.9 * now + p[GUST])
    wind = [gust * p[WX], gust * p[WY], gust * p[WZ]]
    has_wind = wind[0] * wind[0] + wind[1] * wind[1] + wind[2] * wind[2] > 0
    for e in range(area.shape[0]):
        i, j, k = home + triangles[3 * e], home + triangles[3 * e + 1], home + triangles[3 * e + 2]
        b00, b01, b10, b11 = inverse[4 * e], inverse[4 * e + 1], inverse[4 * e + 2], inverse[4 * e + 3]
        a = area[e]
        xi = at(x, i)
        q, r = less(at(x, j), xi), less(at(x, k), xi)
        u, w = sum_of(b00, q, b10, r), sum_of(b01, q, b11, r)
        upright = cross(u, w)
        jacobian = length_of(upright) + 1e-12
        per_jacobian = 1.0 / jacobian
        n = [upright[0] * per_jacobian, upright[1] * per_jacobian, upright[2] * per_jacobian]
        pressure = (lam + mu) * (jacobian - 1.0) - mu
        wn, nu = cross(w, n), cross(n, u)
        lu, lw = length_of(u), length_of(w)
        eu, ew = lu - 1.0, lw - 1.0
        su, sw = weft * eu, warp * ew
        if stiffening > 0:
            au, aw = stiffening * magnitude(eu), stiffening * magnitude(ew)
            su, sw = su * (1.0 + au + 0.5 * au * au), sw * (1.0 + aw + 0.5 * aw * aw)
        if time > 0:
            vi = at(v, i)
            vq, vr = less(at(v, j), vi), less(at(v, k), vi)
            su = su + time * weft * dot(sum_of(b00, vq, b10, vr), u) / lu
            sw = sw + time * warp * dot(sum_of(b01, vq, b11, vr), w) / lw
        pu, pw = sum_of(mu + su / lu, u, pressure, wn), sum_of(mu + sw / lw, w, pressure, nu)
        fj, fk = sum_of(0.0 - a * b00, pu, 0.0 - a * b01, pw), sum_of(0.0 - a * b10, pu, 0.0 - a * b11, pw)
        fi = [0.0 - fj[0] - fk[0], 0.0 - fj[1] - fk[1], 0.0 - fj[2] - fk[2]]
        if has_air or has_wind:
            vi, vj, vk = at(v, i), at(v, j), at(v, k)
            vc = [(vi[0] + vj[0] + vk[0]) / 3.0, (vi[1] + vj[1] + vk[1]) / 3.0, (vi[2] + vj[2] + vk[2]) / 3.0]
            vn, speed = dot(vc, n), length_of(vc)
            along = sum_of(1.0, vc, 0.0 - vn, n)
            push = 0.0 - plate(speed, vn, drag)
            push = push - (0.5 * BLIND_AIR * p[LIFT]) * vn * dot(along, along) / (speed + 1e-12)
            if has_wind:
                # drag in moving air minus drag in still air, which is a separate effect
                flow = [wind[0] - vc[0], wind[1] - vc[1], wind[2] - vc[2]]
                push = push + plate(length_of(flow), dot(flow, n), 1.2) + plate(speed, vn, 1.2)
            if p[WAKE] > 0:
                lagging = wake[first + e] + (vn - wake[first + e]) * (dt / p[WAKE_TIME])
                wake[first + e] = lagging
                push = push - p[WAKE] * (vn - lagging)
            carried = jacobian * (a / 3.0)
            share = sum_of(push * carried, n, (0.0 - 0.5 * BLIND_AIR * SKIN_FRICTION * drag) * speed * carried, along)
            add(f, i, share)
            add(f, j, share)
            add(f, k, share)
        add(f, i, fi)
        add(f, j, fj)
        add(f, k, fk)
        if p[ADDED] > 0:
            lot = [a * n[0], a * n[1], a * n[2]]
            add(normal, i, lot)
            add(normal, j, lot)
            add(normal, k, lot)


@ti.func
def on_hinges(home, first, x: ti.template(), v: ti.template(), f: ti.template(), slip: ti.template(),
              hinges: ti.template(), cotangents: ti.template(), hinge_area: ti.template(), bending: ti.template(),
              curl: ti.template(), p: ti.template()):  # fmt: skip
    """Add the bending forces of every hinge; first: the group's first hinge."""
    viscosity, friction = p[BEND_VISCOSITY], p[FRICTION]
    for h in range(hinge_area.shape[0]):
        g = 4 * h
        i, j, k, m = home + hinges[g], home + hinges[g + 1], home + hinges[g + 2], home + hinges[g + 3]
        ci, cj, ck, cm = cotangents[g], cotangents[g + 1], cotangents[g + 2], cotangents[g + 3]
        xi, xj, xk, xm = at(x, i), at(x, j), at(x, k), at(x, m)
        s = [ci * xi[c] + cj * xj[c] + ck * xk[c] + cm * xm[c] for c in range(3)]
        stiff = bending[h] / hinge_area[h]
        m0, m1, m2 = stiff * s[0], stiff * s[1], stiff * s[2]
        if viscosity > 0:
            loose = viscosity / hinge_area[h]
            vi, vj, vk, vm = at(v, i), at(v, j), at(v, k), at(v, m)
            rate = [ci * vi[c] + cj * vj[c] + ck * vk[c] + cm * vm[c] for c in range(3)]
            m0, m1, m2 = m0 + loose * rate[0], m1 + loose * rate[1], m2 + loose * rate[2]
        if friction > 0 or curl[h] != 0:
            edge = less(xj, xi)
            left, right = cross(edge, less(xk, xi)), cross(edge, less(xm, xi))
            both = sum_of(1.0 / length_of(left), left, 0.0 - 1.0 / length_of(right), right)
            per = 1.0 / (length_of(both) + 1e-12)
            n = [per * both[0], per * both[1], per * both[2]]
            extra = vec(0.0 - bending[h] * curl[h])
            if friction > 0:
                kappa = 3.0 * dot(s, n) / hinge_area[h]
                past = 3 * (first + h)
                change = kappa - slip[past + 2]
                most = 0.5 * HINGE_SHARE * friction
                one = ti.max(0.0 - most, ti.min(most, slip[past] + most / FIRST_YIELD * change))
                two = ti.max(0.0 - most, ti.min(most, slip[past + 1] + most / SECOND_YIELD * change))
                slip[past], slip[past + 1], slip[past + 2] = one, two, kappa
                extra = extra + one + two
            third = extra / 3.0
            m0, m1, m2 = m0 + third * n[0], m1 + third * n[1], m2 + third * n[2]
        add(f, i, [0.0 - ci * m0, 0.0 - ci * m1, 0.0 - ci * m2])
        add(f, j, [0.0 - cj * m0, 0.0 - cj * m1, 0.0 - cj * m2])
        add(f, k, [0.0 - ck * m0, 0.0 - ck * m1, 0.0 - ck * m2])
        add(f, m, [0.0 - cm * m0, 0.0 - cm * m1, 0.0 - cm * m2])


@ti.func
def on_nodes(home, b, x: ti.template(), v: ti.template(), f: ti.template(), bob: ti.template(), spot: ti.template(),
             dt, poles: ti.template(), p: ti.template()):  # fmt: skip
    """Add the forces outside the library: a weight on a string, a thread to the room, a magnet behind the cloth."""
    if p[BOB] > 0:
        node = home + ti.cast(p[BOB_NODE], ti.i32)
        place, speed = at(bob, 2 * b), at(bob, 2 * b + 1)
        apart = less(place, at(x, node))
        length = length_of(apart) + 1e-9
        tension = BOB_STIFFNESS * ti.max(0.0, length - p[BOB_LENGTH]) / length
        pull = [tension * apart[0], tension * apart[1], tension * apart[2]]
        faster = [speed[c] + dt * (p[GX + c] - pull[c] / p[BOB]) for c in range(3)]
        put(bob, 2 * b, sum_of(1.0, place, dt, faster))
        put(bob, 2 * b + 1, faster)
        add(f, node, pull)
    if p[THREAD] > 0:
        node = home + ti.cast(p[THREAD_NODE], ti.i32)
        apart = [poles[b, TIED + c] - x[3 * node + c] for c in range(3)]
        length = length_of(apart) + 1e-9
        tension = p[THREAD] * ti.max(0.0, length - p[THREAD_LENGTH]) / length
        add(f, node, [tension * apart[0], tension * apart[1], tension * apart[2]])
    if p[MAGNET] > 0:
        for n in range(spot.shape[0]):
            if spot[n] > 0:
                apart = [(poles[b, POLE + c] - x[3 * (home + n) + c]) / p[REACH] for c in range(3)]
                near = 1.0 + dot(apart, apart)
                force = p[MAGNET] * spot[n] / (near * near)
                add(f, home + n, [force * apart[0], force * apart[1], force * apart[2]])


@ti.kernel
def rollout(
    x: v1, v: v1, f: v1, acceleration: v1, normal: v1, wake: v1, slip: v1, bob: v1, triangles: i1, inverse: f1,
    area: f1, hinges: i1, cotangents: f1, hinge_area: f1, bending: f1, curl: f1, mass: f1, air_mass: f1, spot: f1,
    held: i1, fraction: f1, path: v2, poles: v2, p: f1, dt: ti.f64, settle_steps: ti.i32, settle_damping: ti.f64,
    every: ti.i32, point_nodes: i2, point_weights: f2, seen: v3, shapes: v3, keep_shapes: ti.i32,
):  # fmt: skip
    """Settle, then run every take; one task for each group of them.

    - `x` and the four after it, (groups x nodes x 3,)
    - `wake`, (groups x triangles,)
    - `slip`, (groups x hinges x 3,)
    - `bob`, (groups x 6,): position and velocity
    - `path`, (groups x (steps + 1), 6)
    - `poles`, (groups, 6)
    - `p`: `NUMBER_NAMES`
    - `seen`, (groups, samples, points x 3)
    - `shapes`, (groups, samples, nodes x 6)
    """
    for task in range(poles.shape[0] * TASK):
        if task % TASK == 0:
            b, nodes = task // TASK, mass.shape[0]
            home, first_step = b * nodes, b * (path.shape[0] // poles.shape[0])
            steps = (seen.shape[1] - 1) * every
            for step in range(-settle_steps, steps + 1):
                now = ti.cast(ti.max(step, 0), ti.f64) * dt
                damping = p[DAMPING]
                if step < 0:
                    damping += settle_damping
                kept = ti.exp(-0.5 * damping * dt)
                for k in range(3 * home, 3 * (home + nodes)):
                    speed = kept * v[k] + (0.5 * dt) * acceleration[k]
                    v[k] = speed
                    x[k] = x[k] + dt * speed
                here, was = first_step + ti.max(step, 0), first_step + ti.max(step - 1, 0)
                for h in range(held.shape[0]):
                    k, share = 3 * (home + held[h]), fraction[h]
                    for c in ti.static(range(3)):
                        place = (1.0 - share) * path[here, c] + share * path[here, c + 3]
                        before = (1.0 - share) * path[was, c] + share * path[was, c + 3]
                        x[k + c] = place
                        v[k + c] = (place - before) / dt
                for m in range(nodes):
                    k = 3 * (home + m)
                    for c in ti.static(range(3)):
                        f[k + c] = vec(mass[m] * p[GX + c])
                if p[ADDED] > 0:
                    for k in range(3 * home, 3 * (home + nodes)):
                        normal[k] = vec(0.0)
                on_triangles(home, b * area.shape[0], now, dt, x, v, f, normal, wake, triangles, inverse, area, p)
                on_hinges(
                    home, b * hinge_area.shape[0], x, v, f, slip, hinges, cotangents, hinge_area, bending, curl, p
                )
                on_nodes(home, b, x, v, f, bob, spot, dt, poles, p)
                for m in range(nodes):
                    i = home + m
                    per_mass = 1.0 / mass[m]
                    a0, a1, a2 = per_mass * f[3 * i], per_mass * f[3 * i + 1], per_mass * f[3 * i + 2]
                    if p[ADDED] > 0:
                        n = at(normal, i)
                        air = p[ADDED] * air_mass[m]
                        back = (a0 * n[0] + a1 * n[1] + a2 * n[2]) / dot(n, n) * (air / (mass[m] + air))
                        a0, a1, a2 = a0 - back * n[0], a1 - back * n[1], a2 - back * n[2]
                    put(acceleration, i, [a0, a1, a2])
                    half = 0.5 * dt
                    put(v, i, [
                        kept * (v[3 * i] + half * a0), kept * (v[3 * i + 1] + half * a1),
                        kept * (v[3 * i + 2] + half * a2),
                    ])  # fmt: skip
                for h in range(held.shape[0]):
                    for c in ti.static(range(3)):
                        acceleration[3 * (home + held[h]) + c] = vec(0.0)
                if step >= 0 and step % every == 0:
                    sample = step // every
                    for m in range(point_nodes.shape[0]):
                        i, j, k = home + point_nodes[m, 0], home + point_nodes[m, 1], home + point_nodes[m, 2]
                        for c in ti.static(range(3)):
                            seen[b, sample, 3 * m + c] = (
                                point_weights[m, 0] * x[3 * i + c]
                                + point_weights[m, 1] * x[3 * j + c]
                                + point_weights[m, 2] * x[3 * k + c]
                            )
                    if keep_shapes == 1:
                        for m in range(nodes):
                            for c in ti.static(range(3)):
                                shapes[b, sample, 6 * m + c] = x[3 * (home + m) + c]
                                shapes[b, sample, 6 * m + c + 3] = v[3 * (home + m) + c]

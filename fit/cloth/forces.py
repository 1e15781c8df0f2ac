"""Forces inside the cloth, for candidates side by side: fibres, shear, bending, twist, and the nodes' normals.

Samples and stencils are those of `fit.cloth.mesh`. With Fu, Fv the columns of the deformation gradient:
    fibres     S11 = k_u (E11 + a |E11| E11 + tau Fu.dFu/dt), E11 = (Fu.Fu - 1)/2; P = S11 Fu; alike down
    shear      S12 = G (Fu.Fv + tau d(Fu.Fv)/dt); P_u = S12 Fv, P_v = S12 Fu
    bending    M = B (kappa + tau dkappa/dt - kappa_0 n) + Dahl friction along the normal n, kappa = x_uu, x_vv, x_uv
The force on a node is minus the sum of stress times the weight with which the node enters its sample.

Sums over stencils are unrolled: a sum carried round a loop in registers is not vectorised. `+=` on memory would be an
atomic, three times slower: load, add, store.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.bends import PIECE, ROW_BEND, TWIST
from fit.cloth.lanes import decay, magnitude
from fit.effects.bending_hysteresis import REFERENCE_CURVATURE


@ti.func
def slope(
    b, y: ti.template(), begin, nodes: ti.template(), weights: ti.template(), count: ti.template()
):  # fmt: skip
    """Weighted sum of a field over a stencil of known length."""
    first, h = nodes[begin], weights[begin, 0]
    s0, s1, s2 = h * y[b, first, 0], h * y[b, first, 1], h * y[b, first, 2]
    for n in ti.static(range(1, count)):
        w, i = weights[begin + n, 0], nodes[begin + n]
        s0, s1, s2 = s0 + w * y[b, i, 0], s1 + w * y[b, i, 1], s2 + w * y[b, i, 2]
    return s0, s1, s2


@ti.func
def push(
    b, f: ti.template(), p0, p1, p2, begin, nodes: ti.template(), weights: ti.template(), count: ti.template()
):  # fmt: skip
    """Force of a stress p on the nodes of its stencil."""
    for n in ti.static(range(count)):
        w, i = weights[begin + n, 0], nodes[begin + n]
        f[b, i, 0], f[b, i, 1], f[b, i, 2] = f[b, i, 0] - w * p0, f[b, i, 1] - w * p1, f[b, i, 2] - w * p2


@ti.func
def fibre_slopes(
    b,
    y: ti.template(),
    slopes: ti.template(),
    nodes: ti.template(),
    weights: ti.template(),
    fibres_across,
    fibre_nodes: ti.template(),
):
    """Slope of a field of the nodes at every fibre sample; fibre_nodes: nodes of a sample across, and of one down."""
    for e in range(fibres_across):
        slopes[b, e, 0], slopes[b, e, 1], slopes[b, e, 2] = slope(
            b, y, fibre_nodes[0] * e, nodes, weights, fibre_nodes[0]
        )
    for e in range(fibres_across, slopes.shape[1]):
        begin = fibre_nodes[1] * e - (fibre_nodes[1] - fibre_nodes[0]) * fibres_across
        slopes[b, e, 0], slopes[b, e, 1], slopes[b, e, 2] = slope(b, y, begin, nodes, weights, fibre_nodes[1])


@ti.func
def fibres(
    b,
    begin,
    end,
    slopes: ti.template(),
    rates: ti.template(),
    stress: ti.template(),
    area: ti.template(),
    stiffness,
    time,
    stiffening,
):
    """Stress of one family of fibres at its samples."""
    for e in range(begin, end):
        u0, u1, u2 = slopes[b, e, 0], slopes[b, e, 1], slopes[b, e, 2]
        strain = 0.5 * (u0 * u0 + u1 * u1 + u2 * u2 - 1.0)
        rate = u0 * rates[b, e, 0] + u1 * rates[b, e, 1] + u2 * rates[b, e, 2]
        tension = (strain + stiffening * magnitude(strain) * strain + time * rate) * (area[e] * stiffness)
        stress[b, e, 0], stress[b, e, 1], stress[b, e, 2] = tension * u0, tension * u1, tension * u2


@ti.func
def tied(b, values: ti.template(), e, samples: ti.template(), weights: ti.template(), offset: ti.template()):
    """Interpolate from four fibre samples."""
    first, h = samples[e, 0], weights[e, offset]
    s0, s1, s2 = h * values[b, first, 0], h * values[b, first, 1], h * values[b, first, 2]
    for n in ti.static(range(1, 4)):
        w, i = weights[e, offset + n], samples[e, n]
        s0, s1, s2 = s0 + w * values[b, i, 0], s1 + w * values[b, i, 1], s2 + w * values[b, i, 2]
    return s0, s1, s2


@ti.func
def hand_back(
    b, stress: ti.template(), p0, p1, p2, e, samples: ti.template(), weights: ti.template(), offset: ti.template()
):  # fmt: skip
    """Give a stress to the four fibre samples that its strain was interpolated from."""
    for n in ti.static(range(4)):
        w, i = weights[e, offset + n], samples[e, n]
        stress[b, i, 0] = stress[b, i, 0] + w * p0
        stress[b, i, 1] = stress[b, i, 1] + w * p1
        stress[b, i, 2] = stress[b, i, 2] + w * p2


@ti.func
def shearing(
    b,
    slopes: ti.template(),
    rates: ti.template(),
    stress: ti.template(),
    across: ti.template(),
    down: ti.template(),
    weights: ti.template(),
    area: ti.template(),
    stiffness,
    time,
):
    """Shear, its stress handed back to the fibre samples that its strain was interpolated from."""
    for e in range(area.shape[0]):
        u0, u1, u2 = tied(b, slopes, e, across, weights, 0)
        w0, w1, w2 = tied(b, slopes, e, down, weights, 4)
        d0, d1, d2 = tied(b, rates, e, across, weights, 0)
        h0, h1, h2 = tied(b, rates, e, down, weights, 4)
        rate = u0 * h0 + u1 * h1 + u2 * h2 + w0 * d0 + w1 * d1 + w2 * d2
        tension = (u0 * w0 + u1 * w1 + u2 * w2 + time * rate) * (area[e] * stiffness)
        hand_back(b, stress, tension * w0, tension * w1, tension * w2, e, across, weights, 0)
        hand_back(b, stress, tension * u0, tension * u1, tension * u2, e, down, weights, 4)


@ti.func
def push_fibres(
    b,
    stress: ti.template(),
    f: ti.template(),
    nodes: ti.template(),
    weights: ti.template(),
    fibres_across,
    fibre_nodes: ti.template(),
):
    """Forces of the stress at the samples on the nodes."""
    for e in range(fibres_across):
        push(
            b, f, stress[b, e, 0], stress[b, e, 1], stress[b, e, 2], fibre_nodes[0] * e, nodes, weights, fibre_nodes[0]
        )  # fmt: skip
    for e in range(fibres_across, stress.shape[1]):
        begin = fibre_nodes[1] * e - (fibre_nodes[1] - fibre_nodes[0]) * fibres_across
        push(b, f, stress[b, e, 0], stress[b, e, 1], stress[b, e, 2], begin, nodes, weights, fibre_nodes[1])


@ti.func
def find_normals(
    b,
    x: ti.template(),
    normal: ti.template(),
    area: ti.template(),
    cells: ti.template(),
    basis: ti.template(),
    zero,
):
    """Unit normals of the nodes and the area that each carries: tangents along both directions of each element.

    basis, (5, 4): slopes of the shape functions at the nodes (one row a node), then the nodes' weights.
    """
    for i in range(normal.shape[1]):
        for c in ti.static(range(3)):
            normal[b, i, c] = zero
    for e in range(cells.shape[0]):
        for row in range(4):
            for column in range(4):
                p0, p1, p2 = zero, zero, zero
                q0, q1, q2 = zero, zero, zero
                for n in ti.static(range(4)):
                    i, w = cells[e, 4 * row + n], basis[column, n]
                    p0, p1, p2 = p0 + w * x[b, i, 0], p1 + w * x[b, i, 1], p2 + w * x[b, i, 2]
                    j, h = cells[e, 4 * n + column], basis[row, n]
                    q0, q1, q2 = q0 - h * x[b, j, 0], q1 - h * x[b, j, 1], q2 - h * x[b, j, 2]
                share = basis[4, row] * basis[4, column]
                m = cells[e, 4 * row + column]
                normal[b, m, 0] = normal[b, m, 0] + share * (p1 * q2 - p2 * q1)
                normal[b, m, 1] = normal[b, m, 1] + share * (p2 * q0 - p0 * q2)
                normal[b, m, 2] = normal[b, m, 2] + share * (p0 * q1 - p1 * q0)
    for i in range(normal.shape[1]):
        n0, n1, n2 = normal[b, i, 0], normal[b, i, 1], normal[b, i, 2]
        length = ti.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-20
        normal[b, i, 0], normal[b, i, 1], normal[b, i, 2] = n0 / length, n1 / length, n2 / length
        area[b, i] = length


@ti.func
def moment(
    b,
    e,
    centre,
    root,
    modulus,
    r0,
    r1,
    r2,
    normal: ti.template(),
    rest: ti.template(),
    friction: ti.template(),
    friction_limit,
    dt,
):
    """Moment along the normal from rest curvature and friction, times the root of the area."""
    n0, n1, n2 = normal[b, centre, 0], normal[b, centre, 1], normal[b, centre, 2]
    change = (r0 * n0 + r1 * n1 + r2 * n2) / root * dt
    # Dahl, exponent 1, integrated exactly over a change of one sign:
    # M -> s + (M - s) exp(-|dkappa| / kappa_ref), s = sign(dkappa) M_max
    goal = ti.select(change > 0.0, friction_limit, 0.0 - friction_limit)
    fade = decay(magnitude(change) / REFERENCE_CURVATURE)
    friction[b, e] = goal + (friction[b, e] - goal) * fade
    along = root * (friction[b, e] - modulus * rest[b, e])
    return along * n0, along * n1, along * n2


@ti.func
def second(
    b, y: ti.template(), begin, end, nodes: ti.template(), weights: ti.template(), length: ti.template(),
    total: ti.template(),
):  # fmt: skip
    """`slope` over a stencil of this length or, from `PIECE` on, of whole pieces, summed up at `total[b, 0]`."""
    if ti.static(length < PIECE):
        return slope(b, y, begin, nodes, weights, length)
    else:
        for c in ti.static(range(3)):
            total[b, 0, c] = 0.0 * y[b, 0, c]
        for piece in range((end - begin) // PIECE):
            s0, s1, s2 = slope(b, y, begin + piece * PIECE, nodes, weights, PIECE)
            total[b, 0, 0] = total[b, 0, 0] + s0
            total[b, 0, 1] = total[b, 0, 1] + s1
            total[b, 0, 2] = total[b, 0, 2] + s2
        return total[b, 0, 0], total[b, 0, 1], total[b, 0, 2]


@ti.func
def bending(
    b,
    x: ti.template(),
    v: ti.template(),
    f: ti.template(),
    first: ti.template(),
    nodes: ti.template(),
    weights: ti.template(),
    kinds: ti.template(),
    centres: ti.template(),
    roots: ti.template(),
    counts: ti.template(),
    lengths: ti.template(),
    stiffness,
    stiffness_across,
    stiffness_mixed,
    time,
    normal: ti.template(),
    rest: ti.template(),
    friction: ti.template(),
    friction_limit,
    dt,
    with_bends: ti.template(),
    sums: ti.template(),
    rates: ti.template(),
):
    """Second derivatives at nodes; counts: how many have each of the lengths; sums, rates: memory that is free."""
    end = 0
    for k in ti.static(range(len(lengths))):
        begin = end
        end = begin + counts[k]
        for e in range(begin, end):
            modulus = stiffness
            if kinds[e] == ROW_BEND:
                modulus = stiffness_across
            elif kinds[e] == TWIST:
                modulus = stiffness_mixed
            m0, m1, m2 = second(b, x, first[e], first[e + 1], nodes, weights, lengths[k], sums)
            r0, r1, r2 = second(b, v, first[e], first[e + 1], nodes, weights, lengths[k], rates)
            m0, m1, m2 = modulus * (m0 + time * r0), modulus * (m1 + time * r1), modulus * (m2 + time * r2)
            if ti.static(with_bends):
                n0, n1, n2 = moment(
                    b, e, centres[e], roots[e], modulus, r0, r1, r2, normal, rest, friction, friction_limit, dt
                )
                m0, m1, m2 = m0 + n0, m1 + n1, m2 + n2
            if ti.static(lengths[k] < PIECE):
                push(b, f, m0, m1, m2, first[e], nodes, weights, lengths[k])
            else:
                for piece in range((first[e + 1] - first[e]) // PIECE):
                    push(b, f, m0, m1, m2, first[e] + piece * PIECE, nodes, weights, PIECE)


@ti.func
def twisting(
    b,
    slopes: ti.template(),
    rates: ti.template(),
    stress: ti.template(),
    across: ti.template(),
    weights: ti.template(),
    centres: ti.template(),
    roots: ti.template(),
    stiffness,
    time,
    normal: ti.template(),
    rest: ti.template(),
    friction: ti.template(),
    friction_limit,
    dt,
    with_bends: ti.template(),
):
    """Mixed second derivatives, from the slopes across."""
    for e in range(centres.shape[0]):
        m0, m1, m2 = tied(b, slopes, e, across, weights, 0)
        r0, r1, r2 = tied(b, rates, e, across, weights, 0)
        m0, m1, m2 = stiffness * (m0 + time * r0), stiffness * (m1 + time * r1), stiffness * (m2 + time * r2)
        if ti.static(with_bends):
            place = friction.shape[1] - centres.shape[0] + e
            n0, n1, n2 = moment(
                b, place, centres[e], roots[e], stiffness, r0, r1, r2, normal, rest, friction, friction_limit, dt
            )
            m0, m1, m2 = m0 + n0, m1 + n1, m2 + n2
        hand_back(b, stress, m0, m1, m2, e, across, weights, 0)

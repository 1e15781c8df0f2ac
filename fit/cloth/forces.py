"""Forces inside the cloth, for candidates side by side: fibres, shear, bending, twist, and the nodes' normals.

Samples and stencils are those of `fit.cloth.mesh`. With Fu, Fv the columns of the deformation gradient:
    fibres     S11 = k_u (E11 + a |E11| E11 + tau dE11/dt + z), E11 = (Fu.Fu - 1)/2; P = S11 Fu; alike down
    shear      S12 = G (E12 + tau dE12/dt + z), E12 = Fu.Fv; P_u = S12 Fv, P_v = S12 Fu
    z          viscosity that relaxes (fit.effects.stretch_viscosity)
    bending    M = B (kappa + tau dkappa/dt - kappa_0 n) + Dahl friction along the normal n, kappa = x_uu, x_vv, x_uv
The force on a node is minus the sum of stress times the weight with which the node enters its sample.

Rates of strain are differences between steps, d/dt = (E_n - E_n-1) / dt, the mean over the step that led here. Bends
are linear in the places, and damped for much longer than a step: theirs come from x + tau v (`ahead`), whose second
derivative is kappa + tau dkappa/dt; or from v itself (in the place of `ahead`) where friction needs to know them.

Arrays are flat, three vectors of lanes to a node or a sample: those of node i begin at home + 3 i, those of sample e at
place + 3 e, and index arrays hold 3 i and 3 e (`fit.cloth.launch`). Taichi works out where an element of an array of
several dimensions is at every access anew, which took longer than the sums.

Sums over stencils are unrolled: a sum carried round a loop in registers is not vectorised. `+=` on memory would be an
atomic, three times slower: load, add, store.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.bends import PIECE, ROW_BEND, TWIST
from fit.cloth.lanes import decay, magnitude, within
from fit.effects.bending_hysteresis import REFERENCE_CURVATURE


@ti.func
def stencil_sum(y: ti.template(), home, begin, nodes: ti.template(), weights: ti.template(), count: ti.template()):
    """Weighted sum of a field over a stencil of known length."""
    k, w = within(home + nodes[begin]), weights[begin]
    s0, s1, s2 = w * y[k], w * y[k + 1], w * y[k + 2]
    for n in ti.static(range(1, count)):
        i, h = within(home + nodes[begin + n]), weights[begin + n]
        s0, s1, s2 = s0 + h * y[i], s1 + h * y[i + 1], s2 + h * y[i + 2]
    return s0, s1, s2


@ti.func
def push(
    f: ti.template(), p0, p1, p2, home, begin, nodes: ti.template(), weights: ti.template(), count: ti.template()
):  # fmt: skip
    """Force of a stress p on the nodes of its stencil."""
    for n in ti.static(range(count)):
        i, w = within(home + nodes[begin + n]), weights[begin + n]
        f[i], f[i + 1], f[i + 2] = f[i] - w * p0, f[i + 1] - w * p1, f[i + 2] - w * p2


@ti.func
def lagging(
    strain, e, strains: ti.template(), delay, with_viscosity: ti.template(), lags: ti.template(), kept, gain
):  # fmt: skip
    """What rates of strain add to it; delay: damping time over step; viscosity is `fit.effects.stretch_viscosity`."""
    change = strain - strains[e]
    strains[e] = strain
    late = delay * change
    if ti.static(with_viscosity):
        lag = kept * lags[e] + gain * change
        lags[e] = lag
        late = late + lag
    return late


@ti.func
def fibres(
    home,
    first,
    start,
    end,
    entry,
    x: ti.template(),
    ahead: ti.template(),
    slopes: ti.template(),
    slopes_ahead: ti.template(),
    strains: ti.template(),
    stress: ti.template(),
    nodes: ti.template(),
    weights: ti.template(),
    area: ti.template(),
    stiffness,
    delay,
    stiffening,
    count: ti.template(),
    with_ahead: ti.template(),
    with_viscosity: ti.template(),
    lags: ti.template(),
    kept,
    gain,
):
    """Slopes and stress of one family of fibres.

    first: the group's first sample; entry: where the family's stencils begin
    """
    for e in range(start, end):
        begin, k = within(entry + count * (e - start)), within(3 * (first + e))
        u0, u1, u2 = stencil_sum(x, home, begin, nodes, weights, count)
        if ti.static(with_ahead):
            a0, a1, a2 = stencil_sum(ahead, home, begin, nodes, weights, count)
            slopes_ahead[k], slopes_ahead[k + 1], slopes_ahead[k + 2] = a0, a1, a2
        strain = 0.5 * (u0 * u0 + u1 * u1 + u2 * u2 - 1.0)
        late = lagging(strain, first + e, strains, delay, with_viscosity, lags, kept, gain)
        tension = (strain + stiffening * magnitude(strain) * strain + late) * (area[e] * stiffness)
        slopes[k], slopes[k + 1], slopes[k + 2] = u0, u1, u2
        stress[k], stress[k + 1], stress[k + 2] = tension * u0, tension * u1, tension * u2


@ti.func
def shearing(
    place,
    first,
    slopes: ti.template(),
    slopes_ahead: ti.template(),
    strains: ti.template(),
    stress: ti.template(),
    across: ti.template(),
    down: ti.template(),
    across_weights: ti.template(),
    down_weights: ti.template(),
    area: ti.template(),
    stiffness,
    delay,
    with_viscosity: ti.template(),
    lags: ti.template(),
    kept,
    gain,
    with_twist: ti.template(),
    twist_weights: ti.template(),
    twist_centres: ti.template(),
    twist_roots: ti.template(),
    twist_stiffness,
    bend_time,
    with_bends: ti.template(),
    home,
    first_bend,
    normal: ti.template(),
    rest: ti.template(),
    friction: ti.template(),
    friction_limit,
    dt,
):
    """Shear and mixed second derivatives, handed back to the fibre samples that they were interpolated from."""
    for e in range(area.shape[0]):
        begin = within(4 * e)
        u0, u1, u2 = stencil_sum(slopes, place, begin, across, across_weights, 4)
        w0, w1, w2 = stencil_sum(slopes, place, begin, down, down_weights, 4)
        strain = u0 * w0 + u1 * w1 + u2 * w2
        late = lagging(strain, first + e, strains, delay, with_viscosity, lags, kept, gain)
        tension = (strain + late) * (0.0 - area[e] * stiffness)
        p0, p1, p2 = tension * w0, tension * w1, tension * w2
        if ti.static(with_twist):
            m0, m1, m2 = stencil_sum(slopes_ahead, place, begin, across, twist_weights, 4)
            if ti.static(with_bends):
                n0, n1, n2 = stencil_sum(slopes, place, begin, across, twist_weights, 4)
                m0, m1, m2 = damped_moment(
                    home + twist_centres[e], first_bend + e, twist_roots[e], twist_stiffness, bend_time,
                    n0, n1, n2, m0, m1, m2, normal, rest, friction, friction_limit, dt,
                )  # fmt: skip
            else:
                m0, m1, m2 = twist_stiffness * m0, twist_stiffness * m1, twist_stiffness * m2
            for n in ti.static(range(4)):
                i, g, t = within(place + across[begin + n]), across_weights[begin + n], twist_weights[begin + n]
                stress[i], stress[i + 1], stress[i + 2] = (
                    stress[i] + (t * m0 - g * p0), stress[i + 1] + (t * m1 - g * p1), stress[i + 2] + (t * m2 - g * p2)
                )  # fmt: skip
        else:
            push(stress, p0, p1, p2, place, begin, across, across_weights, 4)
        push(stress, tension * u0, tension * u1, tension * u2, place, begin, down, down_weights, 4)


@ti.func
def push_fibres(
    home,
    place,
    start,
    end,
    entry,
    stress: ti.template(),
    f: ti.template(),
    nodes: ti.template(),
    weights: ti.template(),
    count: ti.template(),
):
    """Forces of the stress of one family of fibres on the nodes."""
    for e in range(start, end):
        k = within(place + 3 * e)
        push(
            f, stress[k], stress[k + 1], stress[k + 2], home, within(entry + count * (e - start)), nodes, weights, count
        )  # fmt: skip


@ti.func
def find_normals(
    home,
    first_node,
    count,
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
    for i in range(3 * count):
        normal[home + i] = zero
    for e in range(cells.shape[0]):
        for row in range(4):
            for column in range(4):
                p0, p1, p2 = zero, zero, zero
                q0, q1, q2 = zero, zero, zero
                for n in ti.static(range(4)):
                    i, w = within(home + cells[e, 4 * row + n]), basis[column, n]
                    p0, p1, p2 = p0 + w * x[i], p1 + w * x[i + 1], p2 + w * x[i + 2]
                    j, h = within(home + cells[e, 4 * n + column]), basis[row, n]
                    q0, q1, q2 = q0 - h * x[j], q1 - h * x[j + 1], q2 - h * x[j + 2]
                share = basis[4, row] * basis[4, column]
                m = within(home + cells[e, 4 * row + column])
                normal[m] = normal[m] + share * (p1 * q2 - p2 * q1)
                normal[m + 1] = normal[m + 1] + share * (p2 * q0 - p0 * q2)
                normal[m + 2] = normal[m + 2] + share * (p0 * q1 - p1 * q0)
    for i in range(count):
        k = within(home + 3 * i)
        n0, n1, n2 = normal[k], normal[k + 1], normal[k + 2]
        length = ti.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-20
        normal[k], normal[k + 1], normal[k + 2] = n0 / length, n1 / length, n2 / length
        area[first_node + i] = length


@ti.func
def damped_moment(
    centre,
    e,
    root,
    modulus,
    time,
    k0,
    k1,
    k2,
    r0,
    r1,
    r2,
    normal: ti.template(),
    rest: ti.template(),
    friction: ti.template(),
    friction_limit,
    dt,
):
    """Moment of a second derivative k that changes at the rate r, all times the root of the area; with the effects'."""
    i = within(centre)
    n0, n1, n2 = normal[i], normal[i + 1], normal[i + 2]
    change = (r0 * n0 + r1 * n1 + r2 * n2) / root * dt
    # Dahl, exponent 1, integrated exactly over a change of one sign:
    # M -> s + (M - s) exp(-|dkappa| / kappa_ref), s = sign(dkappa) M_max
    goal = ti.select(change > 0.0, friction_limit, 0.0 - friction_limit)
    fade = decay(magnitude(change) / REFERENCE_CURVATURE)
    friction[e] = goal + (friction[e] - goal) * fade
    along = root * (friction[e] - modulus * rest[e])
    return (
        modulus * (k0 + time * r0) + along * n0,
        modulus * (k1 + time * r1) + along * n1,
        modulus * (k2 + time * r2) + along * n2,
    )


@ti.func
def second(
    y: ti.template(), home, begin, end, nodes: ti.template(), weights: ti.template(), length: ti.template(),
    total: ti.template(), place,
):  # fmt: skip
    """`stencil_sum` over a stencil of this length or, from `PIECE` on, of whole pieces, summed up at `total[place]`."""
    if ti.static(length < PIECE):
        return stencil_sum(y, home, begin, nodes, weights, length)
    else:
        for c in ti.static(range(3)):
            total[place + c] = 0.0 * y[home + c]
        for piece in range((end - begin) // PIECE):
            s0, s1, s2 = stencil_sum(y, home, within(begin + piece * PIECE), nodes, weights, PIECE)
            total[place] = total[place] + s0
            total[place + 1] = total[place + 1] + s1
            total[place + 2] = total[place + 2] + s2
        return total[place], total[place + 1], total[place + 2]


@ti.func
def bending(
    home,
    first_bend,
    x: ti.template(),
    ahead: ti.template(),
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
    with_bends: ti.template(),
    normal: ti.template(),
    rest: ti.template(),
    friction: ti.template(),
    friction_limit,
    dt,
    place,
    sums: ti.template(),
):
    """Second derivatives at nodes; counts: how many have each of the lengths; sums: memory that is free from place."""
    end = 0
    for k in ti.static(range(len(lengths))):
        start = end
        end = start + counts[k]
        for e in range(start, end):
            modulus = stiffness
            if kinds[e] == ROW_BEND:
                modulus = stiffness_across
            elif kinds[e] == TWIST:
                modulus = stiffness_mixed
            begin = within(first[e])
            m0, m1, m2 = second(ahead, home, begin, first[e + 1], nodes, weights, lengths[k], sums, place)
            if ti.static(with_bends):
                n0, n1, n2 = second(x, home, begin, first[e + 1], nodes, weights, lengths[k], sums, place)
                m0, m1, m2 = damped_moment(
                    home + centres[e], first_bend + e, roots[e], modulus, time,
                    n0, n1, n2, m0, m1, m2, normal, rest, friction, friction_limit, dt,
                )  # fmt: skip
            else:
                m0, m1, m2 = modulus * m0, modulus * m1, modulus * m2
            if ti.static(lengths[k] < PIECE):
                push(f, m0, m1, m2, home, begin, nodes, weights, lengths[k])
            else:
                for piece in range((first[e + 1] - begin) // PIECE):
                    push(f, m0, m1, m2, home, within(begin + piece * PIECE), nodes, weights, PIECE)

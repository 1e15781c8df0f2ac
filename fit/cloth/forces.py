"""Forces inside the cloth, for candidates side by side: fibres, shear and twist; and the nodes' normals.

Samples and stencils are those of `fit.cloth.mesh`. With Fu, Fv the columns of the deformation gradient:
    fibres     S11 = k_u (E11 + a |E11| E11 + tau dE11/dt + z), E11 = (Fu.Fu - 1)/2; P = S11 Fu; alike down
    shear      S12 = G (E12 + tau dE12/dt + z), E12 = Fu.Fv; P_u = S12 Fv, P_v = S12 Fu
    z          viscosity that relaxes (fit.effects.stretch_viscosity)
    twist      kappa = x_uv, as the slope down of Fu (fit.cloth.moments)
Where threads cross the elements, of k_u and k_v only what shear has is felt at the fibres' own samples, and the rest at
those of shear, from the same Fu and Fv (`fit.cloth.elements`).
The force on a node is minus the sum of stress times the weight with which the node enters its sample.

Rates of strain are differences between steps, d/dt = (E_n - E_n-1) / dt, the mean over the step that led here.
Arrays are those of `fit.cloth.stencils`: the group's first node is at home, its first fibre sample at place.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.lanes import magnitude, within
from fit.cloth.lines import IN_LINES, UNIT_SLOPES
from fit.cloth.moments import bent
from fit.cloth.stencils import (
    hand_back,
    line_slopes,
    line_stencil,
    line_values,
    push,
    push_line,
    stencil,
    weighted,
)


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
def tautness(
    u0,
    u1,
    u2,
    e,
    strains: ti.template(),
    area,
    stiffness,
    delay,
    stiffening,
    with_viscosity: ti.template(),
    lags: ti.template(),
    kept,
    gain,
):
    """Tension times area of threads whose slope is u."""
    strain = 0.5 * (u0 * u0 + u1 * u1 + u2 * u2 - 1.0)
    late = lagging(strain, e, strains, delay, with_viscosity, lags, kept, gain)
    return (strain + stiffening * magnitude(strain) * strain + late) * (area * stiffness)


@ti.func
def tighten(
    e,
    k,
    u: ti.template(),
    slopes: ti.template(),
    strains: ti.template(),
    stress: ti.template(),
    area,
    stiffness,
    delay,
    stiffening,
    with_viscosity: ti.template(),
    lags: ti.template(),
    kept,
    gain,
):
    """Stress of one fibre sample from its slope."""
    tension = tautness(
        u[0], u[1], u[2], e, strains, area, stiffness, delay, stiffening, with_viscosity, lags, kept, gain
    )  # fmt: skip
    slopes[k], slopes[k + 1], slopes[k + 2] = u[0], u[1], u[2]
    stress[k], stress[k + 1], stress[k + 2] = tension * u[0], tension * u[1], tension * u[2]


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
    """Slopes and stress of one family of fibres; first: the group's first sample; entry: where its stencils begin.

    count: nodes of a sample, or `IN_LINES`, where three samples share four nodes
    """
    if ti.static(count == IN_LINES):
        for line in range((end - start) // 3):
            e = within(start + 3 * line)
            k = within(3 * (first + e))
            at, w = line_stencil(home, entry, line, nodes, weights)
            u = line_slopes(x, at, w)
            if ti.static(with_ahead):
                a = line_slopes(ahead, at, w)
                for g in ti.static(range(3)):
                    for c in ti.static(range(3)):
                        slopes_ahead[k + 3 * g + c] = a[g][c]
            for g in ti.static(range(3)):
                tighten(
                    first + e + g, k + 3 * g, u[g], slopes, strains, stress, area[e + g],
                    stiffness, delay, stiffening, with_viscosity, lags, kept, gain,
                )  # fmt: skip
    else:
        for e in range(start, end):
            k = within(3 * (first + e))
            at, w = stencil(home, within(entry + count * (e - start)), nodes, weights, count)
            u = weighted(x, at, w)
            if ti.static(with_ahead):
                slopes_ahead[k], slopes_ahead[k + 1], slopes_ahead[k + 2] = weighted(ahead, at, w)
            tighten(
                first + e, k, u, slopes, strains, stress, area[e],
                stiffness, delay, stiffening, with_viscosity, lags, kept, gain,
            )  # fmt: skip


@ti.func
def sheared(
    e,
    row,
    u: ti.template(),
    place,
    first,
    slopes: ti.template(),
    strains: ti.template(),
    stress: ti.template(),
    down: ti.template(),
    between: ti.template(),
    area: ti.template(),
    stiffness,
    delay,
    with_viscosity: ti.template(),
    lags: ti.template(),
    kept,
    gain,
    is_crossed: ti.template(),
    first_crossed,
    stiffness_across,
    stiffness_down,
    stiffening,
):
    """Shear at one sample, handed back to the fibre samples down; returns what those across are to give."""
    begin, g = within(4 * e), within(4 * row)
    below, h = [within(place + down[begin + n]) for n in range(4)], [between[g + n] for n in range(4)]
    w0, w1, w2 = weighted(slopes, below, h)
    strain = u[0] * w0 + u[1] * w1 + u[2] * w2
    late = lagging(strain, first + e, strains, delay, with_viscosity, lags, kept, gain)
    tension = (strain + late) * (0.0 - area[e] * stiffness)
    if ti.static(is_crossed):
        k = first_crossed + 2 * e
        along = tautness(
            u[0], u[1], u[2], k, strains, area[e], stiffness_across, delay, stiffening, with_viscosity, lags, kept, gain
        )
        askew = tautness(
            w0, w1, w2, k + 1, strains, area[e], stiffness_down, delay, stiffening, with_viscosity, lags, kept, gain
        )
        push(stress, tension * u[0] - askew * w0, tension * u[1] - askew * w1, tension * u[2] - askew * w2, below, h)
        return [tension * w0 - along * u[0], tension * w1 - along * u[1], tension * w2 - along * u[2]]
    else:
        push(stress, tension * u[0], tension * u[1], tension * u[2], below, h)
        return [tension * w0, tension * w1, tension * w2]


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
    between: ti.template(),
    area: ti.template(),
    stiffness,
    delay,
    with_viscosity: ti.template(),
    lags: ti.template(),
    kept,
    gain,
    with_twist: ti.template(),
    twist_scales: ti.template(),
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
    is_crossed: ti.template(),
    first_crossed,
    stiffness_across,
    stiffness_down,
    stiffening,
):
    """Shear and mixed second derivatives, handed back to the fibre samples that they were interpolated from.

    Of an element's nine samples three at a time, which lie between the same four samples across. Where threads cross
    the elements, `is_crossed`, what else they have of stiffness too; its strains begin at first_crossed, two a sample.
    """
    for line in range(area.shape[0] // 3):
        begin, e = within(12 * line), within(3 * line)
        at = [within(place + across[begin + n]) for n in range(4)]
        u = line_values(slopes, at)
        p = [
            sheared(
                e + h, line % 3, u[h], place, first, slopes, strains, stress, down, between, area,
                stiffness, delay, with_viscosity, lags, kept, gain,
                is_crossed, first_crossed, stiffness_across, stiffness_down, stiffening,
            )
            for h in range(3)
        ]  # fmt: skip
        if ti.static(with_twist):
            a = line_slopes(slopes_ahead, at, ti.static(UNIT_SLOPES))
            s = line_slopes(slopes if ti.static(with_bends) else slopes_ahead, at, ti.static(UNIT_SLOPES))
            m = [
                bent(
                    e + h, twist_scales[e + h], a[h], s[h], twist_centres, twist_roots, twist_stiffness, bend_time,
                    with_bends, home, first_bend, normal, rest, friction, friction_limit, dt,
                )
                for h in range(3)
            ]  # fmt: skip
            hand_back(stress, p, m, at, True)
        else:
            hand_back(stress, p, p, at, False)


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
    """Forces of the stress of one family of fibres on the nodes; arguments as of `fibres`."""
    if ti.static(count == IN_LINES):
        for line in range((end - start) // 3):
            at, w = line_stencil(home, entry, line, nodes, weights)
            push_line(f, stress, within(place + 3 * (start + 3 * line)), at, w)
    else:
        for e in range(start, end):
            k = within(place + 3 * e)
            at, w = stencil(home, within(entry + count * (e - start)), nodes, weights, count)
            push(f, stress[k], stress[k + 1], stress[k + 2], at, w)


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

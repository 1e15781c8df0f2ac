"""Bending moments for candidates in SIMD lanes: elasticity, viscosity, friction and rest curvature.

    M = B (kappa + tau dkappa/dt - kappa_0 n) + Dahl friction along the normal n,   kappa = x_uu, x_vv, x_uv

Bends and stencils are those of `fit.cloth.bends`, arrays those of `fit.cloth.stencils`. Bends are linear in the
positions, and their damping time is much longer than a step. So they come from x + tau v (`ahead`), whose second
derivative is kappa + tau dkappa/dt. Friction needs the rates themselves; `ahead` then holds v.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.bends import ROW_BEND, STENCIL_NODES, TWIST
from fit.cloth.lanes import decay, magnitude, within
from fit.cloth.lines import IN_LINES
from fit.cloth.material import REFERENCE_CURVATURE
from fit.cloth.stencils import line_curvatures, push, push_pair, stencil, weighted


@ti.func
def damped_moment(
    centre, e, root, modulus, k0, k1, k2, r0, r1, r2, facing: ti.template(), law: ti.template()
):  # fmt: skip
    """Return the moment of a second derivative k with rate r, including the contributions of effects.

    Derivatives and moment are times the root of the area. Bundles, of `fit.cloth.bundles`: Facing, BendLaw.
    """
    i = within(centre)
    n0, n1, n2 = facing.normal[i], facing.normal[i + 1], facing.normal[i + 2]
    change = (r0 * n0 + r1 * n1 + r2 * n2) / root * law.dt
    # Dahl, exponent 1, integrated exactly over a change of one sign:
    # M -> s + (M - s) exp(-|dkappa| / kappa_ref), s = sign(dkappa) M_max
    goal = ti.select(change > 0.0, law.friction_limit, 0.0 - law.friction_limit)
    fade = decay(magnitude(change) / REFERENCE_CURVATURE)
    facing.friction[e] = goal + (facing.friction[e] - goal) * fade
    along = root * (facing.friction[e] - modulus * facing.rest_curvature[e])
    return (
        modulus * (k0 + law.bend_time * r0) + along * n0,
        modulus * (k1 + law.bend_time * r1) + along * n1,
        modulus * (k2 + law.bend_time * r2) + along * n2,
    )


@ti.func
def bent(
    e, scale, m: ti.template(), n: ti.template(), centres: ti.template(), roots: ti.template(), stiffness, home,
    first_bend, facing: ti.template(), law: ti.template(), with_bends: ti.template(),
):  # fmt: skip
    """Return the moment of one bend for its unit weights.

    m: second derivative of `ahead`, n: of the positions, by these weights
    """
    if ti.static(with_bends):
        m0, m1, m2 = damped_moment(
            home + centres[e], first_bend + e, roots[e], stiffness,
            scale * n[0], scale * n[1], scale * n[2], scale * m[0], scale * m[1], scale * m[2], facing, law,
        )  # fmt: skip
        return [scale * m0, scale * m1, scale * m2]
    else:
        modulus = scale * scale * stiffness
        return [modulus * m[0], modulus * m[1], modulus * m[2]]


@ti.func
def long_sum(
    y: ti.template(), home, begin, end, nodes: ti.template(), weights: ti.template(), total: ti.template(), place
):  # fmt: skip
    """Return the weighted sum of a field over a stencil of whole pieces, accumulated in `total[place]`."""
    for c in ti.static(range(3)):
        total[place + c] = 0.0 * y[home + c]
    for piece in range((end - begin) // STENCIL_NODES):
        at, w = stencil(home, within(begin + piece * STENCIL_NODES), nodes, weights, STENCIL_NODES)
        s0, s1, s2 = weighted(y, at, w)
        total[place] = total[place] + s0
        total[place + 1] = total[place + 1] + s1
        total[place + 2] = total[place + 2] + s2
    return total[place], total[place + 1], total[place + 2]


@ti.func
def second(
    y: ti.template(), at: ti.template(), w: ti.template(), is_long: ti.template(),
    home, begin, end, nodes: ti.template(), weights: ti.template(), total: ti.template(), place,
):  # fmt: skip
    """Return the second derivative of a field at a node."""
    if ti.static(is_long):
        return long_sum(y, home, begin, end, nodes, weights, total, place)
    else:
        return weighted(y, at, w)


@ti.func
def modulus_of(kind, stiffness, stiffness_across, stiffness_mixed):
    """Return the bending stiffness for a kind of second derivative."""
    modulus = stiffness
    if kind == ROW_BEND:
        modulus = stiffness_across
    elif kind == TWIST:
        modulus = stiffness_mixed
    return modulus


@ti.func
def bending(
    place: ti.template(),
    nodes: ti.template(),
    stencils: ti.template(),
    facing: ti.template(),
    stiffness: ti.template(),
    law: ti.template(),
    kind: ti.template(),
    sums: ti.template(),
):
    """Add the nodal forces of bending moments; sums: scratch memory from `place.first_slope` on.

    Bundles, of `fit.cloth.bundles`: Place, Motion, Stencils, Facing, Row, BendLaw, Kind.
    """
    end = 0
    for k in ti.static(range(len(kind.bend_lengths))):
        length = ti.static(kind.bend_lengths[k])
        start = end
        end = start + stencils.bend_counts[k]
        if ti.static(length == IN_LINES):
            for pair in range((end - start) // 2):
                e = start + 2 * pair
                modulus = modulus_of(
                    stencils.bend_kind[e], stiffness.bending_down, stiffness.bending_across, stiffness.bending_mixed
                )
                begin = within(stencils.bend_first[e])
                at = [within(place.home + stencils.bend_nodes[begin + n]) for n in range(4)]
                a = line_curvatures(nodes.ahead, at)
                s = line_curvatures(nodes.x if ti.static(kind.with_bends) else nodes.ahead, at)
                m = [
                    bent(
                        e + h, stencils.bend_weights[begin + 4 * h], a[h], s[h], stencils.bend_centre,
                        stencils.bend_root, modulus, place.home, place.first_bend, facing, law, kind.with_bends,
                    )
                    for h in range(2)
                ]  # fmt: skip
                push_pair(nodes.f, m, at)
        else:
            for e in range(start, end):
                modulus = modulus_of(
                    stencils.bend_kind[e], stiffness.bending_down, stiffness.bending_across, stiffness.bending_mixed
                )
                begin, after = within(stencils.bend_first[e]), stencils.bend_first[e + 1]
                some_nodes, weights = ti.static(stencils.bend_nodes, stencils.bend_weights)
                at, w = stencil(place.home, begin, some_nodes, weights, 0 if length == STENCIL_NODES else length)
                is_long = ti.static(length == STENCIL_NODES)
                m0, m1, m2 = second(
                    nodes.ahead, at, w, is_long, place.home, begin, after, some_nodes, weights, sums, place.first_slope
                )
                if ti.static(kind.with_bends):
                    n0, n1, n2 = second(
                        nodes.x, at, w, is_long, place.home, begin, after, some_nodes, weights, sums, place.first_slope
                    )
                    m0, m1, m2 = damped_moment(
                        place.home + stencils.bend_centre[e], place.first_bend + e, stencils.bend_root[e], modulus,
                        n0, n1, n2, m0, m1, m2, facing, law,
                    )  # fmt: skip
                else:
                    m0, m1, m2 = modulus * m0, modulus * m1, modulus * m2
                if ti.static(length < STENCIL_NODES):
                    push(nodes.f, m0, m1, m2, at, w)
                else:
                    for piece in range((after - begin) // STENCIL_NODES):
                        some, g = stencil(
                            place.home, within(begin + piece * STENCIL_NODES), some_nodes, weights, STENCIL_NODES
                        )  # fmt: skip
                        push(nodes.f, m0, m1, m2, some, g)

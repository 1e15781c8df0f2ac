"""Moments inside the cloth, for candidates side by side: bending, viscosity and friction in it, and rest curvature.

    M = B (kappa + tau dkappa/dt - kappa_0 n) + Dahl friction along the normal n,   kappa = x_uu, x_vv, x_uv

Bends and stencils are those of `fit.cloth.bends`, arrays those of `fit.cloth.stencils`. Bends are linear in the places,
and damped for much longer than a step: theirs come from x + tau v (`ahead`), whose second derivative is
kappa + tau dkappa/dt; or from v itself, in the place of `ahead`, where friction needs to know them.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.bends import PIECE, ROW_BEND, TWIST
from fit.cloth.lanes import decay, magnitude, within
from fit.cloth.lines import IN_LINES
from fit.cloth.material import REFERENCE_CURVATURE
from fit.cloth.stencils import line_curvatures, push, push_pair, stencil, weighted


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
def bent(
    e,
    scale,
    m: ti.template(),
    n: ti.template(),
    centres: ti.template(),
    roots: ti.template(),
    stiffness,
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
    """Moment of one bend for its unit weights; m: second derivative of `ahead`, n: of the places, by those weights."""
    if ti.static(with_bends):
        m0, m1, m2 = damped_moment(
            home + centres[e], first_bend + e, roots[e], stiffness, bend_time,
            scale * n[0], scale * n[1], scale * n[2], scale * m[0], scale * m[1], scale * m[2],
            normal, rest, friction, friction_limit, dt,
        )  # fmt: skip
        return [scale * m0, scale * m1, scale * m2]
    else:
        modulus = scale * scale * stiffness
        return [modulus * m[0], modulus * m[1], modulus * m[2]]


@ti.func
def long_sum(
    y: ti.template(), home, begin, end, nodes: ti.template(), weights: ti.template(), total: ti.template(), place
):  # fmt: skip
    """Weighted sum of a field over a stencil of whole pieces, summed up at `total[place]`."""
    for c in ti.static(range(3)):
        total[place + c] = 0.0 * y[home + c]
    for piece in range((end - begin) // PIECE):
        at, w = stencil(home, within(begin + piece * PIECE), nodes, weights, PIECE)
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
    """Second derivative of a field at a node."""
    if ti.static(is_long):
        return long_sum(y, home, begin, end, nodes, weights, total, place)
    else:
        return weighted(y, at, w)


@ti.func
def modulus_of(kind, stiffness, stiffness_across, stiffness_mixed):
    """Bending stiffness by the kind of second derivative."""
    modulus = stiffness
    if kind == ROW_BEND:
        modulus = stiffness_across
    elif kind == TWIST:
        modulus = stiffness_mixed
    return modulus


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
        if ti.static(lengths[k] == IN_LINES):
            for pair in range((end - start) // 2):
                e = start + 2 * pair
                modulus = modulus_of(kinds[e], stiffness, stiffness_across, stiffness_mixed)
                begin = within(first[e])
                at = [within(home + nodes[begin + n]) for n in range(4)]
                a = line_curvatures(ahead, at)
                s = line_curvatures(x if ti.static(with_bends) else ahead, at)
                m = [
                    bent(
                        e + h, weights[begin + 4 * h], a[h], s[h], centres, roots, modulus, time,
                        with_bends, home, first_bend, normal, rest, friction, friction_limit, dt,
                    )
                    for h in range(2)
                ]  # fmt: skip
                push_pair(f, m, at)
        else:
            for e in range(start, end):
                modulus = modulus_of(kinds[e], stiffness, stiffness_across, stiffness_mixed)
                begin = within(first[e])
                at, w = stencil(home, begin, nodes, weights, 0 if lengths[k] == PIECE else lengths[k])
                is_long = ti.static(lengths[k] == PIECE)
                m0, m1, m2 = second(ahead, at, w, is_long, home, begin, first[e + 1], nodes, weights, sums, place)
                if ti.static(with_bends):
                    n0, n1, n2 = second(x, at, w, is_long, home, begin, first[e + 1], nodes, weights, sums, place)
                    m0, m1, m2 = damped_moment(
                        home + centres[e], first_bend + e, roots[e], modulus, time,
                        n0, n1, n2, m0, m1, m2, normal, rest, friction, friction_limit, dt,
                    )  # fmt: skip
                else:
                    m0, m1, m2 = modulus * m0, modulus * m1, modulus * m2
                if ti.static(lengths[k] < PIECE):
                    push(f, m0, m1, m2, at, w)
                else:
                    for piece in range((first[e + 1] - begin) // PIECE):
                        some, g = stencil(home, within(begin + piece * PIECE), nodes, weights, PIECE)
                        push(f, m0, m1, m2, some, g)

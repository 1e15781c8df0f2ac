"""Membrane forces for candidates in SIMD lanes: fibres, shear and twist; and the nodes' normals.

Samples and stencils are those of `fit.cloth.mesh`. With Fu, Fv the columns of the deformation gradient:
    fibres     S11 = k_u (E11 + a |E11| E11 + tau dE11/dt + z), E11 = (Fu.Fu - 1)/2; P = S11 Fu; alike down
    shear      S12 = G (E12 + tau dE12/dt + z), E12 = Fu.Fv; P_u = S12 Fv, P_v = S12 Fu
    z          viscosity that relaxes (fit.effects.stretch_viscosity)
    twist      kappa = x_uv, as the slope down of Fu (fit.cloth.moments)
If threads cross the elements, a part of k_u and k_v as large as G acts at the fibres' own samples. The rest acts at the
samples of shear, from the same Fu and Fv (`fit.cloth.elements`). The force on a node is minus the sum of stress times
the weight with which the node enters its sample.

Rates of strain are differences between steps, d/dt = (E_n - E_n-1) / dt, the mean over the step that led here.
`fit.cloth.stencils` describes the array layout, and `fit.cloth.bundles` the bundles; `Place` holds a group's offsets.
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
def lagging(strain, e, strains: ti.template(), lags: ti.template(), law: ti.template(), with_viscosity: ti.template()):
    """Return the viscous part that is added to the strain, with the viscosity of `fit.effects.stretch_viscosity`."""
    change = strain - strains[e]
    strains[e] = strain
    late = law.delay * change
    if ti.static(with_viscosity):
        lag = law.kept * lags[e] + law.lag_gain * change
        lags[e] = lag
        late = late + lag
    return late


@ti.func
def tautness(
    u0, u1, u2, e, strains: ti.template(), lags: ti.template(), area, stiffness, law: ti.template(),
    with_viscosity: ti.template(),
):  # fmt: skip
    """Return tension times area of threads whose slope is u."""
    strain = 0.5 * (u0 * u0 + u1 * u1 + u2 * u2 - 1.0)
    late = lagging(strain, e, strains, lags, law, with_viscosity)
    return (strain + law.stiffening * magnitude(strain) * strain + late) * (area * stiffness)


@ti.func
def tighten(
    e, k, u: ti.template(), memory: ti.template(), area, stiffness, law: ti.template(), with_viscosity: ti.template()
):
    """Compute and store slope u and stress of fibre sample e, whose numbers begin at k."""
    tension = tautness(
        u[0], u[1], u[2], e, memory.strains, memory.fibre_lags, area, stiffness, law, with_viscosity
    )  # fmt: skip
    memory.slopes[k], memory.slopes[k + 1], memory.slopes[k + 2] = u[0], u[1], u[2]
    memory.stress[k], memory.stress[k + 1], memory.stress[k + 2] = tension * u[0], tension * u[1], tension * u[2]


@ti.func
def fibres(
    place: ti.template(),
    family: ti.template(),
    nodes: ti.template(),
    cloth: ti.template(),
    memory: ti.template(),
    stiffness,
    law: ti.template(),
    kind: ti.template(),
    with_ahead: ti.template(),
):
    """Compute slopes and stress of one family of fibres; with_ahead: also the slopes of `ahead`.

    Bundles, of `fit.cloth.bundles`: Place, Family, Motion, Membrane, Strains, Law, Kind. Of a family that goes
    `IN_LINES` three samples share four nodes.
    """
    if ti.static(family.sample_nodes == IN_LINES):
        for line in range((family.end - family.start) // 3):
            e = within(family.start + 3 * line)
            k = within(3 * (place.first_fibre + e))
            at, w = line_stencil(place.home, family.entry, line, cloth.fibre_at, cloth.fibre_weights)
            u = line_slopes(nodes.x, at, w)
            if ti.static(with_ahead):
                a = line_slopes(nodes.ahead, at, w)
                for g in ti.static(range(3)):
                    for c in ti.static(range(3)):
                        memory.slopes_ahead[k + 3 * g + c] = a[g][c]
            for g in ti.static(range(3)):
                tighten(
                    place.first_fibre + e + g, k + 3 * g, u[g], memory, cloth.fibre_area[e + g], stiffness, law,
                    kind.with_viscosity,
                )  # fmt: skip
    else:
        for e in range(family.start, family.end):
            k = within(3 * (place.first_fibre + e))
            begin = within(family.entry + family.sample_nodes * (e - family.start))
            at, w = stencil(place.home, begin, cloth.fibre_at, cloth.fibre_weights, family.sample_nodes)
            u = weighted(nodes.x, at, w)
            if ti.static(with_ahead):
                memory.slopes_ahead[k], memory.slopes_ahead[k + 1], memory.slopes_ahead[k + 2] = weighted(
                    nodes.ahead, at, w
                )
            tighten(place.first_fibre + e, k, u, memory, cloth.fibre_area[e], stiffness, law, kind.with_viscosity)


@ti.func
def sheared(
    e, row, u: ti.template(), place: ti.template(), cloth: ti.template(), memory: ti.template(),
    stiffness: ti.template(), law: ti.template(), kind: ti.template(),
):  # fmt: skip
    """Add one sample's shear stress to the fibre samples down; return the stress for the samples across."""
    begin, g = within(4 * e), within(4 * row)
    below = [within(place.first_slope + cloth.shear_down[begin + n]) for n in range(4)]
    h = [cloth.between[g + n] for n in range(4)]
    w0, w1, w2 = weighted(memory.slopes, below, h)
    strain = u[0] * w0 + u[1] * w1 + u[2] * w2
    late = lagging(
        strain, place.first_shear + e, memory.shear_strains, memory.shear_lags, law, kind.with_viscosity
    )  # fmt: skip
    tension = (strain + late) * (0.0 - cloth.shear_area[e] * stiffness.shear)
    if ti.static(kind.is_crossed):
        k = place.first_crossed + 2 * e
        along = tautness(
            u[0], u[1], u[2], k, memory.shear_strains, memory.shear_lags, cloth.shear_area[e],
            stiffness.shear_across, law, kind.with_viscosity,
        )  # fmt: skip
        askew = tautness(
            w0, w1, w2, k + 1, memory.shear_strains, memory.shear_lags, cloth.shear_area[e],
            stiffness.shear_down, law, kind.with_viscosity,
        )  # fmt: skip
        push(
            memory.stress, tension * u[0] - askew * w0, tension * u[1] - askew * w1, tension * u[2] - askew * w2,
            below, h,
        )  # fmt: skip
        return [tension * w0 - along * u[0], tension * w1 - along * u[1], tension * w2 - along * u[2]]
    else:
        push(memory.stress, tension * u[0], tension * u[1], tension * u[2], below, h)
        return [tension * w0, tension * w1, tension * w2]


@ti.func
def shearing(
    place: ti.template(),
    cloth: ti.template(),
    memory: ti.template(),
    stencils: ti.template(),
    facing: ti.template(),
    stiffness: ti.template(),
    law: ti.template(),
    bend_law: ti.template(),
    kind: ti.template(),
):
    """Compute shear and mixed second derivatives, and add their stresses to the fibre samples of the interpolation.

    A step treats three of an element's nine samples, which lie between the same four samples across. If threads cross
    the elements, the rest of their stiffness acts here too; its strains begin at `first_crossed`, two a sample.
    Bundles, of `fit.cloth.bundles`: Place, Membrane, Strains, Stencils, Facing, Row, Law, BendLaw, Kind.
    """
    for line in range(cloth.shear_area.shape[0] // 3):
        begin, e = within(12 * line), within(3 * line)
        at = [within(place.first_slope + cloth.shear_across[begin + n]) for n in range(4)]
        u = line_values(memory.slopes, at)
        p = [sheared(e + h, line % 3, u[h], place, cloth, memory, stiffness, law, kind) for h in range(3)]
        if ti.static(kind.with_twist):
            a = line_slopes(memory.slopes_ahead, at, ti.static(UNIT_SLOPES))
            s = line_slopes(
                memory.slopes if ti.static(kind.with_bends) else memory.slopes_ahead, at, ti.static(UNIT_SLOPES)
            )
            m = [
                bent(
                    e + h, stencils.twist_scales[e + h], a[h], s[h], stencils.twist_centre, stencils.twist_root,
                    stiffness.bending_mixed, place.home, place.first_twist, facing, bend_law, kind.with_bends,
                )
                for h in range(3)
            ]  # fmt: skip
            hand_back(memory.stress, p, m, at, True)
        else:
            hand_back(memory.stress, p, p, at, False)


@ti.func
def push_fibres(
    place: ti.template(), family: ti.template(), nodes: ti.template(), cloth: ti.template(), memory: ti.template()
):
    """Add the nodal forces of one family of fibres; arguments as of `fibres`."""
    if ti.static(family.sample_nodes == IN_LINES):
        for line in range((family.end - family.start) // 3):
            at, w = line_stencil(place.home, family.entry, line, cloth.fibre_at, cloth.fibre_weights)
            push_line(nodes.f, memory.stress, within(place.first_slope + 3 * (family.start + 3 * line)), at, w)
    else:
        for e in range(family.start, family.end):
            k = within(place.first_slope + 3 * e)
            begin = within(family.entry + family.sample_nodes * (e - family.start))
            at, w = stencil(place.home, begin, cloth.fibre_at, cloth.fibre_weights, family.sample_nodes)
            push(nodes.f, memory.stress[k], memory.stress[k + 1], memory.stress[k + 2], at, w)


@ti.func
def find_normals(place: ti.template(), first_node, count, nodes: ti.template(), facing: ti.template(), zero):
    """Compute unit normals and areas of the nodes, from the tangents along both directions of the elements.

    Bundles, of `fit.cloth.bundles`: Place, Motion, Facing.
    """
    for i in range(3 * count):
        facing.normal[place.home + i] = zero
    for e in range(facing.cells.shape[0]):
        for row in range(4):
            for column in range(4):
                p0, p1, p2 = zero, zero, zero
                q0, q1, q2 = zero, zero, zero
                for n in ti.static(range(4)):
                    i, w = within(place.home + facing.cells[e, 4 * row + n]), facing.basis[column, n]
                    p0, p1, p2 = p0 + w * nodes.x[i], p1 + w * nodes.x[i + 1], p2 + w * nodes.x[i + 2]
                    j, h = within(place.home + facing.cells[e, 4 * n + column]), facing.basis[row, n]
                    q0, q1, q2 = q0 - h * nodes.x[j], q1 - h * nodes.x[j + 1], q2 - h * nodes.x[j + 2]
                share = facing.basis[4, row] * facing.basis[4, column]
                m = within(place.home + facing.cells[e, 4 * row + column])
                facing.normal[m] = facing.normal[m] + share * (p1 * q2 - p2 * q1)
                facing.normal[m + 1] = facing.normal[m + 1] + share * (p2 * q0 - p0 * q2)
                facing.normal[m + 2] = facing.normal[m + 2] + share * (p0 * q1 - p1 * q0)
    for i in range(count):
        k = within(place.home + 3 * i)
        n0, n1, n2 = facing.normal[k], facing.normal[k + 1], facing.normal[k + 2]
        length = ti.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-20
        facing.normal[k], facing.normal[k + 1], facing.normal[k + 2] = n0 / length, n1 / length, n2 / length
        facing.faced_area[first_node + i] = length

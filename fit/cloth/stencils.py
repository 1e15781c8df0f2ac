"""Weighted sums over stencils and lines of nodes, and their transposes, which distribute stresses to nodes.

Arrays are flat, with three vectors of lanes to a node or a sample. The vectors of node i begin at home + 3 i, and index
arrays hold 3 i (`fit.cloth.launch`). Taichi would compute an element's offset in an array of several dimensions at
every access. This took longer than the sums.

Sums are unrolled: a sum carried round a loop in registers is not vectorised. `+=` on memory would be an atomic, three
times slower: load, add, store. Values are loaded once, before the first store: the compiler cannot know that a store
changes no index. Lines are those of `fit.cloth.lines`.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.lanes import within
from fit.cloth.lines import CURVATURES, LINE_ENTRIES, UNIT_SLOPES, VALUES


@ti.func
def stencil(home, begin, nodes: ti.template(), weights: ti.template(), count: ti.template()):
    """Return the node offsets and weights of a stencil of known length."""
    return [within(home + nodes[begin + n]) for n in range(count)], [weights[begin + n] for n in range(count)]


@ti.func
def weighted(y: ti.template(), at: ti.template(), weights: ti.template()):
    """Return the weighted sum of a field over a stencil."""
    k, w = at[0], weights[0]
    s0, s1, s2 = w * y[k], w * y[k + 1], w * y[k + 2]
    for n in ti.static(range(1, len(at))):
        i, h = at[n], weights[n]
        s0, s1, s2 = s0 + h * y[i], s1 + h * y[i + 1], s2 + h * y[i + 2]
    return s0, s1, s2


@ti.func
def push(f: ti.template(), p0, p1, p2, at: ti.template(), weights: ti.template()):
    """Add the forces of stress p to the nodes of a stencil."""
    for n in ti.static(range(len(at))):
        i, w = at[n], weights[n]
        f[i], f[i + 1], f[i + 2] = f[i] - w * p0, f[i + 1] - w * p1, f[i + 2] - w * p2


@ti.func
def line_stencil(home, entry, line, nodes: ti.template(), weights: ti.template()):
    """Return the offsets of a line's four nodes, and its five weights."""
    begin = within(entry + LINE_ENTRIES * line)
    return [within(home + nodes[begin + n]) for n in range(4)], [weights[begin + n] for n in range(LINE_ENTRIES)]


@ti.func
def line_slopes(y: ti.template(), at: ti.template(), w: ti.template()):
    """Return the slopes of a field at the three samples of a line."""
    outer = [y[at[3] + c] - y[at[0] + c] for c in range(3)]
    inner = [y[at[2] + c] - y[at[1] + c] for c in range(3)]
    bulge = [(y[at[0] + c] + y[at[3] + c]) - (y[at[1] + c] + y[at[2] + c]) for c in range(3)]
    even = [w[2] * outer[c] + w[3] * inner[c] for c in range(3)]
    odd = [w[4] * bulge[c] for c in range(3)]
    return (
        [even[c] - odd[c] for c in range(3)],
        [w[0] * outer[c] + w[1] * inner[c] for c in range(3)],
        [even[c] + odd[c] for c in range(3)],
    )


@ti.func
def push_line(f: ti.template(), stress: ti.template(), k, at: ti.template(), w: ti.template()):
    """Add the forces of a line's sample stresses, stored from k on, to its nodes: the transpose of `line_slopes`."""
    for c in ti.static(range(3)):
        first, middle, last = stress[k + c], stress[k + 3 + c], stress[k + 6 + c]
        both, bulge = first + last, w[4] * (last - first)
        outer, inner = w[0] * middle + w[2] * both, w[1] * middle + w[3] * both
        f[at[0] + c] = f[at[0] + c] + (outer - bulge)
        f[at[1] + c] = f[at[1] + c] + (inner + bulge)
        f[at[2] + c] = f[at[2] + c] - (inner - bulge)
        f[at[3] + c] = f[at[3] + c] - (outer + bulge)


@ti.func
def line_values(y: ti.template(), at: ti.template()):
    """Return the values of a field at the three points between four samples."""
    w = ti.static(VALUES)
    both = [y[at[0] + c] + y[at[3] + c] for c in range(3)]
    mid = [y[at[1] + c] + y[at[2] + c] for c in range(3)]
    odd = [w[4] * (y[at[3] + c] - y[at[0] + c]) + w[5] * (y[at[2] + c] - y[at[1] + c]) for c in range(3)]
    even = [w[2] * both[c] + w[3] * mid[c] for c in range(3)]
    return (
        [even[c] - odd[c] for c in range(3)],
        [w[0] * both[c] + w[1] * mid[c] for c in range(3)],
        [even[c] + odd[c] for c in range(3)],
    )


@ti.func
def hand_back(stress: ti.template(), p: ti.template(), m: ti.template(), at: ti.template(), with_twist: ti.template()):
    """Subtract stresses p at three points from the four samples of `line_values`, and add moments m likewise."""
    v, w = ti.static(VALUES), ti.static(UNIT_SLOPES)
    for c in ti.static(range(3)):
        both, apart = p[0][c] + p[2][c], p[2][c] - p[0][c]
        outer, inner = v[0] * p[1][c] + v[2] * both, v[1] * p[1][c] + v[3] * both
        outer_apart, inner_apart = v[4] * apart, v[5] * apart
        s0, s1 = stress[at[0] + c] - (outer - outer_apart), stress[at[1] + c] - (inner - inner_apart)
        s2, s3 = stress[at[2] + c] - (inner + inner_apart), stress[at[3] + c] - (outer + outer_apart)
        if ti.static(with_twist):
            twisted, bulge = m[0][c] + m[2][c], w[4] * (m[2][c] - m[0][c])
            rim, core = w[0] * m[1][c] + w[2] * twisted, w[1] * m[1][c] + w[3] * twisted
            s0, s1, s2, s3 = s0 - (rim - bulge), s1 - (core + bulge), s2 + (core - bulge), s3 + (rim + bulge)
        stress[at[0] + c], stress[at[1] + c], stress[at[2] + c], stress[at[3] + c] = s0, s1, s2, s3


@ti.func
def line_curvatures(y: ti.template(), at: ti.template()):
    """Return the second derivatives of a field at the two inner nodes of a line."""
    w = ti.static(CURVATURES)
    even = [w[0] * ((y[at[0] + c] + y[at[3] + c]) - (y[at[1] + c] + y[at[2] + c])) for c in range(3)]
    odd = [w[1] * (y[at[3] + c] - y[at[0] + c]) + w[2] * (y[at[2] + c] - y[at[1] + c]) for c in range(3)]
    return [even[c] - odd[c] for c in range(3)], [even[c] + odd[c] for c in range(3)]


@ti.func
def push_pair(f: ti.template(), m: ti.template(), at: ti.template()):
    """Add the forces of two moments to a line's nodes: the transpose of `line_curvatures`."""
    w = ti.static(CURVATURES)
    for c in ti.static(range(3)):
        even, apart = w[0] * (m[0][c] + m[1][c]), m[1][c] - m[0][c]
        outer, inner = w[1] * apart, w[2] * apart
        f[at[0] + c] = f[at[0] + c] - (even - outer)
        f[at[1] + c] = f[at[1] + c] + (even + inner)
        f[at[2] + c] = f[at[2] + c] + (even - inner)
        f[at[3] + c] = f[at[3] + c] - (even + outer)

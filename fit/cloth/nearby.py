"""Neighbour lists of contact pairs for candidates in SIMD lanes, and the memory layout of contact.

A pair is a sample and a quad that may touch, or a sample and a body. Pairs within `SEARCH_DISTANCE` of contact in any
lane are watched, and of these, pairs within `PAIR_DISTANCE` are computed. A list is valid until a node has moved so far
that an unlisted pair could touch. A sample moves by at most `Surface.carried` times the node's displacement. So with
the margin m

    2 carried max |x - x_then| <= m,   m = PAIR_DISTANCE, or SEARCH_DISTANCE where nothing is watched

(L. Verlet, Phys. Rev. 159 (1967), section II). Every pair that touches is computed, and every other pair adds exactly
nothing. So a candidate's result does not depend on the other lanes. Moving bodies (`fit.cloth.driven`) may additionally
move m / 2, and (WATCHED - NEAR) / 2 before pairs are watched anew.

A kernel takes 64 arrays at most, so contact has three, each holding several things one after the other:
    whole      samples, quads, bodies, length of a list, where the vectors begin in `memory`, instants of the bodies'
               motion, 0 if they stand still; nodes of the samples, times 3; corners of the quads, times `SPOT`; who
               may meet, a bit per quad, a row of words per sample; then, per group, what it has listed: counts; marks
               of samples and quads; those that take part, samples from the front, quads from the end; pairs, those
               with bodies from the end; pairs that are watched
    memory     vectors of lanes, after the numbers of `alone`: `SPOT` per sample (place, velocity, force), `PANEL` per
               quad (`face_quad`), places of the nodes when pairs were last chosen, and watched; a gauge per group
    alone      the same memory number by number. At its front: weights of the samples' nodes; areas; reaches and
               windows of the quads; carried, friction, clearance, time between instants; per group the largest distance
               between layers, then the bodies, `BODY` each, then the bodies' way now and when pairs were last chosen
               and watched; the bodies' way and poses at every instant. What must be decided for all lanes at once is
               written as a vector and read here.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.lanes import magnitude, within

# m beyond contact; the watch list is rebuilt when a sample has moved by half of it. Our choice: it changes the time
# that lists take and no result. Half and double were not tried.
SEARCH_DISTANCE = 0.05
PAIR_DISTANCE = 0.005  # m, as above for the pair list; our choice: a tenth, so that few pairs are computed
# Times `PAIR_DISTANCE` that a sample may have moved against the plane of a quad, or along it. `beside` derives 5/4 for
# the point below, 1/2 for the sample, and the plane's turn. Half would miss contact; twice only lists more pairs.
MOVED = 2.5
SPOT, PANEL, BODY = 9, 30, 29  # numbers of a sample, a quad and a body: `Body.row`, then the rates of its pose
RADIUS, TAPER, RATE = 15, 16, 17  # of a body's numbers
CARRIED_AT, FRICTION_AT, CLEARANCE_AT, INSTANT, THICKNESS_AT = range(5)  # of the numbers behind those of the quads
WAY_NOW, WAY_CHOSEN, WAY_WATCHED, WAY_COUNT = range(4)  # of a group's ways; how many
POSE = 12  # numbers of a pose
CENTRE, NORMAL, FIRST, SECOND, SPEED, SPEED_1, SPEED_2, FORCE = 0, 3, 6, 9, 12, 15, 18, 21  # of a quad's numbers
MARKED, WATCHING, PAIRS, SPOTS, PANELS, BODIES = range(6)  # of the counts; MARKED: whether there are lists
LIST_COUNTS = 6  # how many of them
HEADER_SIZES = 6  # sizes at the front of `whole`
WORD = 32  # bits of an integer of Taichi
TINY_DIVISOR = 1e-20  # m^4 or m: added against division by zero


@ti.func
def least(alone: ti.template(), begin, lanes: ti.template()):
    """Return the minimum of the vector at `begin` by repeated halving, which is faster than a loop over lanes."""
    if ti.static(lanes == 1):
        return alone[begin]
    else:
        return ti.min(least(alone, begin, lanes // 2), least(alone, begin + lanes // 2, lanes // 2))


@ti.func
def has_moved(
    home, nodes, x: ti.template(), then, gauge, memory: ti.template(), alone: ti.template(), allowed,
    lanes: ti.template(),
):  # fmt: skip
    """Return whether a node of any lane has moved farther than allowed [m] from its position stored at `then`."""
    memory[gauge] = 0.0 * x[home]
    for i in range(nodes):
        j, k = within(home + 3 * i), within(then + 3 * i)
        d0, d1, d2 = x[j] - memory[k], x[j + 1] - memory[k + 1], x[j + 2] - memory[k + 2]
        memory[gauge] = ti.min(memory[gauge], 0.0 - (d0 * d0 + d1 * d1 + d2 * d2))
    return least(alone, gauge * lanes, lanes) < 0.0 - allowed * allowed


@ti.func
def remember(home, nodes, x: ti.template(), then, memory: ti.template()):
    """Store the positions of the nodes."""
    for i in range(3 * nodes):
        memory[then + i] = x[home + i]


@ti.func
def carry(home, at, s, y: ti.template(), whole: ti.template(), alone: ti.template(), memory: ti.template()):
    """Interpolate a nodal field at a sample, from the 16 nodes of its element."""
    i, h = within(home + whole[HEADER_SIZES + 16 * s]), alone[16 * s]
    s0, s1, s2 = h * y[i], h * y[i + 1], h * y[i + 2]
    for n in range(1, 16):
        w, j = alone[16 * s + n], within(home + whole[HEADER_SIZES + 16 * s + n])
        s0, s1, s2 = s0 + w * y[j], s1 + w * y[j + 1], s2 + w * y[j + 2]
    memory[at], memory[at + 1], memory[at + 2] = s0, s1, s2


@ti.func
def corners(q, first, samples, whole: ti.template()):
    """Return the positions of a quad's four corners."""
    at = HEADER_SIZES + 16 * samples + 4 * q
    return (
        within(first + whole[at]), within(first + whole[at + 1]), within(first + whole[at + 2]),
        within(first + whole[at + 3]),
    )  # fmt: skip


@ti.func
def apart(at, facing, memory: ti.template(), distance):
    """Return a sample's squared distance from a quad's centre, less the square of `distance`."""
    d0, d1, d2 = memory[at] - memory[facing], memory[at + 1] - memory[facing + 1], memory[at + 2] - memory[facing + 2]
    return d0 * d0 + d1 * d1 + d2 * d2 - distance * distance


@ti.func
def located(at, facing, memory: ti.template()):
    """Return a sample's gap above the plane of a quad, its xi_1 and xi_2, and its squared distance from the centre."""
    r0, r1, r2 = memory[at] - memory[facing], memory[at + 1] - memory[facing + 1], memory[at + 2] - memory[facing + 2]
    j, k, m = within(facing + NORMAL), within(facing + FIRST), within(facing + SECOND)
    return (
        r0 * memory[j] + r1 * memory[j + 1] + r2 * memory[j + 2],
        r0 * memory[k] + r1 * memory[k + 1] + r2 * memory[k + 2],
        r0 * memory[m] + r1 * memory[m + 1] + r2 * memory[m + 2], r0 * r0 + r1 * r1 + r2 * r2,
    )  # fmt: skip


@ti.func
def length(at, memory: ti.template()):
    """Return the length of a vector."""
    return ti.sqrt(memory[at] * memory[at] + memory[at + 1] * memory[at + 1] + memory[at + 2] * memory[at + 2])


@ti.func
def beside(at, facing, windows, memory: ti.template(), alone: ti.template(), thickness):
    """Return a number below 0 if a sample is, or soon could be, in the window of a quad and near its plane.

    Sample and corners each move by NEAR / 2 at most before the lists are rebuilt. With sum |h_k| <= 5/2 the point below
    the sample moves by 5/4 of NEAR, and the sample by 1/2. The plane turns by NEAR over a side.
    """
    gap, one, two, _ = located(at, facing, memory)
    more = MOVED * PAIR_DISTANCE
    first, second = more * length(facing + FIRST, memory), more * length(facing + SECOND, memory)
    out = ti.max(one - alone[windows + 2], 0.0 - one - alone[windows + 3]) - first
    out = ti.max(out, ti.max(two - alone[windows], 0.0 - two - alone[windows + 1]) - second)
    return ti.max(out, magnitude(gap) - (thickness + more))


@ti.func
def numbers_at(samples, count):
    """Return the index at which the numbers common to all of contact begin."""
    return 17 * samples + 5 * count


@ti.func
def bodies_at(samples, count, groups, bodies, b):
    """Return the index at which a group's bodies begin."""
    return numbers_at(samples, count) + THICKNESS_AT + groups + BODY * bodies * b


@ti.func
def ways_at(samples, count, groups, bodies, b):
    """Return the index at which a group's body displacements begin."""
    return bodies_at(samples, count, groups, bodies, groups) + WAY_COUNT * b


@ti.func
def in_body(at, body, memory: ti.template(), alone: ti.template()):
    """Return a sample's coordinates along a body's axes, from the body's centre [m]."""
    d0, d1, d2 = memory[at] - alone[body], memory[at + 1] - alone[body + 1], memory[at + 2] - alone[body + 2]
    p0 = alone[body + 3] * d0 + alone[body + 4] * d1 + alone[body + 5] * d2
    p1 = alone[body + 6] * d0 + alone[body + 7] * d1 + alone[body + 8] * d2
    p2 = alone[body + 9] * d0 + alone[body + 10] * d1 + alone[body + 11] * d2
    return p0, p1, p2


@ti.func
def body_distance(p0, p1, p2, body, alone: ti.template()):
    """Return the distance [m] between a body and a point along its axes, negative inside, and the outward direction."""
    q0, q1 = magnitude(p0) - alone[body + 12], magnitude(p1) - alone[body + 13]
    q2 = magnitude(p2) - alone[body + 14]
    o0, o1, o2 = ti.max(q0, 0.0), ti.max(q1, 0.0), ti.max(q2, 0.0)
    outside = ti.sqrt(o0 * o0 + o1 * o1 + o2 * o2)
    deepest = ti.max(q0, ti.max(q1, q2))
    # Outside, the direction points away from the nearest surface point; inside, towards the nearest side.
    zero = 0.0 * p0
    one = zero + 1.0
    g0 = ti.select(deepest < zero, ti.select(q0 >= deepest, one, zero), o0 / (outside + TINY_DIVISOR))
    g1 = ti.select(deepest < zero, ti.select(q1 >= deepest, one, zero), o1 / (outside + TINY_DIVISOR))
    g2 = ti.select(deepest < zero, ti.select(q2 >= deepest, one, zero), o2 / (outside + TINY_DIVISOR))
    g0, g1 = ti.select(p0 < zero, zero - g0, g0), ti.select(p1 < zero, zero - g1, g1)
    g2 = ti.select(p2 < zero, zero - g2, g2)
    taper, half = alone[body + TAPER], alone[body + 14]
    radius = alone[body + RADIUS] + taper * ti.min(ti.max(p2, zero - half), zero + half)
    g2 = g2 - ti.select(q2 < zero, zero + taper, zero)
    slant = 1.0 / ti.sqrt(1.0 + taper * taper)
    g0, g1, g2 = slant * g0, slant * g1, slant * g2
    n0 = alone[body + 3] * g0 + alone[body + 6] * g1 + alone[body + 9] * g2
    n1 = alone[body + 4] * g0 + alone[body + 7] * g1 + alone[body + 10] * g2
    n2 = alone[body + 5] * g0 + alone[body + 8] * g1 + alone[body + 11] * g2
    return slant * (outside + ti.min(deepest, 0.0) - radius), n0, n1, n2


@ti.func
def find_places(
    home, first, front, samples, count, x: ti.template(), whole: ti.template(), alone: ti.template(),
    memory: ti.template(),
):  # fmt: skip
    """Compute the positions of all samples, and the positions and normals of all quads."""
    for s in range(samples):
        carry(home, within(first + SPOT * s), s, x, whole, alone, memory)
    for q in range(count):
        face_quad(q, first, within(front + PANEL * q), samples, whole, memory)


@ti.func
def watch(
    mine, first, front, gauge, watched, standing, whole: ti.template(), memory: ti.template(),
    alone: ti.template(), thickness, clearance, lanes: ti.template(),
):  # fmt: skip
    """List pairs within `SEARCH_DISTANCE` of contact: sample times quads plus quad, after these those with bodies."""
    samples, count, bodies = whole[0], whole[1], whole[2]
    found = 0
    if thickness > 0.0:
        for s in range(samples):
            at = within(first + SPOT * s)
            for part in range((count + WORD - 1) // WORD):
                word = whole[HEADER_SIZES + 16 * samples + 4 * count + s * ((count + WORD - 1) // WORD) + part]
                end = ti.min(WORD, count - WORD * part)
                memory[gauge] = 0.0 * memory[at] + 1.0
                for n in range(end):
                    if (word >> n) & 1 == 1:
                        q = WORD * part + n
                        reach = alone[17 * samples + q] + thickness + SEARCH_DISTANCE
                        memory[gauge] = ti.min(memory[gauge], apart(at, within(front + PANEL * q), memory, reach))
                # Pairs are tested one by one only if any of them may be near in any lane.
                if least(alone, gauge * lanes, lanes) < 0.0:
                    for n in range(end):
                        if (word >> n) & 1 == 1:
                            q = WORD * part + n
                            reach = alone[17 * samples + q] + thickness + SEARCH_DISTANCE
                            memory[gauge] = apart(at, within(front + PANEL * q), memory, reach)
                            if least(alone, gauge * lanes, lanes) < 0.0:
                                whole[mine + watched + found] = s * count + q
                                found += 1
    for s in range(samples):
        for body in range(bodies):
            at_body = standing + BODY * body
            p0, p1, p2 = in_body(within(first + SPOT * s), at_body, memory, alone)
            far, _n0, _n1, _n2 = body_distance(p0, p1, p2, at_body, alone)
            memory[gauge] = far - (clearance + SEARCH_DISTANCE)
            if least(alone, gauge * lanes, lanes) < 0.0:
                whole[mine + watched + found] = samples * count + s * bodies + body
                found += 1
    whole[mine + WATCHING] = found


@ti.func
def choose(
    mine, first, front, gauge, watched, standing, whole: ti.template(), memory: ti.template(),
    alone: ti.template(), thickness, clearance, lanes: ti.template(),
):  # fmt: skip
    """List the watched pairs within `PAIR_DISTANCE` of contact, and mark their samples and quads."""
    samples, count, bodies, most = whole[0], whole[1], whole[2], whole[3]
    listed, pairs = LIST_COUNTS + samples + count, LIST_COUNTS + 2 * (samples + count)
    found, with_bodies, in_pairs, facing = 0, 0, 0, 0
    for n in range(samples + count):
        whole[mine + LIST_COUNTS + n] = 0
    for n in range(whole[mine + WATCHING]):
        code = whole[mine + watched + n]
        s, q, body = code // count, code % count, -1
        if code >= samples * count:
            s, body = (code - samples * count) // bodies, (code - samples * count) % bodies
            at_body = standing + BODY * body
            p0, p1, p2 = in_body(within(first + SPOT * s), at_body, memory, alone)
            far, _n0, _n1, _n2 = body_distance(p0, p1, p2, at_body, alone)
            memory[gauge] = far - (clearance + PAIR_DISTANCE)
        else:
            at, windows = within(first + SPOT * s), 17 * samples + count + 4 * q
            memory[gauge] = beside(at, within(front + PANEL * q), windows, memory, alone, thickness)
        if least(alone, gauge * lanes, lanes) < 0.0:
            whole[mine + LIST_COUNTS + s] = 1
            if body < 0:
                whole[mine + pairs + found] = code
                found += 1
                whole[mine + LIST_COUNTS + samples + q] = 1
                for k in range(4):
                    whole[mine + LIST_COUNTS + whole[HEADER_SIZES + 16 * samples + 4 * q + k] // SPOT] = 1
            else:
                with_bodies += 1
                whole[mine + pairs + most - with_bodies] = s * bodies + body
    for s in range(samples):
        if whole[mine + LIST_COUNTS + s] == 1:
            whole[mine + listed + in_pairs] = s
            in_pairs += 1
    for q in range(count):
        if whole[mine + LIST_COUNTS + samples + q] == 1:
            facing += 1
            whole[mine + listed + samples + count - facing] = q
    whole[mine + PAIRS], whole[mine + BODIES] = found, with_bodies
    whole[mine + SPOTS], whole[mine + PANELS] = in_pairs, facing


@ti.func
def face_quad(q, first, at, samples, whole: ti.template(), memory: ti.template()):
    """Compute a quad's centre, normal, dual tangents t^1 and t^2, and velocities; set its force to zero."""
    i, j, k, m = corners(q, first, samples, whole)
    for c in ti.static(range(3)):
        y0, y1, y2, y3 = memory[i + c], memory[j + c], memory[k + c], memory[m + c]
        memory[at + CENTRE + c] = 0.25 * (y0 + y1 + y2 + y3)
        memory[at + FIRST + c] = 0.5 * (y1 - y0 + y3 - y2)
        memory[at + SECOND + c] = 0.5 * (y2 - y0 + y3 - y1)
        v0, v1, v2, v3 = memory[i + 3 + c], memory[j + 3 + c], memory[k + 3 + c], memory[m + 3 + c]
        memory[at + SPEED + c] = 0.25 * (v0 + v1 + v2 + v3)
        memory[at + SPEED_1 + c] = 0.5 * (v1 - v0 + v3 - v2)
        memory[at + SPEED_2 + c] = 0.5 * (v2 - v0 + v3 - v1)
    p0, p1, p2 = memory[at + FIRST], memory[at + FIRST + 1], memory[at + FIRST + 2]
    r0, r1, r2 = memory[at + SECOND], memory[at + SECOND + 1], memory[at + SECOND + 2]
    n0, n1, n2 = p1 * r2 - p2 * r1, p2 * r0 - p0 * r2, p0 * r1 - p1 * r0
    square = n0 * n0 + n1 * n1 + n2 * n2 + TINY_DIVISOR
    # t^1 = t_2 x N / N.N and t^2 = N x t_1 / N.N with N = t_1 x t_2.
    memory[at + FIRST] = (r1 * n2 - r2 * n1) / square
    memory[at + FIRST + 1] = (r2 * n0 - r0 * n2) / square
    memory[at + FIRST + 2] = (r0 * n1 - r1 * n0) / square
    memory[at + SECOND] = (n1 * p2 - n2 * p1) / square
    memory[at + SECOND + 1] = (n2 * p0 - n0 * p2) / square
    memory[at + SECOND + 2] = (n0 * p1 - n1 * p0) / square
    size = ti.sqrt(square)
    memory[at + NORMAL], memory[at + NORMAL + 1], memory[at + NORMAL + 2] = n0 / size, n1 / size, n2 / size
    for c in ti.static(range(9)):
        memory[at + FORCE + c] = 0.0 * square


@ti.func
def find_pairs(
    b, mine, home, nodes, first, front, then, gauge, x: ti.template(), whole: ti.template(),
    memory: ti.template(), alone: ti.template(), groups, lanes: ti.template(),
):  # fmt: skip
    """Rebuild the lists if an unlisted pair may have come near since their last update."""
    samples, count, bodies, most = whole[0], whole[1], whole[2], whole[3]
    numbers, standing = numbers_at(samples, count), bodies_at(samples, count, groups, bodies, b)
    carried, clearance = alone[numbers + CARRIED_AT], alone[numbers + CLEARANCE_AT]
    thickness = alone[numbers + THICKNESS_AT + b]
    before, watched = then + 3 * nodes * groups, LIST_COUNTS + 2 * (samples + count) + most
    margin = PAIR_DISTANCE
    if whole[mine + WATCHING] == 0:
        margin = SEARCH_DISTANCE
    is_new = whole[mine + MARKED] == 0
    ways = ways_at(samples, count, groups, bodies, b)
    way = alone[ways + WAY_NOW]
    if way - alone[ways + WAY_CHOSEN] > 0.5 * margin:
        is_new = True
    if is_new or has_moved(home, nodes, x, then, gauge, memory, alone, margin / (2.0 * carried), lanes):
        alone[ways + WAY_CHOSEN] = way
        find_places(home, first, front, samples, count, x, whole, alone, memory)
        far = (SEARCH_DISTANCE - PAIR_DISTANCE) / (2.0 * carried)
        is_new = whole[mine + MARKED] == 0
        if way - alone[ways + WAY_WATCHED] > 0.5 * (SEARCH_DISTANCE - PAIR_DISTANCE):
            is_new = True
        if is_new or has_moved(home, nodes, x, before, gauge, memory, alone, far, lanes):
            alone[ways + WAY_WATCHED] = way
            watch(mine, first, front, gauge, watched, standing, whole, memory, alone, thickness, clearance, lanes)
            remember(home, nodes, x, before, memory)
        choose(mine, first, front, gauge, watched, standing, whole, memory, alone, thickness, clearance, lanes)
        remember(home, nodes, x, then, memory)
        whole[mine + MARKED] = 1

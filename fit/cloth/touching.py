"""Contact forces in the kernel, for candidates in SIMD lanes (law: `fit.cloth.contact`).

Positions, lists and memory are those of `fit.cloth.nearby`.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti

from fit.cloth.contact import CONTACT_DAMPING, CONTACT_OMEGA, WINDOW
from fit.cloth.driven import drive
from fit.cloth.lanes import magnitude, within
from fit.cloth.nearby import (
    BODIES,
    BODY,
    CLEARANCE_AT,
    FORCE,
    FRICTION_AT,
    HEADER_SIZES,
    LIST_COUNTS,
    NORMAL,
    PAIRS,
    PANEL,
    PANELS,
    RATE,
    SPEED,
    SPEED_1,
    SPEED_2,
    SPOT,
    SPOTS,
    WORD,
    bodies_at,
    body_distance,
    carry,
    corners,
    face_quad,
    find_pairs,
    in_body,
    located,
    numbers_at,
)  # fmt: skip

SHARPNESS = 1 / (2 * WINDOW - 1)  # slope of a window at a quad's edge


@ti.func
def traction(gap, side, n0, n1, n2, u0, u1, u2, distance, stiffness, viscosity, friction):
    """Return the force per area on cloth with velocity u at a gap along n; side: sign of the force along n."""
    overlap = ti.max(distance - gap, 0.0)
    grip = ti.min(4.0 * overlap / (distance + 1e-9), 1.0) * viscosity
    along = u0 * n0 + u1 * n1 + u2 * n2
    pressure = ti.max(stiffness * overlap - grip * side * along, 0.0)
    s0, s1, s2 = u0 - along * n0, u1 - along * n1, u2 - along * n2
    rub = ti.min(viscosity, friction * pressure / (ti.sqrt(s0 * s0 + s1 * s1 + s2 * s2) + 1e-9))
    push = pressure * side
    return push * n0 - rub * s0, push * n1 - rub * s1, push * n2 - rub * s2


@ti.func
def window(place, after, before):
    """Return 1 over a quad, falling to 0 about its edges."""
    return ti.min(ti.max(ti.min(after - place, before + place) * SHARPNESS, 0.0), 1.0)


@ti.func
def press(
    at, facing, share, reach, windows, alone: ti.template(), memory: ti.template(), distance, stiffness, viscosity,
    friction,
):  # fmt: skip
    """Add the contact forces between a sample and a quad; share: the sample's share of its area [m^2]."""
    gap, one, two, square = located(at, facing, memory)
    n0, n1, n2 = memory[facing + NORMAL], memory[facing + NORMAL + 1], memory[facing + NORMAL + 2]
    zero = 0.0 * gap
    felt = window(one, alone[windows + 2], alone[windows + 3]) * share
    felt = window(two, alone[windows], alone[windows + 1]) * felt
    felt = ti.select(square < zero + reach * reach, felt, zero)
    j, k, m = within(facing + SPEED), within(facing + SPEED_1), within(facing + SPEED_2)
    u0 = memory[at + 3] - (memory[j] + one * memory[k] + two * memory[m])
    u1 = memory[at + 4] - (memory[j + 1] + one * memory[k + 1] + two * memory[m + 1])
    u2 = memory[at + 5] - (memory[j + 2] + one * memory[k + 2] + two * memory[m + 2])
    side = ti.select(gap < zero, zero - 1.0, zero + 1.0)
    f0, f1, f2 = traction(magnitude(gap), side, n0, n1, n2, u0, u1, u2, distance, stiffness, viscosity, friction)
    f0, f1, f2 = felt * f0, felt * f1, felt * f2
    memory[at + 6], memory[at + 7], memory[at + 8] = memory[at + 6] + f0, memory[at + 7] + f1, memory[at + 8] + f2
    back = within(facing + FORCE)
    memory[back], memory[back + 1], memory[back + 2] = memory[back] - f0, memory[back + 1] - f1, memory[back + 2] - f2
    memory[back + 3] = memory[back + 3] - one * f0
    memory[back + 4] = memory[back + 4] - one * f1
    memory[back + 5] = memory[back + 5] - one * f2
    memory[back + 6] = memory[back + 6] - two * f0
    memory[back + 7] = memory[back + 7] - two * f1
    memory[back + 8] = memory[back + 8] - two * f2


@ti.func
def lean(
    at, body, area, memory: ti.template(), alone: ti.template(), clearance, stiffness, viscosity, friction
):  # fmt: skip
    """Add the contact force on a sample from a body, whose motion is prescribed."""
    p0, p1, p2 = in_body(at, body, memory, alone)
    gap, n0, n1, n2 = body_distance(p0, p1, p2, body, alone)
    rate = body + RATE
    u0 = memory[at + 3] - (alone[rate] + alone[rate + 3] * p0 + alone[rate + 6] * p1 + alone[rate + 9] * p2)
    u1 = memory[at + 4] - (alone[rate + 1] + alone[rate + 4] * p0 + alone[rate + 7] * p1 + alone[rate + 10] * p2)
    u2 = memory[at + 5] - (alone[rate + 2] + alone[rate + 5] * p0 + alone[rate + 8] * p1 + alone[rate + 11] * p2)
    f0, f1, f2 = traction(
        gap, 1.0, n0, n1, n2, u0, u1, u2, clearance, 2.0 * stiffness, 2.0 * viscosity, friction
    )  # fmt: skip
    memory[at + 6] = memory[at + 6] + area * f0
    memory[at + 7] = memory[at + 7] + area * f1
    memory[at + 8] = memory[at + 8] + area * f2


@ti.func
def give_corners(q, first, at, samples, whole: ti.template(), memory: ti.template()):
    """Distribute a quad's force to its corners: h_k = 1/4 +- xi_1 / 2 +- xi_2 / 2, summed over its samples."""
    i, j, k, m = corners(q, first + 6, samples, whole)
    for c in ti.static(range(3)):
        total = 0.25 * memory[at + FORCE + c]
        one, two = 0.5 * memory[at + FORCE + 3 + c], 0.5 * memory[at + FORCE + 6 + c]
        memory[i + c] = memory[i + c] + (total - one - two)
        memory[j + c] = memory[j + c] + (total + one - two)
        memory[k + c] = memory[k + c] + (total - one + two)
        memory[m + c] = memory[m + c] + (total + one + two)


@ti.func
def give_nodes(
    home, at, s, f: ti.template(), whole: ti.template(), alone: ti.template(), memory: ti.template()
):  # fmt: skip
    """Distribute a sample's force to the nodes of its element."""
    f0, f1, f2 = memory[at + 6], memory[at + 7], memory[at + 8]
    for n in range(16):
        w, i = alone[16 * s + n], within(home + whole[HEADER_SIZES + 16 * s + n])
        f[i], f[i + 1], f[i + 2] = f[i] + w * f0, f[i + 1] + w * f1, f[i + 2] + w * f2


@ti.func
def touching(
    b, home, nodes, groups, x: ti.template(), v: ti.template(), f: ti.template(), whole: ti.template(),
    memory: ti.template(), alone: ti.template(), distance, density, time, moving,
    lanes: ti.template(),
):  # fmt: skip
    """Add the forces of contact to those on the nodes, with bodies as at `time` [s]; moving: 0 for bodies at rest."""
    samples, count, bodies, most = whole[0], whole[1], whole[2], whole[3]
    first = whole[4] + SPOT * samples * b
    front = whole[4] + SPOT * samples * groups + PANEL * count * b
    then = whole[4] + (SPOT * samples + PANEL * count) * groups + 3 * nodes * b
    gauge = whole[4] + (SPOT * samples + PANEL * count + 6 * nodes) * groups + b
    mine = HEADER_SIZES + 16 * samples + 4 * count + samples * ((count + WORD - 1) // WORD)
    mine += b * (LIST_COUNTS + 2 * (samples + count + most))
    if whole[5] > 0:
        drive(b, groups, time, moving, whole, alone)
    find_pairs(b, mine, home, nodes, first, front, then, gauge, x, whole, memory, alone, groups, lanes)
    numbers, standing = numbers_at(samples, count), bodies_at(samples, count, groups, bodies, b)
    friction, clearance = alone[numbers + FRICTION_AT], alone[numbers + CLEARANCE_AT]
    listed, pairs = LIST_COUNTS + samples + count, LIST_COUNTS + 2 * (samples + count)
    stiffness, viscosity = 0.5 * CONTACT_OMEGA * CONTACT_OMEGA * density, CONTACT_DAMPING * CONTACT_OMEGA * density
    for n in range(whole[mine + SPOTS]):
        s = whole[mine + listed + n]
        at = within(first + SPOT * s)
        carry(home, at, s, x, whole, alone, memory)
        carry(home, at + 3, s, v, whole, alone, memory)
        for c in ti.static(range(3)):
            memory[at + 6 + c] = 0.0 * memory[at]
    for n in range(whole[mine + PANELS]):
        q = whole[mine + pairs - 1 - n]
        face_quad(q, first, within(front + PANEL * q), samples, whole, memory)
    for n in range(whole[mine + PAIRS]):
        code = whole[mine + pairs + n]
        s, q = code // count, code % count
        press(
            within(first + SPOT * s), within(front + PANEL * q), 0.5 * alone[16 * samples + s],
            alone[17 * samples + q], 17 * samples + count + 4 * q, alone, memory, distance, stiffness, viscosity,
            friction,
        )  # fmt: skip
    for n in range(whole[mine + BODIES]):
        code = whole[mine + pairs + most - 1 - n]
        s, body = code // bodies, code % bodies
        lean(
            within(first + SPOT * s), standing + BODY * body, alone[16 * samples + s], memory, alone, clearance,
            stiffness, viscosity, friction,
        )  # fmt: skip
    for n in range(whole[mine + PANELS]):
        q = whole[mine + pairs - 1 - n]
        give_corners(q, first, within(front + PANEL * q), samples, whole, memory)
    for n in range(whole[mine + SPOTS]):
        s = whole[mine + listed + n]
        give_nodes(home, within(first + SPOT * s), s, f, whole, alone, memory)

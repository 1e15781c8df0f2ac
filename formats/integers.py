"""Compress tables of integers: differences along rows, zigzag code, and a Rice code for each column.

    r_t = q_t - p_t for t >= 1,  where of order 1  p_t = q_(t-1),  of order 2  p_t = 2 q_(t-1) - q_(t-2),
    of order 3  p_t = q_(t-1) + floor((q_(t-1) - q_(t-3)) / 2);  rows before the first are like the first
    z = 2 r for r >= 0, -2 r - 1 else;   z = quotient 2^k + remainder

Each column has its own order and k; a constant column costs one byte. All blocks of a take are coded
in one pass, because a call of NumPy costs more than the thirty rows of a block. The bytes are
described in `formats/SPEC.md`.

Source of the code: R. F. Rice, "Some practical universal noiseless coding techniques",
JPL Publication 79-22, 1979, section 3.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from formats.arrays import Booleans, Integers

ESCAPE = 24  # the quotient that marks an exception, whose z is stored in eight bytes
LARGEST_K = 30  # bits of a remainder, `formats/SPEC.md`
ORDERS = (1, 2, 3)  # of the differences, see the module
LONG = 4096  # rows: longer tables, such as scans, decode faster column by column
FEW = 16  # numbers in a row of all blocks: narrower tables also decode faster column by column
HALF = 1 << 63  # beyond the largest 64-bit integer with a sign
CODE_BYTES = 5  # of a column: its code and its first value
MOST_BYTES_A_NUMBER = 16  # of a number: its exception in 8 bytes, k bits, and a quotient of 24 in 25 bits


def encode_tables(values: Integers, rows: Integers) -> list[bytes]:
    """Return the bytes of each block of a table.

    - values: (sum of rows, columns), each below 2^31 in magnitude, since a block's first values have 32 bits
    - rows, (blocks,): number of rows of each block
    """
    starts = np.cumsum(rows) - rows
    first = values[starts]
    is_residual = np.ones(len(values), bool)
    is_residual[starts] = False
    active = np.flatnonzero((values != np.repeat(first, rows, axis=0)).any(0))  # the others are constant everywhere
    moving = values[:, active]
    row = np.arange(len(values))
    before = [moving[np.maximum(row - back, np.repeat(starts, rows))] for back in (1, 2, 3)]
    residuals = [moving - _predicted(order, *before) for order in ORDERS]
    sums = np.stack([np.add.reduceat(np.abs(residual), starts, axis=0) for residual in residuals])
    chosen = sums.argmin(0)
    residual = np.choose(np.repeat(chosen, rows, axis=0), residuals)
    z = (residual << 1) ^ (residual >> 63)
    is_coded = np.maximum.reduceat(z, starts, axis=0) > 0
    k = _best_k(z, starts, rows)
    codes = np.zeros(first.shape, np.uint8)
    codes[:, active] = np.where(is_coded, 32 * (chosen + 1) + k, 0)

    coded_at = np.repeat(is_coded, rows, axis=0) & is_residual[:, None]
    z, k_of = z[coded_at], np.repeat(k, rows, axis=0)[coded_at]
    counts = is_coded.sum(1) * (rows - 1)
    ends = np.cumsum(counts)
    quotient = np.minimum(z >> k_of, ESCAPE)
    is_exception = quotient == ESCAPE
    remainders, remainder_ends = _packed_remainders(z, k_of, ends, counts)
    unary, unary_ends = _packed_unary(quotient, ends, counts)
    exceptions = z[is_exception].astype("<i8").tobytes()
    exception_ends = np.concatenate([[0], np.cumsum(is_exception)])[ends]
    zigzag = ((first << 1) ^ (first >> 63)).astype("<u4")
    planes = np.ascontiguousarray(zigzag).view(np.uint8).reshape(len(rows), -1, 4).transpose(0, 2, 1)

    coded = []
    done = np.zeros(3, np.int64)
    for b, after in enumerate(np.stack([remainder_ends, exception_ends, unary_ends], 1)):
        coded.append(
            codes[b].tobytes()
            + planes[b].tobytes()
            + int(after[1] - done[1]).to_bytes(4, "little")
            + remainders[done[0] : after[0]]
            + exceptions[8 * done[1] : 8 * after[1]]
            + unary[done[2] : after[2]]
        )
        done = after
    return coded


def _predicted(order: int | Integers, one: Integers, two: Integers, three: Integers) -> Integers:
    """Return the row that the three before it predict."""
    if isinstance(order, int):
        return one if order == 1 else 2 * one - two if order == 2 else one + (one - three >> 1)
    return np.where(order == 1, one, np.where(order == 2, 2 * one - two, one + (one - three >> 1)))


def _best_k(z: Integers, starts: Integers, rows: Integers) -> Integers:
    """Return the best k of each block's columns, (blocks, columns), among the three near the mean length in bits."""
    length = np.add.reduceat(np.log2(z + 1), starts, axis=0) / np.maximum(rows - 1, 1)[:, None]
    near = np.clip(length.astype(np.int64), 1, LARGEST_K - 1)
    best, least = near, np.full(near.shape, np.iinfo(np.int64).max)
    for k in (near - 1, near, near + 1):
        quotient = z >> np.repeat(k, rows, axis=0)
        bits = np.where(quotient < ESCAPE, quotient, ESCAPE + 64)
        cost = np.add.reduceat(bits, starts, axis=0) + k * (rows - 1)[:, None]
        best, least = np.where(cost < least, k, best), np.minimum(cost, least)
    return np.asarray(best)


def _packed_remainders(z: Integers, k: Integers, ends: Integers, counts: Integers) -> tuple[bytes, Integers]:
    """Pack the lowest k bits of each z, and return the byte offset of each block's end.

    Each block begins at a byte boundary.
    """
    bit_ends = np.concatenate([[0], np.cumsum(k)])
    offset, byte_ends = _aligned(bit_ends[ends] - bit_ends[ends - counts])
    at = bit_ends[:-1] + np.repeat(offset - bit_ends[ends - counts], counts)
    rest = (z & ((1 << k) - 1)) << (at & 7)
    size, byte = int(byte_ends[-1]), at >> 3
    packed = np.zeros(size + 8, np.uint8)
    while rest.any():
        # No two remainders share a bit, so that a byte is the sum of its parts.
        packed += np.bincount(byte, rest & 255, size + 8).astype(np.uint8)
        rest, byte = rest >> 8, byte + 1
    return packed[:size].tobytes(), byte_ends


def _packed_unary(quotient: Integers, ends: Integers, counts: Integers) -> tuple[bytes, Integers]:
    """Pack each quotient as that many zeros and a one, each block from a byte boundary on."""
    bit_ends = np.concatenate([[0], np.cumsum(quotient + 1)])
    offset, byte_ends = _aligned(bit_ends[ends] - bit_ends[ends - counts])
    ones = bit_ends[1:] - 1 + np.repeat(offset - bit_ends[ends - counts], counts)
    bits = np.zeros(8 * int(byte_ends[-1]), np.uint8)
    bits[ones] = 1
    return np.packbits(bits, bitorder="little").tobytes(), byte_ends


def _aligned(bits: Integers) -> tuple[Integers, Integers]:
    """Return each block's first bit and last byte, where every block begins at a byte boundary."""
    byte_ends = np.cumsum(-(-bits // 8))
    return 8 * np.concatenate([[0], byte_ends[:-1]]), byte_ends


def decode_tables(coded: Sequence[bytes], rows: Integers, columns: int) -> tuple[Integers, Booleans]:
    """Return the tables of the sound blocks, (sum of their rows, columns), and which blocks are sound.

    A malformed block is left out. The memory allocated is at most a small multiple of the given bytes and of rows x
    columns.
    """
    beyond = np.array([len(raw) for raw in coded]) - (CODE_BYTES * columns + 4)
    sound = (beyond >= 0) & (beyond <= MOST_BYTES_A_NUMBER * columns * rows) & (rows > 0)
    while True:
        kept = [raw for raw, good in zip(coded, sound, strict=True) if good]
        if not kept:
            return np.zeros((0, columns), np.int64), sound
        values, good = _decoded(kept, rows[sound], columns)
        if good.all():
            return values, sound
        sound[np.flatnonzero(sound)[~good]] = False


def _decoded(coded: list[bytes], rows: Integers, columns: int) -> tuple[Integers, Booleans]:
    """Decode blocks in one pass; if some are malformed, return only which ones."""
    raw = np.frombuffer(b"".join([*coded, bytes(8)]), np.uint8)
    sizes = np.array([len(one) for one in coded])
    begins = np.cumsum(sizes) - sizes
    head = raw[begins[:, None] + np.arange(CODE_BYTES * columns + 4)]
    codes = head[:, :columns].astype(np.int64)
    order, k = codes >> 5, codes & 31
    is_coded = codes > 0
    planes = head[:, columns : CODE_BYTES * columns].reshape(len(coded), 4, columns).transpose(0, 2, 1)
    zigzag = np.ascontiguousarray(planes).view("<u4")[..., 0].astype(np.int64)
    first = (zigzag >> 1) ^ -(zigzag & 1)
    exceptions = np.ascontiguousarray(head[:, CODE_BYTES * columns :]).view("<u4")[:, 0].astype(np.int64)
    counts = is_coded.sum(1) * (rows - 1)
    remainder_at = begins + CODE_BYTES * columns + 4
    exception_at = remainder_at + -(-(np.where(is_coded, k, 0).sum(1) * (rows - 1)) // 8)
    unary_at = exception_at + 8 * exceptions
    ends = begins + sizes
    # Each value has 1 to 25 bits, so a block cannot have more values than bits.
    good = (unary_at + -(-counts // 8) <= ends) & (ends <= unary_at + -(-(ESCAPE + 1) * counts // 8))
    good &= (((order > 0) | ~is_coded) & (order <= ORDERS[-1])).all(1)
    if not good.all():
        return first, good

    sections = [raw[a:b] for a, b in zip(unary_at, ends, strict=True)]
    bits = np.unpackbits(np.concatenate(sections), bitorder="little")
    bit_ends = 8 * np.cumsum(ends - unary_at)
    ones = np.flatnonzero(bits)
    value_ends = np.searchsorted(ones, bit_ends)
    good = np.diff(value_ends, prepend=0) == counts
    if not good.all():
        return first, good
    quotient = np.diff(ones, prepend=-1) - 1
    has_values = counts > 0
    firsts = (value_ends - counts)[has_values]
    quotient[firsts] = ones[firsts] - (bit_ends - 8 * (ends - unary_at))[has_values]

    is_exception = quotient == ESCAPE
    found = np.diff(np.concatenate([[0], np.cumsum(is_exception)])[value_ends], prepend=0)
    good = found == exceptions
    if not good.all() or (quotient > ESCAPE).any():
        too_large = np.concatenate([[0], np.cumsum(quotient > ESCAPE)])[value_ends]
        return first, good & (np.diff(too_large, prepend=0) == 0)

    active = np.flatnonzero(is_coded.any(0))
    is_coded, k, order = is_coded[:, active], k[:, active], order[:, active]
    per_row = np.where(is_coded, k, 0)
    within = np.cumsum(per_row, axis=1) - per_row
    starts = np.cumsum(rows) - rows
    row_in_block = np.arange(rows.sum()) - np.repeat(starts, rows)
    row_bit = np.repeat(8 * remainder_at, rows) + (row_in_block - 1) * np.repeat(per_row.sum(1), rows)
    coded_at = np.repeat(is_coded, rows, axis=0) & (row_in_block > 0)[:, None]
    bit = (row_bit[:, None] + np.repeat(within, rows, axis=0))[coded_at]
    k_of = np.repeat(k, rows, axis=0)[coded_at]
    windows = np.ndarray((len(raw) - 7,), "<i8", raw, strides=(1,))
    z = quotient << k_of | windows[bit >> 3] >> (bit & 7) & (1 << k_of) - 1
    if is_exception.any():
        z[is_exception] = np.concatenate([raw[a:b] for a, b in zip(exception_at, unary_at, strict=True)]).view("<i8")
    residual = np.zeros(coded_at.shape, np.int64)
    residual[coded_at] = (z >> 1) ^ -(z & 1)
    table = np.repeat(first, rows, axis=0)
    table[:, active] = _summed(residual, first[:, active], order, rows)
    return table, np.ones(len(coded), bool)


def _summed(residual: Integers, first: Integers, order: Integers, rows: Integers) -> Integers:
    """Undo the prediction row by row, in all blocks and columns at once, or column by column where that is faster."""
    if not residual.size:
        return residual
    starts = np.cumsum(rows) - rows
    if residual.size < FEW * rows.max() or (len(rows) == 1 and rows[0] > LONG):
        for start, count, *of_block in zip(starts, rows, first, order, strict=True):
            part = residual[start : start + count]
            part[:] = np.column_stack([_column(*one) for one in zip(part.T, *of_block, strict=True)])
        return residual
    residual[starts] = first
    longest_first = np.argsort(-rows)
    starts, order, rows = starts[longest_first], order[longest_first], rows[longest_first]
    for t in range(1, int(rows.max())):
        count = int(np.searchsorted(-rows, -t))  # blocks that have a row t
        at, start = starts[:count] + t, starts[:count]
        before = (residual[np.maximum(at - back, start)] for back in (1, 2, 3))
        residual[at] += _predicted(order[:count], *before)
    return residual


def _column(residual: Integers, first: int, order: int) -> Integers:
    """Undo the prediction in one column, as `_summed` does.

    A sum beyond 64 bits, which no writer makes, wraps round.
    """
    residual = residual.copy()
    if order != ORDERS[-1]:
        residual[0] = first if order == 1 else 0
        for _ in range(order):
            residual = np.cumsum(residual)
        return residual if order == 1 else residual + first
    one = two = three = int(first)
    values = [one]
    for rest in residual[1:].tolist():
        one, two, three = rest + one + (one - three >> 1), one, two
        if not -HALF <= one < HALF:
            one = (one + HALF) % (2 * HALF) - HALF
        values.append(one)
    return np.array(values, np.int64)

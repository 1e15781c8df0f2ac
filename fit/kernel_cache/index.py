"""Reading of the index of Taichi's compiled kernels, which Taichi 1.7.4 trusts without a check."""

from __future__ import annotations

import struct

INDEX, TAICHI_LOCK = "ticache.tcb", "ticache.lock"  # Taichi's names for files of its cache
INDEX_VERSION = (1, 7, 4)  # of Taichi, whose index `sizes_of_kernels` knows
# bytes; our choice: Taichi keeps at most 100 MiB of kernels. The smallest of 110 measured ones has 13 kB, so that an
# index with entries of 170 bytes reaches 1.4 MB. An index of this limit is checked in 1.1 s (measured), which one of
# twice the size would double.
LARGEST_INDEX = 1 << 26


def sizes_of_kernels(held: bytes) -> dict[str, int] | None:
    """Return the sizes of compiled kernels [bytes] by name, from the bytes of their index; None if it is damaged.

    - header: length of the file, version of Taichi, size of all kernels, number of entries
    - entry: the kernel's name twice, each after its length, then the size of its file and two dates

    Taichi itself discards the index of another version, which gives no sizes here.
    """
    header = struct.Struct("<q3HQQ")
    if len(held) < header.size:
        return None
    length, *version, _, count = header.unpack_from(held)
    if tuple(version) != INDEX_VERSION:
        return {}
    sizes: dict[str, int] = {}
    at = header.size
    for _ in range(min(count, len(held))):
        names = []
        for _ in range(2):
            end = at + 8 + int.from_bytes(held[at : at + 8], "little")
            names.append(held[at + 8 : end])
            if end > len(held):
                return None
            at = end
        if names[0] != names[1] or not names[0].isalnum():
            return None
        sizes[names[0].decode()] = int.from_bytes(held[at : at + 8], "little")
        at += 24
    return sizes if at == length == len(held) else None

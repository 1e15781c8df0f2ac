"""Limit the memory that decoding the tables of one file may take. See `formats/SPEC.md`."""

from __future__ import annotations

from dataclasses import dataclass

CELL_BYTES = 8  # memory of a decoded number
# Bytes of memory: for a table, and for each of its bytes of the file. A second of 66 points, 30 frames, has 2^17.
STILL_TABLE, MEMORY_PER_BYTE = 1 << 17, 64
# Bytes for all tables of a file beyond that, since tables without motion have more numbers than bytes. At 30 frames a
# second, 81 unseen markers take this memory in 1.6 hours, 500 in 2.6 minutes, 2000 in 36 seconds.
FREE_MEMORY = 1 << 27

NUMBERS_AT_ONCE = 1 << 20  # numbers decoded together: each takes 70 bytes meanwhile


@dataclass
class TableMemory:
    """The memory budget [bytes] left for a file's tables, beyond the share of each."""

    left: int = FREE_MEMORY
    left_out: int = 0  # tables that would fit in the budget alone

    def fits(self, numbers: int, own: int, may_rest: bool = True) -> bool:
        """Reserve the memory of a table with `numbers` numbers and `own` bytes in the file; return whether it fits.

        A table that is too large to be decoded with others takes nothing from the budget beyond its share.

        may_rest: whether the table may hold a second without motion, which has extra memory
        """
        beyond = max(CELL_BYTES * numbers - STILL_TABLE * may_rest - MEMORY_PER_BYTE * own, 0)
        if beyond > (0 if numbers > NUMBERS_AT_ONCE else self.left):
            self.left_out += beyond <= FREE_MEMORY
            return False
        self.left -= beyond
        return True

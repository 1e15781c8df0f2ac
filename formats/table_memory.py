"""The memory that the tables of one file may take while they are read. See `formats/SPEC.md`."""

from __future__ import annotations

from dataclasses import dataclass

CELL_BYTES = 8  # of memory that a number of a table takes once it is read
# Bytes of memory: for a table, and for each of its bytes of the file. A second of 66 points, 30 frames, has 2^17.
STILL_TABLE, MEMORY = 1 << 17, 64
# Bytes for the tables of a file that need more: still ones have more numbers than bytes. 81 markers that nobody sees
# for 1.6 hours, 30 frames a second, take so much; 500 take it in 2.6 minutes, 2000 in 36 seconds.
FREE_MEMORY = 1 << 27

AT_ONCE = 1 << 20  # numbers of tables that are decoded together: each takes 70 bytes meanwhile


@dataclass
class TableMemory:
    """The bytes that a file's tables may still take beyond their shares."""

    left: int = FREE_MEMORY
    left_out: int = 0  # tables for which a file without the others has memory

    def fits(self, numbers: int, own: int, may_rest: bool = True) -> bool:
        """Set aside the memory of a table of so many numbers that takes so many bytes of the file.

        A table that is too large to be decoded with others takes none beyond its bytes.

        may_rest: whether it may hold a second in which nothing moves, and has memory of its own for that
        """
        beyond = max(CELL_BYTES * numbers - STILL_TABLE * may_rest - MEMORY * own, 0)
        if beyond > (0 if numbers > AT_ONCE else self.left):
            self.left_out += beyond <= FREE_MEMORY
            return False
        self.left -= beyond
        return True

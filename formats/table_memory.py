"""The memory that the tables of one file may take while they are read. See `formats/SPEC.md`."""

from __future__ import annotations

from dataclasses import dataclass

CELL_BYTES = 8  # of memory that a number of a table takes once it is read
STILL_TABLE, MEMORY = 1 << 16, 64  # bytes of memory: for a table, and for each of its bytes of the file
# Bytes for the tables of a file that need more: still ones have more numbers than bytes. 81 markers that nobody sees
# for 25 minutes, 30 frames a second, take so much. The memory of reading is then 70 MB beyond the take's own arrays.
FREE_MEMORY = 1 << 27


@dataclass
class TableMemory:
    """The bytes that a file's tables may still take beyond their shares."""

    left: int = FREE_MEMORY
    left_out: int = 0  # tables for which a file without the others has memory

    def fits(self, numbers: int, own: int) -> bool:
        """Set aside the memory of a table of so many numbers that takes so many bytes of the file."""
        beyond = max(CELL_BYTES * numbers - STILL_TABLE - MEMORY * own, 0)
        if beyond > self.left:
            self.left_out += beyond <= FREE_MEMORY
            return False
        self.left -= beyond
        return True

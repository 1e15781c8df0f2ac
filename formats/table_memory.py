"""The memory that the tables of one file may take while they are read. See `formats/SPEC.md`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

CELL_BYTES = 24  # of memory that a number of a table takes while it is read
FREE_MEMORY, MEMORY, STILL_TABLE = 1 << 26, 160, 1 << 17  # bytes: for a file, each of its bytes, block or scan


@dataclass
class TableMemory:
    """The bytes that a file's tables may still take."""

    left: int

    @classmethod
    def of(cls, file_bytes: int) -> Self:
        """Return the memory that a file of so many bytes may take."""
        return cls(FREE_MEMORY + MEMORY * file_bytes)

    def fits(self, numbers: int) -> bool:
        """Set aside the memory of a table: a still one has far more numbers than bytes, few more than STILL_TABLE."""
        self.left -= max(CELL_BYTES * numbers - STILL_TABLE, 0)
        return self.left > 0

"""Read and write take archives: one recording in one MCAP file that survives power cuts and flipped bits.

`formats/SPEC.md` specifies the format.
"""

from __future__ import annotations

from formats.take_reader import read_take, read_with_report, take_of, verify_take
from formats.take_report import TakeReport
from formats.take_writer import TakeWriter, write_take

__all__ = ["TakeReport", "TakeWriter", "read_take", "read_with_report", "take_of", "verify_take", "write_take"]

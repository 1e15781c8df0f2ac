"""Read a C3D file with ezc3d in a process of its own, so that a crash of the library ends only this process.

Run: python -m formats.importers.c3d_process FILE SIZE. Prints an .npz of what the file holds; on an error nothing, exit
code 3. `formats.importers.c3d_file` runs it.
"""

from __future__ import annotations

import io
import resource
import sys
from typing import Any

import numpy as np

BASE_MEMORY = 1 << 30  # bytes, and some for each of the file's
PER_BYTE = 64
CPU_SECONDS = 60
REFUSED = 3  # exit code


def main() -> None:
    """Read the file named on the command line."""
    path, size = sys.argv[1], int(sys.argv[2])
    limit = BASE_MEMORY + PER_BYTE * size
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import ezc3d

    try:
        content = _content(ezc3d.c3d(path))
    except Exception:  # ezc3d's own words are for its developers
        sys.exit(REFUSED)
    stream = io.BytesIO()
    np.savez(stream, **content)
    sys.stdout.buffer.write(stream.getvalue())


def _content(file: Any) -> dict[str, Any]:
    """Return labels, units, rate, positions, (frames, points, 3), and residuals as the file has them."""
    points = file["parameters"]["POINT"]
    labels: list[str] = []
    for name in ("LABELS", *(f"LABELS{k}" for k in range(2, 10))):
        labels += [str(label).strip() for label in points[name]["value"]] if name in points else []
    units = [str(unit).strip() for unit in points["UNITS"]["value"]] if "UNITS" in points else []
    rates = np.ravel(points["RATE"]["value"] if "RATE" in points else [])
    values = np.asarray(file["data"]["points"][:3], float)
    return {
        "labels": np.array(labels, np.str_),
        "units": np.array(units, np.str_),
        "rate": float(rates[0]) if len(rates) else 0.0,
        "positions": np.moveaxis(values, 0, -1).swapaxes(0, 1),
        "residuals": np.asarray(file["data"]["meta_points"]["residuals"][0], float).T,
        "stated": _stated_frames(file["parameters"]),
    }


def _stated_frames(parameters: Any) -> int:
    """Return the number of frames by parameters that count further than the header's 16 bits, 0 where there are none.

    ezc3d sets POINT:FRAMES to what it read. Source: the C3D file format, user guide: TRIAL:ACTUAL_START_FIELD and
    ACTUAL_END_FIELD hold two words of 16 bits, the lower first; POINT:LONG_FRAMES is a float.
    """

    def numbers(group: str, name: str) -> list[float]:
        found = parameters[group][name]["value"] if group in parameters and name in parameters[group] else []
        return [float(number) for number in np.ravel(found) if np.isfinite(number)]

    begin, end = (numbers("TRIAL", f"ACTUAL_{which}_FIELD") for which in ("START", "END"))
    if len(begin) == len(end) == 2:
        first, last = (int(low) % 65536 + 65536 * (int(high) % 65536) for low, high in (begin, end))
        return max(last - first + 1, 0)
    return max(int(next(iter(numbers("POINT", "LONG_FRAMES")), 0)), 0)


if __name__ == "__main__":
    main()

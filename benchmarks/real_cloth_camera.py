"""Print a camera's faults in real recordings of swung cloth, of all takes together and take by take.

    benchmarks/real_cloth_camera.py FOLDER

FOLDER holds the `.npz` recordings (docs/notebook/real-cloth.md). The first lines are the findings of a fit to all takes
(`fit.recordings.camera_findings`). The table has a line for each take:

- `lengths`: common change of the lengths between neighbours (`fit.recordings.point_kind`)
- `row`: offset of the held row across the cloth while the hanger moves (`fit.recordings.frame_offsets`)
- `left`: error of the held row after all corrections (`fit.recordings.row_and_rest`)
- `pose`: loss of the bottom border per unit of lean (`fit.recordings.outline`)
- `scale`: scale of the row's travel against that of the path, less 1 (`fit.recordings.timing`)
- `lean`: of the cloth at rest (`fit.recordings.row_and_rest`)

A missing value was not certain, or was not seen. The last line is the scale of all takes. Nothing is simulated.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from fit.recordings.camera_findings import describe_camera, scale_together
from fit.recordings.point_kind import kind_shown
from fit.recordings.recording import Recording, prepare
from formats.importers.swung_cloth import import_swung_cloth

COLUMNS = ("lengths, %", "row, mm", "left, mm", "pose, mm", "scale, %", "lean, degrees")


def figures_of(recording: Recording) -> list[float | None]:
    """Return the figures of one take, in the order and the units of `COLUMNS`."""
    camera, kind = recording.camera, kind_shown(recording)
    outline, timing = camera.outline, camera.timing
    return [
        None if kind is None else 100 * kind[1],
        None if camera.offsets is None else 1e3 * camera.offsets.rms,
        1e3 * camera.row_off,
        None if outline is None or outline.by_pose is None else 1e3 * outline.by_pose,
        None if timing is None or timing.scale_interval is None else 100 * timing.scale,
        None if camera.lean is None else float(np.degrees(camera.lean.angle)),
    ]


def main(folder: Path) -> None:
    """Print the findings, and a line for each take."""
    recordings = [prepare(import_swung_cloth(path)) for path in sorted(folder.glob("*.npz"))]
    for finding in describe_camera(recordings):
        print(finding.sentence)
    print(f"\n{'':16s} " + " ".join(f"{name:>13s}" for name in COLUMNS))
    for recording in recordings:
        cells = ["" if figure is None else f"{figure:.1f}" for figure in figures_of(recording)]
        print(f"{recording.take_id:16s} " + " ".join(f"{cell:>13s}" for cell in cells))
    figure, (low, high) = scale_together(recordings)
    print(f"\nscale of all takes: {100 * figure:.1f} % [{100 * low:.1f} to {100 * high:.1f}]")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

"""The rig and the garment description of a towel on a hanger."""

from __future__ import annotations

from formats.garment import Garment, TrackedPoint
from formats.rig import Hanger

HANGER = Hanger(
    dictionary="DICT_4X4_50", ids=(0, 1), marker_size_m=0.06, marker_distance_m=0.3,
    held_m=((-0.2, 0.09, 0.0), (0.2, 0.09, 0.0)),
)  # fmt: skip
OUTLINE = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4))
GARMENT = Garment(
    format="hangtime-garment/1", name="towel", kind="swatch", mass_kg=0.05, outline_m=OUTLINE, held="edge",
    points=tuple(TrackedPoint(name=f"p{k}", at_m=p) for k, p in enumerate(OUTLINE)),
)  # fmt: skip

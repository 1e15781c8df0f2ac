"""Measure tracking against the synthetic world's truth: errors, occlusion, and time per frame.

Run: python benchmarks/tracking.py [--set report-5] [--keep FOLDER] [--by garment]. The scenes are those of
`benchmarks/tracking_scenes.py`. Every figure is stated with its spread over the scenes (quartiles).

Points    error [m] of a point that is visible and was located. Centre also as a share of the garment's width.
Constant  the part of a point's error that is the same in all frames of a scene, root mean square per axis. Hidden
precision: share of truly hidden points among those reported hidden; recall: share reported. Both twice:
          clear   as in `firmware_host.synthetic.visibility`; points neither visible nor hidden do not count
          strict  a point is visible if the camera's ray meets it, however little of the cloth around it shows, and in
                  the projector's shadow too; all others are hidden; none is left out
z         (position - truth) / stated sd, per axis; its standard deviation over all points and axes.
Time      CPU time of the whole processing of a frame up to the take, one core, without rendering.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.tracking_scenes import SEEDS, Scene, Shown, ShownSensor, scenes, show
from capture.recording.session import record
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.motion import START
from firmware_host.synthetic.scene import RIG
from firmware_host.synthetic.visibility import PointSight
from formats.archive import read_take

OTHER_SHARES = (0.0, 0.1, 0.5)  # shares from which cloth counts as clearly visible, for alternative values of precision
SWAPPED = 0.1  # m: a marker with a larger error is the other one or none


@dataclass(frozen=True)
class Measured:
    """The results of one scene: arrays per frame and point; errors and z in 3D and per axis, NaN without a position.

    constant [m], (points, 3): mean errors of visible points over the scene's frames
    """

    scene: Scene
    sight: PointSight
    hidden: np.ndarray
    error: np.ndarray
    z: np.ndarray
    constant: np.ndarray
    markers: np.ndarray
    moving: np.ndarray
    width: float
    milliseconds: float

    @property
    def visible(self) -> np.ndarray:
        """Return which points the camera's ray meets."""
        return self.sight.in_view

    @property
    def ambiguous(self) -> np.ndarray:
        """Return which points are neither clearly visible nor clearly hidden."""
        return ~self.sight.visible & ~self.sight.hidden


def measure(shown: Shown) -> Measured:
    """Track one scene."""
    garment = GARMENTS[shown.scene.garment]()
    hidden, valid = [], []

    def watch(frame, hanger, cloth) -> None:
        hidden.append(cloth.hidden)
        valid.append(cloth.valid)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "t.mcap"
        start = time.process_time()
        record(ShownSensor(shown), RIG, garment, path, take_id="t", created="now", watch=watch)
        spent = time.process_time() - start
        take = read_take(path)
    apart = take.points - shown.points
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a point that is never visible has no mean
        constant = np.nanmean(np.where(shown.sight.in_view[..., None], apart, np.nan), axis=0)
    return Measured(
        scene=shown.scene,
        sight=shown.sight,
        hidden=np.array(hidden),
        error=np.linalg.norm(apart, axis=-1),
        z=apart / np.where(take.points_valid[..., None], take.points_sd, np.nan),
        constant=constant,
        markers=np.linalg.norm(take.markers - shown.markers, axis=-1),
        moving=shown.time >= START,
        width=float(np.ptp([x for x, _ in garment.outline_m])),
        milliseconds=1e3 * spent / len(shown.time),
    )


def figures(found: list[Measured]) -> dict[str, tuple[float | None, float, np.ndarray]]:
    """Return every figure's target, its value over all scenes, and its values scene by scene."""

    def corners(m: Measured) -> np.ndarray:
        return 1e3 * m.error[:, :4][m.visible[:, :4]]

    def centre(m: Measured) -> np.ndarray:
        return 1e3 * m.error[:, 4][m.visible[:, 4]]

    def markers(m: Measured, moving: bool) -> np.ndarray:
        return 1e6 * m.markers[m.moving == moving] ** 2

    def pooled(pick, reduce) -> tuple[float, np.ndarray]:
        def known(values: np.ndarray) -> float:
            return reduce(values) if np.isfinite(values).any() else np.nan

        parts = [pick(m) for m in found]
        return known(np.concatenate(parts)), np.array([known(p) for p in parts])

    def rms(squares: np.ndarray) -> float:
        return float(np.sqrt(np.nanmean(squares)))

    def share(pick_some, pick_all) -> tuple[float, np.ndarray]:
        some = np.array([np.count_nonzero(pick_some(m)) for m in found], float)
        of = np.array([np.count_nonzero(pick_all(m)) for m in found], float)
        with np.errstate(invalid="ignore", divide="ignore"):
            return 100 * some.sum() / max(of.sum(), 1), (100 * some / of)[of >= 10]

    def every(m: Measured) -> np.ndarray:
        return np.ones_like(m.visible)

    def z(m: Measured) -> np.ndarray:
        return np.where(m.visible[..., None], m.z, np.nan)

    def deviation(values: np.ndarray) -> float:
        return float(np.nanstd(values))

    return {
        "corners, median [mm]": (8.0, *pooled(corners, np.nanmedian)),
        "corners, 95 % [mm]": (None, *pooled(corners, lambda e: np.nanpercentile(e, 95))),
        "centre, mean [mm]": (9.0, *pooled(centre, np.nanmean)),
        "centre, mean [% of width]": (2.0, *pooled(lambda m: centre(m) / (10 * m.width), np.nanmean)),
        "constant part, held corners [mm]": (
            None, *pooled(lambda m: 1e6 * m.constant[:2].ravel() ** 2, rms)),
        "constant part, other points [mm]": (
            None, *pooled(lambda m: 1e6 * m.constant[2:].ravel() ** 2, rms)),
        "corners visible: located [%]": (
            None, *share(lambda m: np.isfinite(m.error[:, :4]) & m.visible[:, :4], lambda m: m.visible[:, :4])),
        "centre visible: located [%]": (
            None, *share(lambda m: np.isfinite(m.error[:, 4]) & m.visible[:, 4], lambda m: m.visible[:, 4])),
        "hidden, clear: precision [%]": (
            95.0, *share(lambda m: m.hidden & m.sight.hidden, lambda m: m.hidden & ~m.ambiguous)),
        "hidden, clear: recall [%]": (90.0, *share(lambda m: m.hidden & m.sight.hidden, lambda m: m.sight.hidden)),
        **{
            f"hidden, from {least:.1f} on: precision [%]": (None, *share(
                lambda m: m.hidden & m.sight.hidden,
                lambda m, least=least: m.hidden & (m.sight.hidden | m.sight.visible_from(least))))
            for least in OTHER_SHARES
        },
        "hidden, strict: precision [%]": (None, *share(lambda m: m.hidden & ~m.visible, lambda m: m.hidden)),
        "hidden, strict: recall [%]": (None, *share(lambda m: m.hidden & ~m.visible, lambda m: ~m.visible)),
        "clearly hidden, of all points [%]": (None, *share(lambda m: m.sight.hidden, lambda m: every(m))),
        "ambiguous, of all points [%]": (None, *share(lambda m: m.ambiguous, lambda m: every(m))),
        "ambiguous: reported hidden [%]": (None, *share(lambda m: m.hidden & m.ambiguous, lambda m: m.ambiguous)),
        "ambiguous: located [%]": (
            None, *share(lambda m: np.isfinite(m.error) & m.ambiguous, lambda m: m.ambiguous)),
        "clearly hidden: located [%]": (
            None, *share(lambda m: np.isfinite(m.error) & m.sight.hidden, lambda m: m.sight.hidden)),
        "clearly visible: not located [%]": (
            None, *share(lambda m: np.isnan(m.error) & m.sight.visible, lambda m: m.sight.visible)),
        "clearly visible corner: not located [%]": (
            None, *share(lambda m: (np.isnan(m.error) & m.sight.visible)[:, :4], lambda m: m.sight.visible[:, :4])),
        "z of corners, sd": (
            None, *pooled(lambda m: z(m)[:, :4].ravel(), deviation)),
        "z of centre, sd": (None, *pooled(lambda m: z(m)[:, 4].ravel(), deviation)),
        "z, sd (0.8 to 1.25)": (1.25, *pooled(lambda m: z(m).ravel(), deviation)),
        "marker rms, still [mm]": (2.0, *pooled(lambda m: markers(m, False), rms)),
        "marker rms, moving [mm]": (5.0, *pooled(lambda m: markers(m, True), rms)),
        "markers found [%]": (99.5, *share(lambda m: np.isfinite(m.markers), lambda m: np.ones_like(m.markers))),
        "markers swapped [%]": (0.0, *share(lambda m: m.markers > SWAPPED, lambda m: np.isfinite(m.markers))),
        "whole way, a frame [ms]": (8.0, *pooled(lambda m: np.array([m.milliseconds]), np.mean)),
    }  # fmt: skip


def print_table(title: str, found: list[Measured]) -> None:
    """Print target, value and quartiles over scenes."""
    print(f"\n{title}: {len(found)} scenes, {sum(len(m.visible) for m in found)} frames")
    print(f"{'':<38}{'target':>8}{'all':>9}{'25 %':>9}{'50 %':>9}{'75 %':>9}{'worst':>9}")
    for name, (target, value, per_scene) in figures(found).items():
        spread = per_scene[np.isfinite(per_scene)]
        low, middle, high = np.percentile(spread, [25, 50, 75]) if spread.size else (np.nan,) * 3
        is_share = name.startswith("markers found") or ("precision" in name or "recall" in name or "placed [%]" in name)
        worst = (spread.min() if is_share else spread.max()) if spread.size else np.nan
        wanted = f"{target:>8.1f}" if target is not None else f"{'':>8}"
        print(f"{name:<38}{wanted}{value:>9.2f}{low:>9.2f}{middle:>9.2f}{high:>9.2f}{worst:>9.2f}")


def tracked(chosen: str, keep: Path | None, only: str) -> Iterator[Measured]:
    """Yield every scene of a set whose name holds some text, tracked."""
    for scene, make in scenes(chosen):
        if only in scene.name:
            yield measure(show(scene, make, keep / chosen if keep else None))


def main() -> None:
    """Print the table, over all scenes and by the chosen groups."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", choices=sorted(SEEDS), default="report-5", help="which seeds (default: report-5)")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="cache rendered frames there, 130 MB a scene")
    parser.add_argument("--by", choices=("garment", "swing", "distance", "background", "has_arm"), help="also split by")
    parser.add_argument("--only", default="", metavar="TEXT", help="scenes whose name holds this")
    chosen = parser.parse_args()
    found = list(tracked(chosen.set, chosen.keep, chosen.only))
    if chosen.by:
        for kind in dict.fromkeys(getattr(m.scene, chosen.by) for m in found):
            print_table(f"{chosen.by} {kind}", [m for m in found if getattr(m.scene, chosen.by) == kind])
    print_table(chosen.set, found)


if __name__ == "__main__":
    main()

"""Follow the tracked points of a garment: one strategy per kind of garment behind one small interface.

A strategy is a class with `track`; its kinds are listed in `STRATEGIES`, and that is all there is to add one.
`PanelTracker` follows flat panels held along their top (skirts, swatches): four silhouette corners and the centre
(`capture.silhouette`, `capture.geodesic`), placed in metres with the depth of the nearest cloth, because the pixels
at the rim are missing or mixed with the background:

    position = z(u, v) ((u - cx) / fx, (v - cy) / fy, 1),    z of the plane through the cloth around (u, v)
    sd_x^2 = (z sd_u / fx)^2 + (x / z sd_z)^2                likewise y
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from capture.depth_surface import CorrelationMeter, fit_surface
from capture.errors import UntrackableError
from capture.geodesic import farthest_place, geodesic_distances
from capture.plausibility import MotionGate, fits_flat_garment
from capture.silhouette import Silhouette, Window, cut_out, find_corners
from formats.garment import Garment
from formats.rig import Rig, Sensor

Floats = NDArray[np.float64]

CORNER_MATCH = 0.01  # m, a tracked point this near to an outline corner is that corner
SLACK = 1.08  # of the garment's reach from the held edge: stretch and the markers' tolerance
GROWTH = 3.0  # m/s, how fast the hem may leave the window of the frame before
LONGEST_TRUST = 0.2  # s, after which the window of the last sighting says nothing
SMALLEST_SHARE = 0.3  # of the flat garment's area in view; a smaller piece is not the garment
PATCH_RADIUS = 14  # px around a point whose cloth tells its depth: 39 mm at 1.6 m, flat to 1 mm
RIM = 2  # px at the silhouette's edge whose depth may be mixed
PATCH_SPREAD = 0.06  # m, how far a steep cloth reaches in depth across the patch
NODES_ALONG_HEIGHT = 22  # of the grid for geodesics: 20 mm steps on a 0.45 m skirt
CENTRE_SD = 0.1  # grid steps across the view: rms 1.7 mm against a drawn skirt, with corners off by as much


@dataclass(frozen=True, kw_only=True)
class GarmentSight:
    """What one frame shows of the garment, in the order of `garment.points`; NaN where not seen.

    points [m], (points, 3), sensor frame; sd [m], (points, 3); valid, (points,); pixels [px], (points, 2);
    outline [px], (n, 2): the silhouette, empty where the garment was not found
    """

    points: Floats
    sd: Floats
    valid: NDArray[np.bool_]
    hidden: NDArray[np.bool_]
    pixels: Floats
    outline: Floats

    @property
    def is_found(self) -> bool:
        """The garment's silhouette was found, whatever became of its points."""
        return len(self.outline) > 0


class GarmentTracker(Protocol):
    """Follows one garment through a recording."""

    def track(self, depth: NDArray[np.uint16], held: Floats, time: float) -> GarmentSight:
        """Find the garment's points in one frame.

        depth [mm], (H, W), 0 where missing; held [m], (2, 3): ends of the held edge, left first, sensor frame;
        time [s], increasing.
        """
        ...


def nothing_found(points: int) -> GarmentSight:
    """Return the sight of a frame in which the garment was not found."""
    nowhere = np.full((points, 3), np.nan)
    return GarmentSight(
        points=nowhere,
        sd=nowhere.copy(),
        valid=np.zeros(points, dtype=bool),
        hidden=np.zeros(points, dtype=bool),
        pixels=np.full((points, 2), np.nan),
        outline=np.empty((0, 2)),
    )


def garment_tracker(garment: Garment, rig: Rig, correlation: CorrelationMeter | None = None) -> GarmentTracker:
    """Return the tracker for this kind of garment.

    Raises:
        UntrackableError: the kind has no strategy yet, a point cannot be found by it, or the rig has no sensor.
    """
    strategy = STRATEGIES.get(garment.kind)
    if strategy is None:
        raise UntrackableError(
            f"garments of kind {garment.kind!r} cannot be tracked yet",
            where=garment.name,
            advice="use one of " + ", ".join(sorted(STRATEGIES)),
        )
    return strategy(garment, rig, correlation or CorrelationMeter())


class PanelTracker:
    """Follows a flat panel held along its top edge by its four corners and its centre."""

    def __init__(self, garment: Garment, rig: Rig, correlation: CorrelationMeter) -> None:
        if rig.sensor is None:
            raise UntrackableError("it has no sensor section", where=rig.name, advice="add the sensor's intrinsics")
        self.sensor: Sensor = rig.sensor
        self.correlation = correlation
        outline = np.array(garment.outline_m)
        self.flat = _extreme_corners(outline)
        self.roles = _roles(garment, self.flat)
        self.reach = SLACK * max(float(np.linalg.norm(self.flat[i] - self.flat[j])) for i, j in ((0, 3), (1, 2)))
        x, y = outline.T
        self.area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
        self._gate = MotionGate(len(self.roles))
        self._last: tuple[float, Window] | None = None

    def track(self, depth: NDArray[np.uint16], held: Floats, time: float) -> GarmentSight:
        """Find the corners and the centre in one frame; see `GarmentTracker.track`."""
        if not np.isfinite(held).all() or held[:, 2].min() <= 0.1:
            return nothing_found(len(self.roles))
        silhouette = self._silhouette(depth, held, time)
        if silhouette is None:
            self._last = None
            return nothing_found(len(self.roles))
        self._last = (time, silhouette.bounds)
        held_px = self._project(held)
        pixels, sd_px = find_corners(silhouette, held_px)
        core = cv2.erode(silhouette.mask, np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8), borderValue=0)
        corners, sd = np.full((5, 3), np.nan), np.full((5, 3), np.nan)
        pixels = np.vstack([pixels, np.full(2, np.nan)])
        for i in range(4):
            corners[i], sd[i] = self._place(pixels[i], float(sd_px[i]), silhouette, core)
        plausible = fits_flat_garment(corners[:4], sd[:4].max(1), self.flat)
        corners[:4][~plausible] = np.nan
        if plausible.all():
            pixels[4], centre_sd = self._centre(silhouette, corners[:4])
            corners[4], sd[4] = self._place(pixels[4], centre_sd, silhouette, core)
        points, sd, pixels = corners[self.roles], sd[self.roles], pixels[self.roles]
        valid = self._gate.admit(points, sd, time)
        points[~valid] = np.nan
        sd[~valid] = np.nan
        offset = [silhouette.window.left, silhouette.window.top]
        return GarmentSight(
            points=points, sd=sd, valid=valid, hidden=~valid, pixels=pixels, outline=silhouette.outline + offset
        )

    def _silhouette(self, depth: NDArray[np.uint16], held: Floats, time: float) -> Silhouette | None:
        middle = float(held[:, 2].mean())
        window = self._window(depth.shape, held, middle)
        near = self._recent_window(window, middle, time)
        limits = {"nearest": middle - self.reach, "farthest": middle + self.reach}
        held_px = self._project(held)
        found = cut_out(depth, near, held_px, **limits) if near is not None else None
        if (found is None or found.touches_rim) and not window.is_empty:
            found = cut_out(depth, window, held_px, **limits)
        if found is None:
            return None
        area = float(np.count_nonzero(found.mask)) * middle**2 / (self.sensor.fx * self.sensor.fy)
        return found if area > SMALLEST_SHARE * self.area else None

    def _window(self, shape: tuple[int, ...], held: Floats, middle: float) -> Window:
        """Return the window that the garment cannot leave, however it swings."""
        low, high = self._project(held).min(0), self._project(held).max(0)
        reach = self.reach * self.sensor.fx / max(middle - 0.7 * self.reach, 0.3)
        return Window(
            max(0, int(low[0] - reach)),
            max(0, int(low[1]) - 2),
            min(shape[1], int(high[0] + reach) + 1),
            min(shape[0], int(high[1] + reach) + 1),
        )

    def _recent_window(self, widest: Window, middle: float, time: float) -> Window | None:
        """Return the last sighting's window, grown by what the hem can have moved since."""
        if self._last is None or time - self._last[0] > LONGEST_TRUST:
            return None
        last = self._last[1]
        grown = int(GROWTH * (time - self._last[0]) * self.sensor.fx / middle) + 4
        window = Window(
            max(widest.left, last.left - grown),
            widest.top,
            min(widest.right, last.right + grown),
            min(widest.bottom, last.bottom + grown),
        )
        return None if window.is_empty else window

    def _project(self, places: Floats) -> Floats:
        s = self.sensor
        return np.stack(
            [s.fx * places[..., 0] / places[..., 2] + s.cx, s.fy * places[..., 1] / places[..., 2] + s.cy],
            axis=-1,
        )

    def _place(
        self, pixel: Floats, sd_px: float, silhouette: Silhouette, core: NDArray[np.uint8]
    ) -> tuple[Floats, Floats]:
        """Return position and sd [m] of the cloth at a pixel of the image; NaN where no cloth tells its depth."""
        if not np.isfinite(pixel[0]):
            return np.full(3, np.nan), np.full(3, np.nan)
        window, s = silhouette.window, self.sensor
        u, v = pixel[0] - window.left, pixel[1] - window.top
        h, w = core.shape
        left, right = np.clip([int(u) - PATCH_RADIUS, int(u) + PATCH_RADIUS + 1], 0, w)
        top, bottom = np.clip([int(v) - PATCH_RADIUS, int(v) + PATCH_RADIUS + 1], 0, h)
        patch = silhouette.depth[top:bottom, left:right]
        rows, columns = np.nonzero((core[top:bottom, left:right] > 0) & (patch > 0))
        surface = fit_surface(
            columns + (left - u),
            rows + (top - v),
            patch[rows, columns].astype(np.float64),
            focal_length=s.fx,
            spread=PATCH_SPREAD,
            correlated_pixels=self.correlation.pixels,
        )
        if surface is None:
            return np.full(3, np.nan), np.full(3, np.nan)
        ray = np.array([(pixel[0] - s.cx) / s.fx, (pixel[1] - s.cy) / s.fy, 1.0])
        across = surface.depth * sd_px * np.array([1.0 / s.fx, 1.0 / s.fy, 0.0])
        return surface.depth * ray, np.hypot(across, ray * surface.sd)

    def _centre(self, silhouette: Silhouette, corners: Floats) -> tuple[Floats, float]:
        """Return the centre's pixel in the image and its standard deviation [px]."""
        window, s = silhouette.window, self.sensor
        cell = max(3, round((silhouette.bounds.bottom - silhouette.bounds.top) / NODES_ALONG_HEIGHT))
        rows, columns = silhouette.mask.shape[0] // cell, silhouette.mask.shape[1] // cell
        part = silhouette.depth[: rows * cell, : columns * cell]
        size = (columns, rows)
        filled = cv2.resize((part > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA)
        total = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
        z = np.where(filled > 0.4, total / np.maximum(filled, 1e-6), np.nan).astype(np.float64)
        u = window.left + (np.arange(columns) + 0.5) * cell - 0.5
        v = window.top + (np.arange(rows) + 0.5) * cell - 0.5
        surface = np.stack([z * ((u - s.cx) / s.fx)[None], z * ((v - s.cy) / s.fy)[:, None], z], axis=-1)
        place = farthest_place(geodesic_distances(surface, corners))
        if place is None:
            return np.full(2, np.nan), float("nan")
        row, column = place
        pixel = np.array([window.left + (column + 0.5) * cell - 0.5, window.top + (row + 0.5) * cell - 0.5])
        return pixel, CENTRE_SD * cell


def _extreme_corners(outline: Floats) -> Floats:
    """Return the flat garment's corners [m], (4, 2), in the order and by the rule of `find_corners`; y is up."""
    total, difference = outline[:, 0] - outline[:, 1], outline[:, 0] + outline[:, 1]
    return outline[[total.argmin(), difference.argmax(), total.argmax(), difference.argmin()]]


def _roles(garment: Garment, corners: Floats) -> list[int]:
    """Return for every tracked point the corner that it is, 0 to 3, or 4 for the centre."""
    roles = []
    for point in garment.points:
        away = np.linalg.norm(corners - np.array(point.at_m), axis=1)
        if away.min() < CORNER_MATCH:
            roles.append(int(away.argmin()))
        elif point.name in {"centre", "center"}:
            roles.append(4)
        else:
            raise UntrackableError(
                f"the point {point.name!r} is neither a corner of the outline nor the centre",
                where=garment.name,
                advice="track the four corners and the point 'centre'",
            )
    return roles


STRATEGIES: dict[str, type[PanelTracker]] = {"skirt": PanelTracker, "swatch": PanelTracker}

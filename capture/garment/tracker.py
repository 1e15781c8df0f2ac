"""Track a garment's four corners and its centre through a recording.

    held edge -> silhouette -> corners in pixels -> corners in metres -> occlusion of corners -> centre

One `SilhouetteTracker` for all garments; the kinds differ in where their corners are (`capture.garment.corners`).

Distances along the cloth show a misplaced corner. With the excess x_ij = max(0, |d_ij - D_ij| - slack) of its distances
to the others, a corner's deviation along each axis grows by

    the second largest of x_ij over j,    of it the shares `DOUBT_ALONG`

A corner may be off by e along each axis, so by sqrt(2) e over the cloth. This changes its distance to another one by
sqrt(2) e times the cosine of the angle between. The others lie at some 0, 45 and 90 degrees. Over directions of the
error, the second largest of the three changes is then e, root mean square. One distance alone accuses the cloth
between the two, or the other corner.

The centre is the point p with equal distances from the four corners. With unit vectors g_i from the corners, errors n_i
of these distances move it by

    -(G^T G)^-1 G^T n,    of one corner in a panel's diagonals, at an angle a: n / (4 cos a) along an axis

A corner that only its distances place, at no corner of the outline, does not count just after a gap. In the first
frame it counts. It lies beyond the visible cloth by some length, a flap beside the garment's side. So this length is a
part of its deviation along x, but for the tip of a sleeve.
A held corner is never placed so: distances would put it up to 32 mm from the held edge, which the markers show.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from capture.depth.surface import CorrelationMeter, pixel_sd
from capture.errors import UntrackableError
from capture.garment.corners import HELD_LINE_SD
from capture.garment.coverage import Beyond, SeenWays, beyond_the_seen
from capture.garment.flat_garment import CENTRE_ROLE, flat_garment
from capture.garment.folding import THRESHOLD, TRACES, Belief, traces
from capture.garment.geodesic import FINE_STEPS, farthest_place, geodesic_distances
from capture.garment.held_scatter import HeldScatter
from capture.garment.occlusion import (
    COVERED,
    folded_away,
    is_at_border,
    is_behind_something,
    with_ends,
)
from capture.garment.peeking import peeking_area
from capture.garment.placing import Placer, project
from capture.garment.plausibility import MotionGate
from capture.garment.sight import FINDERS, GarmentSight, GarmentTracker, frame_quality, nothing_found
from capture.garment.silhouette import Silhouette, Window, cut_out
from capture.garment.slant import UPRIGHT, rim_slant
from capture.garment.surface_scan import scan_surface
from formats.arrays import Booleans, Floats, Singles, Unsigned
from formats.garment import Garment
from formats.rig import Rig, Sensor
from formats.surface import SurfaceScan

# of the garment's reach from the held edge: stretch and the markers' tolerance. Half and double of the 0.08 change no
# figure of nine scenes at 1.6 m (`benchmarks/tracking.py --set development-11`).
REACH_FACTOR = 1.08
# m/s, speed at which the hem may leave the previous frame's window. Our choice: a hand swings a hanger at 1 m/s, and
# a hem moves up to three times as fast. Half and double change no figure of the same scenes.
GROWTH = 3.0
# s, after which the last window is useless: grown by 0.6 m to every side, it is nearly the picture. Half and double
# change no figure of the same scenes.
LONGEST_TRUST = 0.2
# of the flat garment's area in view; a smaller piece is not the garment. On the same scenes half changes nothing.
# Double finds 77 % of the hidden corners in place of 91.
SMALLEST_SHARE = 0.25
LARGEST_AREA_SHARE = 1.5  # of its area: 1.02 at most on the development sets, 3 to 5 in one piece with a wall behind
# m and pixel noises in depth between neighbours that are two surfaces. On the same scenes half finds 69 % of the hidden
# corners in place of 91. Double finds 92 %, and the corners' 95 % rise from 9.9 to 10.2 mm.
JUMP, JUMP_NOISE = 0.03, 6.0
NEAREST_HANGER = 0.1  # m; a hanger cannot be nearer, so this is an error
# m, a held corner this far from the held edge's end is not that corner. On the same scenes half puts the corners' 95 %
# at 9.7 mm in place of 9.9, and double changes nothing.
HELD_MATCH = 0.03
# x, y and z, of the error in depth of a corner that its distances or a gap make doubtful. The image itself shows where
# the cloth ends across the view. On the sets `development` of `benchmarks/stated_noise.py` corners with an excess of
# 5 to 10 mm err by 5, 7 and 16 mm. Those after a gap err by 4, 4 and 12 mm.
DOUBT_ALONG = np.array([0.4, 0.4, 1.0])
# m: a doubtful corner that is at most so far beyond the visible cloth lies at its nearest point. On the same scenes the
# corners' 95 % are 9.9 mm, and 96.7 % are located. Half gives 9.2 mm and 95.3 %, double 10.8 mm and 97.9 %.
BY_WAYS = 0.020
# of the distance, along each axis, beside the flap that is out of view: rms on the development sets' hard swings. On
# the same scenes half and double change the deviation of the corners' z from 0.96 to 0.98 and 0.95.
BY_WAYS_SD = 0.0055
# m, of the grid for geodesics. Our choice: near `GRID_STEP` of the flat garment, so that both distances are too long
# alike. On the same scenes half puts the corners' 95 % at 10.9 mm in place of 9.9. Double puts the centre off by
# 4.5 mm, and locates it in 79 % of the frames in place of 84.
CELL = 0.028
# of a distance between corners: tolerance of its measurement. Our choice: half and double place all garments of
# `test_garment_points.py` as well.
CORNER_SLACK = 0.02
# of the rms error of the distances between corners. Errors of single corners alone would make it 0.5, and an error that
# all distances share moves no centre. On the same scenes the centre's z is 1.29; 1.72 with half, and 0.93 with double.
CENTRE_SHARE = 0.3
# grid steps across the view: the maps are compared at `FINE_STEPS` points of a step. A value rounded to a step has a
# deviation of the step / sqrt 12. The corners' errors are part of the distances' error above.
GARMENT_CENTRE_SD = 1.0 / FINE_STEPS / math.sqrt(12.0)
# of one corner's error, along each axis, that moves the centre: see the module
CENTRE_MOVES = 1.0 / (4.0 * math.cos(math.pi / 4.0))
UNPLACED = np.full((CENTRE_ROLE + 1, 3), np.nan)  # m, of the corners and the centre before they are found


def garment_tracker(garment: Garment, rig: Rig, correlation: CorrelationMeter | None = None) -> GarmentTracker:
    """Return the tracker for this kind of garment.

    Raises:
        UntrackableError: the kind has no strategy, the strategy cannot find a point, or the rig has no sensor.
    """
    if garment.kind not in FINDERS:
        raise UntrackableError(
            f"garments of kind {garment.kind!r} cannot be tracked yet",
            where=garment.name,
            advice="use one of " + ", ".join(sorted(FINDERS)),
        )
    return SilhouetteTracker(garment, rig, correlation or CorrelationMeter())


class SilhouetteTracker:
    """Tracks the silhouette's corners and the centre of a garment that hangs from its held edge."""

    def __init__(self, garment: Garment, rig: Rig, correlation: CorrelationMeter) -> None:
        if rig.sensor is None:
            raise UntrackableError(
                "has no sensor section", where=rig.name, advice="add [sensor] with what `hangtime sensor play` says"
            )
        self.sensor: Sensor = rig.sensor
        self.correlation = correlation
        self.finder = FINDERS[garment.kind]()
        outline = np.array(garment.outline_m)
        corners = self.finder.flat_corners(outline)
        self.flat = flat_garment(garment, corners)
        self.held_corners = [
            next((e for e in (0, 1) if np.linalg.norm(corners[i] - outline[e]) < HELD_MATCH), None) for i in range(4)
        ]
        is_centre = np.array(self.flat.roles)[:, None] == CENTRE_ROLE
        self._gate = MotionGate(len(self.flat.roles), np.where(is_centre, CENTRE_MOVES, DOUBT_ALONG))
        self._scatter = HeldScatter(4)
        self._last: tuple[float, Window] | None = None
        self._seen: tuple[Silhouette, Floats] | None = None
        self._belief = Belief()
        self.traces = np.full((4, len(TRACES)), np.nan)  # of the last frame's doubtful corners, NaN for others

    def track(self, depth: Unsigned, held: Floats, time: float, held_sd: Floats | None = None) -> GarmentSight:
        """Find the corners and the centre in one frame; see `GarmentTracker.track`."""
        roles = self.flat.roles
        silhouette = self._silhouette(depth, held, time)
        self._seen = None
        self.traces = np.full((4, len(TRACES)), np.nan)
        if silhouette is None:
            self._last = None
            return nothing_found(len(roles))
        self._last = (time, silhouette.window)
        sides = self.flat.sides * self.sensor.fx / float(held[:, 2].mean())
        across = HELD_LINE_SD
        if held_sd is not None:
            across = float(np.sqrt((held_sd[:, :2] ** 2).mean())) * self.sensor.fx / float(held[:, 2].mean())
        view = self.finder.find(silhouette, project(held, self.sensor), sides, across)
        placer = Placer(silhouette, self.sensor, self.correlation)
        places, sd = UNPLACED.copy(), UNPLACED.copy()
        pixels = np.vstack([view.pixels, UNPLACED[CENTRE_ROLE, :2]])
        for i in range(4):
            places[i], sd[i] = placer.place(view.pixels[i], view.sd[i])
        is_held = self._match_held(places, sd, held, time)
        surface, cell = self._surface(silhouette)
        missing = ~_are_known(places[:4])
        distances, along = self._ways_between(surface, places)
        hidden = np.zeros(len(places), bool)
        folded, wrong = folded_away(*self._with_held_ends(surface, places, along, held, is_held))
        dropped = (folded | wrong)[:4]
        beyond: Beyond | None = None
        if (dropped | missing).any():
            ways = SeenWays(surface, cell, held, distances, ~(dropped | missing))
            beyond = beyond_the_seen(silhouette, ways, self.flat.from_ends, self.flat.distances, self.sensor)
            for i in np.flatnonzero(dropped | missing).tolist():
                self.traces[i] = self._traces(silhouette, i, view.pixels[i], beyond, held)
        hidden[:4] = self._hidden(silhouette, depth.shape, pixels, places, along, dropped, time)
        if beyond is not None:
            hidden[:4] |= (dropped | missing) & self._covered(silhouette, beyond)
        places[:4][hidden[:4] | dropped] = np.nan
        by_ways = np.zeros(4, bool) if beyond is None else ~hidden[:4] & (beyond.by_all < BY_WAYS) & (dropped | missing)
        by_ways &= np.array([end is None for end in self.held_corners])
        if beyond is not None and by_ways.any():
            places[:4][by_ways] = beyond.places[by_ways]
            sd[:4][by_ways] = BY_WAYS_SD * places[:4, 2:][by_ways]
            beside = by_ways & ~np.isin(np.arange(4), self.finder.tips)
            sd[:4, 0][beside] = np.hypot(sd[:4, 0], beyond.by_all)[beside]
            pixels[:4][by_ways] = project(beyond.places[by_ways], self.sensor)
            distances, along = self._ways_between(surface, places)
        sd[:4] = np.hypot(sd[:4], self._mismatch(places, is_held, along)[:, None] * DOUBT_ALONG)
        if _are_known(places[:4]).all():
            mismatch = np.abs(along - self.flat.distances)
            off = float(np.sqrt((mismatch**2).sum() / 12.0))
            pixels[CENTRE_ROLE], centre_sd = self._centre(silhouette, distances, cell)
            centre_sd = float(np.hypot(centre_sd, CENTRE_SHARE * off * self.sensor.fx / float(held[:, 2].mean())))
            places[CENTRE_ROLE], sd[CENTRE_ROLE] = placer.place(pixels[CENTRE_ROLE], np.full(2, centre_sd))
        points, sd, pixels = places[roles], sd[roles], pixels[roles]
        valid, sd = self._gate.admit(points, sd, time, np.append(by_ways, False)[roles])
        points[~valid] = np.nan
        sd[~valid] = np.nan
        self._seen = silhouette, np.where(_are_known(places[:4])[:, None], pixels[:4], np.nan)
        filled = np.count_nonzero(silhouette.depth) / np.count_nonzero(silhouette.mask)
        offset = [silhouette.window.left, silhouette.window.top]
        return GarmentSight(
            points=points, sd=sd, valid=valid, hidden=hidden[roles] & ~valid, pixels=pixels,
            outline=silhouette.outline + offset, quality=frame_quality(valid, sd, filled),
        )  # fmt: skip

    def scan(self, time: float, *, grid: int, contour: int) -> SurfaceScan | None:
        """Scan the visible surface of the last tracked frame; see `GarmentTracker.scan`."""
        if self._seen is None:
            return None
        silhouette, corners = self._seen
        return scan_surface(silhouette, corners, self.sensor, time, grid=grid, contour=contour)

    @staticmethod
    def _ways_between(surface: Floats, places: Floats) -> tuple[Singles, Floats]:
        """Return distances from the four corners to the nodes and to each other, NaN for a corner without position."""
        distances, along = geodesic_distances(surface, places[:4])
        missing = ~_are_known(places[:4])
        along[missing] = along[:, missing] = np.nan
        return distances, along

    def _with_held_ends(
        self, surface: Floats, places: Floats, along: Floats, held: Floats, is_held: Booleans
    ) -> tuple[Floats, Floats, Booleans]:
        """Return what `folded_away` takes: the corners, and after them the held ends at which no corner is found."""
        known = _are_known(places[:4])
        ends = [e for e in (0, 1) if not any(is_held[i] and end == e for i, end in enumerate(self.held_corners))]
        if not ends or known.all() or not known.any():  # four corners test one another
            return along, self.flat.distances, is_held
        seen = geodesic_distances(surface, np.concatenate([held[ends], places[:4]]))[1][: len(ends), len(ends) :]
        return with_ends(along, self.flat.distances, is_held, seen, self.flat.from_ends[ends])

    def _traces(self, silhouette: Silhouette, i: int, pixel: Floats, beyond: Beyond, held: Floats) -> Floats:
        """Return the features of corner i for the regression of `capture.garment.folding`."""

        def peeking(at: Floats) -> float:
            return peeking_area(silhouette, at, missing, held, self.flat.from_ends[:, i], self.sensor)

        missing, place = float(beyond.by_all[i]), beyond.places[i]
        nearest = peeking(beyond.pixels[i]) if np.isfinite(beyond.pixels[i]).all() else 0.0
        outline = peeking(pixel) if np.isfinite(pixel).all() else nearest
        slant = UPRIGHT
        if np.isfinite(place).all():
            slant = rim_slant(silhouette, project(place, self.sensor), float(place[2]), self.sensor)
        return traces(float(beyond.by_ends[i]), outline, nearest, slant, is_tip=i in self.finder.tips)

    def _hidden(
        self, silhouette: Silhouette, shape: tuple[int, ...], pixels: Floats, places: Floats, along: Floats,
        dropped: Booleans, time: float,
    ) -> Booleans:  # fmt: skip
        """Return which corners are hidden, (4,); dropped, (4,): corners whose positions contradict the flat garment."""
        flat = self.flat.distances
        hidden = self._belief.update(self.traces, time) > THRESHOLD
        for i in np.flatnonzero(_are_known(places[:4])):
            if is_at_border(pixels[i], shape):
                hidden[i] = True
                continue
            lost = float(np.nanmax(np.where(np.isfinite(along[i]), flat[i] - along[i], 0.0)))
            if self._ends_at_a_nearer_thing(silhouette, places[i], max(lost, 0.0)):
                hidden[i] = dropped[i] or lost > COVERED * flat[i].max()
        return np.asarray(hidden)

    def _covered(self, silhouette: Silhouette, beyond: Beyond) -> Booleans:
        """Return which corners are missing where the cloth nearest to them ends at an object in front, (4,)."""
        covered = beyond.by_all > COVERED * self.flat.distances.max(1)
        for i in np.flatnonzero(covered):
            covered[i] = self._ends_at_a_nearer_thing(silhouette, beyond.places[i], float(beyond.by_all[i]))
        return np.asarray(covered)

    def _ends_at_a_nearer_thing(self, silhouette: Silhouette, place: Floats, lost: float) -> bool:
        """Return whether a surface beside a position [m] is nearer than missing cloth of that length [m] can be."""
        z = float(place[2])
        return np.isfinite(z) and is_behind_something(silhouette, project(place, self.sensor), z, self._jump(z) + lost)

    def _mismatch(self, places: Floats, is_held: Booleans, along: Floats) -> Floats:
        """Return each corner's error in depth [m], (4,), from its distances to the others: see the module."""
        flat, placed = self.flat.distances, _are_known(places[:4])
        off = np.where(placed[:, None] & placed & np.isfinite(along), np.abs(along - flat), 0.0)
        return np.where(is_held, 0.0, np.sort(np.maximum(off - CORNER_SLACK * flat, 0.0), axis=1)[:, -2])

    def _match_held(self, places: Floats, sd: Floats, held: Floats, time: float) -> Booleans:
        """Return which corners are ends of the held edge; remove those that should be but are elsewhere.

        The deviations of those that are there follow their distances from these ends (`capture.garment.held_scatter`).
        """
        apart = np.full((4, 3), np.nan)
        for i, end in enumerate(self.held_corners):
            if end is not None:
                apart[i] = places[i] - held[end]
        far = np.linalg.norm(apart, axis=1)
        is_held = far < HELD_MATCH
        places[:4][far >= HELD_MATCH] = np.nan
        sd[:4] = self._scatter.stated(places[:4], apart, sd[:4], is_held, time)
        return np.asarray(is_held)

    def _jump(self, z: float) -> float:
        return JUMP + JUMP_NOISE * pixel_sd(z, self.sensor.fx)

    def _silhouette(self, depth: Unsigned, held: Floats, time: float) -> Silhouette | None:
        if not np.isfinite(held).all() or held[:, 2].min() <= NEAREST_HANGER:
            return None
        middle = float(held[:, 2].mean())
        window = self._window(depth.shape, held, middle)
        near = self._recent_window(window, middle, time)
        reach = REACH_FACTOR * self.flat.reach
        limits = {"nearest": middle - reach, "farthest": middle + reach, "jump": self._jump(middle)}
        held_px = project(held, self.sensor)
        found = cut_out(depth, near, held_px, **limits) if near is not None else None
        if (found is None or found.touches_rim) and not window.is_empty:
            found = cut_out(depth, window, held_px, **limits)
        if found is None:
            return None
        pixel = 1.0 / (self.sensor.fx * self.sensor.fy)
        area = float(np.count_nonzero(found.mask)) * middle**2 * pixel
        across = cv2.norm(found.depth, cv2.NORM_L2SQR) * pixel  # as if the visible surface faced the sensor
        is_garment = area > SMALLEST_SHARE * self.flat.area and across < LARGEST_AREA_SHARE * self.flat.area
        return found if is_garment else None

    def _window(self, shape: tuple[int, ...], held: Floats, middle: float) -> Window:
        """Return the window that the garment cannot leave, however it swings."""
        ends = project(held, self.sensor)
        low, high = ends.min(0), ends.max(0)
        reach = REACH_FACTOR * self.flat.reach
        pixels = reach * self.sensor.fx / max(middle - 0.7 * reach, 0.3)
        return Window(
            max(0, int(low[0] - pixels)),
            max(0, int(low[1]) - 2),
            min(shape[1], int(high[0] + pixels) + 1),
            min(shape[0], int(high[1] + pixels) + 1),
        )

    def _recent_window(self, widest: Window, middle: float, time: float) -> Window | None:
        """Return the last window, enlarged by the distance that the hem can have moved since."""
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

    def _surface(self, silhouette: Silhouette) -> tuple[Floats, int]:
        """Return the visible surface as a grid [m], (rows, columns, 3), NaN where missing, and its step [px]."""
        window, s = silhouette.window, self.sensor
        middle = float(silhouette.depth[silhouette.depth > 0].mean())
        cell = max(3, round(CELL * s.fx / middle))
        rows, columns = silhouette.mask.shape[0] // cell, silhouette.mask.shape[1] // cell
        part = silhouette.depth[: rows * cell, : columns * cell]
        size = (columns, rows)
        filled = cv2.resize((part > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA)
        total = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
        z = np.where(filled > 0.4, total / np.maximum(filled, 1e-6), np.nan).astype(np.float64)
        u = window.left + (np.arange(columns) + 0.5) * cell - 0.5
        v = window.top + (np.arange(rows) + 0.5) * cell - 0.5
        return np.stack([z * ((u - s.cx) / s.fx)[None], z * ((v - s.cy) / s.fy)[:, None], z], axis=-1), cell

    def _centre(self, silhouette: Silhouette, distances: Singles, cell: int) -> tuple[Floats, float]:
        """Return the centre's pixel in the image and its standard deviation [px]."""
        place = farthest_place(distances)
        if place is None:
            return np.full(2, np.nan), float("nan")
        row, column = place
        window = silhouette.window
        pixel = np.array([window.left + (column + 0.5) * cell - 0.5, window.top + (row + 0.5) * cell - 0.5])
        return pixel, GARMENT_CENTRE_SD * cell


def _are_known(places: Floats) -> Booleans:
    """Return which positions, (n, 3), are there, (n,)."""
    return np.asarray(np.isfinite(places).all(1))

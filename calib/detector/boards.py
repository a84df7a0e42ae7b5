"""Other makers' boards in a photo: found and named by kind (`calib.detector.marks`), then measured here.

Where the named points lead to others, through the lens known or guessed so far, these are measured, too. What is no
corner of this board, by its contrast, its edges, what the model leaves, or its place, is not told.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core import homography
from calib.core.linear_algebra import solve_square
from calib.core.types import OUTSIDE, TOO_FLAT, Detections, FaceRecord
from calib.detector.corner_fit import BLUR, TURN, CornerFits, fit_corners
from calib.detector.lens import CameraLens, Lens, local_form, scale_to_weigh_with
from calib.detector.marks import FINDERS, FoundFace
from calib.detector.place import nearest_rows
from calib.detector.ring_marks import COVERED, FAINT, FAINTEST, LEAST_CONTRAST, MAX_SIGMA_PX, ODD_SHAPE, OFF_GRID, VAGUE
from calib.detector.ring_scores import variance_ratios
from calib.detector.wide_guess import guess_lens
from designer.base.arrays import Array, Flags, Rows
from designer.marks.face_marks import FaceMarks
from designer.target import TargetGeometry

LEAST_SIDE_PX = 16
LEAST_POINTS = 4
"""Of a face: fewer tell no homography."""
MARK_PX = 6.0
"""Radius of what is drawn where a finder measured."""
SUREST_PX = 0.003
"""Lenses and boards are not truer than this."""
USUAL_BLUR_PX = 1.0
"""To begin with."""
SOFTENED_BLUR_PX, SOFTENING_PX, SOFTENED_RATIO = 0.45, 0.5, 1.25
"""Edges this sharp hang on where a pixel falls; softened they do so by half, and neighbouring residuals go together."""
LEAST_ROOM_PX = 2.5
"""Along a corner's edges: less holds no crossing."""
MOST_OFF = 0.2
"""Of the room along its edges: farther from where it is predicted nothing is the corner."""
MOST_TURN_RAD = 0.3
ROUNDS, LENS_ROUNDS = 3, 2
TICKS = 96
AROUND, LEAST_AROUND = 12, 6
"""Neighbours that tell where a point has to be."""
STRAY, STRAY_FLOOR_PX, STRAY_ROUNDS = 5.0, 0.02, 4
"""In standard deviations: of 80,000 corners that nothing covers .1 % lie farther off."""
NOT_THERE = "no board of this target was found"
NEW_OFF_PX = 0.5
FOUND_SIGMA_PX = 0.1
"""Of corners that only likeness with an ideal one has placed (rendered: .04 to .07 px an axis)."""
CLOSE_MARKERS = (
    f"markers are so close to the corners, or squares so small, that corners are placed to {FOUND_SIGMA_PX:g} px only"
)
TOO_FEW = "only {count} corners of the board are seen; its pose needs four and more"
NOT_CORNERS = "not taken for the board: of {count} corners found only {good} are corners of such edges"


@dataclass(frozen=True, eq=False)
class Neighbourhoods:
    """What a face shows around its R points, from the outlines of its marks."""

    way: Array  # (R, 2) signs of x and y in the quadrant that has a colour of its own, or shares it with the one across
    is_dark: Flags  # (R,) that quadrant
    is_saddle: Flags  # (R,) two quadrants across are of one colour; else one is alone
    room_mm: Array  # (R, 3) how far nothing else begins along the edges towards it, and away; how deep between them


@lru_cache(maxsize=64)
def neighbourhoods(marks: FaceMarks) -> Neighbourhoods:
    """Of the corners of a face, as its polygons tell."""
    at = marks.position_mm
    longest = 2.0 * float((np.ptp(at, axis=0) / np.ptp(marks.index, axis=0).clip(min=1)).max())
    tick = (np.arange(TICKS) + 0.5) / TICKS * longest
    # A picture of the face, with a margin all around; four pixels a tick.
    fine, low = 4 * TICKS / longest, at.min(axis=0) - 2 * longest
    picture = np.zeros(np.ceil((np.ptp(at, axis=0) + 4 * longest) * fine).astype(np.int64)[::-1] + 1, dtype=np.uint8)
    for polygon in marks.polygons_mm:
        # Pixels are at whole numbers, and those on the outline are drawn, too.
        drawn = np.round(256 * ((polygon - low) * fine - 0.5)).astype(np.int32)
        cv2.fillConvexPoly(picture, drawn, 1, shift=8)
    quadrants = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    way, room = np.ones((len(at), 2)), np.zeros((len(at), 3))
    is_dark, is_saddle = np.zeros((2, len(at)), dtype=np.bool_)
    grid = np.stack(np.meshgrid(tick, tick, indexing="ij"), axis=-1)
    for row, point in enumerate(at):
        x, y = np.moveaxis(np.floor((point + quadrants[:, None, None] * grid - low) * fine).astype(np.int64), -1, 0)
        dark = picture[y, x] > 0
        first = dark[:, 0, 0]
        # Counted from a quadrant on: forth along both of its edges, back along those of the one across.
        is_saddle[row] = first[0] == first[2] != first[1] == first[3]
        is_lone = first.sum() in {1, 3}
        own = np.flatnonzero(first if is_saddle[row] else is_lone & (first == (first.sum() == 1)))
        free = [_room(dark == first[:, None, None], k, tick) for k in own.tolist()]
        if free:
            best = int(np.argmax([each[0] for each in free]))
            way[row], is_dark[row], room[row] = quadrants[own[best]], first[own[best]], free[best]
    return Neighbourhoods(way, is_dark, is_saddle, room)


def _room(is_even: Flags, k: int, tick: Array) -> Array:
    """Forth, back and deep, where (4, T, T) samples of the quadrants have the colour of their corner.  # -> (3,)"""
    half = 0.5 * float(tick[1] - tick[0])

    def until(is_free: Flags) -> float:
        ends = np.flatnonzero(~is_free)
        return float(tick[ends[0]] - half) if len(ends) else float(tick[-1] + half)

    # Along x and y at the first tick beside the edges; the quadrant and its neighbours forth, the others back.
    along_x, along_y = is_even[:, :, 0], is_even[:, 0, :]
    beside_x, beside_y = (3 - k) % 4, k ^ 1
    across = (k + 2) % 4
    forth = min(until(along_x[k] & along_x[beside_x]), until(along_y[k] & along_y[beside_y]))
    back = min(until(along_x[across] & along_x[beside_y]), until(along_y[across] & along_y[beside_x]))
    deep = float(tick[-1]) + half
    for quadrant, x_mm, y_mm in (
        (k, forth, forth),
        (across, back, back),
        (beside_x, forth, back),
        (beside_y, back, forth),
    ):
        odd_x, odd_y = np.nonzero(~is_even[quadrant] & (tick[:, None] < x_mm) & (tick < y_mm))
        if len(odd_x):
            deep = min(deep, float(tick[np.minimum(odd_x, odd_y).min()]) - half)
    return np.array([forth, back, deep])


@dataclass(frozen=True, eq=False)
class FoundBoards:
    """What the finders named in a photo: the half of the search that is the same for any lens."""

    faces: tuple[FoundFace, ...]


def find_boards(pixels: NDArray[np.generic], target: TargetGeometry) -> FoundBoards:
    """The faces' points, about where they are."""
    assert target.marks is not None  # noqa: S101 - who calls has looked
    grey = as_bytes(pixels)
    found = []
    for kind in dict.fromkeys(marks.kind for marks in target.marks):
        face = [row for row, marks in enumerate(target.marks) if marks.kind == kind]
        faces = FINDERS[kind](grey, [target.marks[row] for row in face])
        found += [replace(one, face=face[one.face]) for one in faces]
    return FoundBoards(tuple(found))


def as_bytes(pixels: NDArray[np.generic]) -> NDArray[np.uint8]:
    """The photo as finders take it: other levels are stretched over what occurs.  # (H, W)"""
    if pixels.dtype == np.uint8:
        return np.ascontiguousarray(pixels.view(np.uint8))
    low, high = float(pixels.min()), float(pixels.max())
    return np.asarray((pixels.astype(np.float64) - low) * (255.0 / max(high - low, 1e-9)), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class _Points:
    """N points of the target's R, where they are, and how sure that is."""

    ring: Rows  # (N,) ascending
    center_px: Array  # (N, 2)
    sigma_px: Array  # (N,)

    def of(self, target: TargetGeometry, face: int) -> "_Points":
        """Those of a face."""
        mine = target.ring_face[self.ring] == face
        return _Points(self.ring[mine], self.center_px[mine], self.sigma_px[mine])


@dataclass(frozen=True, eq=False)
class _Places:
    """Where N points must be, as the others and a lens say."""

    ring: Rows  # (N,)
    center_px: Array  # (N, 2)
    px_from_mm: Array  # (N, 2, 2) by x and y of the face
    farther: Array  # (N, 2) by what share a mm along them takes the face away from the camera
    bend: Array  # (N, 6)


def _places(target: TargetGeometry, seen: _Points, lens: Lens, image_size: tuple[int, int]) -> _Places:
    """Of all points of the faces seen, as far as they are in the image."""
    parts = []
    for face in np.unique(target.ring_face[seen.ring]).tolist():
        mine, rows = seen.of(target, face), np.flatnonzero(target.ring_face == face)
        plane, facing = target.center_in_face_mm[:, :2], lens.facing(mine.center_px)
        straight = facing.straighten(mine.center_px)
        known = np.isfinite(straight).all(axis=1)
        if known.sum() < LEAST_POINTS or not homography.is_determined(plane[mine.ring[known]]):
            continue
        sigma = mine.sigma_px * scale_to_weigh_with(facing, mine.center_px)
        matrix, _, _, _ = homography.fit_near(
            plane[mine.ring[known]], straight[known], 1 / sigma[known] ** 2, slack=1.0, least=LEAST_POINTS
        )
        if not np.isfinite(matrix).all():
            continue
        step = 0.01 * float(np.abs(target.lattice_mm[face]).max())
        ways = step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        at_mm = plane[rows][:, None] + ways
        # Behind the camera nothing is seen.
        depth = at_mm @ matrix[2, :2] + matrix[2, 2]
        sign = np.sign(np.median(plane[mine.ring[known]] @ matrix[2, :2] + matrix[2, 2]))
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            at_px = facing.distort(np.where((sign * depth > 0)[..., None], homography.apply(matrix, at_mm), np.nan))
            by_mm = np.stack([at_px[:, 1] - at_px[:, 2], at_px[:, 3] - at_px[:, 4]], axis=-1) / (2 * step)
            inside = (at_px[:, 0] >= 1) & (at_px[:, 0] <= np.array(image_size) - 2)
            good = inside.all(axis=1) & np.isfinite(by_mm).all(axis=(1, 2)) & (np.linalg.det(by_mm) != 0)
        center = at_px[good, 0]
        farther = matrix[2, :2] / depth[good, :1]
        parts.append(_Places(rows[good], center, by_mm[good], farther, local_form(facing, center)[1]))
    none = _Places(
        np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros((0, 6))
    )
    return _Places(*(np.concatenate([getattr(part, name) for part in (none, *parts)]) for name in vars(none)))


def _lens_of(target: TargetGeometry, seen: _Points, image_size: tuple[int, int]) -> Lens:
    """Guessed from one photo."""
    faces = [seen.of(target, face) for face in np.unique(target.ring_face[seen.ring]).tolist()]
    return guess_lens([(target.center_in_face_mm[one.ring, :2], one.center_px) for one in faces], image_size)


def detect_boards(
    pixels: NDArray[np.generic],
    target: TargetGeometry,
    *,
    name: str,
    camera: Camera | None = None,
    found: FoundBoards | None = None,
) -> Detections:
    """Find, name and measure the points of a target of other makers' marks; as `calib.detector.pipeline.detect`."""
    if found is None:
        found = find_boards(pixels, target) if min(pixels.shape) >= LEAST_SIDE_PX else FoundBoards(())
    corners = _named(target, [one for one in found.faces if one.cov_px2 is None])
    others = _named(target, done := [one for one in found.faces if one.cov_px2 is not None])
    measured = _measured(pixels, target, corners, camera)
    if len(others.ring):
        cov = np.concatenate([one.cov_px2 for one in done if one.cov_px2 is not None])
        measured = measured.with_others(others, cov)
    remarks = tuple(dict.fromkeys((*(remark for one in found.faces for remark in one.remarks), *measured.remarks)))
    if not remarks and not len(measured.ring):
        remarks = (NOT_THERE,)
    return Detections(
        image=name,
        image_size=(pixels.shape[1], pixels.shape[0]),
        layout_id=target.layout_id,
        geometry_id=target.geometry_id,
        ring=measured.ring,
        position_mm=target.center_mm[measured.ring],
        center_px=measured.center_px,
        cov_px2=measured.cov_px2,
        ellipse_px=np.column_stack([measured.center_px, *2 * [measured.room_px], np.zeros(len(measured.ring))]),
        faces=_records(target, measured),
        remarks=remarks,
        rejected_px=corners.center_px[~np.isin(corners.ring, measured.ring)],
    )


def _named(target: TargetGeometry, faces: Sequence[FoundFace]) -> _Points:
    """The points of faces that were found."""
    first = np.searchsorted(target.ring_face, np.arange(target.face_count))
    ring = np.concatenate([np.zeros(0, dtype=np.int64), *(first[one.face] + one.row for one in faces)])
    near_px = np.concatenate([np.zeros((0, 2)), *(one.near_px for one in faces)])
    order = np.argsort(ring, kind="stable")
    return _Points(ring[order], near_px[order], np.ones(len(ring)))


@dataclass(frozen=True, eq=False)
class _Fits:
    """N points, and why others of the faces seen are missing."""

    ring: Rows  # (N,)
    center_px: Array  # (N, 2)
    cov_px2: Array  # (N, 2, 2)
    room_px: Array  # (N,)
    missing: tuple[tuple[int, str], ...] = ()
    remarks: tuple[str, ...] = ()

    def with_others(self, points: _Points, cov_px2: Array) -> "_Fits":
        """With points that a finder measured, in the order of their faces."""
        ring = np.concatenate([self.ring, points.ring])
        order = np.argsort(ring, kind="stable")
        return replace(
            self,
            ring=ring[order],
            center_px=np.concatenate([self.center_px, points.center_px])[order],
            cov_px2=np.concatenate([self.cov_px2, cov_px2])[order],
            room_px=np.concatenate([self.room_px, np.full(len(points.ring), MARK_PX)])[order],
        )


def _measured(pixels: NDArray[np.generic], target: TargetGeometry, named: _Points, camera: Camera | None) -> _Fits:
    """Rounds of prediction and fit: each knows the lens and the blur better, and more points, than the one before."""
    image_size = (pixels.shape[1], pixels.shape[0])
    seen, blur_px, is_soft = named, USUAL_BLUR_PX, False
    lens: Lens | None = None if camera is None else CameraLens(camera)
    for turn in range(ROUNDS):
        # What the finder saw is rougher than what is measured; the last round adds little.
        if camera is None and turn < LENS_ROUNDS:
            lens = _lens_of(target, seen, image_size)
        assert lens is not None  # noqa: S101 - the first round has one
        places = _places(target, seen, lens, image_size)
        fits = _fitted(pixels, target, places, _starts(target, places, seen), blur_px, is_rough=turn < ROUNDS - 1)
        reason = _judged(fits, target, places, np.isin(places.ring, named.ring))
        if turn == ROUNDS - 1 and (reason != "").any():
            # Where something covers a square farther off, what is near the corner tells.
            near = _fitted(pixels, target, places, _starts(target, places, seen), blur_px, is_rough=True)
            fits = fits.or_else(near, reason == "")
            reason = _judged(fits, target, places, np.isin(places.ring, named.ring))
        good = reason == ""
        kept = int(np.isin(named.ring, places.ring[good]).sum())
        if not good.any() or 2 * kept < len(named.ring):
            return _as_found(target, named, kept)
        blur_px = float(np.median(fits.blur_px[good]))
        if blur_px < SOFTENED_BLUR_PX and not is_soft:
            # Not in bytes: rounding would be one more noise.
            pixels = np.asarray(cv2.GaussianBlur(np.asarray(pixels, dtype=np.float32), (3, 3), SOFTENING_PX))
            is_soft, blur_px = True, float(np.hypot(blur_px, SOFTENING_PX))
        seen = _Points(places.ring[good], fits.center_px[good], np.maximum(_sigma_px(fits.cov_px2[good]), SUREST_PX))
    face = np.where(good, 4 * target.ring_face[places.ring] + target.ring_index[places.ring] % 2 @ [2, 1], -1)
    radius_px = np.repeat(fits.half_px[:, None] / np.pi, 2, axis=1)
    ratios = variance_ratios(fits.scores, radius_px, _roughness(fits), face, SOFTENED_RATIO if is_soft else 1.0)
    cov = ratios.ring[:, None, None] * fits.cov_px2
    reason[good & (_sigma_px(cov) > MAX_SIGMA_PX / 2**0.5)] = VAGUE
    good = reason == ""
    missing = [(int(ring), str(why)) for ring, why in zip(places.ring[~good], reason[~good], strict=True)]
    on_seen = np.flatnonzero(np.isin(target.ring_face, target.ring_face[places.ring]))
    missing += [(int(ring), OUTSIDE) for ring in np.setdiff1d(on_seen, places.ring)]
    return _Fits(places.ring[good], fits.center_px[good], cov[good], fits.half_px[good] / 2, tuple(missing))


def _as_found(target: TargetGeometry, named: _Points, good: int) -> _Fits:
    """Where too few fits are corners: crossings that markers name beyond doubt stay as their finder placed them."""
    assert target.marks is not None  # noqa: S101 - who calls has looked
    sure = [face for face, marks in enumerate(target.marks) if marks.marker_ids and marks.is_crossing]
    mine = np.isin(target.ring_face[named.ring], sure)
    if not mine.any():
        return _nothing(named, good)
    cov = np.tile(FOUND_SIGMA_PX**2 * np.eye(2), (int(mine.sum()), 1, 1))
    half = np.full(len(cov), MARK_PX)
    return _Fits(named.ring[mine], named.center_px[mine], cov, half, (), (CLOSE_MARKERS,))


def _nothing(named: _Points, good: int) -> _Fits:
    """Of points that are none."""
    none, count = np.zeros(0, dtype=np.int64), len(named.ring)
    said = TOO_FEW if count < LEAST_POINTS else NOT_CORNERS
    remarks = (said.format(count=count, good=good),) if count else ()
    return _Fits(none, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0), (), remarks)


def _starts(target: TargetGeometry, places: _Places, seen: _Points) -> Array:
    """Where fits begin: at what was seen, else where it is predicted, moved as what was seen nearby is.  # (N, 2)"""
    row = np.searchsorted(seen.ring, places.ring).clip(max=max(len(seen.ring) - 1, 0))
    is_seen = seen.ring[row] == places.ring if len(seen.ring) else np.zeros(len(places.ring), dtype=np.bool_)
    start = places.center_px.copy()
    start[is_seen] = seen.center_px[row[is_seen]]
    moved = start - places.center_px
    face = target.ring_face[places.ring]
    for n in np.flatnonzero(~is_seen).tolist():
        others = np.flatnonzero(is_seen & (face == face[n]))
        away = np.linalg.norm(places.center_px[others] - places.center_px[n], axis=1)
        start[n] += np.median(moved[others[np.argsort(away)[:4]]], axis=0)
    return start


def _fitted(
    pixels: NDArray[np.generic],
    target: TargetGeometry,
    places: _Places,
    start_px: Array,
    blur_px: float,
    is_rough: bool,
) -> CornerFits:
    """The corners of all places."""
    around = _around(target, places)
    px_from_mm = places.px_from_mm * around.way[:, None, :]
    room_px = around.room_mm[:, :1] * np.linalg.norm(px_from_mm, axis=1)
    return fit_corners(
        pixels,
        start_px,
        px_from_mm=px_from_mm,
        farther=places.farther * around.way,
        is_saddle=around.is_saddle,
        room_mm=np.where(room_px.min(axis=1)[:, None] > LEAST_ROOM_PX, around.room_mm, 0.0),
        most_px=MOST_OFF * room_px.min(axis=1) + 1.0,
        blur_px=np.full(len(start_px), blur_px),
        bend=places.bend,
        is_rough=is_rough,
    )


def _around(target: TargetGeometry, places: _Places) -> Neighbourhoods:
    """What is around each place."""
    assert target.marks is not None  # noqa: S101 - who calls has looked
    faces = [neighbourhoods(marks) for marks in target.marks]
    whole = (np.concatenate([getattr(one, name) for one in faces])[places.ring] for name in vars(faces[0]))
    return Neighbourhoods(*whole)


def _judged(fits: CornerFits, target: TargetGeometry, places: _Places, is_named: Flags) -> NDArray[np.str_]:
    """Why fits are refused; empty: they are not.  # (N,)"""
    count = len(fits.ok)
    reason = np.full(count, "", dtype="<U40")
    around = _around(target, places)
    way = places.px_from_mm * around.way[:, None, :]
    room_px = (around.room_mm[:, :1] * np.linalg.norm(way, axis=1)).min(axis=1)
    # A light lone quadrant is brighter; where a board is printed the other way around, all are.
    step = fits.contrast * np.where(around.is_dark, -1.0, 1.0)
    if not fits.ok.any():
        return np.full(count, COVERED)
    good = fits.ok & (np.sign(step) == np.sign(np.median(step[fits.ok])))
    contrast = np.abs(step)
    usual = float(np.median(contrast[good]))
    roughness = _roughness(fits)
    off = fits.center_px - places.center_px
    distance = np.linalg.norm(off, axis=1)
    usual_distance = float(np.median(distance[good]))
    sigma = _sigma_px(fits.cov_px2)
    side = np.sign(np.linalg.det(way))[:, None] * np.array([1.0, -1.0])
    turn = np.arctan2(side * way[:, 1], side * way[:, 0])
    turned = (fits.params[:, TURN : TURN + 2] - turn + np.pi) % (2 * np.pi) - np.pi
    wide = fits.params[:, BLUR : BLUR + 2].max(axis=1)
    usual_wide = float(np.median(wide[good]))
    reason[distance > 8 * usual_distance + 5 * np.where(good, sigma, 0) + 0.1] = OFF_GRID
    reason[distance > MOST_OFF * room_px] = OFF_GRID
    reason[(np.abs(turned) > MOST_TURN_RAD).any(axis=1) | (wide > 3 * usual_wide)] = ODD_SHAPE
    reason[sigma > MAX_SIGMA_PX / 2**0.5] = VAGUE
    # Noise does not shrink with the light.
    darker = np.maximum(usual / np.maximum(contrast, 1e-9), 1.0)
    reason[roughness > 3 * float(np.median(roughness[good])) * darker + 0.04] = COVERED
    reason[(contrast < FAINTEST * usual) | (contrast < LEAST_CONTRAST * fits.noise)] = FAINT
    reason[~good] = COVERED
    reason[~(room_px > LEAST_ROOM_PX)] = TOO_FLAT
    # What no finder has named may be where a cover ends: it has to be where it is predicted.
    if is_named.any():
        reason[~is_named & (distance > NEW_OFF_PX + 3 * float(np.median(distance[is_named])))] = OFF_GRID
    for face in np.unique(target.ring_face[places.ring]).tolist():
        rows = np.flatnonzero((reason == "") & (target.ring_face[places.ring] == face))
        at_mm = target.center_in_face_mm[places.ring[rows], :2]
        reason[rows[strays(at_mm, off[rows], fits.cov_px2[rows])]] = OFF_GRID
    return reason


def strays(at_mm: Array, off_px: Array, cov_px2: Array) -> Flags:
    """Points that are not where those around them are: the edge of a cover is as sharp as a board's.  # (N,)

    Over the neighbours of a point, without it, a linear map of their offsets is fitted, with Cauchy's weights squared;
    what it leaves there is held against all covariances, and against what is usual on the face: lenses and paper bend.
    """
    stray = np.zeros(len(at_mm), dtype=np.bool_)
    var = np.trace(cov_px2, axis1=1, axis2=2) / 2 + STRAY_FLOOR_PX**2
    while (left := np.flatnonzero(~stray)).size > LEAST_AROUND:
        near = nearest_rows(at_mm[left], at_mm[left], AROUND + 1)
        is_other = near != np.arange(len(left))[:, None]
        offset, each = off_px[left[near]], var[left[near]]
        away = at_mm[left[near]] - at_mm[left][:, None]
        linear = np.concatenate([np.ones((*near.shape, 1)), away / np.abs(away).max()], axis=2)
        even = is_other / each
        weight, size = even, np.zeros(near.shape)
        for _ in range(STRAY_ROUNDS):
            by_offset = np.swapaxes(linear * weight[..., None], 1, 2)
            normal = by_offset @ linear
            ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
            by_offset = solve_square(normal + ridge, by_offset)
            size = np.linalg.norm(offset - linear @ (by_offset @ offset), axis=2) / np.sqrt(each)
            usual = np.sort(np.where(is_other, size, np.inf), axis=1)[:, near.shape[1] // 2 - 1, None]
            weight = even / (1 + (size / (2 * usual + 1e-9)) ** 2) ** 2
        share = by_offset[:, 0]
        rest = off_px[left] - np.einsum("nk,nki->ni", share, offset)
        cov = np.einsum("nk,nkij->nij", share**2, cov_px2[left[near]]) + cov_px2[left] + STRAY_FLOOR_PX**2 * np.eye(2)
        deviation = np.sqrt(np.einsum("ni,ni->n", rest, solve_square(cov, rest[..., None])[..., 0]))
        # The worst one of a neighbourhood first: the others may look odd beside it only.
        bad = deviation > STRAY * max(1.0, float(np.median(deviation)))
        bad &= deviation >= deviation[near].max(axis=1)
        if not bad.any():
            break
        stray[left[bad]] = True
    return stray


def _roughness(fits: CornerFits) -> Array:
    return np.asarray(fits.noise / np.maximum(np.abs(fits.contrast), 1e-9))


def _sigma_px(cov_px2: Array) -> Array:
    """Per axis.  # (N, 2, 2) -> (N,)"""
    return np.asarray(np.sqrt(np.abs(np.trace(cov_px2, axis1=1, axis2=2)) / 2))


def _records(target: TargetGeometry, measured: _Fits) -> tuple[FaceRecord, ...]:
    """A record for each face that was found."""
    seen = Counter(target.ring_face[measured.ring].tolist())
    records = []
    for face, count in sorted(seen.items()):
        missing = Counter(why for ring, why in measured.missing if target.ring_face[ring] == face)
        expected = int(np.count_nonzero(target.ring_face == face))
        records.append(FaceRecord(face, (), 0, count, expected, tuple(sorted(missing.items()))))
    return tuple(records)

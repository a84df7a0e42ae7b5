"""How much of the image sightings surround: the same for coarse and fine targets, and for any image size.

A view covers the convex hull of its sightings of a face. Of a grid of cells that does not depend on the resolution
those whose middles lie in a hull are counted, so the share is right to about the hulls' outline times a cell.

The part of the image that a camera is judged over: all of it, or what a wide lens shows: `lit_part(calibration)`.

The image circle of a wide lens may end inside the frame, while its model runs on over the dark. Where the light ends
photos tell (`field_rad` of the camera). Without them the sightings say how far it reaches at least: beyond the farthest
one nothing is asked, and that is said. Nor is anything asked where a wide model has no ray.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.jit import jit
from calib.core.se3 import transform
from calib.core.types import freeze
from calib.solver.accuracy import moved_sigma_px, projected_change, share_px
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Flags, Rows

UNSEEN_RAD = math.radians(5)
"""Where the light ends so far beyond the farthest sighting, the angle is a guess of the lens model."""


@dataclass(frozen=True, eq=False)
class LitPart:
    """What is asked of a camera."""

    camera: Camera  # without rays beyond
    off_axis_rad: float | None  # where it ends; None: all of the image is asked for
    is_measured: bool = True  # where the light ends; else that is where the farthest sighting is
    farthest_rad: float = 0.0  # sighting off the axis

    def is_lit(self, pixel: Array) -> Flags:
        """Whether pixels (..., 2) are in it."""
        if self.off_axis_rad is None:
            return np.ones(pixel.shape[:-1], dtype=np.bool_)
        return np.asarray(np.isfinite(rays(self.camera, pixel)).all(axis=-1))

    @cached_property
    def change(self) -> Array:
        """How each parameter moves what is seen at a grid of its pixels (N, 2, P)."""
        pixel = image_grid(self.camera.image_size).reshape(-1, 2)
        return projected_change(self.camera, pixel[self.is_lit(pixel)])

    @property
    def name(self) -> str:
        """What it is called: "95 % of the image circle"."""
        if self.off_axis_rad is None:
            return "image"
        return "image circle" if self.is_measured else f"image up to {self.end_words}"

    @property
    def end_words(self) -> str:
        """Where it ends, "97° off the axis"; "" if that is the image's border."""
        return "" if self.off_axis_rad is None else f"{math.degrees(self.off_axis_rad):.0f}° off the axis"

    @property
    def remark(self) -> str:
        """Why it ends there, as a sentence; "" if it is all of the image."""
        if self.off_axis_rad is None:
            return ""
        if self.is_measured:
            known = ""
            if self.farthest_rad < self.off_axis_rad - UNSEEN_RAD:
                known = (
                    f" by the lens model, which no observation beyond {math.degrees(self.farthest_rad):.0f}° confirms"
                )
            return f"The light ends {self.end_words}{known}; nothing is asked of the camera beyond."
        return (
            f"The farthest observation is {self.end_words}; nothing is asked of the camera beyond, as only photos tell "
            "whether light arrives there."
        )

    @property
    def box_px(self) -> tuple[Array, Array]:
        """First and last pixel of the box around it (2,), (2,)."""
        last = np.array(self.camera.image_size, dtype=np.float64) - 1
        if self.off_axis_rad is None:
            return np.zeros(2), last
        pixel = image_grid(self.camera.image_size).reshape(-1, 2)
        lit = pixel[self.is_lit(pixel)]
        return (lit.min(axis=0), lit.max(axis=0)) if len(lit) else (np.zeros(2), last)


def lit_part(calibration: Calibration) -> LitPart:
    """The part of the image that a calibration is judged over."""
    camera = calibration.camera
    if not camera.has_dark_corners:
        return LitPart(camera, None)
    seen, counted = calibration.observations, ~calibration.is_outlier
    is_measured = camera.field_rad is not None
    pose = calibration.cam_from_target[seen.view[counted]]
    point = transform(pose, seen.points.position_mm[seen.point[counted]])
    farthest = float(np.arctan2(np.hypot(point[:, 0], point[:, 1]), point[:, 2]).max(initial=0.0))
    reach = farthest if camera.field_rad is None else camera.field_rad / 2
    if not 0 < reach <= math.pi:  # nothing was seen, or nothing is known of poses
        return LitPart(camera, None)
    limited = replace(camera, field_rad=2 * reach)
    pixel = image_grid(camera.image_size)
    has_ray = np.isfinite(rays(limited, pixel)).all(axis=-1)
    return (
        LitPart(camera, None) if has_ray.all() or not has_ray.any() else LitPart(limited, reach, is_measured, farthest)
    )


def sigma_over_lit_px(lit: LitPart, param_covariance: Array) -> float:
    """What 95 % of it stays within (1 sigma); infinite if less is known."""
    return share_px(moved_sigma_px(lit.change, param_covariance))


COLUMNS = 160
"""Of the grid of cells; as many rows as make the cells about square."""
FEWEST_ROWS = 8
BAND = 0.25
"""How far in from the border the corners and edges of an image reach, of its sides."""
BAND_DEG = 15.0
"""Width of the bands of angles off the axis."""
LEAST_LIT = 0.05
"""Of a region: if less of it is lit nothing is said of it."""
NOT_COVERED = 0.5
"""A part of the image of which less than this is covered is called not covered."""
LEAST_OF_HULL = 3
CORNERS = 4
"""Of an image, which has as many edges."""


@dataclass(frozen=True)
class Region:
    """A part of the image, and how much of it is covered."""

    name: str  # "top left corner", "left edge", "centre"
    area: float  # of the image, 0 to 1
    covered: float  # of the region, 0 to 1


@dataclass(frozen=True, eq=False)
class Coverage:
    """The cells of the image that sightings surround."""

    image_size: tuple[int, int]
    views: Rows  # (R, C) how many views cover each cell
    regions: tuple[Region, ...]  # row by row, the upper left corner first
    is_lit: Flags  # (R, C) cells that are asked for
    bands: tuple[Region, ...] = ()  # of angles off the axis, where not all of the image is lit
    area: str = "image"  # what is asked for, in words
    remark: str = ""  # why it is no more

    def __post_init__(self) -> None:
        freeze(self, "views", dtype=np.int64)
        freeze(self, "is_lit", dtype=np.bool_)

    @property
    def is_covered(self) -> Flags:
        """Which cells are covered.  # (R, C)"""
        covered: Flags = self.views > 0
        return covered

    @property
    def share(self) -> float:
        """How much of what is lit is covered, 0 to 1."""
        return self.share_of(self.is_covered)

    def share_of(self, cells: Flags) -> float:
        """How much of what is lit some cells (R, C) are."""
        return float(cells[self.is_lit].mean()) if self.is_lit.any() else 0.0

    @property
    def not_covered(self) -> tuple[Region, ...]:
        """The regions that are mostly not covered."""
        return tuple(region for region in self.regions if region.covered < NOT_COVERED)

    @property
    def missing_words(self) -> str:
        """Where it is mostly not covered: "the left edge", "all of the rim, and 75° to 95° off the axis"; "" if so."""
        regions = region_words(tuple(region.name for region in self.not_covered))
        return ", and ".join(part for part in (regions, self.missing_angles) if part)

    @property
    def missing_angles(self) -> str:
        """Angles at which it is mostly not covered: "75° to 95° off the axis"; "" if none, or all are asked for."""
        return _angle_words([band.name for band in self.bands if band.covered < NOT_COVERED])

    @property
    def middle_px(self) -> Array:
        """The middles of the cells.  # (R, C, 2)"""
        return _middles(self.image_size, (self.views.shape[0], self.views.shape[1]))


def coverage_of(calibration: Calibration) -> Coverage:
    """What the sightings cover that a camera was solved from."""
    seen, counted = calibration.observations, ~calibration.is_outlier
    face = seen.points.face[seen.point]
    return coverage(seen.image_size, seen.center_px[counted], seen.view[counted], face[counted], lit_part(calibration))


def area_of(image_size: tuple[int, int], center_px: Array, face: Rows) -> Flags:
    """The cells that the sightings (N, 2) of one view surround.  # (R, C)"""
    covered: Flags = _views_of(image_size, center_px, np.zeros(len(face), dtype=np.int64), face) > 0
    return covered


def coverage(
    image_size: tuple[int, int], center_px: Array, view: Rows, face: Rows, lit: LitPart | None = None
) -> Coverage:
    """What sightings cover.

    Args:
        image_size: width, height in px.
        center_px: where sightings are (N, 2).
        view: of each (N,).
        face: of each (N,); those on no known face belong together.
        lit: what is asked for; None: all of the image.
    """
    views = _views_of(image_size, center_px, view, face)
    shape = (views.shape[0], views.shape[1])
    if lit is None or lit.off_axis_rad is None:
        is_lit = np.ones(shape, dtype=np.bool_)
        return Coverage(image_size, views, _regions(views > 0, is_lit), is_lit)
    middle = _middles(image_size, shape)
    is_lit = lit.is_lit(middle)
    return Coverage(
        image_size, views, _regions(views > 0, is_lit), is_lit, _bands_of(lit, middle, views > 0), lit.name, lit.remark
    )


def _views_of(image_size: tuple[int, int], center_px: Array, view: Rows, face: Rows) -> Rows:
    """How many views cover each cell.  # (R, C)"""
    width, height = image_size
    shape = max(FEWEST_ROWS, round(COLUMNS * height / width)), COLUMNS
    views = np.zeros(shape, dtype=np.int64)
    # In cells, the middle of the first cell at 0.
    place = (center_px + 0.5) * [shape[1] / width, shape[0] / height] - 0.5
    order = np.lexsort((face, view))
    place, view, face = place[order], view[order], face[order]
    begin = np.flatnonzero(np.diff(view, prepend=-1) | np.diff(face, prepend=-1))
    covered = np.zeros(shape, dtype=np.bool_)
    for first, last in pairwise([*begin.tolist(), len(view)]):
        if last - first >= LEAST_OF_HULL:
            part = place[first:last]
            _add_hull(part[convex_hull(part)], covered)
        if last == len(view) or view[last] != view[first]:
            views += covered
            covered[:] = False
    return views


def _middles(image_size: tuple[int, int], shape: tuple[int, int]) -> Array:
    """The middles of cells.  # (R, C, 2)"""
    (rows, columns), (width, height) = shape, image_size
    u, v = (np.arange(columns) + 0.5) * width / columns - 0.5, (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(u, v), axis=-1)


def _bands_of(lit: LitPart, middle_px: Array, is_covered: Flags) -> tuple[Region, ...]:
    """Bands of angles off the axis; names are their limits in degrees."""
    cosine = rays(lit.camera, middle_px)[..., 2]
    end = math.degrees(lit.off_axis_rad or 0.0)
    limits = [*np.arange(0, end - BAND_DEG / 2, BAND_DEG).tolist(), end]
    angle, found = np.degrees(np.arccos(np.clip(cosine, -1, 1))), []
    for low, high in pairwise(limits):
        part = (angle >= low) & (angle <= high)
        if part.any():
            share = float(part.sum() / np.isfinite(cosine).sum())
            found.append(Region(f"{low:.0f}-{high:.0f}", share, float(is_covered[part].mean())))
    return tuple(found)


def _angle_words(bands: list[str]) -> str:
    """Bands in words, those that touch as one: "75° to 95° off the axis"; "" without any."""
    spans: list[list[str]] = []
    for low, high in (band.split("-") for band in bands):
        if spans and spans[-1][1] == low:
            spans[-1][1] = high
        else:
            spans.append([low, high])
    return f"{' and '.join(f'{low}° to {high}°' for low, high in spans)} off the axis" if spans else ""


def convex_hull(point: Array) -> Rows:
    """Rows of the corners of the convex hull of points (N, 2), in order around it (Andrew 1979)."""
    least = 1e-9 * float(np.abs(point).max(initial=0.0)) ** 2
    return _hull(np.ascontiguousarray(point), np.lexsort((point[:, 1], point[:, 0])), least)


@jit
def _hull(point: Array, order: Rows, least: float) -> Rows:
    """The same of points in order from left to right: there along one side, and back along the other."""
    rows, count = np.empty(2 * len(order) + 1, np.int64), 0
    for step in (1, -1):
        begin = count
        for row in order[::step]:
            while count > begin + 1:
                a, b, c = point[rows[count - 2]], point[rows[count - 1]], point[row]
                if (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > least:
                    break
                count -= 1
            rows[count] = row
            count += 1
        count -= 1
    return rows[:count].copy()


@jit
def _add_hull(outline: Array, covered: Flags) -> None:
    """Mark the integer places (row, column) within a convex outline (K, 2) of column and row.

    A row of the grid cuts the outline in two points; what lies between them is inside.
    """
    for row in range(covered.shape[0]):
        left, right = np.inf, -np.inf
        for k in range(len(outline)):
            x, y = outline[k - 1, 0], outline[k - 1, 1]
            rise = outline[k, 1] - y
            along = (row - y) / rise
            if rise != 0 and 0 <= along <= 1:
                cut = x + along * (outline[k, 0] - x)
                left, right = min(left, cut), max(right, cut)
        for column in range(covered.shape[1]):
            if left <= column <= right:
                covered[row, column] = True


def _regions(is_covered: Flags, is_lit: Flags) -> tuple[Region, ...]:
    """Corners, edges and centre of the box around what is lit, whose corners may be dark."""
    part = slice(*_span(is_lit, 0)), slice(*_span(is_lit, 1))
    is_covered, is_lit, all_lit = is_covered[part], is_lit[part], bool(is_lit.all())
    rows, columns = is_covered.shape
    bands = []
    for count in (rows, columns):
        band = max(1, round(BAND * count))
        bands.append((slice(0, band), slice(band, count - band), slice(count - band, count)))
    found = []
    for vertical, down in zip(("top", "", "bottom"), bands[0], strict=True):
        for horizontal, across in zip(("left", "", "right"), bands[1], strict=True):
            lit = is_lit[down, across]
            if lit.mean() > LEAST_LIT:
                name, covered = _region_name(vertical, horizontal, all_lit), is_covered[down, across][lit]
                found.append(Region(name, covered.size / int(is_lit.sum()), float(covered.mean())))
    return tuple(found)


def _span(is_lit: Flags, axis: int) -> tuple[int, int]:
    """The first row or column of which some is lit, and the one after the last."""
    rows = np.flatnonzero(is_lit.any(axis=1 - axis))
    return (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, is_lit.shape[axis])


def _region_name(vertical: str, horizontal: str, all_lit: bool) -> str:
    if not all_lit and (vertical or horizontal):
        return f"{vertical} {horizontal} rim".strip().replace("  ", " ")
    if vertical and horizontal:
        return f"{vertical} {horizontal} corner"
    return f"{vertical or horizontal} edge" if vertical or horizontal else "centre"


def region_words(names: tuple[str, ...]) -> str:
    """Regions in words, all corners or all edges as such: "all corners and the left edge"."""
    rim = [f"the {name}" for name in names if name.endswith("rim")]
    words = ["all of the rim"] if len(rim) == 2 * CORNERS else rim
    for kind, every in (("corner", "corners"), ("edge", "edges")):
        of_kind = [name for name in names if name.endswith(kind)]
        words += [f"all {every}"] if len(of_kind) == CORNERS else [f"the {name}" for name in of_kind]
    words += ["the centre"] if "centre" in names else []
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""

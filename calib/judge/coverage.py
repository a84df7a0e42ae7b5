"""How much of the image sightings surround: the same for coarse and fine targets, and for any image size.

A view covers the convex hull of its sightings of a face. Of a grid of cells that does not depend on the resolution
those whose middles lie in a hull are counted, so the share is right to about the hulls' outline times a cell.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calib.cameras import rays
from calib.core.jit import jit
from calib.core.types import frozen_array
from calib.judge.lit_part import LitPart, lit_part
from calib.solver.calibration import Calibration

Array = NDArray[np.float64]

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
    views: NDArray[np.int64]  # (R, C) how many views cover each cell
    regions: tuple[Region, ...]  # row by row, the upper left corner first
    is_lit: NDArray[np.bool_]  # (R, C) cells that are asked for
    bands: tuple[Region, ...] = ()  # of angles off the axis, where not all of the image is lit
    area: str = "image"  # what is asked for, in words
    remark: str = ""  # why it is no more

    def __post_init__(self) -> None:
        object.__setattr__(self, "views", frozen_array(self.views, np.int64))
        object.__setattr__(self, "is_lit", frozen_array(self.is_lit, np.bool_))

    @property
    def is_covered(self) -> NDArray[np.bool_]:
        """Which cells are covered.  # (R, C)"""
        covered: NDArray[np.bool_] = self.views > 0
        return covered

    @property
    def share(self) -> float:
        """How much of what is lit is covered, 0 to 1."""
        return self.share_of(self.is_covered)

    def share_of(self, cells: NDArray[np.bool_]) -> float:
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


def coverage(
    image_size: tuple[int, int],
    center_px: Array,
    view: NDArray[np.int64],
    face: NDArray[np.int64],
    lit: LitPart | None = None,
) -> Coverage:
    """What sightings cover.

    Args:
        image_size: width, height in px.
        center_px: where sightings are (N, 2).
        view: of each (N,).
        face: of each (N,); those on no known face belong together.
        lit: what is asked for; None: all of the image.
    """
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
            _add_hull(_hull_of(place[first:last]), covered)
        if last == len(view) or view[last] != view[first]:
            views += covered
            covered[:] = False
    if lit is None or lit.off_axis_rad is None:
        is_lit = np.ones(shape, dtype=np.bool_)
        return Coverage(image_size, views, _regions(views > 0, is_lit), is_lit)
    middle = _middles(image_size, shape)
    is_lit = lit.is_lit(middle)
    return Coverage(
        image_size, views, _regions(views > 0, is_lit), is_lit, _bands_of(lit, middle, views > 0), lit.name, lit.remark
    )


def _middles(image_size: tuple[int, int], shape: tuple[int, int]) -> Array:
    """The middles of cells.  # (R, C, 2)"""
    (rows, columns), (width, height) = shape, image_size
    u, v = (np.arange(columns) + 0.5) * width / columns - 0.5, (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(u, v), axis=-1)


def _bands_of(lit: LitPart, middle_px: Array, is_covered: NDArray[np.bool_]) -> tuple[Region, ...]:
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


def _hull_of(points: Array) -> Array:
    """The outline of the convex hull of points (N, 2).  # (K, 2)"""
    import cv2

    outline: Array = cv2.convexHull(points.astype(np.float32))[:, 0].astype(np.float64)
    return outline


@jit
def _add_hull(outline: Array, covered: NDArray[np.bool_]) -> None:
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


def _regions(is_covered: NDArray[np.bool_], is_lit: NDArray[np.bool_]) -> tuple[Region, ...]:
    """Corners, edges and centre of the box around what is lit, whose corners may be dark."""
    part = slice(*_span(is_lit, 0)), slice(*_span(is_lit, 1))
    is_covered, is_lit, all_lit = is_covered[part], is_lit[part], bool(is_lit.all())
    rows, columns = is_covered.shape
    bands = [_bands(count) for count in (rows, columns)]
    found = []
    for vertical, down in zip(("top", "", "bottom"), bands[0], strict=True):
        for horizontal, across in zip(("left", "", "right"), bands[1], strict=True):
            lit = is_lit[down, across]
            if lit.mean() > LEAST_LIT:
                name, covered = _region_name(vertical, horizontal, all_lit), is_covered[down, across][lit]
                found.append(Region(name, covered.size / int(is_lit.sum()), float(covered.mean())))
    return tuple(found)


def _span(is_lit: NDArray[np.bool_], axis: int) -> tuple[int, int]:
    """The first row or column of which some is lit, and the one after the last."""
    rows = np.flatnonzero(is_lit.any(axis=1 - axis))
    return (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, is_lit.shape[axis])


def _bands(count: int) -> tuple[slice, slice, slice]:
    """The first, middle and last of so many rows or columns."""
    band = max(1, round(BAND * count))
    return slice(0, band), slice(band, count - band), slice(count - band, count)


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

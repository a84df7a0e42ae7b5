"""Why nothing was found in a photo, as far as the things in it that look like rings tell it.

What pattern a photo shows, in words, whatever target was asked for.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.core.types import LEAST_RADIUS_PX, Detections
from calib.detector.borders import reduced, reduction, thresholds
from calib.detector.candidates import Candidates, find_candidates
from calib.detector.grid import Grid, Lattice, grow_grids, lattice_from
from calib.detector.plan import plan_for
from designer.base.arrays import Array
from designer.spec.spec import RING_RATIO
from designer.target import TargetGeometry

FEWEST = 12
"""Things of one size that are no chance any more."""
ALIKE = 1.3
"""Radii up to so many times smaller or larger than the usual one are of one size."""


def explained(seen: Detections, pixels: NDArray[np.generic], target: TargetGeometry) -> Detections:
    """Detections with a remark on why there are none; those with features as they are.

    Args:
        seen: of the photo.
        pixels: of the photo.  # (H, W)
        target: what was looked for.
    """
    if len(seen.ring) or target.marks is not None or pixels.ndim != 2 or min(pixels.shape) < FEWEST:
        return seen
    why = why_nothing(pixels, target)
    return replace(seen, remarks=(*seen.remarks, why)) if why else seen


def why_nothing(pixels: NDArray[np.generic], target: TargetGeometry) -> str:
    """What is in a photo instead of the target, and what to change, in a line; "" if that is not known.

    Rings whose white centre is no longer resolved are dark spots all of one size: then the target is there, and too
    small in the photo.
    """
    factor = reduction((pixels.shape[0], pixels.shape[1]))
    grey, ratio = reduced(pixels, factor), plan_for(target).ratio
    spots, rings = 0, 0
    spot_px = ring_px = 0.0
    shown = ""
    for threshold in thresholds(grey):
        found = find_candidates(grey, threshold, factor, 0, ratio)
        count, radius_px = _of_one_size(found, is_ring=False)
        if count > spots:
            spots, spot_px = count, radius_px
        count, radius_px = _of_one_size(found, is_ring=True)
        if count > rings:
            rings, ring_px = count, radius_px
            shown = looks_like(found)
    if max(spots, rings) < FEWEST:
        return ""
    what, count, radius_px = ("rings", rings, ring_px) if rings >= spots else ("dark spots", spots, spot_px)
    told = f"{count} {what} of about {radius_px:.1f} px radius were seen"
    if shown:  # rings whose order is seen are large and sharp enough to be read
        told = f"{rings} rings of about {ring_px:.1f} px radius were seen, in no order that fits this target"
        return f"{told}: is this the right target file? it looks like {shown}"
    if radius_px < LEAST_RADIUS_PX:
        return f"{told}; rings need about {LEAST_RADIUS_PX:g} px: come nearer, or use a longer lens or more pixels"
    if what == "rings":
        return (
            f"{told}, in no order that fits this target: is this the right target file, is it sharp, and not cut off?"
        )
    return f"{told}, without the white centre of a ring: is it the target of this file, and sharp?"


def _of_one_size(found: Candidates, *, is_ring: bool) -> tuple[int, float]:
    """How many candidates with a white centre, or without one, have about the usual radius, and that radius in px."""
    radius_px = found.radius_px[(found.ratio > 0) == is_ring]
    if not len(radius_px):
        return 0, 0.0
    usual = float(np.median(radius_px))
    alike = radius_px[(radius_px > usual / ALIKE) & (radius_px < usual * ALIKE)]
    return len(alike), float(np.median(alike)) if len(alike) else 0.0  # the middle of two sizes is neither


FEWEST_RINGS = 6
"""Rings of a grid that is more than clutter."""
SAMPLES = 300
NEIGHBOUR = 1.3
"""Neighbours lie closer than this, in distances of the nearest one; the diagonal of a square at 1.41."""
STEPS = {4: np.eye(2), 6: np.array([[1.0, 0.0], [0.5, 0.75**0.5]])}
WORDS = {4: "square", 6: "triangular"}


def looks_like(candidates: Candidates) -> str:
    """The pattern of the rings seen: its lattice, its size as far as it is seen, its proportions; "": none.

    How many fold the lattice is shows around each ring, in the plane that its ellipse tells: a neighbour at the angle
    `a` from another has `exp(n i a) = 1` on an n-fold lattice.
    """
    rings = candidates.take(np.flatnonzero(candidates.ratio > 0))
    if rings.count < FEWEST_RINGS:
        return ""
    near = [_neighbours(rings, ring) for ring in range(0, rings.count, 1 + rings.count // SAMPLES)]
    crowded = [y for y in near if len(y) >= 3]
    if len(crowded) < FEWEST_RINGS:
        return ""
    pitch_radii = float(np.median([np.hypot(*y.T).min() for y in crowded]))
    order = {fold: float(np.mean([_order(y, fold) for y in crowded])) for fold in STEPS}
    fold = max(order, key=lambda n: order[n])
    # Exposure moves both edges of the ink: the sum of the radii is what the print says.
    radius = float(np.median(1 + rings.ratio)) / (1 + RING_RATIO)
    lattice = lattice_from(pitch_radii * STEPS[fold], 1.0)
    grids = [grid for grid in grow_grids(candidates, lattice, across_gaps=False) if len(grid.row) >= FEWEST_RINGS]
    if not grids:
        return ""
    on = f"on a {WORDS[fold]} lattice, their diameter {2 * radius / pitch_radii:.2f} of the pitch"
    columns, rows = _extent(grids[0], lattice)
    if len(grids) > 1:
        return f"{len(grids)} faces with rows of up to {columns} rings {on}"
    return f"a board of {columns} x {rows} rings or more {on}"


def _neighbours(rings: Candidates, ring: int) -> Array:
    """Where the nearest rings of about the same size lie in the plane of one, in its radii.  # (K, 2)"""
    e = rings.ellipse[ring]
    offset = rings.ellipse[:, :2] - e[:2]
    y = np.stack([e[2] * offset[:, 0], e[3] * offset[:, 0] + e[4] * offset[:, 1]], axis=1)
    size = rings.radius_px / rings.radius_px[ring]
    y = y[(size > 1 / NEIGHBOUR) & (size < NEIGHBOUR) & (np.arange(len(y)) != ring)]
    distance = np.hypot(*y.T)
    return np.asarray(y[distance < NEIGHBOUR * distance.min()] if len(y) else y)


def _order(y: Array, fold: int) -> float:
    """How well neighbours stand in an n-fold way, from 0 to 1."""
    return float(np.abs(np.exp(1j * fold * np.arctan2(y[:, 1], y[:, 0])).mean()))


def _extent(grid: Grid, lattice: Lattice) -> tuple[int, int]:
    """The longest row of a grid and the number of its rows, along those rows that make them fewest."""
    extents = []
    for turn in lattice.turns:
        index = grid.index @ turn.T
        _, length = np.unique(index[:, 1], return_counts=True)
        extents.append((int(length.max()), len(length)))
    columns, rows = min(extents, key=lambda extent: (extent[0] * extent[1], -extent[0]))
    return columns, rows

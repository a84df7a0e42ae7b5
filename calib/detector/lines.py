"""The vanishing line at each feature, from its face's grid or from the whole solid."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detector import homography
from calib.detector.lens import Lens, estimate_lens, local_form
from calib.detector.place import Placement
from calib.detector.plan import TargetPlan

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

MIN_FOR_LINE = 6
"""A grid of so many features has a homography with something to spare; fewer leave the vanishing line free."""
OFF_ROW = 3
"""So many of them must stand off any one row: what hangs on a single point shows no misfit when that point is wrong."""


@dataclass(frozen=True, eq=False)
class Seen:
    """N centres as far as they are known."""

    center_px: Floats  # (N, 2)
    sigma_px: Floats  # (N,) per axis
    use: NDArray[np.bool_]  # (N,) whether to trust it


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines at N features, as a prior for their fits."""

    line: Floats  # (N, 2) m of the ring model
    information: Floats  # (N, 2, 2) zero: not known
    residual_px: Floats  # (N, 2) from where the grid puts the feature

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether a feature has a line.  # (N,)"""
        return np.asarray(self.information[:, 0, 0] > 0)


def fit_lens(plan: TargetPlan, ring: Integers, seen: Seen, image_size: tuple[int, int]) -> Lens:
    """The lens from the centres so far."""
    return estimate_lens(plan.by_face(ring[seen.use], seen.center_px[seen.use]), image_size)


def fit_lines(plan: TargetPlan, ring: Integers, seen: Seen, lens: Lens, placement: Placement) -> Lines:
    """Each feature's line from its face's grid, or from the solid where the grid has too little to spare.

    Misfit beyond the centres' own noise (a bent sheet, a lens not modelled) widens the line's covariance.
    """
    count = len(ring)
    line, information = np.zeros((count, 2)), np.zeros((count, 2, 2))
    residual = np.zeros((count, 2))
    face = plan.target.ring_face[ring]
    plane = plan.target.center_in_face_mm[ring, :2]
    straight = lens.straighten(seen.center_px)
    jacobian, _ = local_form(lens, seen.center_px)
    for f in np.unique(face):
        mine = np.flatnonzero(face == f)
        rows = mine[seen.use[mine] & np.isfinite(straight[mine]).all(axis=1)]
        matrix, covariance, base = placement.by_solid[f], np.zeros((8, 8)), plane[mine]
        if len(rows) >= MIN_FOR_LINE and _spans_plane(plan.target.ring_index[ring[rows]], plan):
            own, spread, kept = _weighted_homography(plane[rows], straight[rows], seen.sigma_px[rows])
            if np.isfinite(own).all():
                matrix, covariance, base = own, spread, plane[rows][kept]
        if not np.isfinite(matrix).all():
            continue
        m = homography.vanishing_terms(matrix, straight[mine])
        spread = homography.vanishing_covariance(matrix, base, covariance, straight[mine])
        line[mine] = np.einsum("nji,nj->ni", jacobian[mine], m)
        spread = np.einsum("nji,njk,nkl->nil", jacobian[mine], spread, jacobian[mine])
        # A floor of one part in ten thousand of the line keeps the inverse finite.
        floor = (1e-4 * np.linalg.norm(m, axis=1) + 1e-9) ** 2
        information[mine] = np.linalg.inv(spread + floor[:, None, None] * np.eye(2))
        residual[mine] = seen.center_px[mine] - lens.distort(homography.apply(matrix, plane[mine]))
    return Lines(line, information, residual)


def _spans_plane(index: Integers, plan: TargetPlan) -> bool:
    """Whether a homography has something to spare: OFF_ROW points and more are left without any one row of the grid."""
    for move in plan.lattice.move:
        row = index @ np.array([-move[1], move[0]])
        if len(row) - np.bincount(row - row.min()).max() < OFF_ROW:
            return False
    return True


def _weighted_homography(plane: Floats, straight: Floats, sigma: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Homography and covariance, scaled by the misfit if that is more than the noise; far points left out."""
    weight = 1 / (sigma**2 + 0.003**2)
    matrix, covariance, residual, keep = homography.fit_near(plane, straight, weight, slack=1e-9, least=MIN_FOR_LINE)
    freedom = max(2 * int(keep.sum()) - 8, 1)
    misfit = float((weight * (residual**2).sum(axis=1))[keep].sum()) / freedom
    return matrix, covariance * max(misfit, 1.0), keep

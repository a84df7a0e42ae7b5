"""Over a face: the vanishing line at each feature, and how the blur of a lens changes.

A thin lens spreads a point at depth z over a disc whose diameter goes with `1 / z - 1 / z_focus` (signed). On a plane
1 / z is linear in the image, so with the even blur of lens and pixel the square of the blur s is a quadratic there. The
picture is the mean of what pinholes all over the lens see; along a line across an edge each of them has the edge moved
in proportion to the blur *at the edge*. An edge that is curved moves towards its centre by about s^2 / 2 rho. Where one
side of a ring is blurred more than the other, the whole ring so moves by about s grad s: by hundredths of a pixel, and
by alike amounts on all faces that lean alike, which a camera takes for another focal length.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.core import homography
from calib.core.linear_algebra import least_squares
from calib.detector.candidates import semi_axes_px
from calib.detector.lens import Lens, local_form, scale_to_weigh_with
from calib.detector.place import Placement
from calib.detector.plan import TargetPlan
from calib.detector.wide_guess import guess_lens
from designer.base.arrays import Array, Flags, Rows

LEAST_FOR_SLOPE, LEAST_FOR_QUADRATIC = 6, 12
ROUNDS = 4
FAR_OFF = 2.0
"""Blurs beyond so many robust standard deviations count less (Huber)."""
SHARPEST_PX = 0.3
NOTICED_PX = 0.001
"""Root mean square of s |grad s|: less than this a camera of a hundred thousand edge pixels does not notice."""
NARROW = 4.0
"""Opposite edges run into each other where a hole is hardly wider than the blur, which the model does not know: of
s grad s the share NARROW exp(-r) is left, r being the hole's semi-minor axis in blurs. Measured with a thin lens: .6 at
1.3, .3 at 1.5 and at 2.1, .1 at 2.6, twice of which is taken."""
MIN_FOR_LINE = 6
"""A grid of so many features has a homography with something to spare; fewer leave the vanishing line free."""
CONTRADICTED = 4.0
"""Standard deviations of a line by which one of better centres may differ from it."""
OFF_ROW = 3
"""So many of them must stand off any one row: what hangs on a single point shows no misfit when that point is wrong."""


def blur_growth(center_px: Array, blur_px: Array, is_known: Flags, face: Rows) -> Array:
    """The gradient (N, 2) of the blur's logarithm at each feature, per px; 0 on faces with few whose blur is known."""
    growth = np.zeros_like(center_px)
    for f in np.unique(face[is_known]):
        known = is_known & (face == f)
        count = int(known.sum())
        if count < LEAST_FOR_SLOPE:
            continue
        middle = center_px[known].mean(axis=0)
        size = float(np.abs(center_px[known] - middle).max())
        at = (center_px - middle) / size
        terms = 6 if count >= LEAST_FOR_QUADRATIC else 3
        found = _fitted(_terms(at[known])[:, :terms], blur_px[known] ** 2)
        mine = face == f
        x, y = at[mine].T
        square = _terms(at[mine])[:, :terms] @ found
        a, b, c, d, e = [*found[1:], 0.0, 0.0, 0.0][:5]
        slope = np.stack([a + 2 * c * x + d * y, b + d * x + 2 * e * y], axis=1) / size
        growth[mine] = 0.5 * slope / np.maximum(square, SHARPEST_PX**2)[:, None]
    return growth


def is_noticed(growth: Array, blur_px: Array) -> bool:
    """Whether centres are to be measured with the growth of the blur known.  # (N, 2), (N,)"""
    return len(growth) > 0 and float(np.mean((blur_px**2 * np.linalg.norm(growth, axis=1)) ** 2)) > NOTICED_PX**2


def left_covariance(growth: Array, blur_px: Array, shape: Array, ratio: Array) -> Array:
    """What opposite edges that run into each other may do to centres, of the shapes E (N, 3).  # (N, 2, 2)"""
    hole_px = np.where(ratio > 0, ratio, 1.0) * semi_axes_px(shape)[1]
    left = (NARROW * np.exp(-hole_px / blur_px) * blur_px**2)[:, None] * growth
    return np.asarray(left[:, :, None] * left[:, None, :])


def _terms(at: Array) -> Array:
    """Of a quadratic.  # (N, 2) -> (N, 6)"""
    x, y = at.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def _fitted(terms: Array, values: Array) -> Array:
    """Coefficients by iterated reweighting."""
    weight = np.ones(len(values))
    for _ in range(ROUNDS):
        found = least_squares(terms * weight[:, None], values * weight)
        off = np.abs(values - terms @ found)
        usual = 1.4826 * float(np.median(off)) + 1e-9
        weight = np.sqrt(1 / np.maximum(off / (FAR_OFF * usual), 1.0))
    return np.asarray(found)


@dataclass(frozen=True, eq=False)
class Seen:
    """N centres as far as they are known."""

    center_px: Array  # (N, 2)
    sigma_px: Array  # (N,) per axis
    use: Flags  # (N,) whether to trust it


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines at N features, as a prior for their fits."""

    line: Array  # (N, 2) m of the ring model
    information: Array  # (N, 2, 2) zero: not known
    residual_px: Array  # (N, 2) from where the grid puts the feature

    @property
    def known(self) -> Flags:
        """Whether a feature has a line.  # (N,)"""
        return np.asarray(self.information[:, 0, 0] > 0)


def fit_lens(plan: TargetPlan, ring: Rows, seen: Seen, image_size: tuple[int, int]) -> Lens:
    """The lens from the centres so far."""
    pixel = seen.center_px[seen.use]
    return guess_lens(plan.by_face(ring[seen.use], pixel), image_size).facing(pixel)


def fit_lines(plan: TargetPlan, ring: Rows, seen: Seen, lens: Lens, placement: Placement) -> Lines:
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
    sigma = seen.sigma_px * scale_to_weigh_with(lens, seen.center_px)
    for f in np.unique(face):
        mine = np.flatnonzero(face == f)
        rows = mine[seen.use[mine] & np.isfinite(straight[mine]).all(axis=1)]
        matrix, covariance, base = placement.by_solid[f], np.zeros((8, 8)), plane[mine]
        if len(rows) >= MIN_FOR_LINE and _spans_plane(plan.target.ring_index[ring[rows]], plan):
            own, spread, kept = _weighted_homography(plane[rows], straight[rows], sigma[rows])
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


def with_sound_lines(rough: Lines, fine: Lines) -> Lines | None:
    """Lines of which those that better centres contradict are theirs; None: there are none.

    A ring that is covered in part, and that the pairs of ellipses took for whole, may turn the line of its whole face:
    where it lies far out, the grid follows it, and the misfit that remains does not tell.
    """
    off = fine.line - rough.line
    squares = np.einsum("ni,nij,nj->n", off, rough.information, off)
    contradicted = rough.known & fine.known & (squares > CONTRADICTED**2)
    if not contradicted.any():
        return None
    return replace(rough, line=np.where(contradicted[:, None], fine.line, rough.line))


def _spans_plane(index: Rows, plan: TargetPlan) -> bool:
    """Whether a homography has something to spare: OFF_ROW points and more are left without any one row of the grid."""
    for move in plan.lattice.move:
        row = index @ np.array([-move[1], move[0]])
        if len(row) - np.bincount(row - row.min()).max() < OFF_ROW:
            return False
    return True


def _weighted_homography(plane: Array, straight: Array, sigma: Array) -> tuple[Array, Array, Flags]:
    """Homography and covariance, scaled by the misfit if that is more than the noise; far points left out."""
    weight = 1 / (sigma**2 + 0.003**2)
    matrix, covariance, residual, keep = homography.fit_near(plane, straight, weight, slack=1e-9, least=MIN_FOR_LINE)
    freedom = max(2 * int(keep.sum()) - 8, 1)
    misfit = float((weight * (residual**2).sum(axis=1))[keep].sum()) / freedom
    return matrix, covariance * max(misfit, 1.0), keep

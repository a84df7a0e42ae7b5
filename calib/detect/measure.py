"""Centres of named features to the limit of the pixels: start, vanishing line, direct fit, and the checks after it."""

from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.detect import homography
from calib.detect.candidates import MIN_RADIUS_PX, Candidates, semi_axes_px
from calib.detect.lens import Lens, estimate_lens, local_form
from calib.detect.marks import DOT, RING, read_marks
from calib.detect.pair_fit import fit_pairs
from calib.detect.place import Naming, Placement, Places, predict
from calib.detect.plan import TargetPlan
from calib.detect.ring_fit import RingFits, fit_rings
from calib.detect.ring_model import PARAMETERS

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

MIN_FOR_LINE = 6
"""A grid of so many features has a homography with something to spare; fewer leave the vanishing line free."""

MAX_SIGMA_PX = 0.5
"""Centres less certain than this (2-D) would only do harm to who does not weigh them."""
MANY_RINGS = 600
UNDERSAMPLED_BLUR_PX = 0.5
SOFTENING_PX = 0.5
SOFTENED_SPREAD = 1.25
"""Softening ties neighbouring residuals together; the covariance that takes them for independent grows by this."""

COVERED = "covered, washed out or too blurred"
FAINT = "too little contrast"
ODD_SHAPE = "not the shape a feature has there"
VAGUE = "too blurred to be placed well"
OFF_GRID = "off the grid"
OUTSIDE = "outside the image"
FLAT = "seen too small or too flat"


@dataclass(frozen=True, eq=False)
class Measured:
    """N named features with centres, and why others of the faces that show are missing."""

    ring: Integers  # (N,)
    center_px: Floats  # (N, 2)
    cov_px2: Floats  # (N, 2, 2)
    shape: Floats  # (N, 3) E
    missing: tuple[tuple[int, str], ...]  # row of the target, reason


@dataclass(frozen=True, eq=False)
class _Seen:
    """N centres as far as they are known."""

    center_px: Floats  # (N, 2)
    sigma_px: Floats  # (N,) per axis
    use: NDArray[np.bool_]  # (N,) whether to trust it


def measure(
    image: NDArray[np.generic],
    plan: TargetPlan,
    candidates: Candidates,
    naming: Naming,
    placement: Placement,
    contrast: float,
    camera_lens: Lens | None,
) -> Measured:
    """Fit all features that must be in the image and keep those that prove to be there."""
    image_size = (image.shape[1], image.shape[0])
    places = predict(plan, placement, image_size)
    marks = read_marks(
        image,
        np.hstack([places.center_px, places.shape]),
        ratio=plan.ratio,
        around=0.4 + 0.6 * plan.limit,
        contrast=contrast,
    )
    is_dot = plan.target.is_dot[places.ring]
    named = np.isin(places.ring, naming.ring)
    # What a border already showed to be a ring need not be read again; the rest must look as the target says.
    there = np.where(is_dot, marks == DOT, (marks == RING) | named)
    start = _starts(image, plan, candidates, naming, places, is_dot)
    at = np.flatnonzero(there & (start[:, 8] > 0))
    fits, residual = _fit_with_lines(
        image, plan, places.ring[at], start[at], placement, camera_lens, image_size
    )  # fmt: skip
    reason = _judge(fits, residual, is_dot[at], places.shape[at], plan)
    good = reason == ""
    left_out = np.setdiff1d(np.arange(len(places.ring)), at)
    _, small = semi_axes_px(places.shape[left_out])
    missing = [
        (int(r), FLAT if minor < MIN_RADIUS_PX else COVERED)
        for r, minor in zip(places.ring[left_out], small, strict=True)
    ]
    missing += [(int(r), str(why)) for r, why in zip(places.ring[at][~good], reason[~good], strict=True)]
    on_seen = np.flatnonzero(np.isin(plan.target.ring_face, placement.seen()))
    missing += [(int(r), OUTSIDE) for r in np.setdiff1d(on_seen, places.ring)]
    return Measured(
        ring=places.ring[at][good],
        center_px=fits.center_px[good],
        cov_px2=fits.cov_px2[good],
        shape=fits.params[good, 2:5],
        missing=tuple(missing),
    )


def _starts(
    image: NDArray[np.generic],
    plan: TargetPlan,
    candidates: Candidates,
    naming: Naming,
    places: Places,
    is_dot: NDArray[np.bool_],
) -> Floats:
    """Parameters to start from: pairs of ellipses where a ring was seen, predictions with typical levels elsewhere."""
    count = len(places.ring)
    candidate_of = np.full(plan.target.ring_count, -1, dtype=np.int64)
    candidate_of[naming.ring] = naming.candidate
    candidate = candidate_of[places.ring]
    seen = (candidate >= 0) & ~is_dot
    seen[seen] = candidates.ratio[candidate[seen]] > 0
    start = np.zeros((count, PARAMETERS))
    start[:, :2], start[:, 2:5] = places.center_px, places.shape
    pair = np.zeros((int(seen.sum()), 8))
    pair[:, :5] = candidates.ellipse[candidate[seen]]
    pair[:, 7] = candidates.ratio[candidate[seen]]
    params, rms = fit_pairs(image, pair)
    good = (rms >= 0) & (rms < 1.0 + 0.1 / np.sqrt(np.maximum(params[:, 2] * params[:, 4], 1e-12)))
    if not good.any():
        return start
    rows = np.flatnonzero(seen)[good]
    start[rows] = params[good]
    usual = np.median(params[good], axis=0)
    rest = np.setdiff1d(np.arange(count), rows)
    nearest = _nearest_row(places.center_px[rest], places.center_px[rows])
    start[rest, 8] = usual[8]
    start[rest, 9] = params[good][nearest, 9]
    start[rest, 12] = params[good][nearest, 12]
    start[rest, 7] = np.where(is_dot[rest], 0.0, usual[7])
    return start


def _nearest_row(point: Floats, among: Floats) -> Integers:
    """The nearest of some points to each.  # (N, 2), (M, 2) -> (N,)"""
    offset = point[:, None] - among[None]
    return np.asarray(np.argmin((offset**2).sum(axis=2), axis=1))


def _fit_with_lines(
    image: NDArray[np.generic],
    plan: TargetPlan,
    ring: Integers,
    start: Floats,
    placement: Placement,
    camera_lens: Lens | None,
    image_size: tuple[int, int],
) -> tuple[RingFits, Floats]:
    """Direct fits with the faces' vanishing lines, twice: the second time with lines from the first one's centres."""
    # Dots have not been measured yet: their predicted centres would only repeat the grid.
    seen = _Seen(start[:, :2], np.full(len(ring), 0.1), ~plan.target.is_dot[ring])

    def fit(start: Floats, *, is_final: bool) -> RingFits:
        lens = camera_lens if camera_lens is not None else _lens(plan, ring, seen, image_size)
        line, information, _ = _lines(plan, ring, seen, lens, placement)
        _, bend = local_form(lens, seen.center_px)
        return fit_rings(
            image, start, limit=plan.limit, line=line, line_information=information, bend=bend, is_final=is_final
        )

    # Very many rings give the line from their ellipses alone; a second pass would only repeat the first.
    is_enough = len(ring) > MANY_RINGS
    fits = fit(start, is_final=is_enough)
    if not is_enough:
        start = np.where(fits.ok[:, None], fits.params, start)
        seen = _Seen(start[:, :2], _sigma_px(fits), fits.ok)
        softened = _is_undersampled(fits)
        if softened:
            image, start = _softened(image, start)
        fits = fit(start, is_final=True)
        if softened:
            fits = replace(fits, cov_px2=SOFTENED_SPREAD * fits.cov_px2)
    seen = _Seen(np.where(fits.ok[:, None], fits.center_px, start[:, :2]), _sigma_px(fits), fits.ok)
    lens = camera_lens if camera_lens is not None else _lens(plan, ring, seen, image_size)
    return fits, _lines(plan, ring, seen, lens, placement)[2]


def _sigma_px(fits: RingFits) -> Floats:
    """Standard deviation of the centres per axis; infinite where the fit failed.  # (N,)"""
    return np.asarray(np.where(fits.ok, np.sqrt(np.abs(np.trace(fits.cov_px2, axis1=1, axis2=2)) / 2), np.inf))


def _is_undersampled(fits: RingFits) -> bool:
    """Whether edges are so sharp that where a pixel falls matters more than how much ink it sees."""
    return bool(fits.ok.any()) and float(np.median(fits.params[fits.ok, 8])) < UNDERSAMPLED_BLUR_PX


def _softened(image: NDArray[np.generic], start: Floats) -> tuple[NDArray[np.generic], Floats]:
    """The image blurred by SOFTENING_PX, and starts to fit: halves the error of images without grey edges."""
    soft = np.asarray(cv2.GaussianBlur(np.asarray(image, dtype=np.float32), (0, 0), SOFTENING_PX))
    start = start.copy()
    start[:, 8] = np.hypot(start[:, 8], SOFTENING_PX)
    return soft, start


def _lens(plan: TargetPlan, ring: Integers, seen: _Seen, image_size: tuple[int, int]) -> Lens:
    """The lens from the centres so far."""
    face = plan.target.ring_face[ring]
    plane = plan.target.center_in_face_mm[ring, :2]
    groups = [seen.use & (face == f) for f in np.unique(face)]
    return estimate_lens([(plane[group], seen.center_px[group]) for group in groups], image_size)


def _lines(
    plan: TargetPlan, ring: Integers, seen: _Seen, lens: Lens, placement: Placement
) -> tuple[Floats, Floats, Floats]:
    """Each feature's m with its information from its face's grid, and its distance from that grid in px.

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
        rows = mine[seen.use[mine]]
        if len(rows) >= MIN_FOR_LINE and np.linalg.matrix_rank(plane[rows] - plane[rows[0]], tol=1e-6) == 2:
            matrix, covariance, kept = _weighted_homography(plane[rows], straight[rows], seen.sigma_px[rows])
            base = plane[rows][kept]
        elif np.isfinite(placement.homography[f, 0, 0]) and placement.is_from_solid[f]:
            matrix, covariance, base = placement.homography[f], np.zeros((8, 8)), plane[mine]
        else:
            continue
        m = homography.vanishing_terms(matrix, straight[mine])
        spread = homography.vanishing_covariance(matrix, base, covariance, straight[mine])
        line[mine] = np.einsum("nji,nj->ni", jacobian[mine], m)
        spread = np.einsum("nji,njk,nkl->nil", jacobian[mine], spread, jacobian[mine])
        # A floor of one part in ten thousand of the line keeps the inverse finite.
        floor = (1e-4 * np.linalg.norm(m, axis=1) + 1e-9) ** 2
        information[mine] = np.linalg.inv(spread + floor[:, None, None] * np.eye(2))
        residual[mine] = seen.center_px[mine] - lens.distort(homography.apply(matrix, plane[mine]))
    return line, information, residual


def _weighted_homography(plane: Floats, straight: Floats, sigma: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Homography and covariance, scaled by the misfit if that is more than the noise; far points left out."""
    weight = 1 / (sigma**2 + 0.003**2)
    keep = np.ones(len(plane), dtype=np.bool_)
    matrix, covariance, residual = homography.fit(plane, straight, weight)
    for _ in range(3):
        size = np.sqrt(weight * (residual**2).sum(axis=1))
        new = size <= 5 * np.median(size[keep]) + 1e-9
        if new.sum() < MIN_FOR_LINE or (new == keep).all():
            break
        keep = new
        matrix, covariance, _ = homography.fit(plane[keep], straight[keep], weight[keep])
        residual = straight - homography.apply(matrix, plane)
    freedom = max(2 * int(keep.sum()) - 8, 1)
    misfit = float((weight * (residual**2).sum(axis=1))[keep].sum()) / freedom
    return matrix, covariance * max(misfit, 1.0), keep


def _judge(
    fits: RingFits, residual: Floats, is_dot: NDArray[np.bool_], shape: Floats, plan: TargetPlan
) -> NDArray[np.str_]:
    """Why a fit is refused; empty: it stands.  # (N,)"""
    count = len(fits.ok)
    reason = np.full(count, "", dtype="<U40")
    if not count:
        return reason
    contrast = fits.contrast
    good = fits.ok & (contrast > 0)
    usual_contrast = float(np.median(contrast[good])) if good.any() else 1.0
    roughness = fits.noise / np.maximum(contrast, 1e-9)
    usual_roughness = float(np.median(roughness[good])) if good.any() else 0.0
    area = np.log(np.abs(fits.params[:, 2] * fits.params[:, 4]) / (shape[:, 0] * shape[:, 2]) + 1e-12)
    usual_area = float(np.median(area[good])) if good.any() else 0.0
    ratio = fits.params[:, 7]
    rings = good & ~is_dot
    usual_ratio = float(np.median(ratio[rings])) if rings.any() else plan.ratio
    distance = np.linalg.norm(residual, axis=1)
    sigma = np.sqrt(np.trace(fits.cov_px2, axis1=1, axis2=2))
    usual_distance = float(np.median(distance[good])) if good.any() else 0.0
    reason[distance > 8 * usual_distance + 5 * np.where(good, sigma, 0) + 0.1] = OFF_GRID
    odd = np.abs(area - usual_area) > 0.35
    odd |= ~is_dot & (np.abs(ratio - usual_ratio) > 0.2)
    reason[odd] = ODD_SHAPE
    reason[sigma > MAX_SIGMA_PX] = VAGUE
    reason[roughness > 3 * usual_roughness + 0.04] = COVERED
    reason[contrast < 0.3 * usual_contrast] = FAINT
    reason[~good] = COVERED
    return reason

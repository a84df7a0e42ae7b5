"""Centres of named features to the limit of the pixels: start, vanishing line, direct fit, and the checks after it.

The tone curve of a photo: `light = level ** exponent`, one number from all rings, and the photo without it.

Cameras write levels that are no light: gamma, sRGB, or a curve on top. A lens blurs light, and the ring model adds it
up: through a curve all edges move by as many pixels, and their profiles are skewed. Of a small change d of the exponent
levels y change by `d y ln y`. As skewed profiles have other causes, too, that is held against the residuals by an
instrument: edges that move alike, less what a ring's own parameters take up. A curve that is no power is taken for the
power most like it between ink and white.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.core.types import CUT_OFF, LEAST_RADIUS_PX, OUTSIDE, TOO_FLAT
from calib.detector.candidates import MIN_RADIUS_PX, Candidates, semi_axes_px
from calib.detector.lens import Lens, local_form
from calib.detector.lines import (
    Lines,
    Seen,
    blur_growth,
    fit_lens,
    fit_lines,
    is_noticed,
    left_covariance,
    with_sound_lines,
)
from calib.detector.pair_fit import fit_pairs
from calib.detector.place import Naming, Placement, Places, nearest_rows, predict, usual_nearby
from calib.detector.plan import TargetPlan
from calib.detector.ring_fit import RingFits, fit_rings
from calib.detector.ring_marks import COVERED, DOT, RING, judge, marks_of, zone_levels
from calib.detector.ring_model import (
    BLUR,
    DARKNESS,
    E00,
    E11,
    INK_LIGHT_U,
    INK_LIGHT_V,
    LIGHT_U,
    LIGHT_V,
    PARAMETERS,
    RATIO,
    WHITE,
)
from calib.detector.ring_scores import variance_ratios
from designer.base.arrays import Array, Flags, Rows

Image: TypeAlias = NDArray[np.generic]
Fit: TypeAlias = Callable[[Image, Array, Rows], RingFits]

LEAST, MOST = 0.8, 2.2
"""From 1: of usual encodings it is 1.2, with a curve on top up to 1.7. What else leaves a trace alike comes to .75
(whites cut off), or is far more."""
SURE = 5.0
"""Standard deviations, by how rings of a photo differ."""
FEWEST, ENOUGH = 12, 40
"""Rings, that tell it and that suffice for it."""
ROUNDS, SAME = 4, 0.15
"""After a step this small the next would be by a hundredth."""
LIMITS = 1.0, 3.5
WIDE = 4.0
"""The hole's smaller semi-axis in blurs, of rings that tell it: in narrower ones opposite edges run into each other."""


def some_of(able: Flags) -> Flags:
    """As many rings as suffice, of those that are able, spread over the photo.  # (N,)"""
    rows = np.flatnonzero(able)
    some = np.zeros(len(able), dtype=np.bool_)
    some[rows[:: -(-len(rows) // ENOUGH) or 1]] = True
    return some


def _told(fits: RingFits, is_sound: Flags) -> Flags:
    """Rings that were asked and that can tell.  # (N,)"""
    hole_px = fits.params[:, RATIO] * semi_axes_px(fits.params[:, E00 : E11 + 1])[1]
    return np.asarray(is_sound & (fits.scores.tone[:, 0] != 0) & (hole_px > WIDE * fits.params[:, BLUR]))


def change_of_exponent(fits: RingFits, is_sound: Flags) -> tuple[float, float]:
    """By what factor the exponent is to be changed, less 1, and its standard deviation; 0 and infinite: not told."""
    information, score = fits.scores.tone[_told(fits, is_sound)].T
    if len(score) < FEWEST or not information.sum() > 0:
        return 0.0, np.inf
    change = float(score.sum() / information.sum())
    return change, float(np.linalg.norm(score - change * information) / information.sum())


def without_tone(image: Image, fits: RingFits, is_sound: Flags, fit: Fit) -> tuple[NDArray[np.float32], Array] | None:
    """The photo with its tone curve undone, and parameters to start from; None where levels are light for all one sees.

    Args:
        image: grey levels, uint8 or float32.  # (H, W)
        fits: of the photo as it is.
        is_sound: which to ask.  # (N,)
        fit: of some rows (K,) in another image, from parameters (K, 15).
    """
    change, sigma = change_of_exponent(fits, is_sound)
    if not max(LEAST, SURE * sigma) < change < MOST:
        return None
    rows = np.flatnonzero(_told(fits, is_sound))
    full, exponent = float(np.median(fits.params[is_sound, WHITE])), 1.0
    for _ in range(ROUNDS):
        # To twice or half as much at most: the step is to first order.
        exponent = float(np.clip(exponent * np.clip(1 + change, 0.5, 2.0), *LIMITS))
        if abs(change) < SAME:
            break
        there = fit(_in_light(image, exponent, full), _starts_in_light(fits.params[rows], exponent, full), rows)
        change, sigma = change_of_exponent(there, there.ok)
    if not (np.isfinite(sigma) and exponent > 1 + 0.5 * LEAST):
        return None
    return _in_light(image, exponent, full), _starts_in_light(fits.params, exponent, full)


def _in_light(image: Image, exponent: float, full: float) -> NDArray[np.float32]:
    """`full (level / full) ** exponent`: the usual white stays as it is."""
    if image.dtype == np.uint8:
        table = full * (np.arange(256) / full) ** exponent
        return np.asarray(table.astype(np.float32)[image.view(np.uint8)])
    share = np.maximum(np.asarray(image, dtype=np.float32) * np.float32(1 / full), 0)
    return np.asarray(cv2.pow(share, exponent), dtype=np.float32) * np.float32(full)


def _starts_in_light(params: Array, exponent: float, full: float) -> Array:
    """Parameters to start from there: levels through the curve, light without a gradient."""
    moved, white = params.copy(), np.maximum(params[:, WHITE], 1e-9)
    moved[:, WHITE] = full * (white / full) ** exponent
    moved[:, DARKNESS] = 1 - np.maximum(1 - params[:, DARKNESS], 0) ** exponent
    moved[:, [LIGHT_U, LIGHT_V, INK_LIGHT_U, INK_LIGHT_V]] = 0
    return moved


USUAL_BLUR_PX = 0.8
UNDERSAMPLED_BLUR_PX = 0.65
"""Edges this sharp (as pairs of ellipses see them; pixels alone make .5) hang on where a pixel falls."""
SOFTENING_PX = 0.5
SOFTENED_RATIO = 1.25
"""Of variances, where rings are too few to tell: softening ties neighbouring residuals together."""
WORTH_A_WORD = 4.0
"""Variances of centres so many times those of noise alone are said to be so."""
ODD_EDGES = (
    "edges are no blurred circles, by more than noise (the print, denoising, compression or resampling); the centres' "
    "standard deviations are more than doubled for it"
)
NO_GREY_EDGES = (
    "edges have hardly any grey levels (drawn or resized without smoothing?): centres hang on where pixels fall, and "
    "their standard deviations are more than doubled for it"
)
DARK_FACES = (
    "a face turned to the camera is so dark (in shadow, or covered) that none of its rings could be measured: light "
    "the target from more sides"
)


@dataclass(frozen=True, eq=False)
class Measured:
    """N named features with centres, and why others of the faces that show are missing."""

    ring: Rows  # (N,)
    center_px: Array  # (N, 2)
    cov_px2: Array  # (N, 2, 2)
    shape: Array  # (N, 3) E
    ratio: Array  # (N,) inner over outer radius; 0: a dot
    blur_px: Array  # (N,) standard deviation
    missing: tuple[tuple[int, str], ...]  # row of the target, reason
    remarks: tuple[str, ...] = ()  # what the edges of the photo tell of it


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
    ellipse = np.hstack([places.center_px, places.shape])
    level = zone_levels(image, ellipse, ratio=plan.ratio, around=0.4 + 0.6 * plan.limit)
    is_dot = plan.target.is_dot[places.ring]
    named = np.isin(places.ring, naming.ring)
    step = level[:, 2] - level[:, 1]
    nearby = usual_nearby(plan, places, ~(step > contrast / 3), step, named & (step > 0))
    marks = marks_of(level, np.where(np.isnan(nearby), contrast, np.minimum(nearby, contrast)))
    # What a border already showed to be a ring need not be read again; the rest must look as the target says.
    there = np.where(is_dot & ~(named & (plan.ratio == 0)), marks == DOT, (marks == RING) | named)
    # Flatter ones run into their neighbours' blur, which the model does not know.
    _, small = semi_axes_px(places.shape)
    there &= small >= MIN_RADIUS_PX
    start = _starts(image, plan, candidates, naming, places, is_dot) if plan.ratio > 0 else _discs(places, level)
    at = np.flatnonzero(there & (start[:, BLUR] > 0))
    found = Places(places.ring[at], places.center_px[at], places.shape[at])
    fits, residual_px, remarks = _fit_with_lines(image, plan, found, start[at], placement, camera_lens)
    reason = judge(fits, residual_px, found, plan)
    good = reason == ""
    left_out = np.setdiff1d(np.arange(len(places.ring)), at)
    is_whole = places.are_whole(image_size)
    reason[~good & ~is_whole[at]] = CUT_OFF
    unseen = np.where(small < MIN_RADIUS_PX, TOO_FLAT, np.where(is_whole, COVERED, CUT_OFF))[left_out]
    missing = [(int(r), str(why)) for r, why in zip(places.ring[left_out], unseen, strict=True)]
    missing += [(int(r), str(why)) for r, why in zip(found.ring[~good], reason[~good], strict=True)]
    on_seen = np.flatnonzero(np.isin(plan.target.ring_face, placement.seen()))
    missing += [(int(r), OUTSIDE) for r in np.setdiff1d(on_seen, places.ring)]
    plain = is_whole & (small >= LEAST_RADIUS_PX) & np.isfinite(level).all(axis=1)
    if _has_dark_face(plan, places.ring[plain], level[plain], found.ring[good]):
        remarks = (*remarks, DARK_FACES)
    return Measured(
        ring=found.ring[good],
        center_px=fits.center_px[good],
        cov_px2=fits.cov_px2[good],
        shape=fits.params[good, E00 : E11 + 1],
        ratio=fits.params[good, RATIO],
        blur_px=fits.params[good, BLUR],
        missing=tuple(missing),
        remarks=remarks,
    )


def _has_dark_face(plan: TargetPlan, ring: Rows, level: Array, measured: Rows) -> bool:
    """Whether white is darker, on a face without features measured, than halfway from ink to white on the others."""
    face, lit = plan.target.ring_face[ring], np.unique(plan.target.ring_face[measured])
    is_lit = np.isin(face, lit)
    if not is_lit.any():
        return False
    middle = float(np.median(level[is_lit, 1:3], axis=0).mean())
    return any(float(np.median(level[face == f, 2])) < middle for f in np.setdiff1d(face, lit))


def _starts(
    image: NDArray[np.generic], plan: TargetPlan, candidates: Candidates, naming: Naming, places: Places, is_dot: Flags
) -> Array:
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
    pair[:, RATIO] = candidates.ratio[candidate[seen]]
    params, rms = fit_pairs(image, pair)
    good = (rms >= 0) & (rms < 1.0 + 0.1 / np.sqrt(np.maximum(params[:, E00] * params[:, E11], 1e-12)))
    if not good.any():
        return start
    rows = np.flatnonzero(seen)[good]
    start[rows] = params[good]
    usual = np.median(params[good], axis=0)
    rest = np.setdiff1d(np.arange(count), rows)
    nearest = nearest_rows(places.center_px[rest], places.center_px[rows])[:, 0]
    start[rest, BLUR] = usual[BLUR]
    start[rest, WHITE] = params[good][nearest, WHITE]
    start[rest, DARKNESS] = params[good][nearest, DARKNESS]
    start[rest, RATIO] = np.where(is_dot[rest], 0.0, usual[RATIO])
    return start


def _discs(places: Places, level: Array) -> Array:
    """Parameters to start from where all are dots, from the levels of ink and white.  # (N, 15)"""
    start = np.zeros((len(places.ring), PARAMETERS))
    known = np.flatnonzero(np.isfinite(level).all(axis=1))
    if len(known):
        # Beside the image's edge levels are those of the nearest neighbour.
        level = level[known[nearest_rows(places.center_px, places.center_px[known])[:, 0]]]
        start[:, :2], start[:, E00 : E11 + 1], start[:, BLUR] = places.center_px, places.shape, USUAL_BLUR_PX
        start[:, WHITE], start[:, DARKNESS] = level[:, 2], 1 - level[:, 1] / np.maximum(level[:, 2], 1e-9)
    return start


def _fit_with_lines(
    image: NDArray[np.generic],
    plan: TargetPlan,
    places: Places,
    start: Array,
    placement: Placement,
    camera_lens: Lens | None,
) -> tuple[RingFits, Array, tuple[str, ...]]:
    """Direct fits with the faces' vanishing lines, which the pairs of ellipses give well enough.

    Returns:
        The fits; their distances from where the grid puts them in px (N, 2); what the edges tell of the photo.
    """
    image_size = (image.shape[1], image.shape[0])
    # Where there are dots only, their outlines have told where they are.
    is_dot = plan.target.is_dot[places.ring] & (plan.ratio > 0)

    def lines(seen: Seen) -> tuple[Lens, Lines]:
        lens = placement.lens if camera_lens is not None else fit_lens(plan, places.ring, seen, image_size)
        return lens, fit_lines(plan, places.ring, seen, lens, placement)

    softened = len(start) > 0 and float(np.median(start[:, BLUR])) < UNDERSAMPLED_BLUR_PX
    if softened:
        image, start = _softened(image, start)
    # Dots have not been measured yet: their predicted centres would only repeat the grid.
    seen = Seen(start[:, :2], np.full(len(start), 0.1), ~is_dot)
    lens, known = lines(seen)
    bend, on_face = local_form(lens, seen.center_px)[1], plan.target.ring_face[places.ring]

    def fitted(start: Array, growth: Array | None, tone_asked: Flags | None = None) -> RingFits:
        fits = fit_rings(
            image,
            start,
            limit=plan.limit,
            line=known.line,
            line_information=known.information,
            bend=bend,
            growth=growth,
            tone_asked=tone_asked,
        )
        # One circle alone does not tell where its centre is projected to.
        return replace(fits, ok=fits.ok & (known.known | (start[:, RATIO] > 0)))

    # Without grey edges no tone curve is told.
    fits = fitted(start, None, None if softened else some_of(~is_dot))
    is_sound = judge(fits, None, places, plan) == ""

    def fitted_in(image: NDArray[np.generic], start: Array, rows: Rows) -> RingFits:
        line, information, asked = known.line[rows], known.information[rows], np.ones(len(rows), dtype=np.bool_)
        return fit_rings(
            image, start, limit=plan.limit, line=line, line_information=information, bend=bend[rows], tone_asked=asked
        )

    in_light = without_tone(image, fits, is_sound, fitted_in)
    if in_light is not None:
        image, begin = in_light
        start = np.where(fits.ok[:, None], begin, start)
        fits = fitted(start, None)
    fine = lines(_seen(fits, start, places, plan))[1]
    sounder = with_sound_lines(known, fine) if plan.ratio > 0 else fine
    if sounder is not None:
        known = sounder
        fits = fitted(start, None)
    growth = blur_growth(fits.center_px, fits.params[:, BLUR], fits.ok & ~is_dot, on_face)
    if is_noticed(growth[fits.ok], fits.params[fits.ok, BLUR]):
        fits = fitted(np.where(fits.ok[:, None], fits.params, start), growth)
    sound = judge(fits, None, places, plan) == ""
    face = np.where(sound, plan.target.ring_face[places.ring], -1)
    roughness = fits.noise / np.maximum(fits.contrast, 1e-9)
    ratios = variance_ratios(fits.scores, fits.radii_px, roughness, face, SOFTENED_RATIO if softened else 1.0)
    left = left_covariance(growth, fits.params[:, BLUR], fits.params[:, E00 : E11 + 1], fits.params[:, RATIO])
    fits = replace(fits, cov_px2=ratios.ring[:, None, None] * fits.cov_px2 + left)
    remarks = () if ratios.photo < WORTH_A_WORD else (NO_GREY_EDGES if softened else ODD_EDGES,)
    return fits, lines(_seen(fits, start, places, plan))[1].residual_px, remarks


def _seen(fits: RingFits, start: Array, places: Places, plan: TargetPlan) -> Seen:
    """The centres of fits, to be trusted where these are sound."""
    sigma_px = np.sqrt(np.abs(np.trace(fits.cov_px2, axis1=1, axis2=2)) / 2)
    sound = judge(fits, None, places, plan) == ""
    return Seen(np.where(fits.ok[:, None], fits.center_px, start[:, :2]), sigma_px, sound)


def _softened(image: NDArray[np.generic], start: Array) -> tuple[NDArray[np.generic], Array]:
    """The image blurred by SOFTENING_PX, and starts to fit: halves the error of images without grey edges."""
    # Not in bytes: rounding would be one more noise.
    soft = np.asarray(cv2.GaussianBlur(np.asarray(image, dtype=np.float32), (3, 3), SOFTENING_PX))
    start = start.copy()
    start[:, BLUR] = np.hypot(start[:, BLUR], SOFTENING_PX)
    return soft, start

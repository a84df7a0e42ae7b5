"""Other readings of what was seen: pictures that were turned, columns that were exchanged, lengths in another unit.

A table may be wrong as a whole and yet fit, or fit in part. Each reading is tried, and told only if it explains all.
"""

from dataclasses import replace

import numpy as np

from calib.cameras import COMMON, fitted_models, parameter_names
from calib.core.se3 import transform
from calib.core.types import Observations, keep_sightings
from calib.solver.calibration import Calibration
from calib.solver.free_shape import POSE, whitened_views
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.words import figure, first_few

FEWEST_PHOTOS = 4
BY_CENTRE = 0.2
"""Of the residuals' squares: turned photos are sought if a centre of the image of each photo's own takes up so much."""
ROUNDS = 4
EXPLAINS = 0.25
"""Of the residuals' squares before: with photos turned back no more may be left,"""
EVEN = 3.0
"""and in no photo more than so many times the median's root mean square."""
NAMED = 20
CENTRED, OFF_CENTRE = 0.03, 0.06
"""Of the longer side: as near the middle of the image a principal point is in order, as far from it, it is not."""
SURE = 5.0
"""Standard deviations that a principal point is off the middle, at least."""
NEAR_MM, FAR_MM = 20.0, 1e5
"""Distances to the target that are not usual, so that a unit is asked about."""
USUAL_MM = (60.0, 3e4), (20.0, 6e3)
"""Distances and extents of targets that are usual."""
UNITS = {"micrometres": 1e-3, "centimetres": 10.0, "inches": 25.4, "metres": 1000.0}


def reading_of(calibration: Calibration) -> str:
    """What else the observations are, as a sentence, if it explains all that was seen; "" if they are as they are."""
    if calibration.status == "degenerate" or calibration.camera.learned is not None:
        return ""
    return _exchanged(calibration) or _turned(calibration)


def unit_doubt(calibration: Calibration) -> str:
    """A question about the unit of a target that is seen from nowhere; "" if there is none."""
    points = calibration.observations.points
    used = np.unique(calibration.observations.point)
    if not len(used) or calibration.status == "degenerate":
        return ""
    place = points.position_mm[used]
    distance_mm = float(np.median(np.linalg.norm(transform(calibration.cam_from_target, place.mean(axis=0)), axis=-1)))
    if NEAR_MM <= distance_mm <= FAR_MM or not distance_mm > 0:
        return ""
    span_mm = float(np.ptp(place, axis=0).max())
    able = [
        name
        for name, times in UNITS.items()
        if all(low <= times * size <= high for size, (low, high) in zip((distance_mm, span_mm), USUAL_MM, strict=True))
    ]
    what = f"X, Y, Z in {' or '.join(able)}" if able else "X, Y, Z in another unit"
    return (
        f"taken as mm, the points span {figure(span_mm, 2)} mm and are seen from {figure(distance_mm, 2)} mm: are "
        f"{what}? They count as mm; the camera itself does not depend on it, distances do"
    )


def _exchanged(calibration: Calibration) -> str:
    """Columns u and v exchanged: the principal point lies where it would lie in the image laid on its side."""
    size, center = np.array(calibration.camera.image_size, dtype=np.float64), calibration.camera.params[2:4]
    middle, sigma = 0.5 * (size - 1), np.sqrt(np.diagonal(calibration.stated_covariance)[2:4])
    off, off_exchanged = np.abs(center - middle), np.abs(center[::-1] - middle)
    largest = calibration.observations.center_px[~calibration.is_outlier].max(axis=0, initial=0.0)
    fits = (off_exchanged < CENTRED * size.max()).all() and (largest[::-1] < size).all()
    if not (fits and (off > np.maximum(SURE * sigma, OFF_CENTRE * size.max())).all()):
        return ""
    u, v = center.tolist()
    return (
        f"u and v look exchanged, as row and column of an array are: the principal point lies at {u:.0f}, {v:.0f} px, "
        f"{off.max():.0f} px off the middle of {size[0]:.0f} x {size[1]:.0f} px, and exchanged at {v:.0f}, {u:.0f} px, "
        "in its middle; exchange the columns, or give the size of the pictures as they lie"
    )


def _turned(calibration: Calibration) -> str:
    """Photos that software turned: groups of them that each fit, and all of them when some are turned back."""
    seen, views = calibration.observations, calibration.observations.view_count
    used = keep_sightings(seen, ~calibration.is_outlier)
    if views < FEWEST_PHOTOS or not np.bincount(used.view, minlength=views).all():
        return ""
    center_px, by_centre = _own_centres(calibration)
    if by_centre < BY_CENTRE:
        return ""
    model = calibration.camera.model if calibration.camera.model in fitted_models() else COMMON
    second, found = _second_group(center_px), []
    for back in _turns(seen)[1:]:
        try:
            found.append(_turned_back(used, model, back * second))
        except InputError:
            continue
    settled = [one for one in found if one is not None]
    if not settled:
        return ""
    turns, after = min(settled, key=lambda one: float((one[1] ** 2).mean()))
    before = _rms_px(calibration, views)
    is_even = bool(np.isfinite(after).all()) and after.max() <= EVEN * float(np.median(after))
    if not (turns.any() and is_even and (after**2).mean() <= EXPLAINS * (before**2).mean()):
        return ""
    before_px, after_px = (figure(float(np.sqrt((one**2).mean())), 2) for one in (before, after))
    how = "upside down" if (turns % 2 == 0).all() else "on their side"
    return (
        f"{np.count_nonzero(turns)} of {views} photos look turned {how} against the others: with these turned back, "
        f"all fit to {after_px} px instead of {before_px} px (RMS); turn them back, or the others likewise: "
        f"{_turned_names(seen, turns)}"
    )


def _turns(seen: Observations) -> tuple[int, ...]:
    """Quarter turns after which a picture has its size again."""
    width, height = seen.image_size
    return (0, 1, 2, 3) if width == height else (0, 2)


def _turned_back(used: Observations, model: str, turns: Rows) -> tuple[Rows, Array] | None:
    """By how many quarter turns each view is to be turned to fit best, most not at all, and what is then left over.

    None: it does not settle.

    Raises:
        InputError: pictures turned so do not determine a camera.
    """
    views = used.view_count
    for _ in range(ROUNDS):
        found, last = solve(turned(used, turns), model), turns
        kept = SolveOptions(fixed=tuple(zip(parameter_names(model), found.camera.params.tolist(), strict=True)))
        choices = np.array(_turns(used))
        left = [_rms_px(solve(turned(used, np.full(views, one)), model, kept), views) for one in choices.tolist()]
        turns = choices[np.argmin(left, axis=0)]
        if (last == turns).all():
            usual = int(np.bincount(turns, minlength=4).argmax())
            return (turns - usual) % 4, _rms_px(found, views)
    return None


def _turned_names(seen: Observations, turns: Rows) -> str:
    """The views that are to be turned; with how, if not upside down alone."""
    parts = []
    for quarter in (1, 2, 3):
        names = [name for name, one in zip(seen.view_names, turns.tolist(), strict=True) if one == quarter]
        if names:
            how = "" if (turns % 2 == 0).all() else f" (by {90 * quarter} deg clockwise)"
            parts.append(f"{first_few(names, NAMED)}{how}")
    return "; ".join(parts)


def turned(seen: Observations, turns: Rows) -> Observations:
    """The observations with the picture of each view turned clockwise by so many quarters (V,)."""
    middle, quarter = 0.5 * (np.array(seen.image_size) - 1), np.array([[0, -1], [1, 0]])
    turn = np.stack([np.linalg.matrix_power(quarter, k) for k in range(4)])[turns % 4][seen.view].astype(np.float64)
    center_px = middle + (turn @ (seen.center_px - middle)[:, :, None])[:, :, 0]
    covariance = None if seen.cov_px2 is None else turn @ seen.cov_px2 @ turn.transpose(0, 2, 1)
    return replace(seen, center_px=center_px, cov_px2=covariance)


def _rms_px(found: Calibration, views: int) -> Array:
    """Root mean square length of what is left over in each view (V,); without bound where a view was left out."""
    if found.observations.view_count < views:
        return np.full(views, np.inf)
    used = ~found.is_outlier
    square = np.bincount(found.observations.view[used], (found.residual_px[used] ** 2).sum(axis=1), views)
    count = np.bincount(found.observations.view[used], minlength=views)
    return np.where(count > 0, np.sqrt(square / np.maximum(count, 1)), np.inf)


def _own_centres(calibration: Calibration) -> tuple[Array, float]:
    """By what each photo by itself would shift the image's centre (V, 2), and what share of the squares that takes."""
    shifts, taken, whole = [], 0.0, 0.0
    for view in whitened_views(calibration, np.zeros((len(calibration.camera.params), 0))):
        flat = np.concatenate([view.weight, view.residual], axis=2).reshape(-1, 3)
        across = view.poses_taken().reshape(-1, POSE)
        flat = flat - across @ (across.T @ flat)
        shift = np.linalg.lstsq(flat[:, :2], -flat[:, 2], rcond=None)[0]
        shifts.append(shift)
        taken -= float(flat[:, 2] @ flat[:, :2] @ shift)
        whole += float((flat[:, 2] ** 2).sum())
    return np.array(shifts), taken / whole if whole > 0 else 0.0


def _second_group(shift_px: Array) -> Flags:
    """Which of two groups each of N shifts (N, 2) belongs to, along their longest axis, split where that is widest."""
    off = shift_px - np.median(shift_px, axis=0)
    along = off @ np.linalg.svd(off, full_matrices=False)[2][0]
    order = np.sort(along)
    gap = int(np.argmax(np.diff(order)))
    return np.asarray(along > 0.5 * (order[gap] + order[gap + 1]))

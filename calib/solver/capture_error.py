"""What moves or changes alike in all photos, and what leaving it out may have done to a camera.

    calibration = with_capture_error(calibration, "handheld")
    calibration.capture_error.effects, calibration.stated_covariance

A target that always moves the same way while the shutter rolls, a focal length that follows the distance or the time,
and centres that are off along the tilt, or as the middles of discs' outlines are, displace the sightings of all photos
alike. Poses and lens take up most of it, and halves of the photos agree on it. Each is a parameter more
(`calib.solver.free_shape`). With the precision L of their amplitudes a, what the way of capture lets expect of
them beforehand, N(0, diag(p^2)), and what the camera took of a unit of each, T, the photos leave

    a:  mean m = (L + diag(p^-2))^-1 L a_hat,  covariance S = (L + diag(p^-2))^-1

and as the solution stays as it is, its mean square error is more by `T (S + m m') T'`. Where photos tell an amplitude
that is nothing, little is added; where they tell one, what it did; where they cannot, what the way of capture lets
expect. An amplitude that is beyond chance stands whatever was expected.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from calib.cameras import linearise, project
from calib.cameras.refit import image_grid
from calib.cameras.surface import surface_model
from calib.core.linear_algebra import covariance_with_prior, sums_by, symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.types import KnownPoints
from calib.solver.accuracy import projected_change, share_px
from calib.solver.calibration import Calibration, Capture, CaptureEffect, CaptureError
from calib.solver.free_shape import ExtraParameters, extra_parameters, free_directions
from calib.solver.image_field import with_image_field, with_photo_error
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.words import shown, suggestion_or_all

SURE = 4.0
"""Standard deviations beyond which an amplitude is no chance, of photos without number; of few photos more."""
STEP = 1e-3
"""Of the distance: for second derivatives of the projection."""
FEW = 8.0
"""So many photos that tell an amplitude know its deviation so badly that `SURE` is more by a factor of sqrt 2."""
SAME = 0.1
"""Of the surest amplitude's deviations, those of another may be what its form leaves over."""
ASSUMED: Capture = "still"


@dataclass(frozen=True)
class ErrorKind:
    """Something that is alike in all photos."""

    name: str
    unit: str
    expected: Mapping[Capture, float]  # standard deviation beforehand: assumptions
    remedy: str
    or_solved: str = ""  # another, of a camera by itself


_ROWS = "px from the first row to the last"
_REST = "let target and camera rest while a photo is taken, or take it with a flash or a global shutter"
_FOCUS = "focus by hand and leave focus, zoom and stabilisation alone; let the camera warm up first"
_EDGES = "light the target evenly, and expose less"
_DISCS = "give the images of the discs' centres, not the middles of their outlines, or use rings"
_MOTION: Mapping[Capture, float] = {"still": 0.0, "handheld": 0.1, "moving": 3.0}
KINDS = (
    *(
        ErrorKind(f"a target that moves along {whose} {axis} while the shutter rolls", _ROWS, _MOTION, _REST)
        for whose in ("the camera's", "its own")
        for axis in "xyz"
    ),
    ErrorKind(
        "a focal length that changes with the distance", "‰ from the middle distance to the farthest",
        dict.fromkeys(get_args(Capture), 0.1), _FOCUS, ", or have it solved with --breathing",
    ),
    ErrorKind(
        "a focal length that changes with time", "‰ from the middle photo to the last",
        dict.fromkeys(get_args(Capture), 0.05), _FOCUS,
    ),
    ErrorKind(
        "centres that are off along the tilt", "px where seen from the side", dict.fromkeys(get_args(Capture), 0.05),
        _EDGES,
    ),
    ErrorKind(
        "centres that are off as the middles of discs' outlines are", "px at 45 degrees and the middle distance",
        dict.fromkeys(get_args(Capture), 0.0), _DISCS,
    ),
)  # fmt: skip


def capture_of(word: str | None) -> Capture | None:
    """A way of capture as a person names it; None: none.

    Raises:
        InputError: there is no such way.
    """
    ways: dict[str, Capture] = {"still": "still", "handheld": "handheld", "moving": "moving"}
    if word is None or word in ways:
        return None if word is None else ways[word]
    hint = suggestion_or_all(word, ways)
    raise InputError(f"--capture {shown(word)}: no such way of taking photos{hint}")


@one_thread
def with_capture_error(calibration: Calibration, capture: Capture | None = None) -> Calibration:
    """The calibration with what is alike in all photos, and what is fixed in the image besides; the solution stays.

    Without the former of a learned map or a surface, which are not told by few parameters, and of a camera that the
    photos do not determine, beside which anything seems to move.

    How photos were taken is assumed if `capture` does not say it.
    """
    camera = calibration.camera
    if calibration.status == "degenerate" or camera.learned is not None or surface_model(camera.model) is not None:
        return with_photo_error(with_image_field(replace(calibration, capture_error=None)))
    moved = moved_px(calibration)
    found = extra_parameters(calibration, moved)
    if found is None:
        return with_photo_error(with_image_field(replace(calibration, capture_error=None)))
    way = capture or ASSUMED
    is_solved = [bool(kind.or_solved) and calibration.breathing is not None for kind in KINDS]
    expected = [0.0 if done else kind.expected[way] for kind, done in zip(KINDS, is_solved, strict=True)]
    weighed = weigh(found, np.array(expected))
    sure = list(weighed.sure)
    # A cause that leaves a field in the image over is none, and parameters that are held do what moves things does.
    is_free = free_directions(calibration.param_covariance).shape[1] == len(camera.params)
    rest = calibration.residual_px + moved[:, :, sure] @ weighed.mean[sure]
    field = with_image_field(replace(calibration, residual_px=rest)).image_field
    steps = projected_change(camera, image_grid(camera.image_size).reshape(-1, 2))
    steps = steps[np.isfinite(steps).all(axis=(1, 2))] @ (found.taken[:, sure] * weighed.mean[sure])
    sigma = np.sqrt(np.diagonal(weighed.covariance))
    counts = kinds_that_count(calibration.observations.points)
    effects = tuple(
        CaptureEffect(
            KINDS[row].name, float(weighed.mean[row]), float(sigma[row]), KINDS[row].unit,
            share_px(np.linalg.norm(steps[:, :, number], axis=1)), field is None and is_free,
            KINDS[row].remedy + KINDS[row].or_solved * (not is_solved[row]),
        )
        for number, row in enumerate(sure)
        if counts[row]
    )  # fmt: skip
    square = np.outer(counts, counts) * (weighed.covariance + np.outer(weighed.mean, weighed.mean))
    error = CaptureError(way, "" if capture else "assumed", effects, found.taken @ square @ found.taken.T)
    return with_photo_error(replace(calibration, capture_error=error, image_field=field))


def kinds_that_count(points: KnownPoints) -> Flags:
    """All but what discs do, of points that nobody said are no circles: `calib.solver.circles` tells that.  # (K,)"""
    is_unsaid = points.circle_mm is not None and bool(np.isnan(points.circle_mm).any())
    return np.array([kind.remedy != _DISCS or not is_unsaid for kind in KINDS])


@dataclass(frozen=True, eq=False)
class Weighed:
    """Amplitudes as photos leave them of what was expected."""

    sure: tuple[int, ...]  # rows of those that are beyond chance, the surest first
    mean: Array  # (K,)
    covariance: Array  # (K, K)


def weigh(found: ExtraParameters, expected: Array) -> Weighed:
    """What photos leave of amplitudes of which so much was expected (K,): zero of what is neither expected nor sure."""
    sure: list[int] = []
    beside, limit = found, SURE
    while len(sure) < len(expected):
        times = np.abs(beside.amplitude) / beside.sigma / np.sqrt(1 + FEW / np.maximum(beside.photos, 1.0))
        if not times.max() > limit:
            break
        limit = max(limit, SURE + SAME * float(times.max()))
        sure.append(int(np.argmax(times)))
        beside = found.beside(sure)
    # The sure ones as they are told together; the others by what is left beside them, and what these take of them.
    information, count = found.information, len(expected)
    rows = np.array(sure, dtype=np.int64)
    inverse = symmetric_inverse(information[np.ix_(rows, rows)]).inverse
    root = np.sqrt([found.beside([other for other in sure if other != row]).spread[row] for row in sure])
    alone = beside.variance * root[:, None] * inverse * root
    free = np.array([row for row in range(count) if expected[row] > 0 and row not in sure], dtype=np.int64)
    wide = np.sqrt(beside.variance * beside.spread[free])
    told = beside.information[np.ix_(free, free)] / wide[:, None] / wide
    prior = expected[free]
    left = prior[:, None] * covariance_with_prior(prior[:, None] * told * prior) * prior
    take = np.zeros((count, len(free)))
    take[rows] = -inverse @ information[np.ix_(rows, free)]
    take[free] = np.eye(len(free))
    mean, covariance = np.zeros(count), take @ left @ take.T
    mean[rows] = inverse @ found.pull[rows]
    covariance[np.ix_(rows, rows)] += alone
    return Weighed(tuple(sure), mean + take @ (left @ (beside.pull[free] / wide**2)), covariance)


def moved_px(calibration: Calibration) -> Array:
    """Where a unit of each kind moves the measured centres (M, 2, K)."""
    seen, camera = calibration.observations, calibration.camera
    pose = calibration.cam_from_target[seen.view]
    place = np.einsum("mij,mj->mi", pose[:, :3, :3], seen.points.position_mm[seen.point]) + pose[:, :3, 3]
    linear = linearise(camera, np.ascontiguousarray(place.T))
    by_place, by_params = linear.by_point.transpose(2, 0, 1), linear.by_params.transpose(2, 0, 1)
    distance = np.linalg.norm(place, axis=1)
    count = np.maximum(np.bincount(seen.view, minlength=seen.view_count), 1)
    farther = sums_by(seen.view, distance[:, None], seen.view_count)[:, 0] / count
    middle = float(farther.mean())
    farther -= middle
    late = (seen.center_px[:, 1] + 0.5) / seen.image_size[1] - 0.5
    moving = by_place * (late * middle / camera.params[0])[:, None, None]
    focal = 1e-3 * by_params[:, :, :2] @ camera.params[:2]
    by_distance = focal * (farther / max(float(np.abs(farther).max()), 1e-300))[seen.view, None]
    by_time = focal * np.linspace(-1, 1, seen.view_count)[seen.view, None]
    face = seen.points.face[seen.point]  # -1: on a plane that nobody knows, and so without a tilt
    planes = np.concatenate([seen.points.plane[:, :3], np.zeros((1, 3))])
    normal = np.einsum("mij,mj->mi", pose[:, :3, :3], planes[face])
    ray = place / distance[:, None]
    along = np.where(face[:, None] < 0, 0.0, ray - (ray * normal).sum(axis=1, keepdims=True) * normal)
    ahead = np.einsum("mij,mj->mi", by_place, along)
    sine = np.linalg.norm(along, axis=1, keepdims=True)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-300)
    # The mean of a small disc's image is off by R^2 / 4 times the Laplacian of the projection over the disc's plane.
    bend = np.zeros_like(ahead)
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    for side in (across, np.cross(normal, across)):
        step = STEP * distance[:, None] * side
        apart = project(camera, place + step) + project(camera, place - step) - 2 * project(camera, place)
        bend -= np.nan_to_num(apart) / (STEP * distance[:, None]) ** 2
    outline = middle**2 / camera.params[0] * bend
    by_focus = np.stack([by_distance, by_time, sine * ahead, outline], axis=2)
    return np.concatenate([moving, moving @ pose[:, :3, :3], by_focus], axis=2)

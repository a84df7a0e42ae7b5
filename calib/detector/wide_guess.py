"""The lens of a photo as its grids show it, however wide: radial where that is enough, else the rays of a wide model.

A plane's points X = (x, y, 1) are seen in directions H X. Of the model in `calib.cameras.GUESSED` the focal length is a
factor of H's last row, so that grids tell all the rest of it and not that: any will do, and one is taken with which the
angle grows evenly. H, the centre and the lens's numbers are fitted together to distances in the image, where no angle
is special.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import GUESSED, linearise, neutral, project
from calib.cameras.camera import Camera
from calib.core.linear_algebra import symmetric_inverse
from calib.detector import homography
from calib.detector.lens import (
    FLOOR_PX,
    MIN_POINTS,
    CameraLens,
    Floats,
    Integers,
    Lens,
    estimate_lens,
    local_scale,
    usable_groups,
)

FIXED = 2
"""Parameters before those that grids tell: the focal lengths."""
Groups = list[tuple[Floats, Floats]]

FITS_PX = 0.15
"""A lens that leaves most points nearer than this to where they belong needs no other."""
MOST = 0.8
BETTER = 0.5
"""A wide lens must leave no more than this part of the distances."""
HALF_FIELDS_RAD = np.radians([30.0, 45.0, 65.0, 90.0, 120.0, 150.0])
"""From the middle of the image to its corners: where the fit starts."""
EVEN = np.array([-1 / 3, -1 / 45, -2 / 945])
"""Of `theta cot theta`, in powers of theta squared: angles that grow evenly."""
SPREAD = np.array([0.3, 0.1, 0.05])
CENTRE_SHARE = 0.02
"""What is known beforehand of these numbers, and of the centre in half diagonals, so that few points do not run off."""
USUAL_PX = 0.1
STEPS = 20
CONVERGED = 1e-4
FIRST_DAMPING, MOST_DAMPING = 1e-3, 1e6
TRIMMED = 6.0


def guess_lens(groups: Groups, image_size: tuple[int, int]) -> Lens:
    """The lens that best turns planes' grids into homographies.

    Each group is the points in a plane (N, 2) and their pixels (N, 2).
    """
    radial = estimate_lens(groups, image_size)
    groups = usable_groups(groups)
    if sum(len(plane) for plane, _ in groups) < MIN_POINTS:
        return radial
    before = _distances(radial, groups)
    if np.quantile(before, MOST) <= FITS_PX:
        return radial
    wide = _wide_lens(groups, image_size)
    if wide is None:
        return radial
    after = _distances(wide, groups)
    return wide if np.quantile(after, MOST) < BETTER * np.quantile(before, MOST) else radial


def _distances(lens: Lens, groups: Groups) -> Floats:
    """How far pixels are from where the homography puts them that fits each group best; infinite: nowhere.  # (N,)"""
    off = []
    for plane, pixel in groups:
        straight = lens.facing(pixel).straighten(pixel)
        if not np.isfinite(straight).all():
            off.append(np.full(len(plane), np.inf))
            continue
        scale = local_scale(lens.facing(pixel), pixel)
        residual = homography.fit(plane, straight, 1 / scale**2)[2]
        off.append(np.linalg.norm(residual, axis=1) / scale)
    every = np.concatenate(off)
    return np.where(np.isfinite(every), every, np.inf)


@dataclass(frozen=True, eq=False)
class _Planes:
    """G grids one after the other."""

    plane: Floats  # (N, 3) x, y, 1, each grid at its mean and shrunk to one
    pixel: Floats  # (N, 2)
    first: Integers  # (G,) row where each begins
    group: Integers  # (N,)


@dataclass(frozen=True, eq=False)
class _Guess:
    """A camera, and directions from planes: H (G, 3, 3)."""

    camera: Camera
    cam_from_plane: Floats

    def moved(self, lens: Floats, maps: Floats) -> "_Guess":
        """The guess a step away; the scale of an H is free."""
        params = self.camera.params.copy()
        params[FIXED:] += lens
        h = self.cam_from_plane + maps.reshape(-1, 3, 3)
        return _Guess(replace(self.camera, params=params), h / np.linalg.norm(h, axis=(1, 2), keepdims=True))


def _wide_lens(groups: Groups, image_size: tuple[int, int]) -> CameraLens | None:
    """The best of the descents from all fields of view; None: none shows all points."""
    moved = [homography.moved_to_mean(np.ascontiguousarray(plane))[0] for plane, _ in groups]
    count = np.array([len(plane) for plane in moved])
    plane = np.concatenate(moved)
    planes = _Planes(
        np.column_stack([plane, np.ones(len(plane))]),
        np.concatenate([pixel for _, pixel in groups]),
        np.cumsum(count) - count,
        np.repeat(np.arange(len(count)), count),
    )
    starts = [one for field in HALF_FIELDS_RAD if (one := _start(planes, _even_camera(image_size, field))) is not None]
    if not starts:
        return None
    start = min(starts, key=lambda one: float(np.median(_residual(planes, one))))
    return CameraLens(_descended(planes, start).camera)


def _even_camera(image_size: tuple[int, int], half_field_rad: float) -> Camera:
    """The camera whose angle off the axis grows evenly from the middle of the image to its corners."""
    params = neutral(GUESSED)
    params[:2] = 0.5 * np.hypot(*image_size) / half_field_rad
    params[2:4] = 0.5 * (np.array(image_size) - 1)
    params[4:] = EVEN[: len(params) - 4]
    return Camera(GUESSED, params, image_size)


def _start(planes: _Planes, camera: Camera) -> _Guess | None:
    """The planes before a camera; None: it has no rays there."""
    maps = []
    for plane, pixel in zip(np.split(planes.plane, planes.first[1:]), np.split(planes.pixel, planes.first[1:])):
        lens = CameraLens(camera).facing(pixel)
        straight = lens.straighten(pixel)
        if not np.isfinite(straight).all():
            return None
        h = lens.directions(homography.direct(plane[:, :2], straight))
        maps.append(h / np.linalg.norm(h))
    return _Guess(camera, np.stack(maps))


def _residual(planes: _Planes, guess: _Guess) -> Floats:
    """Distances in the image.  # (N,)"""
    seen = project(guess.camera, np.einsum("nij,nj->ni", guess.cam_from_plane[planes.group], planes.plane))
    return np.linalg.norm(planes.pixel - seen, axis=1)


def _descended(planes: _Planes, guess: _Guess) -> _Guess:
    """Levenberg-Marquardt on the distances, robust (Huber), the numbers of the lens held by what is known of them."""
    start = guess.camera.params[FIXED:]
    half_diagonal_px = 0.5 * float(np.hypot(*guess.camera.image_size))
    sigma = np.concatenate([np.full(2, CENTRE_SHARE * half_diagonal_px), SPREAD[: len(start) - 2]])
    prior = (USUAL_PX / sigma) ** 2
    off = _residual(planes, guess)
    damping = FIRST_DAMPING
    for _ in range(STEPS):
        reach = TRIMMED * float(np.median(off)) + FLOOR_PX
        products = _products(planes, guess, np.minimum(1.0, reach / np.maximum(off, 1e-12)))
        from_start = guess.camera.params[FIXED:] - start
        while damping < MOST_DAMPING:
            lens, maps = _step(products, prior, from_start, damping)
            trial = guess.moved(lens, maps)
            trial_off = _residual(planes, trial)
            gain = _cost(off, reach) + float(prior @ from_start**2)
            gain -= _cost(trial_off, reach) + float(prior @ (from_start + lens) ** 2)
            if gain > 0:
                break
            damping *= 10
        else:
            return guess
        guess, damping = trial, 0.1 * damping
        if gain < CONVERGED * _cost(off, reach):
            return guess
        off = trial_off
    return guess


def _cost(off: Floats, reach: float) -> float:
    """Of distances, Huber's; nan where a point is not seen."""
    return float(np.where(off <= reach, off**2, reach * (2 * off - reach)).sum())


def _products(planes: _Planes, guess: _Guess, weight: Floats) -> Floats:
    """J'J of each plane, with the derivatives by H, by the lens's numbers, and residuals.  # (G, 9 + L + 1, same)"""
    point = np.einsum("nij,nj->in", guess.cam_from_plane[planes.group], planes.plane)
    linear = linearise(guess.camera, point)
    by_map = (linear.by_point[:, :, None] * planes.plane.T).reshape(2, 9, -1)
    residual = planes.pixel.T - linear.pixel
    rows = np.concatenate([by_map, linear.by_params[:, FIXED:], residual[:, None]], axis=1)
    products = np.einsum("can,cbn,n->nab", rows, rows, weight, optimize=True)
    return np.add.reduceat(products, planes.first, axis=0)


def _step(products: Floats, prior: Floats, from_start: Floats, damping: float) -> tuple[Floats, Floats]:
    """The step of the lens's numbers (L,), and of each H (G, 9), which is eliminated."""
    damped = products[:, :9, :9] + damping * np.eye(9) * products[:, :9, :9]
    inverse = symmetric_inverse(damped).inverse
    cross = products[:, :9, 9:]
    rest = (products[:, 9:, 9:] - np.swapaxes(cross, 1, 2) @ inverse @ cross).sum(axis=0)
    normal = rest[:-1, :-1] + damping * np.diag(np.diagonal(rest)[:-1]) + np.diag(prior)
    lens = symmetric_inverse(normal).inverse @ (rest[:-1, -1] - prior * from_start)
    maps = np.einsum("gij,gj->gi", inverse, cross[:, :, -1] - cross[:, :, :-1] @ lens)
    return lens, maps

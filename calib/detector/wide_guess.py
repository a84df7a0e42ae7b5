"""The lens of a photo as its grids show it, however wide: radial where that is enough, else the rays of a wide camera.

A plane's points X = (x, y, 1) are seen in directions H X. The maps H of all planes and the parameters of the camera
`calib.cameras.WIDE` are fitted together to distances in the image, where no angle off the axis is special, from a
camera whose angle grows evenly. What H does not leave to the lens (of a narrow one its focal length) hardly moves.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import linearise, project
from calib.cameras.camera import Camera
from calib.cameras.refit import even_camera
from calib.core import homography
from calib.core.linear_algebra import least_squares, symmetric_inverse
from calib.detector.lens import (
    FLOOR_PX,
    CameraLens,
    Floats,
    Integers,
    Lens,
    radial_lens,
    scale_to_weigh_with,
    usable_groups,
)
from designer.base.errors import InputError

FIRST = 1
"""The parameters from here on are told; the first focal length is as the second."""
Groups = list[tuple[Floats, Floats]]

FITS_PX = 0.15
"""A radial lens that leaves no more (root mean square) is as good as a wide one."""
MOST = 0.8
LEAST_FOR_CUBIC = 14
SMOOTH = 4.0
"""F statistic of what noise does not do in one of a thousand grids."""
BETTER = 0.5
"""A wide lens must leave no more than this part of the distances."""
FIELDS_RAD = np.radians([60.0, 84.0, 112.0, 150.0, 190.0, 240.0, 290.0, 340.0])
"""From corner to corner of the image, of a circle within it far outside: where the fit starts."""
FOCAL_SHARE, CENTRE_SHARE, LENS_SPREAD = 0.3, 0.02, 0.05
"""What is known beforehand of the focal length, as its part, of the centre, in half diagonals, and of the lens's
numbers, so that few points do not run off."""
USUAL_PX = 0.1
STEPS = 100
CONVERGED = 1e-5
FIRST_DAMPING, MOST_DAMPING = 1e-3, 1e6
TRIMMED = 6.0


def guess_lens(
    groups: Groups, image_size: tuple[int, int], likely: Lens | None = None, fits_px: float = FITS_PX
) -> Lens:
    """The lens that best turns planes' grids into homographies.

    Args:
        groups: the points in a plane (N, 2) and their pixels (N, 2), each.
        image_size: width, height in px.
        likely: a lens that is taken instead of a wide one that is fitted, if it does better than a radial one.
        fits_px: a radial lens that leaves no more (root mean square) needs no other.
    """
    groups = usable_groups(groups)
    radial, left_px = radial_lens(groups, image_size)
    if left_px <= fits_px:
        return radial
    off = [_off(radial, *group) for group in groups]
    if not _is_smooth(groups, off):
        return radial
    radial_px = _most(off)
    if likely is not None and _most([_off(likely, *group) for group in groups]) < radial_px:
        return likely
    wide = _wide_lens(groups, image_size)
    is_better = wide is not None and _most([_off(wide, *group) for group in groups]) < BETTER * radial_px
    return wide if wide is not None and is_better else radial


def _off(lens: Lens, plane: Floats, pixel: Floats) -> Floats:
    """From where the homography puts pixels that fits a grid best, in px; infinite: no homography.  # (N, 2)"""
    facing = lens.facing(pixel)
    straight = facing.straighten(pixel)
    if not np.isfinite(straight).all():
        return np.full_like(pixel, np.inf)
    scale = scale_to_weigh_with(facing, pixel)
    residual = homography.fit(plane, straight, 1 / scale**2)[2] / scale[:, None]
    return np.where(np.isfinite(residual), residual, np.inf)


def _most(off: list[Floats]) -> float:
    """The distance that most points keep to."""
    return float(np.quantile(np.linalg.norm(np.concatenate(off), axis=1), MOST, method="higher"))


def _is_smooth(groups: Groups, off: list[Floats]) -> bool:
    """Whether what is left goes evenly over the grids, as of a lens, and not up and down as noise does (F statistic).

    Of the cubics on a plane a homography takes up eight terms of twenty.
    """
    explained = left = freedom = terms = 0.0
    for (plane, _), residual in zip(groups, off, strict=True):
        if not np.isfinite(residual).all():
            return True
        size = np.linalg.norm(residual, axis=1)
        near = size <= TRIMMED * np.median(size)
        x, y = homography.moved_to_mean(np.ascontiguousarray(plane[near]))[0].T
        if len(x) < LEAST_FOR_CUBIC:
            continue
        cubics = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
        rest = residual[near] - cubics @ least_squares(cubics, residual[near])
        explained += float((residual[near] ** 2).sum() - (rest**2).sum())
        left += float((rest**2).sum())
        terms, freedom = terms + 12, freedom + 2 * len(x) - 20
    return terms > 0 and explained / terms > SMOOTH * left / freedom


@dataclass(frozen=True, eq=False)
class _Planes:
    """G grids one after the other."""

    plane: Floats  # (N, 3) x, y, 1, each grid at its mean and shrunk to one
    pixel: Floats  # (N, 2)
    first: Integers  # (G,) row where each begins
    group: Integers  # (N,)


@dataclass(frozen=True, eq=False)
class _WideGuess:
    """A camera, and directions from planes: H (G, 3, 3)."""

    camera: Camera
    cam_from_plane: Floats

    def moved(self, lens: Floats, maps: Floats) -> "_WideGuess":
        """The guess a step away; the scale of an H is free."""
        params = self.camera.params.copy()
        params[0] += lens[0]
        params[FIRST:] += lens
        h = self.cam_from_plane + maps.reshape(-1, 3, 3)
        return _WideGuess(replace(self.camera, params=params), h / np.linalg.norm(h, axis=(1, 2), keepdims=True))


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
    starts = [one for field in FIELDS_RAD if (one := _start(planes, even_camera(image_size, field))) is not None]
    if not starts:
        return None
    start = min(starts, key=lambda one: float(np.median(_residual(planes, one))))
    try:
        return CameraLens(_descended(planes, start).camera)
    except InputError:
        return None  # the descent ran away, to a camera without rays


def _start(planes: _Planes, camera: Camera) -> _WideGuess | None:
    """The planes before a camera; None: it has no rays there."""
    maps = []
    ends = planes.first[1:]
    for plane, pixel in zip(np.split(planes.plane, ends), np.split(planes.pixel, ends), strict=True):
        lens = CameraLens(camera).facing(pixel)
        straight = lens.straighten(pixel)
        if not np.isfinite(straight).all():
            return None
        h = lens.directions(homography.direct(plane[:, :2], straight))
        maps.append(h / np.linalg.norm(h))
    return _WideGuess(camera, np.stack(maps))


def _residual(planes: _Planes, guess: _WideGuess) -> Floats:
    """Distances in the image.  # (N,)"""
    seen = project(guess.camera, np.einsum("nij,nj->ni", guess.cam_from_plane[planes.group], planes.plane))
    return np.asarray(np.linalg.norm(planes.pixel - seen, axis=1))


def _descended(planes: _Planes, guess: _WideGuess) -> _WideGuess:
    """Levenberg-Marquardt on the distances, robust (Huber), the numbers of the lens held by what is known of them."""
    start = guess.camera.params[FIRST:]
    half_diagonal_px = 0.5 * float(np.hypot(*guess.camera.image_size))
    sigma = np.array(
        [FOCAL_SHARE * start[0], *[CENTRE_SHARE * half_diagonal_px] * 2, *[LENS_SPREAD] * (len(start) - 3)]
    )
    prior = (USUAL_PX / sigma) ** 2
    off = _residual(planes, guess)
    damping = FIRST_DAMPING
    for _ in range(STEPS):
        reach = TRIMMED * float(np.median(off)) + FLOOR_PX
        products = _products(planes, guess, np.minimum(1.0, reach / np.maximum(off, 1e-12)))
        from_start = guess.camera.params[FIRST:] - start
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


def _products(planes: _Planes, guess: _WideGuess, weight: Floats) -> Floats:
    """J'J of each plane, with the derivatives by H, by the lens's numbers, and residuals.  # (G, 9 + L + 1, same)"""
    point = np.einsum("nij,nj->in", guess.cam_from_plane[planes.group], planes.plane)
    linear = linearise(guess.camera, point)
    by_map = (linear.by_point[:, :, None] * planes.plane.T).reshape(2, 9, -1)
    residual = planes.pixel.T - linear.pixel
    by_focal = linear.by_params[:, :1] + linear.by_params[:, 1:2]
    rows = np.concatenate([by_map, by_focal, linear.by_params[:, 2:], residual[:, None]], axis=1)
    weighted = rows.swapaxes(0, 1) * np.sqrt(weight)
    parts = [part.reshape(len(weighted), -1) for part in np.split(weighted, planes.first[1:], axis=2)]
    return np.stack([part @ part.T for part in parts])


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

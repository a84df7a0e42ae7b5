"""Lenses that no polynomial describes, and learned maps, for the tests of the virtual camera."""

from dataclasses import replace
from functools import cache

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera, LearnedMap
from calib.cameras.learn_map import MapSamples, learn_map
from calib.core.types import KnownPoints, Observations
from designer.base.arrays import Array
from tests.support.solver_scenes import SIZE, board

FOCAL_PX, CENTRE_PX = 2500.0, np.array([1230.0, 1010.0])
WAVES = ((0.8, 1.3, 0.7, 0.0), (0.5, -0.4, 1.9, 1.6), (0.6, 1.7, -0.5, 0.3), (0.7, 1.0, 1.1, 1.2))
"""Height in px, steps along u and v in 1/500 px, phase; the first two along u, the others along v."""


def waves(pixel: Array) -> Array:
    """A smooth displacement of about a pixel that is not radial.  # (N, 2)"""
    a, b, c, d = (height * np.sin((pixel @ [u, v]) / 500 + phase) for height, u, v, phase in WAVES)
    return np.stack([a + b, c + d], axis=1)


def bent(pixel: Array) -> Array:
    """Where an image's points land through a wavy lens."""
    return pixel + waves(pixel)


def straight(pixel: Array) -> Array:
    """The inverse of `bent`."""
    point = np.array(pixel)
    for _ in range(40):
        point = pixel - waves(point)
    return point


def through_waves(seen: Observations) -> Observations:
    """The observations through a wavy lens on top of the camera's own."""
    return replace(seen, center_px=bent(seen.center_px))


def fisheye_px(direction: Array, focal_px: float = 1500.0) -> Array:
    """Pixels of directions (N, 3) through an equidistant fisheye, `r = f theta`."""
    radius = np.hypot(direction[:, 0], direction[:, 1])
    angle = np.arctan2(radius, direction[:, 2])
    return focal_px * (angle / np.maximum(radius, 1e-12))[:, None] * direction[:, :2] + CENTRE_PX


def board_in(pixel_span: tuple[float, float], columns: int = 21, rows: int = 21) -> Array:
    """A grid of directions that a pinhole of `FOCAL_PX` sees over a part of the image.  # (N, 3)"""
    low, high = (np.array(SIZE) * share for share in pixel_span)
    u, v = np.meshgrid(np.linspace(low[0], high[0], columns), np.linspace(low[1], high[1], rows))
    flat = (np.stack([u.ravel(), v.ravel()], axis=1) - CENTRE_PX) / FOCAL_PX
    return np.column_stack([flat, np.ones(len(flat))])


def samples_of(pixel: Array, point: Array) -> MapSamples:
    """Samples that are all alike."""
    return MapSamples(pixel, point, np.ones(len(pixel)), np.ones(len(pixel), dtype=np.int64))


def sensor_of(direction: Array) -> Array:
    """The pinhole image of directions (N, 3)."""
    point: Array = FOCAL_PX * direction[:, :2] + CENTRE_PX
    return point


@cache
def wavy_map(noise_px: float, seed: int = 0, span: tuple[float, float] = (0.02, 0.98)) -> LearnedMap:
    """A map learned from a grid seen through a wavy lens."""
    direction = board_in(span)
    noise = noise_px * np.random.default_rng(seed).standard_normal((len(direction), 2))
    return learn_map(samples_of(bent(sensor_of(direction)) + noise, sensor_of(direction)), SIZE).map


@cache
def fisheye_map() -> LearnedMap:
    """A map learned through a strong fisheye, which stretches the edge of the image several times."""
    direction = board_in((-0.3, 1.3))
    direction[:, :2] *= 1.6
    pixel = fisheye_px(direction) + 0.02 * np.random.default_rng(0).standard_normal((len(direction), 2))
    return learn_map(samples_of(pixel, sensor_of(direction)), SIZE).map


def virtual_camera(learned: LearnedMap) -> Camera:
    """A virtual camera behind a map."""
    return Camera("virtual", np.array([FOCAL_PX, FOCAL_PX + 10, *CENTRE_PX]), SIZE, learned)


def true_rays(pixel: Array, lens: Camera) -> Array:
    """Directions (N, 3) of light at pixels behind a wavy lens on top of a camera's own."""
    return rays(lens, straight(pixel))


def angle_px(one: Array, other: Array) -> Array:
    """Angles between directions (N, 3) in pixels of `FOCAL_PX`, the best rotation removed; nan where one is.  # (N,)"""
    known = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    a, b = (side / np.linalg.norm(side, axis=1, keepdims=True) for side in (one, other))
    left, _, right = np.linalg.svd(b[known].T @ a[known])
    turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    apart: Array = FOCAL_PX * np.linalg.norm(a - b @ turn, axis=1)
    return apart


def large_board() -> KnownPoints:
    """A board of 300 mm with 21 by 17 points."""
    return board(21, 17, 14.0)

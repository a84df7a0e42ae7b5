"""Light on the target: a lamp that shades faces and mirrors in them, and a gradient across the photo."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.core.se3 import transform
from calib.renderer.trace import polygon_distance

Array = NDArray[np.float64]
Image = NDArray[np.float32]

LEAST_COSINE = 0.3  # of the incidence at the point that mirrors the lamp
LOBE_WIDTH = (0.08, 0.3)  # of the target's size
LAMP_DISTANCE = (1.0, 3.0)  # of the camera's
LOBE_END = 12.0
"""Exponent at which the lobe is cut off: 6e-6 of its peak."""


@dataclass(frozen=True, eq=False)
class Lamp:
    """A small lamp, and how wide a glossy surface spreads its mirror image."""

    position_mm: Array  # (3,) in the camera frame
    lobe_rad: float  # standard deviation of the angle between surface normal and half vector


@dataclass(frozen=True, eq=False)
class Gradient:
    """Light that changes linearly along a direction in the image, and is even beyond the target."""

    middle_px: Array  # (2,)
    per_px: Array  # (2,) change over the mean
    limit: float  # largest change, either way


def place_lamp(center_mm: Array, normal: Array, size_mm: float, rng: np.random.Generator) -> Lamp:
    """A lamp whose mirror image the camera sees on a random one of the features (R, 3), given in the camera frame."""
    to_camera = -center_mm / np.linalg.norm(center_mm, axis=1, keepdims=True)
    cosine = (normal * to_camera).sum(axis=1)
    facing = np.flatnonzero(cosine > LEAST_COSINE)
    row = int(rng.choice(facing)) if len(facing) else int(np.argmax(cosine))
    distance = float(np.linalg.norm(center_mm[row]))
    away = distance * rng.uniform(*LAMP_DISTANCE)
    mirrored = 2 * cosine[row] * normal[row] - to_camera[row]
    # Half of both angles' change with the place on the face turns the lobe's width in mm into an angle.
    lobe = rng.uniform(*LOBE_WIDTH) * size_mm * (1 / distance + 1 / away) / 2
    return Lamp(center_mm[row] + away * mirrored, float(lobe))


def lambert(normal: Array, middle_mm: Array, lamp: Lamp, share: float) -> Array:
    """Light of faces (F,) turned to a lamp, `1 - share + share cos`, over that of the brightest."""
    to_lamp = lamp.position_mm - middle_mm
    cosine = np.maximum(0.0, (normal * to_lamp).sum(axis=1) / np.linalg.norm(to_lamp, axis=1))
    light: Array = 1 - share + share * cosine
    light /= light.max()
    return light


@jit
def lobe(x: float, y: float, camera: Array, lamp: Array, width: float) -> float:
    """The lamp's mirror image at a point of the plane z = 0: `exp(-(1 - cos(half vector, normal)) / width^2)`.

    A Gaussian of the angle for small angles, as in Blinn's microfacet model (1977).
    """
    ax, ay, az = camera[0] - x, camera[1] - y, camera[2]
    bx, by, bz = lamp[0] - x, lamp[1] - y, lamp[2]
    if az <= 0 or bz <= 0:
        return 0.0
    a = 1 / np.sqrt(ax * ax + ay * ay + az * az)
    b = 1 / np.sqrt(bx * bx + by * by + bz * bz)
    hx, hy, hz = ax * a + bx * b, ay * a + by * b, az * a + bz * b
    exponent = (1 - hz / np.sqrt(hx * hx + hy * hy + hz * hz)) / (width * width)
    return float(np.exp(-exponent)) if exponent < LOBE_END else 0.0


@jit
def add_glare(
    ray: Array, face_from_cam: Array, outline: Array, lamp: Array, width: float, peak: float, light: Image
) -> None:
    """Add the lamp's mirror image on one face. `lamp` (3,) is in the face frame, `ray` as in `trace_face`."""
    r, camera = face_from_cam, face_from_cam[:3, 3].copy()
    for row in range(light.shape[0]):
        for column in range(light.shape[1]):
            dx, dy = ray[row + 1, column + 1, 0], ray[row + 1, column + 1, 1]
            w = r[2, 0] * dx + r[2, 1] * dy + r[2, 2]
            if not w * camera[2] < 0:
                continue
            x = camera[0] - camera[2] * (r[0, 0] * dx + r[0, 1] * dy + r[0, 2]) / w
            y = camera[1] - camera[2] * (r[1, 0] * dx + r[1, 1] * dy + r[1, 2]) / w
            if polygon_distance(outline, x, y) < 0:
                light[row, column] += peak * lobe(x, y, camera, lamp, width)


@jit
def glare_at(point: Array, camera: Array, lamp: Array, width: float) -> Array:
    """The lobe at points (N, 2) of a face; camera and lamp (3,) in its frame.  # (N,)"""
    light = np.empty(len(point))
    for n in range(len(point)):
        light[n] = lobe(point[n, 0], point[n, 1], camera, lamp, width)
    return light


def to_face(lamp: Lamp, face_from_cam: Array) -> Array:
    """The lamp (3,) in a face's frame."""
    return transform(face_from_cam, lamp.position_mm)


def make_gradient(low_px: Array, high_px: Array, change: float, rng: np.random.Generator) -> Gradient:
    """A gradient in a random direction; it spans the box (2,) to (2,) around the target."""
    angle = rng.uniform(0, 2 * np.pi)
    direction = np.array([np.cos(angle), np.sin(angle)])
    reach = float(np.abs(direction) @ (high_px - low_px)) / 2
    return Gradient((low_px + high_px) / 2, change / 2 * direction / max(reach, 1.0), change / 2)


def gradient_at(gradient: Gradient, u: Array, v: Array) -> Array:
    """Light over its mean at pixels; u and v are broadcast together."""
    u_part = gradient.per_px[0] * (u - gradient.middle_px[0])
    v_part = gradient.per_px[1] * (v - gradient.middle_px[1])
    light: Array = 1 + np.clip(u_part + v_part, -gradient.limit, gradient.limit)
    return light

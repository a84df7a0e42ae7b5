"""Light on the target (lamp, gradient), through the lens (blur, defocus, dark corners), on the sensor (noise, tone)."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.jit import jit
from calib.core.se3 import transform
from calib.renderer.options import RenderOptions
from calib.renderer.trace import polygon_distance
from designer.base.arrays import Array

Image = NDArray[np.float32]
BAND_ROWS = 256
TAIL = 4.0
"""Standard deviations at which the point-spread function ends."""
LEVEL_PX = 0.5
"""Step of the blurs between which a depth-dependent blur is interpolated."""
Levels = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]
LEAST_COSINE = 0.3  # of the incidence at the point that mirrors the lamp
LOBE_WIDTH = (0.08, 0.3)  # of the target's size
LAMP_DISTANCE = (1.0, 3.0)  # of the camera's
FADE_RAD = math.radians(1.0)
"""Of an image circle, over so much of its rim the light fades."""
RIM_POINTS = 32
LOBE_END = 12.0
"""Exponent at which the lobe is cut off: 6e-6 of its peak."""


def psf_weights(sigma_px: float) -> Array:
    """A sampled Gaussian whose variance is exactly `sigma_px ** 2`.  # (2 N + 1,)

    A Gaussian sampled at whole pixels has less variance than its parameter says once that is below 0.6 px, so the
    parameter is solved for. The function is symmetric: it moves no edge's place, and no centre.
    """
    radius = max(1, math.ceil(TAIL * sigma_px + 1))
    offset = np.arange(-radius, radius + 1)
    low, high = 1e-3, sigma_px + 1.0
    for _ in range(60):
        middle = (low + high) / 2
        weights: Array = np.exp(-0.5 * (offset / middle) ** 2)
        weights /= weights.sum()
        low, high = (middle, high) if weights @ offset**2 < sigma_px**2 else (low, middle)
    return weights


def blurred(light: Image, sigma_px: float) -> Image:
    """The image through a Gaussian point-spread function."""
    weights = psf_weights(sigma_px)
    return np.asarray(cv2.sepFilter2D(light, -1, weights, weights, borderType=cv2.BORDER_REFLECT_101), dtype=np.float32)


def defocus_sigma_px(depth_mm: Image, focus_mm: float, aperture_mm: float, focal_px: float) -> Image:
    """Standard deviation of the blur at each depth, or of a wide lens each range.

    A thin lens spreads a point over a disc of the diameter `f A |1/z - 1/z_focus|`; a disc of diameter c has the
    variance c^2 / 16 along each axis.
    """
    return np.asarray(focal_px * aperture_mm / 4 * np.abs(1 / depth_mm - 1 / focus_mm), dtype=np.float32)


def blurred_by(light: Image, sigma_px: Image) -> Image:
    """The image with a blur of its own at each pixel, interpolated in the variance between a few even blurs."""
    result = np.empty_like(light)
    lowest, highest = float(sigma_px.min()), float(sigma_px.max())
    count = max(1, math.ceil((highest - lowest) / LEVEL_PX))
    levels = np.linspace(lowest, max(highest, lowest + 1e-3), count + 1, dtype=np.float32)
    halo = math.ceil(TAIL * highest + 1) + 1
    for top in range(0, len(light), BAND_ROWS):
        first = max(0, top - halo)
        source = light[first : top + BAND_ROWS + halo]
        rows = slice(top - first, top - first + min(BAND_ROWS, len(light) - top))
        sigma = sigma_px[top : top + BAND_ROWS]
        below = np.clip((sigma - levels[0]) / (levels[1] - levels[0]), 0, count - 1).astype(np.int32)
        share = (sigma**2 - levels[below] ** 2) / (levels[below + 1] ** 2 - levels[below] ** 2)
        band = np.zeros_like(sigma)
        for n in np.flatnonzero(np.bincount(below.ravel(), minlength=count)).tolist():
            is_here = below == n
            for level, weight in ((n, 1 - share), (n + 1, share)):
                even = blurred(source, float(levels[level])) if levels[level] > 0 else source
                np.add(band, weight * even[rows], out=band, where=is_here)
        result[top : top + BAND_ROWS] = band
    return result


def vignette(u: Array, v: Array, camera: Camera, loss: float) -> Array:
    """Light that reaches pixels, over that in the middle: `1 - loss (r / r_end)^2`; r_end: corner or image circle."""
    middle = (np.array(camera.image_size) - 1) / 2
    end = float(middle @ middle)
    if camera.field_rad is not None:
        angle = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
        half = camera.field_rad / 2 * (1 - 1e-9)
        side = math.sin(half) * np.array([np.cos(angle), np.sin(angle)])
        rim_px = project(camera, np.column_stack([*side, np.full(RIM_POINTS, math.cos(half))]))
        end = float(np.fmin(end, ((rim_px - middle) ** 2).sum(axis=1).max()))
    square = np.minimum(((u - middle[0]) ** 2 + (v - middle[1]) ** 2) / max(end, 1.0), 1.0)
    light: Array = 1 - loss * square
    return light


def in_full_light(camera: Camera) -> Camera:
    """The camera without the rim of its image circle, over which the light fades."""
    if camera.field_rad is None:
        return camera
    return replace(camera, field_rad=max(camera.field_rad - 2 * FADE_RAD, FADE_RAD))


def circle_light(camera: Camera, ray: Array) -> Array:
    """Share of the light that reaches pixels (...) from directions (..., 3): none beyond the image circle."""
    cosine = ray[..., 2]
    if camera.field_rad is None:
        return np.where(np.isnan(cosine), 0.0, 1.0)
    inside = camera.field_rad / 2 - np.arccos(np.clip(cosine, -1, 1))
    return np.nan_to_num(np.clip(inside / FADE_RAD, 0.0, 1.0))


def add_noise(light: Image, even_sigma: float, full_well: float, rng: np.random.Generator) -> None:
    """Add even noise, and shot noise in its normal limit: its variance is the light over the full well's electrons."""
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    if full_well:
        noise *= np.sqrt(np.maximum(light, 0) / np.float32(full_well) + np.float32(even_sigma**2))
    else:
        noise *= np.float32(even_sigma)
    light += noise


def quantised(light: Image, options: RenderOptions) -> Levels:
    """Light as the file's numbers: clipped, through the tone curve, rounded; unchanged for 32 bits."""
    if options.bits == 32:
        return light
    shown = np.clip(light, 0, 1)
    if options.gamma != 1:
        shown **= np.float32(1 / options.gamma)
    shown *= 2**options.bits - 1
    np.rint(shown, out=shown)
    return shown.astype(np.uint8) if options.bits == 8 else shown.astype(np.uint16)


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
            dx, dy, dz = ray[row + 1, column + 1, 0], ray[row + 1, column + 1, 1], ray[row + 1, column + 1, 2]
            w = r[2, 0] * dx + r[2, 1] * dy + r[2, 2] * dz
            if not w * camera[2] < 0:
                continue
            x = camera[0] - camera[2] * (r[0, 0] * dx + r[0, 1] * dy + r[0, 2] * dz) / w
            y = camera[1] - camera[2] * (r[1, 0] * dx + r[1, 1] * dy + r[1, 2] * dz) / w
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

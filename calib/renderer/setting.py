"""What is drawn at random around the target for one view, and which rings it leaves clean."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.linear_algebra import solve_square
from calib.core.se3 import transform
from calib.renderer.faces import Box, RingTruth, SeenFace, union
from calib.renderer.light import (
    Gradient,
    Lamp,
    glare_at,
    gradient_at,
    lambert,
    make_gradient,
    place_lamp,
    to_face,
    vignette,
)
from calib.renderer.options import RenderOptions
from calib.renderer.scene import RenderScene
from designer.base.arrays import Array, Flags, Rows

Grey = NDArray[np.uint8]
SHIFT = 4  # bits of sub-pixel places in OpenCV's drawing
BLOB_CORNERS = 48
MASK_SIDE_PX = 256
MAX_SHAPES, MAX_TRIES = 60, 400
OVERSHOOT = 0.02
RING_RADIUS = (0.003, 0.02)  # of the image's width
SHAPE_SIZE = (0.01, 0.12)


TOUCH_MARGIN_PX = 2.0
BLUR_REACH = 3.0
"""Standard deviations of the blur from which an occluder still touches a ring."""
FULL_SCALE = 1.001
WASHED_OUT = 0.5
"""Glare over contrast from which a ring is washed out."""


@dataclass(frozen=True, eq=False)
class Occluders:
    """What stands in front of the target."""

    grey: Grey  # (H, W) its light, 255 = full scale
    share: Grey  # (H, W) how much of the pixel it covers, 255 = all


def fill(image: Grey, polygon_px: Array, grey: int) -> None:
    """Draw an anti-aliased polygon (K, 2)."""
    points = np.clip(np.rint(polygon_px * 2**SHIFT), -(2**26), 2**26).astype(np.int32)
    cv2.fillPoly(image, [points], (grey,), lineType=cv2.LINE_AA, shift=SHIFT)


def blob(middle_px: Array, radius_px: float, rng: np.random.Generator) -> Array:
    """A smooth closed curve around a point.  # (K, 2)"""
    angle = 2 * np.pi * np.arange(BLOB_CORNERS) / BLOB_CORNERS
    radius = np.ones(BLOB_CORNERS)
    for order in range(1, 5):
        radius += 0.35 / order * rng.uniform() * np.cos(order * angle + rng.uniform(0, 2 * np.pi))
    radius *= radius_px / math.sqrt(float((radius**2).mean()))
    curve: Array = middle_px + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return curve


def rod(middle_px: Array, length_px: float, width_px: float, rng: np.random.Generator) -> Array:
    """A long thin rectangle in a random direction.  # (4, 2)"""
    angle = rng.uniform(0, 2 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle)]) * length_px / 2
    across = np.array([-np.sin(angle), np.cos(angle)]) * width_px / 2
    corners: Array = middle_px + np.array([along + across, along - across, -along - across, across - along])
    return corners


def clutter(image_size: tuple[int, int], count: int, background: float, rng: np.random.Generator) -> Grey:
    """A background (H, W) with shapes, every second of them rings that are not the target's."""
    width, height = image_size
    image = np.full((height, width), round(255 * background), dtype=np.uint8)
    for number in range(count):
        middle = rng.uniform([0, 0], [width, height])
        if number % 2:
            _draw_rings(image, middle, width * rng.uniform(*RING_RADIUS), rng)
        else:
            size = width * rng.uniform(*SHAPE_SIZE)
            is_rod = rng.uniform() < 0.4
            shape = rod(middle, 4 * size, 0.3 * size, rng) if is_rod else blob(middle, size, rng)
            fill(image, shape, int(rng.integers(256)))
    return image


def _draw_rings(image: Grey, middle_px: Array, radius_px: float, rng: np.random.Generator) -> None:
    """One to six rings or dots on a light patch, in rows as on a target but tilted and squeezed."""
    turn, squeeze = rng.uniform(0, np.pi), rng.uniform(0.3, 1.0)
    cosine, sine = np.cos(turn), np.sin(turn)
    affine = radius_px * np.array([[cosine, -sine * squeeze], [sine, cosine * squeeze]])
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    dark, pale = int(rng.integers(0, 80)), int(rng.integers(150, 256))
    pitch = rng.uniform(2.3, 3.5)
    half = np.array([columns, rows]) * pitch / 2
    patch = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    fill(image, middle_px + patch @ affine.T, pale)
    angle = 2 * np.pi * np.arange(BLOB_CORNERS) / BLOB_CORNERS
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    for column in range(columns):
        for row in range(rows):
            place = (np.array([column, row]) - (np.array([columns, rows]) - 1) / 2) * pitch
            fill(image, middle_px + (place + circle) @ affine.T, dark)
            if rng.uniform() < 0.8:
                fill(image, middle_px + (place + rng.uniform(0.3, 0.7) * circle) @ affine.T, pale)


def occlude(
    image_size: tuple[int, int], silhouette_px: list[Array], hidden: float, rng: np.random.Generator
) -> Occluders:
    """Blobs and rods in front of the target that hide a share of its silhouette, a union of convex polygons (K, 2)."""
    width, height = image_size
    result = Occluders(np.zeros((height, width), np.uint8), np.zeros((height, width), np.uint8))
    corners = np.concatenate([np.zeros((0, 2)), *silhouette_px])
    if not len(corners):
        return result
    low = np.clip(corners.min(axis=0), 0, [width - 1, height - 1])
    high = np.clip(corners.max(axis=0), 0, [width - 1, height - 1])
    scale = MASK_SIDE_PX / max(float((high - low).max()), 1.0)
    mask = np.zeros(np.ceil((high - low)[::-1] * scale).astype(int) + 1, np.uint8)
    for polygon in silhouette_px:
        fill(mask, (polygon - low) * scale, 255)
    inside = mask >= 128
    whole = max(1, int(inside.sum()))
    covered = np.zeros_like(mask)
    shapes = 0
    for _ in range(MAX_TRIES):
        missing = hidden - float((covered[inside] >= 128).sum()) / whole
        if missing <= OVERSHOOT / 2 or shapes == MAX_SHAPES:
            break
        shape = _occluder(low, high, missing * whole / scale**2, rng)
        trial = covered.copy()
        fill(trial, (shape - low) * scale, 255)
        if float((trial[inside] >= 128).sum()) / whole > hidden + OVERSHOOT:
            continue
        covered, shapes = trial, shapes + 1
        fill(result.grey, shape, int(rng.integers(0, 230)))
        fill(result.share, shape, 255)
    # Where a shape's edge is anti-aliased its grey is mixed with nothing; widen it so that `share` alone mixes.
    cv2.dilate(result.grey, np.ones((3, 3), np.uint8), dst=result.grey)
    return result


def _occluder(low_px: Array, high_px: Array, area_px2: float, rng: np.random.Generator) -> Array:
    """A shape in a box that covers at most about the area asked for."""
    middle = rng.uniform(low_px, high_px)
    size = float(np.linalg.norm(high_px - low_px))
    if rng.uniform() < 0.3:
        width = min(area_px2 / size * 1.5, size * rng.uniform(0.01, 0.06))
        return rod(middle, 2 * size, max(width, 1.0), rng)
    radius = min(math.sqrt(area_px2 / math.pi) * rng.uniform(0.4, 1.0), 0.25 * size)
    return blob(middle, max(radius, 1.0), rng)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """One view's surroundings; None where an effect is off."""

    lamp: Lamp | None
    gradient: Gradient | None
    background: Grey | None  # (H, W)
    occluders: Occluders | None


def make_setting(
    scene: RenderScene,
    faces: list[SeenFace],
    camera: Camera,
    cam_from_target: Array,
    options: RenderOptions,
    streams: list[np.random.Generator],
) -> Surroundings:
    """Draw the surroundings; each effect has a stream of its own, so that it is the same whatever else is on."""
    lamp_rng, gradient_rng, clutter_rng, occluder_rng = streams
    lamp, gradient, background, occluders = None, None, None, None
    if (options.shading or options.glare) and faces:
        center = transform(cam_from_target, scene.center_mm)
        size = float(np.linalg.norm(scene.center_mm, axis=1).max())
        lamp = place_lamp(center, scene.normal @ cam_from_target[:3, :3].T, size, lamp_rng)
    if options.light_gradient:
        low, high = _extent(faces, camera)
        gradient = make_gradient(low, high, options.light_gradient, gradient_rng)
    if options.clutter:
        background = clutter(camera.image_size, options.clutter, options.background, clutter_rng)
    if options.occlusion:
        occluders = occlude(camera.image_size, [face.edge_px for face in faces], options.occlusion, occluder_rng)
    return Surroundings(lamp, gradient, background, occluders)


def _extent(faces: list[SeenFace], camera: Camera) -> tuple[Array, Array]:
    """Lowest and highest pixel of the target, or of the image where no face is seen."""
    width, height = camera.image_size
    box = union([face.box for face in faces]) if faces else Box(0, height, 0, width)
    return np.array([box.left, box.top], dtype=float), np.array([box.right, box.bottom], dtype=float)


def shaded(faces: list[SeenFace], setting: Surroundings, options: RenderOptions) -> list[SeenFace]:
    """The faces as light as the lamp makes them."""
    if not options.shading or setting.lamp is None:
        return faces
    normal, middle = np.stack([face.normal for face in faces]), np.stack([face.middle_mm for face in faces])
    factors = lambert(normal, middle, setting.lamp, options.shading).tolist()
    return [
        replace(face, arrays=face.arrays._replace(black=factor * face.arrays.black, white=factor * face.arrays.white))
        for face, factor in zip(faces, factors, strict=True)
    ]


def clean_rings(
    scene: RenderScene,
    faces: list[SeenFace],
    camera: Camera,
    truth: RingTruth,
    setting: Surroundings,
    options: RenderOptions,
) -> Flags:
    """Rings (R,) that are whole in the image, that nothing hides, and that are neither saturated nor washed out."""
    clean = truth.whole.copy()
    for face in faces:
        rows = np.flatnonzero(clean & (scene.ring_face == face.number))
        if len(rows):
            clean[rows] &= _unsaturated(scene, face, camera, rows, truth, setting, options)
    if setting.occluders is not None:
        reach = TOUCH_MARGIN_PX + BLUR_REACH * options.blur_px
        for row in np.flatnonzero(clean).tolist():
            clean[row] = not _is_touched(setting.occluders.share, truth, row, reach)
    return clean


def _unsaturated(
    scene: RenderScene,
    face: SeenFace,
    camera: Camera,
    rows: Rows,
    truth: RingTruth,
    setting: Surroundings,
    options: RenderOptions,
) -> Flags:
    """Whether the white around and in rings (N,) stays below full scale, and glare well below the contrast."""
    pixel = np.concatenate([truth.rim_px[rows], truth.center_px[rows, None]], axis=1)
    u, v = pixel[..., 0], pixel[..., 1]
    light = np.full(u.shape, max(face.arrays.white, face.arrays.black))
    if setting.gradient is not None:
        light *= gradient_at(setting.gradient, u, v)
    glare = np.zeros_like(light)
    if options.glare and setting.lamp is not None:
        angle = 2 * np.pi * np.arange(u.shape[1] - 1) / (u.shape[1] - 1)
        circle = np.concatenate([np.column_stack([np.cos(angle), np.sin(angle)]), np.zeros((1, 2))])
        point = scene.ring[rows, None, :2] + scene.ring[rows, 3, None, None] * circle
        lamp, eye = to_face(setting.lamp, face.face_from_cam), face.face_from_cam[:3, 3].copy()
        glare = options.glare * glare_at(point.reshape(-1, 2), eye, lamp, setting.lamp.lobe_rad).reshape(u.shape)
    arriving = (light + glare) * vignette(u, v, camera, options.vignetting)
    contrast = abs(face.arrays.white - face.arrays.black)
    return np.asarray((arriving <= FULL_SCALE).all(axis=1) & (glare <= WASHED_OUT * contrast).all(axis=1))


def _is_touched(share: Grey, truth: RingTruth, row: int, reach_px: float) -> bool:
    """Whether an occluder covers anything within reach of a ring's outer ellipse."""
    center, rim = truth.center_px[row], truth.rim_px[row]
    quarter = len(rim) // 4
    affine = np.column_stack([rim[0] - rim[2 * quarter], rim[quarter] - rim[3 * quarter]]) / 2
    low = np.maximum(0, np.floor(rim.min(axis=0) - reach_px - 1).astype(int))
    high = np.ceil(rim.max(axis=0) + reach_px + 2).astype(int)
    patch = share[low[1] : high[1], low[0] : high[0]]
    v, u = np.nonzero(patch)
    if not len(u):
        return False
    # Within the ellipse grown by `reach_px`: at most that much farther out than where the ray leaves the ellipse.
    away = np.column_stack([u, v]) + low - center
    unit_radius = np.linalg.norm(solve_square(affine, away.T), axis=0)
    distance = np.linalg.norm(away, axis=1)
    return bool((distance <= distance / np.maximum(unit_radius, 1e-9) + reach_px).any())

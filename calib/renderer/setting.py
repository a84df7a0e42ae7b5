"""What is drawn at random for one view, and which rings it leaves clean."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.linear_algebra import solve_square
from calib.core.se3 import transform
from calib.renderer.faces import Box, SeenFace, union
from calib.renderer.lens import vignette
from calib.renderer.lighting import Gradient, Lamp, glare_at, gradient_at, lambert, make_gradient, place_lamp, to_face
from calib.renderer.options import RenderOptions
from calib.renderer.rings import RingTruth
from calib.renderer.scene import RenderScene
from calib.renderer.shapes import Grey, Occluders, clutter, occlude

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TOUCH_MARGIN_PX = 2.0
BLUR_REACH = 3.0
"""Standard deviations of the blur from which an occluder still touches a ring."""
FULL_SCALE = 1.001
WASHED_OUT = 0.5
"""Glare over contrast from which a ring is washed out."""


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
    rows: NDArray[np.int64],
    truth: RingTruth,
    setting: Surroundings,
    options: RenderOptions,
) -> Flags:
    """Whether the white around and in rings (N,) stays below full scale, and glare well below the contrast."""
    pixel = np.concatenate([truth.rim_px[rows], truth.center_px[rows, None]], axis=1)
    u, v = pixel[..., 0], pixel[..., 1]
    light = np.full(u.shape, face.arrays.white)
    if setting.gradient is not None:
        light *= gradient_at(setting.gradient, u, v)
    glare = np.zeros_like(light)
    if options.glare and setting.lamp is not None:
        angle = 2 * np.pi * np.arange(u.shape[1] - 1) / (u.shape[1] - 1)
        circle = np.concatenate([np.column_stack([np.cos(angle), np.sin(angle)]), np.zeros((1, 2))])
        point = scene.ring[rows, None, :2] + scene.ring[rows, 3, None, None] * circle
        lamp, eye = to_face(setting.lamp, face.face_from_cam), face.face_from_cam[:3, 3].copy()
        glare = options.glare * glare_at(point.reshape(-1, 2), eye, lamp, setting.lamp.lobe_rad).reshape(u.shape)
    arriving = (light + glare) * vignette(u, v, camera.image_size, options.vignetting)
    contrast = face.arrays.white - face.arrays.black
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

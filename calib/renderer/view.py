"""One synthetic photo: a pure function of target, camera, pose, options and randomness."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras import ABILITIES, rays
from calib.cameras.camera import Camera
from calib.renderer.faces import Box, SeenFace, ring_truth, seen_faces, union
from calib.renderer.light import (
    Levels,
    add_glare,
    add_noise,
    blurred,
    blurred_by,
    circle_light,
    defocus_sigma_px,
    gradient_at,
    quantised,
    to_face,
    vignette,
)
from calib.renderer.options import RenderOptions
from calib.renderer.polygons import ink_polygons
from calib.renderer.scene import RenderScene, scene_from_target
from calib.renderer.setting import Surroundings, clean_rings, make_setting, shaded
from calib.renderer.trace import set_depth, trace_face
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry

Image = NDArray[np.float32]

BLOCK_ROWS = 64
RANDOM_STREAMS = 5


@dataclass(frozen=True, eq=False)
class View:
    """A photo and the truth about its R rings; what the camera cannot see is nan."""

    image: Levels  # (H, W) uint8, uint16 or float32
    visible: Flags  # (R,) turned to the camera and centre inside the image
    clean: Flags  # (R,) visible, 2 px inside the image, nothing in front, neither saturated nor washed out
    center_px: Array  # (R, 2)
    incidence_rad: Array  # (R,)
    minor_radius_px: Array  # (R,)


def render_view(
    target: TargetGeometry | RenderScene,
    camera: Camera,
    cam_from_target: Array,
    options: RenderOptions,
    rng: np.random.Generator,
) -> View:
    """Render one view of a target, or of its scene where many views share it; each random effect has its own stream."""
    scene = target if isinstance(target, RenderScene) else scene_from_target(target)
    *scene_streams, noise_stream = rng.spawn(RANDOM_STREAMS)
    truth = ring_truth(scene, camera, cam_from_target)
    faces = seen_faces(scene, camera, cam_from_target, options)
    setting = make_setting(scene, faces, camera, cam_from_target, options, scene_streams)
    faces = shaded(faces, setting, options)
    light = _light(faces, camera, setting, options)
    light = _through_lens(light, faces, camera, cam_from_target, options)
    return View(
        image=_sensed(light, camera, options, noise_stream),
        visible=truth.visible,
        clean=clean_rings(scene, faces, camera, truth, setting, options),
        center_px=truth.center_px,
        incidence_rad=truth.incidence_rad,
        minor_radius_px=truth.minor_radius_px,
    )


def _light(faces: list[SeenFace], camera: Camera, setting: Surroundings, options: RenderOptions) -> Image:
    """Light on every pixel (H, W), as an ideal lens would bring it there."""
    width, height = camera.image_size
    background = float(options.background >= 0.5) if options.sampling == "binary" else options.background
    light = np.full((height, width), background, dtype=np.float32)
    if setting.background is not None:
        np.multiply(setting.background, np.float32(1 / 255), out=light)
    around, is_partly_dark = union([face.box for face in faces]), camera.has_dark_corners
    for top in range(0, height, BLOCK_ROWS):
        bottom = min(top + BLOCK_ROWS, height)
        block = light[top:bottom]
        inner = Box(max(top, around.top), min(bottom, around.bottom), around.left, around.right)
        glare = np.zeros((0, 0), np.float32)
        if inner.top < inner.bottom:
            glare = _trace(faces, camera, setting, options, inner, light[_slices(inner)])
        if setting.gradient is not None:
            u, v = np.arange(width, dtype=float), np.arange(top, bottom, dtype=float)[:, None]
            block *= gradient_at(setting.gradient, u, v)
        if glare.size:
            light[_slices(inner)] += glare
        if setting.occluders is not None:
            share = setting.occluders.share[top:bottom] * np.float32(1 / 255)
            block += share * (setting.occluders.grey[top:bottom] * np.float32(1 / 255) - block)
        if is_partly_dark:
            ray = _rays(camera, Box(top, bottom, 0, width))[1:-1, 1:-1]
            block *= circle_light(camera, ray).astype(np.float32)
    return light


def _slices(box: Box) -> tuple[slice, slice]:
    return slice(box.top, box.bottom), slice(box.left, box.right)


def _trace(
    faces: list[SeenFace], camera: Camera, setting: Surroundings, options: RenderOptions, box: Box, light: Image
) -> Image:
    """Put the faces over the background in a box of pixels, and return the glare on them (empty without)."""
    ray = _rays(camera, box)
    shown, cover = np.zeros(light.shape, np.float32), np.zeros(light.shape, np.float32)
    has_glare = options.glare > 0 and setting.lamp is not None
    glare = np.zeros(light.shape if has_glare else (0, 0), np.float32)
    for face in faces:
        part = _common(face.box, box)
        if part is None:
            continue
        inner = _slices(_from_corner(part, box))
        # The rays have one more row and column on each side.
        rays_of_part = ray[inner[0].start : inner[0].stop + 2, inner[1].start : inner[1].stop + 2]
        is_binary = options.sampling == "binary"
        if face.patches is not None:
            contrast, eye = face.arrays.white - face.arrays.black, face.face_from_cam
            ink_polygons(rays_of_part, eye, face.patches, is_binary, contrast, shown[inner], cover[inner])
        trace_face(rays_of_part, face.face_from_cam, face.arrays, is_binary, shown[inner], cover[inner])
        if has_glare and setting.lamp is not None:
            lamp = to_face(setting.lamp, face.face_from_cam)
            outline = face.arrays.outline
            width, peak = setting.lamp.lobe_rad, options.glare
            add_glare(rays_of_part, face.face_from_cam, outline, lamp, width, peak, glare[inner])
    light *= 1 - cover
    light += shown
    return glare


def _common(one: Box, two: Box) -> Box | None:
    box = Box(max(one.top, two.top), min(one.bottom, two.bottom), max(one.left, two.left), min(one.right, two.right))
    return box if box.top < box.bottom and box.left < box.right else None


def _from_corner(box: Box, frame: Box) -> Box:
    return Box(box.top - frame.top, box.bottom - frame.top, box.left - frame.left, box.right - frame.left)


def _rays(camera: Camera, box: Box) -> Array:
    """Rays (H + 2, W + 2, 3) of a box of pixels and of one more on each side, dark ones too."""
    pixel = np.empty((box.bottom - box.top + 2, box.right - box.left + 2, 2))
    pixel[..., 0] = np.arange(box.left - 1, box.right + 1)
    pixel[..., 1] = np.arange(box.top - 1, box.bottom + 1)[:, None]
    return rays(replace(camera, field_rad=None), pixel)


def _through_lens(
    light: Image, faces: list[SeenFace], camera: Camera, cam_from_target: Array, options: RenderOptions
) -> Image:
    """Blur, with depth if the lens has an aperture: along the axis as of a thin lens, for wide ones along the ray."""
    if options.aperture_mm:
        origin_mm, is_range = float(np.linalg.norm(cam_from_target[:3, 3])), ABILITIES[camera.model].is_wide
        # What is not the target lies as far away as its origin, so that silhouettes blur as their surroundings do.
        away_mm = origin_mm if is_range else float(cam_from_target[2, 3])
        depth = np.full(light.shape, max(away_mm, 1.0), dtype=np.float32)
        for face in faces:
            for top in range(face.box.top, face.box.bottom, BLOCK_ROWS):
                box = Box(top, min(top + BLOCK_ROWS, face.box.bottom), face.box.left, face.box.right)
                ray, outline = _rays(camera, box), face.arrays.outline
                set_depth(ray, face.face_from_cam, outline, is_range, depth[_slices(box)])
        focus = options.focus_mm or origin_mm
        sigma = defocus_sigma_px(depth, focus, options.aperture_mm, _focal_px(camera))
        np.hypot(sigma, np.float32(options.blur_px), out=sigma)
        return blurred_by(light, sigma)
    return blurred(light, options.blur_px) if options.blur_px else light


def _focal_px(camera: Camera) -> float:
    """Pixels per radian in the middle of the image, for any camera model."""
    width, height = camera.image_size
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    left, right = rays(camera, middle + np.array([[-0.5, 0.0], [0.5, 0.0]]))
    return float(1 / np.linalg.norm(right - left))


def _sensed(light: Image, camera: Camera, options: RenderOptions, rng: np.random.Generator) -> Levels:
    """What the sensor makes of the light, block by block."""
    width, height = camera.image_size
    u = np.arange(width, dtype=float)
    dtype = {8: np.uint8, 16: np.uint16, 32: np.float32}[options.bits]
    image: Levels = np.empty((height, width), dtype=dtype)
    for top in range(0, height, BLOCK_ROWS):
        block = light[top : top + BLOCK_ROWS]
        if options.vignetting:
            v = np.arange(top, top + len(block), dtype=float)[:, None]
            block *= vignette(u, v, camera, options.vignetting)
        if options.noise_sigma or options.full_well:
            add_noise(block, options.noise_sigma, options.full_well, rng)
        image[top : top + BLOCK_ROWS] = quantised(block, options)
    return image

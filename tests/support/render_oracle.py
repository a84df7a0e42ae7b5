"""Targets to be rendered, and a slow renderer: many jittered rays a pixel against every face and ring, in NumPy."""

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.renderer import RenderOptions
from designer.base.arrays import Array, Flags
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support.designs import asked_for

SILHOUETTE = RenderOptions(bits=32, black=0.9, white=1.0, background=0.0)


def board(columns: int = 4, **changes: object) -> TargetGeometry:
    """A board of rings of 7 mm at 9 mm, with a border of 1 mm unless told otherwise."""
    values = {"columns": columns, "rows": columns, "ring_diameter": "7mm", "pitch": "9mm", "border": "1mm"}
    return lay_out(size_job(asked_for("board", {**values, **changes})).job.target)


def ico() -> TargetGeometry:
    """An icosahedron of 100 mm edges."""
    return lay_out(size_job(asked_for("ico", {"edge": "100mm"})).job.target)


def texture(target: TargetGeometry, cam_from_target: Array, direction: Array) -> tuple[Array, Array]:
    """Whether rays (N, 3) from the camera meet the target, and whether it is white there.  # (N,), (N,)"""
    nearest = np.full(len(direction), np.inf)
    white = np.zeros(len(direction))
    for face in range(target.face_count):
        cam_from_face = cam_from_target @ target.target_from_face[face]
        normal, middle = cam_from_face[:3, 2], cam_from_face[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (normal @ middle) / (direction @ normal)
        point = (depth[:, None] * direction - middle) @ cam_from_face[:3, :3]
        hit = (depth > 0) & (depth < nearest) & _inside(target.outline_mm[face], point)
        nearest[hit] = depth[hit]
        shade = _inside(target.window_mm[face], point).astype(float)
        if normal @ middle < 0:  # the front
            for row in np.flatnonzero(target.ring_face == face):
                center = target.center_in_face_mm[row]
                raised = middle + center[2] * normal
                on_ring = ((normal @ raised) / (direction @ normal))[:, None] * direction
                radius = np.linalg.norm(((on_ring - raised) @ cam_from_face[:3, :3])[:, :2] - center[:2], axis=1)
                shade[(radius < target.radius_outer_mm[row]) & (radius >= target.radius_inner_mm[row])] = 0.0
            for polygon in () if target.marks is None else target.marks[face].polygons_mm:
                shade[_inside(polygon, point)] = 0.0
        else:
            shade[:] = 1.0
        white[hit] = shade[hit]
    return np.isfinite(nearest).astype(float), white


def _inside(polygon: Array, point: Array) -> Flags:
    inside = np.ones(len(point), dtype=bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (point[:, 1] - a[1]) - (b[1] - a[1]) * (point[:, 0] - a[0]) > 0
    return inside


def render_slowly(
    target: TargetGeometry,
    camera: Camera,
    cam_from_target: Array,
    levels: tuple[float, float, float],
    samples: int,
    rng: np.random.Generator,
) -> Array:
    """The image (H, W) from `samples` x `samples` stratified rays a pixel; levels are black, white, background."""
    black, white, background = levels
    width, height = camera.image_size
    image = np.zeros((height, width))
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    for row in range(samples):
        for column in range(samples):
            jitter = rng.uniform(size=(2, height, width))
            pixel = np.stack([u + (column + jitter[0]) / samples - 0.5, v + (row + jitter[1]) / samples - 0.5], axis=-1)
            hit, shade = texture(target, cam_from_target, rays(camera, pixel).reshape(-1, 3))
            light = hit * (black + (white - black) * shade) + (1 - hit) * background
            image += light.reshape(height, width)
    return image / samples**2

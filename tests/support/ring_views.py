"""Small targets, views of them, and candidates as a perfect border search would give them."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from calib.cameras.camera import Camera
from calib.core.types import Detections
from calib.detector.candidates import Candidates
from calib.detector.place import Naming
from calib.renderer import RenderOptions, View, render_view
from calib.renderer.faces import RingTruth, ring_truth
from calib.renderer.scene import scene_from_target
from designer.base.arrays import Array, Rows
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.spec.spec import Lattice
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import look_at, random_direction
from tests.support.ring_images import triangle_of
from tests.support.sightings import pinhole

CAMERA = pinhole(1000, 800, 1300.0)
INTO_CORNER = 0.4
"""Tangent of the angle off a corner's diagonal, along two axes, from where a photo shows all that it has."""
USUAL = RenderOptions(blur_px=0.6, contrast_to_noise=50)


@cache
def ico() -> TargetGeometry:
    """An icosahedron of 100 mm edges with 21 large features a face."""
    return lay_out(IcoSpec(100.0, 6, 9.0, 0.45, 13.0, 2.0, 1.5))


@cache
def board(lattice: Lattice = "square", *, dots: bool = True, columns: int = 11, rows: int = 9) -> TargetGeometry:
    """A board of 12 mm pitch with a white margin."""
    size = 12.0 * columns + 20, 12.0 * rows + 20
    return lay_out(BoardSpec(size, 5.0, columns, rows, lattice, 8.0, 0.45, 12.0, 0.0, 4.0, dots=dots))


def pose_of(target: TargetGeometry, rng: np.random.Generator, distance_mm: float = 400.0) -> Array:
    """A camera at a random place that looks at about the target's middle, rolled at random.  # (4, 4)"""
    direction = random_direction(rng, is_board=False)
    if target.faces_up and not target.has_back:
        direction = np.array([*((0.9 if target.is_planar else INTO_CORNER) * rng.uniform(-1, 1, 2)), 1.0])
        direction /= np.linalg.norm(direction)
    return look_at(rng, direction, distance_mm, rng.uniform(-10, 10, 3))


def view_of(
    target: TargetGeometry,
    seed: int,
    *,
    distance_mm: float = 400.0,
    options: RenderOptions = USUAL,
    camera: Camera = CAMERA,
) -> View:
    """A random view."""
    rng = np.random.default_rng(seed)
    return render_view(target, camera, pose_of(target, rng, distance_mm), options, rng)


def misplaced(found: Detections, view: View) -> Array:
    """How far each feature found lies from where its name says, in px; nan: its face is not even seen.  # (N,)"""
    return np.asarray(np.linalg.norm(found.center_px - view.center_px[found.ring], axis=1))


@dataclass(frozen=True, eq=False)
class Scene:
    """Candidates with the target row of each (-1: clutter), and the truth."""

    candidates: Candidates
    row: Rows  # (N,)
    truth: RingTruth
    camera: Camera
    cam_from_target: Array


def scene_of(
    target: TargetGeometry,
    seed: int,
    *,
    camera: Camera = CAMERA,
    distance_mm: float = 400.0,
    missing: float = 0.0,
    clutter: int = 0,
    noise_px: float = 0.1,
    steepest_rad: float = 1.2,
) -> Scene:
    """Candidates of a random view without drawing it; dots are blobs without a white centre."""
    rng = np.random.default_rng(seed)
    pose = pose_of(target, rng, distance_mm)
    truth = ring_truth(scene_from_target(target), camera, pose)
    able = truth.whole & (truth.incidence_rad < steepest_rad) & (truth.minor_radius_px > 2.5)
    row = rng.permutation(np.flatnonzero(able & (rng.random(target.ring_count) >= missing)))
    ellipse = np.array([ellipse_of(truth.rim_px[r]) for r in row]).reshape(-1, 5)
    ellipse[:, :2] = truth.center_px[row] + rng.normal(0, noise_px, (len(row), 2))
    ratio = np.where(target.is_dot[row], 0.0, 0.45)
    region = target.ring_face[row]
    if clutter:
        place = rng.uniform((0, 0), camera.image_size, (clutter, 2))
        radius = rng.uniform(4, 20, clutter)
        shape = np.stack([1 / radius, rng.uniform(-0.2, 0.2, clutter) / radius, rng.uniform(1, 2, clutter) / radius], 1)
        ellipse = np.vstack([ellipse, np.hstack([place, shape])])
        ratio = np.concatenate([ratio, rng.choice([0.0, 0.45], clutter)])
        region = np.concatenate([region, rng.integers(0, 1000, clutter)])
        row = np.concatenate([row, np.full(clutter, -1)])
    return Scene(Candidates(ellipse, ratio, region, np.full(len(row), 0.1)), row, truth, camera, pose)


def ellipse_of(rim_px: Array) -> Array:
    """Centre and E of the ellipse through the points of a rim.  # (N, 2) -> (5,)"""
    middle = rim_px.mean(axis=0)
    (u, v), (first, second), degrees = cv2.fitEllipse((16 * (rim_px - middle)).astype(np.float32))
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    gram = turn @ np.diag([(32 / first) ** 2, (32 / second) ** 2]) @ turn.T
    return np.array([u / 16 + middle[0], v / 16 + middle[1], *triangle_of(gram)])


def true_naming(scene: Scene) -> Naming:
    """Every candidate by its right name."""
    real = np.flatnonzero(scene.row >= 0)
    order = real[np.argsort(scene.row[real])]
    return Naming(order, scene.row[order])

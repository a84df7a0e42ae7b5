"""A target before a camera, and sets of simulated photos of what was made of it.

The paper's five objects: how they were made, how they were photographed, and what came out.

Ruppel, Kutlu et al., Beyond Reprojection Error: Camera Calibration with 3D Targets, section "Real-world evaluation":
medians of 12 sets of photos of each object, about 30 photos of a board, about 90 of an icosahedron.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, nearest_rotation, transform
from calib.core.types import Observations, keep_sightings
from calib.renderer.poses import PoseGrid, grid_poses
from calib.studies.samples import keyed_generator
from calib.studies.tolerance.seen import CONTRAST_TO_NOISE, LEAST_RINGS, views_of
from calib.studies.workers import ValuePool
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.files import read_spec_file
from designer.kinds.layout import lay_out
from designer.kinds.presets import preset_or_file
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.target import TargetGeometry

CAP_RAD = math.radians(50)
"""Half angle of the cap around a board's normal that its photos are taken from. The paper does not tell it, but its
boards have a reconstruction error of 1.25 to 1.33 times the intersection error: what a warp gives between 45 degrees
(1.4 times) and 60 degrees (0.9 times)."""
ROUND_MM = 10.0


@dataclass(frozen=True, eq=False)
class ComparedScene:
    """What is photographed, with what, and from how far."""

    name: str  # that its random numbers hang on
    target: TargetGeometry  # the drawing
    camera: Camera
    distance_mm: float
    views: int  # photos of a set
    contrast_to_noise: float = CONTRAST_TO_NOISE
    farthest: float = 1.0  # of the distances that photos are taken from, in units of the nearest


def fitting_distance_mm(target: TargetGeometry, camera: Camera) -> float:
    """From where a target just fills the shorter side of the image: a board from the front, a body from any side.

    A board of half the size s is `s f / h` away, with half the image's side h; of a body the sphere around all its
    rings touches the cone of the image, at `r / sin(atan(h / f))`. Rounded up to a centimetre.
    """
    focal, half = float(camera.params[:2].min()), 0.5 * (min(camera.image_size) - 1)
    if target.is_planar:
        distance = float(np.abs(target.outline_mm).max()) * focal / half
    else:
        reach = np.linalg.norm(target.center_mm, axis=1) + target.radius_outer_mm
        distance = float(reach.max()) / math.sin(math.atan(half / focal))
    return math.ceil(distance / ROUND_MM) * ROUND_MM


def scene_of(name: str, target: TargetGeometry, camera: Camera, views: int) -> ComparedScene:
    """A scene at the distance that fits."""
    scene = ComparedScene(name, target, camera, fitting_distance_mm(target, camera), views)
    if not len(take_photos(scene, target.center_mm, np.random.default_rng(0), views).view):
        raise InputError(
            f"{name}: from {scene.distance_mm:g}mm, where it fills the image, no photo shows {LEAST_RINGS} rings of "
            "5 px or more; choose a camera with a longer lens or more pixels"
        )
    return scene


def stream(seed: int, *what: str | int) -> np.random.Generator:
    """The random numbers of what is named."""
    return keyed_generator("\n".join(map(str, ("compare", seed, *what))))


def take_photos(
    scene: ComparedScene, made_mm: Array, rng: np.random.Generator, views: int, noise: float = 1.0
) -> Observations:
    """A set of photos: poses and noise of its own, the rings where they were made, their names those of the drawing.

    Args:
        scene: what is photographed.
        made_mm: where the rings truly are (R, 3).
        rng: of poses and noise.
        views: how many.
        noise: the detector's, in units of what it is.
    """
    return photograph(scene, made_mm, rng, views, noise)[0]


def photograph(
    scene: ComparedScene, made_mm: Array, rng: np.random.Generator, views: int, noise: float = 1.0
) -> tuple[Observations, Array]:
    """As `take_photos`, with the poses of the photos that show enough (V, 4, 4)."""
    poses = _poses(scene, rng, views)
    kept, exact = views_of(scene.target, scene.camera, poses, scene.contrast_to_noise)
    covariance, poses = exact.cov_px2, poses[kept]
    if covariance is None or not len(kept):
        return exact, poses
    point = transform(poses[exact.view], made_mm[exact.point])
    off = np.einsum("mij,mj->mi", np.linalg.cholesky(covariance), rng.standard_normal((len(point), 2)))
    pixel = project(scene.camera, point) + noise * off
    taken = replace(exact, center_px=pixel)
    return keep_sightings(taken, np.isfinite(pixel).all(axis=1)), poses


def _poses(scene: ComparedScene, rng: np.random.Generator, views: int) -> Array:
    """Poses of a set: a Fibonacci grid as `calib render` has it, turned at random as a whole.  # (views, 4, 4)"""
    is_board = scene.target.is_planar
    where = CAP_RAD if is_board else math.pi
    far_mm = scene.farthest * scene.distance_mm
    grid = PoseGrid(views, where, (scene.distance_mm, far_mm), random_roll=True, aim_offset_mm=0.0)
    poses = grid_poses(grid, rng)
    turn = np.eye(4)
    if is_board:
        turn[:3, :3] = exp_rotation(np.array([0.0, 0.0, rng.uniform(-math.pi, math.pi)]))
    else:
        turn[:3, :3] = nearest_rotation(rng.standard_normal((3, 3)))
    turned: Array = poses @ turn
    return turned


@dataclass(frozen=True, eq=False)
class ScenePool(ValuePool):
    """Samples of one scene; what is random hangs on that, seed and number."""

    scene: ComparedScene

    @property
    def view_count(self) -> int:
        """Photos of a set."""
        return self.scene.views


VIRTUAL = "virtual"
MODELS = ("luhmann", "opencv", VIRTUAL)
"""The camera models that the paper compares."""
BOARD_VIEWS, ICOSAHEDRON_VIEWS = 30, 90
SETS = 12


@dataclass(frozen=True)
class PaperObject:
    """One object, and the medians that the paper's text gives for it."""

    label: str  # in the paper's figure
    name: str
    template: str  # of the target
    errors: str  # template of how it was made
    views: int
    intersection_mm: float  # nan: the text does not give it
    intersection_text: str
    reconstruction_mm: float

    @property
    def is_known(self) -> bool:
        """Whether the text gives numbers."""
        return math.isfinite(self.intersection_mm)

    @property
    def is_board(self) -> bool:
        """Whether it is flat, and photographed as boards are."""
        return self.views == BOARD_VIEWS

    def median(self, metric: str) -> float:
        """The paper's median of a metric, mm; nan where there is none."""
        return {"intersection": self.intersection_mm, "reconstruction": self.reconstruction_mm}.get(metric, math.nan)


OBJECTS: tuple[PaperObject, ...] = (
    PaperObject("I1", "MasterIco", "master-ico", "hand-stickers", ICOSAHEDRON_VIEWS, 3.0, "> 3", 2.7),
    PaperObject("I2", "ShinyIco", "shiny-ico", "fdm-dual", ICOSAHEDRON_VIEWS, 1.785, "1.74-1.83", 1.08),
    PaperObject("I3", "MattIco", "matt-ico", "fdm-dual", ICOSAHEDRON_VIEWS, math.nan, "-", math.nan),
    PaperObject("B1", "AluBoard", "alu-board", "sheet-print", BOARD_VIEWS, 0.4, "0.4", 0.5),
    PaperObject("B2", "3DBoard", "3d-board", "fdm-board", BOARD_VIEWS, 0.6, "0.6", 0.8),
)
REPROJECTION_RATIO = ("ShinyIco", "3DBoard", 2.0)
"""The one thing the text says of reprojection errors: that of the first is so many times that of the second."""


def object_named(name: str) -> PaperObject:
    """One of `OBJECTS`."""
    return next(one for one in OBJECTS if one.name == name)


def make_target(template: str) -> TargetGeometry:
    """The drawing of a target template."""
    path = preset_or_file("targets", template)
    return lay_out(size_job(parse_spec(read_spec_file(path), str(path))).job.target)

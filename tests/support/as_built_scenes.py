"""Prints that differ from their design, photos of them, and what a measurement should find."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import invert, log_rotation
from calib.core.types import Observations
from calib.measure_target.datum import laid_over, what_is_seen
from calib.measure_target.problem import State
from calib.measure_target.result import AsBuilt, target_of
from calib.measure_target.unknowns import AsBuiltOptions, TargetUnknowns, nominal_shape, place_rings, unknowns_of
from calib.observe.observations import known_points
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.solver.eliminate import Normal
from designer.base.arrays import Array
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.support.rig_views import ring
from tests.support.solver_scenes import CAMERAS, NOISE_PX, observe, poses_around

RIGID = AsBuiltOptions(ring_sigma_mm=None)


@cache
def solid() -> TargetGeometry:
    """An icosahedron with 15 rings on a face."""
    return lay_out(IcoSpec(100.0, 5, 11.0, 0.45, 15.7, 2.0, 1.0))


@cache
def plate() -> TargetGeometry:
    """A board of 11 x 9 rings."""
    return lay_out(BoardSpec((240.0, 200.0), 3.0, 11, 9, "square", 14.0, 0.45, 20.0, 0.0, 1.0, dots=False))


def random_shape(
    target: TargetGeometry,
    rng: np.random.Generator,
    *,
    strain: float = 2e-3,
    turn_rad: float = 3e-3,
    shift_mm: float = 0.15,
    ring_mm: tuple[float, float] = (0.0, 0.0),
    bow_mm: float = 0.0,
) -> TargetUnknowns:
    """Deviations drawn from normal distributions; of a board no motion of its face."""
    faces, normal = target.face_count, rng.standard_normal
    motion = np.concatenate([turn_rad * normal((faces, 3)), shift_mm * normal((faces, 3))], axis=1)
    ring = np.array([ring_mm[0], ring_mm[0], ring_mm[1]]) * normal((target.ring_count, 3))
    bow = bow_mm * normal((faces, 3))
    strains = strain * normal(6)
    if faces == 1:
        strains[2:5], motion = 0.0, np.zeros((1, 6))  # they would only tilt it
    return TargetUnknowns(strains, motion, bow, ring)


def printed(target: TargetGeometry, shape: TargetUnknowns) -> TargetGeometry:
    """The print: its rings are where the deviations put them."""
    unknowns = unknowns_of(target, AsBuiltOptions())
    return replace(target, center_mm=place_rings(unknowns, shape).position_mm, source="perturbed")


def photos(
    print_: TargetGeometry,
    rng: np.random.Generator,
    views: int = 20,
    *,
    camera: Camera = CAMERAS["opencv"],
    noise_px: float = NOISE_PX,
    half_angle_deg: float = 150.0,
    distance_mm: float = 400.0,
    aim_mm: float = 10.0,
) -> Observations:
    """What a camera sees of a print, from many sides."""
    poses = poses_around(views, rng, half_angle_deg=half_angle_deg, distance_mm=distance_mm, aim_mm=aim_mm)
    return observe(camera, known_points(print_), poses, rng, noise_px=noise_px, incidence_deg=70)


@dataclass(frozen=True, eq=False)
class Truth:
    """A print in the datum of a measurement of it."""

    shape: TargetUnknowns
    target: TargetGeometry


def truth_of(measured: AsBuilt, shape: TargetUnknowns, options: AsBuiltOptions) -> Truth:
    """The deviations of a print, laid over its design by the rings that were measured."""
    unknowns = unknowns_of(measured.nominal, options)
    pairs = zip(measured.observations, measured.is_outlier, strict=True)
    seen = replace(what_is_seen(unknowns, [(one, ~out) for one, out in pairs]), outlying=measured.is_outlying)
    state = laid_over(unknowns, seen, State((), (), shape))
    return Truth(state.shape, target_of(unknowns, seen, state.shape, np.zeros((measured.nominal.face_count, 6, 6))))


def frame_errors(measured: TargetGeometry, true: TargetGeometry) -> Array:
    """How the frames of faces differ: rotation vectors (rad) and shifts (mm) in their own frames.  # (F, 6)"""
    difference = invert(true.target_from_face) @ measured.target_from_face
    return np.concatenate([log_rotation(difference[:, :3, :3]), difference[:, :3, 3]], axis=1)


def mahalanobis(error: Array, covariance: Array) -> Array:
    """Squared lengths (N,) of errors (N, K) in units of covariances (N, K, K)."""
    square: Array = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])
    return square


def blocks_of(covariance: Array) -> Array:
    """The diagonal blocks (N, 6, 6) of a covariance (6 N, 6 N)."""
    count = len(covariance) // 6
    return covariance.reshape(count, 6, count, 6)[np.arange(count), :, np.arange(count)]


def no_deviation(target: TargetGeometry) -> TargetUnknowns:
    """As designed."""
    return nominal_shape(target)


def dense(normal: Normal) -> tuple[Array, Array]:
    """The whole normal matrix, poses first, then rings, then the others; and the gradient."""
    poses, rings, others = 6 * len(normal.pose), 3 * len(normal.ring), len(normal.other)
    half = np.zeros((poses + rings + others,) * 2)  # the blocks on the diagonal count twice, so half of each
    for v, block in enumerate(normal.pose):
        half[6 * v : 6 * v + 6, 6 * v : 6 * v + 6] = block / 2
    for r, block in enumerate(normal.ring):
        half[poses + 3 * r :, poses + 3 * r :][:3, :3] = block / 2
    row = normal.ring_row.reshape(rings, poses + others + 1)
    half[poses : poses + rings, :poses] = row[:, :poses]
    half[poses : poses + rings, poses + rings :] = row[:, poses:-1]
    half[:poses, poses + rings :] = normal.pose_row.reshape(poses, others + 1)[:, :-1]
    half[poses + rings :, poses + rings :] = normal.other[:, :-1] / 2
    return half + half.T, np.concatenate([normal.pose_row[:, :, -1].ravel(), row[:, -1], normal.other[:, -1]])


@cache
def rig_before_print(seed: int = 0, *, cameras: int = 3, frames: int = 8) -> tuple[RigCalibration, TargetUnknowns]:
    """A rig that was solved with an icosahedron as designed, and how the print differs from that."""
    shape = random_shape(solid(), np.random.default_rng(seed), ring_mm=(0.03, 0.015))
    made, drawn = known_points(printed(solid(), shape)), known_points(solid())
    seen = ring(made, count=cameras, frames=frames, noise_px=0.05, seed=seed).observations
    seen = replace(seen, sightings=tuple(replace(one, points=drawn) for one in seen.sightings))
    return solve_rig(seen, [CameraChoice("opencv")] * cameras), shape

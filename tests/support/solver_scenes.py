"""Synthetic observations for the solver's tests: targets, cameras, poses, and what is seen of them."""

from dataclasses import replace

import numpy as np

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import look_at, transform
from calib.core.types import KnownPoints, Observations
from calib.observe.observations import known_points
from calib.renderer.poses import fibonacci_cap
from calib.solver.accuracy import projected_change
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Flags, Rows
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out

SIZE = (2448, 2048)
CAMERAS = {
    "opencv": Camera("opencv", np.array([2500.0, 2510, 1230, 1010, -0.12, 0.05, 4e-4, -3e-4, 0.01]), SIZE),
    "luhmann": Camera("luhmann", np.array([2500.0, 2510, 1230, 1010, -0.12, 0.05, 0.01, 4e-4, -3e-4]), SIZE),
    "pinhole": Camera("pinhole", np.array([2500.0, 2510, 1230, 1010]), SIZE),
}
NOISE_PX = 0.05


def board(columns: int = 11, rows: int = 9, pitch_mm: float = 20.0) -> KnownPoints:
    """The points of a board, row by row."""
    size = ((columns + 1) * pitch_mm, (rows + 1) * pitch_mm)
    return known_points(
        lay_out(BoardSpec(size, 3.0, columns, rows, "square", 0.7 * pitch_mm, 0.45, pitch_mm, 0.0, 1.0, dots=False))
    )


def icosahedron(edge_mm: float = 100.0, rings_per_side: int = 6) -> KnownPoints:
    """The points of an icosahedron."""
    pitch = 0.8 * edge_mm / rings_per_side
    return known_points(lay_out(IcoSpec(edge_mm, rings_per_side, 0.7 * pitch, 0.45, pitch, 0.02 * edge_mm, 1.0)))


def poses_around(
    count: int,
    rng: np.random.Generator,
    *,
    half_angle_deg: float = 50.0,
    distance_mm: float = 400.0,
    aim_mm: float = 10.0,
) -> Array:
    """Cameras spread over a cap around the target's z axis, rolled at random, near and far.  # (V, 4, 4)"""
    aim = rng.normal(0, aim_mm, (count, 3))
    eye = distance_mm * rng.uniform(1.0, 1.3, (count, 1)) * fibonacci_cap(count, np.radians(half_angle_deg))
    return look_at(eye, aim, rng.uniform(-np.pi, np.pi, count))


def pose_from(eye_mm: tuple[float, float, float], roll_rad: float = 0.3) -> Array:
    """One camera that looks at the target's origin.  # (1, 4, 4)"""
    return look_at(np.array([eye_mm]), np.zeros((1, 3)), np.array([roll_rad]))


def observe(
    camera: Camera,
    points: KnownPoints,
    cam_from_target: Array,
    rng: np.random.Generator,
    *,
    noise_px: float = 0.0,
    incidence_deg: float = 75.0,
    kept_share: float = 1.0,
) -> Observations:
    """What a camera sees of the points within the image on planes that face it, with normal noise."""
    views, rows, pixels = [], [], []
    normal = points.plane[points.face, :3]
    for view, pose in enumerate(cam_from_target):
        place = transform(pose, points.position_mm)
        cosine = -(place * (normal @ pose[:3, :3].T)).sum(axis=1) / np.linalg.norm(place, axis=1)
        pixel = project(camera, place)
        with np.errstate(invalid="ignore"):
            inside = (pixel > 0).all(axis=1) & (pixel < np.array(camera.image_size) - 1).all(axis=1)
        faces_it = cosine > np.cos(np.radians(incidence_deg))
        row = np.flatnonzero(inside & faces_it & (rng.random(len(pixel)) < kept_share))
        views.append(np.full(len(row), view))
        rows.append(row)
        pixels.append(pixel[row])
    seen = Observations(
        camera.image_size, tuple(f"view{n}.png" for n in range(len(views))), np.concatenate(views),
        np.concatenate(rows), np.concatenate(pixels), None, points,
    )  # fmt: skip
    return noisy(seen, noise_px, rng)


def noisy(seen: Observations, noise_px: float, rng: np.random.Generator) -> Observations:
    """The observations with normal noise on both coordinates."""
    return replace(seen, center_px=seen.center_px + noise_px * rng.standard_normal(seen.center_px.shape))


def rows_of(seen: Observations, rows: Rows | Flags) -> Observations:
    """Some of the observations, all views kept."""
    return replace(
        seen,
        view=seen.view[rows],
        point=seen.point[rows],
        center_px=seen.center_px[rows],
        cov_px2=None if seen.cov_px2 is None else seen.cov_px2[rows],
    )


def with_one_face(seen: Observations, extra: int, rng: np.random.Generator) -> Observations:
    """Of each view the face that shows most points, and a few points of the others."""
    rows: list[int] = []
    for view in range(seen.view_count):
        of_view = np.flatnonzero(seen.view == view)
        face = seen.points.face[seen.point[of_view]]
        main = np.bincount(face).argmax()
        rows += [*of_view[face == main].tolist(), *rng.choice(of_view[face != main], extra, replace=False).tolist()]
    return rows_of(seen, np.sort(np.array(rows)))


def moved_points(points: KnownPoints, new_from_old: Array, scale: float = 1.0) -> KnownPoints:
    """The points in another frame, and scaled about its origin; their planes are not moved."""
    return replace(points, position_mm=scale * transform(new_from_old, points.position_mm))


def random_covariances(count: int, rng: np.random.Generator) -> Array:
    """Covariances (N, 2, 2) of standard deviations from 0.02 to 0.2 px, turned at random."""
    sigma = np.exp(rng.uniform(np.log(0.02), np.log(0.2), (count, 2)))
    angle = rng.uniform(0, np.pi, count)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    covariance: Array = turn * sigma[:, None, :] ** 2 @ turn.transpose(0, 2, 1)
    return covariance


def sigma_of(covariance: Array) -> Array:
    """Standard deviations of a covariance's diagonal (..., N)."""
    return np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))


def times_stated(found: Calibration, true: Camera, covariance: Array) -> float:
    """The error where points were seen over a stated standard deviation, root mean square."""
    change = projected_change(found.camera, found.observations.center_px[::7])
    off = change @ (found.camera.params - true.params)
    stated = np.einsum("nip,pq,niq->", change, covariance, change)
    return float(np.sqrt((off**2).sum() / stated))

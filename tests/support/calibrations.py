"""Calibrations made from known truth, without a solver: for tests of what is said and kept of a calibration."""

from dataclasses import replace

import numpy as np

from calib.cameras import MODELS, project
from calib.cameras.camera import Camera
from calib.core.se3 import look_at, transform
from calib.core.types import KnownPoints, Observations
from calib.observe.observations import known_points
from calib.renderer.poses import fibonacci_cap
from calib.solver.calibration import Calibration
from calib.solver.metrics.errors import centers_mm
from designer.base.arrays import Array
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support.designs import asked_for

LENS = {"opencv": (-0.1, 0.05, 0.001, -0.0005, 0.0), "luhmann": (0.1, -0.05, 0.0, 0.0005, 0.001), "pinhole": ()}


def camera(model: str = "opencv", size: tuple[int, int] = (1200, 900), focal_px: float = 1400.0) -> Camera:
    """A camera with some distortion, if its model has any."""
    params = (focal_px, 1.001 * focal_px, size[0] / 2 + 3.3, size[1] / 2 - 2.1, *LENS[model])
    return Camera(model, np.array(params), size)


def board(columns: int = 9, rows: int = 7, pitch: str = "12mm") -> TargetGeometry:
    """A board."""
    return lay_out(size_job(asked_for("board", {"columns": columns, "rows": rows, "pitch": pitch})).job.target)


def icosahedron(edge: str = "60mm") -> TargetGeometry:
    """An icosahedron."""
    return lay_out(size_job(asked_for("ico", {"edge": edge})).job.target)


def poses_around(
    count: int, rng: np.random.Generator, *, half_angle_rad: float = 0.9, distance_mm: float = 300.0
) -> Array:
    """Cameras around the z axis that look near the origin, rolled at random.  # (V, 4, 4)"""
    aim = rng.normal(0, 8, (count, 3))
    eye = aim + distance_mm * rng.uniform(0.9, 1.2, (count, 1)) * fibonacci_cap(count, half_angle_rad)
    return look_at(eye, aim, rng.uniform(-np.pi, np.pi, count))


def seen_by(one: Camera, points: KnownPoints, cam_from_target: Array, *, names: tuple[str, ...] = ()) -> Observations:
    """What a camera sees without error: points within the image on planes that face it."""
    views, rows, pixels = [], [], []
    center = centers_mm(cam_from_target)
    for view, pose in enumerate(cam_from_target):
        pixel = project(one, transform(pose, points.position_mm))
        width, height = one.image_size
        with np.errstate(invalid="ignore"):
            ok = (pixel > 0).all(axis=1) & (pixel[:, 0] < width - 1) & (pixel[:, 1] < height - 1)
        faces_it = points.plane[:, :3] @ center[view] - points.plane[:, 3] > 0.2 * np.linalg.norm(center[view])
        row = np.flatnonzero(ok & ((points.face < 0) | faces_it[points.face]))
        views.append(np.full(len(row), view))
        rows.append(row)
        pixels.append(pixel[row])
    return Observations(
        one.image_size, names or tuple(f"view_{n:04d}.png" for n in range(len(views))), np.concatenate(views),
        np.concatenate(rows), np.concatenate(pixels), None, points,
    )  # fmt: skip


def calibration_of(one: Camera, seen: Observations, cam_from_target: Array, **changes: object) -> Calibration:
    """A calibration with this camera and these poses, as a solver would return it; its covariances are made up."""
    position = transform(cam_from_target[seen.view], seen.points.position_mm[seen.point])
    count, views = len(MODELS[one.model].parameters), seen.view_count
    values: dict[str, object] = {
        "camera": one,
        "observations": seen,
        "cam_from_target": cam_from_target,
        "residual_px": project(one, position) - seen.center_px,
        "is_outlier": np.zeros(len(seen.view), dtype=bool),
        "scale": 0.1,
        "param_covariance": np.diag(np.arange(1.0, count + 1)) * 1e-6,
        "pose_covariance": np.tile(1e-6 * np.eye(6), (views, 1, 1)),
        "fixed": (),
        "weighted": False,
        "status": "converged",
        "remarks": (),
        "iterations": 5,
        "seconds": 0.25,
    }
    return Calibration(**{**values, **changes})  # type: ignore[arg-type]


def example(
    target: TargetGeometry,
    rng: np.random.Generator,
    *,
    model: str = "opencv",
    views: int = 8,
    noise_px: float = 0.0,
    half_angle_rad: float = 0.9,
) -> Calibration:
    """A calibration with the true camera and poses, of centres measured with noise."""
    one, poses = camera(model), poses_around(views, rng, half_angle_rad=half_angle_rad)
    seen = seen_by(one, known_points(target), poses)
    noisy = replace(seen, center_px=seen.center_px + noise_px * rng.standard_normal(seen.center_px.shape))
    return calibration_of(one, noisy, poses)


def sightings(points: KnownPoints, count: int = 4, seed: int = 0) -> Observations:
    """Noisy sightings, each with its own covariance."""
    rng = np.random.default_rng(seed)
    seen = seen_by(camera(), points, poses_around(count, rng, distance_mm=450.0))
    root = rng.normal(0, 0.1, (len(seen.view), 2, 2))
    return replace(
        seen, center_px=np.round(seen.center_px + rng.normal(0, 0.05, seen.center_px.shape), 6),
        cov_px2=root @ root.transpose(0, 2, 1) + 1e-3 * np.eye(2),
    )  # fmt: skip

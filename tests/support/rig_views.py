"""Rigs of cameras with known truth, what they see of a target, and a slow solution of it: dense least squares."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import linearise, parameter_names, project
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, invert, look_at, make_pose, steps_between, transform
from calib.core.types import KnownPoints, Observations, RigObservations, keep_frames, keep_views, sightings_per_view
from calib.rigs.problem import FREE_SIZE, Mechanism
from calib.rigs.result import RigCalibration
from designer.base.arrays import Array, Flags, Rows
from tests.support import solver_scenes

SIZE = (1280, 960)
LEAST_POINTS = 6
"""Of a view; what shows fewer is no view."""
POSE = 6


@dataclass(frozen=True, eq=False)
class RigScene:
    """A rig as it truly is, and what its C cameras saw of a target in V frames."""

    cameras: tuple[Camera, ...]  # (C,)
    cam_from_rig: Array  # (C, 4, 4) the first is the reference
    rig_from_target: Array  # (V, 4, 4)
    observations: RigObservations
    noise_px: float


def camera(focal_px: float = 1100.0, model: str = "opencv") -> Camera:
    """A camera of a rig, with some distortion if its model has any."""
    lens = {"opencv": (-0.1, 0.05, 4e-4, -3e-4, 0.01), "pinhole": (), "fisheye": (0.01, -0.002, 1e-4, 0.0)}[model]
    return Camera(model, np.array([focal_px, 1.002 * focal_px, 642.0, 476.0, *lens]), SIZE)


def stereo_pair(
    points: KnownPoints | None = None,
    *,
    frames: int = 12,
    baseline_mm: float = 120.0,
    away_mm: float = 500.0,
    noise_px: float = 0.1,
    seed: int = 0,
) -> RigScene:
    """Two cameras side by side, toed in on a board (or other points) that is turned before them."""
    eye = np.array([[-baseline_mm / 2, 0, 0], [baseline_mm / 2, 0, 0]])
    aim = np.tile([0.0, away_mm, 0.0], (2, 1))
    rng = np.random.default_rng(seed)
    held = _held(frames, rng, 60.0, 0.6) @ _pose([np.pi / 2, 0, 0], [0, 0, 0])  # the board's front looks at the cameras
    world_from_target = _pose([0, 0, 0], [0, away_mm, 0]) @ held
    shown = points or solver_scenes.board(9, 7, 20.0)
    return scene_of(
        ("left", "right"), (camera(1100.0), camera(1150.0)), look_at(eye, aim), world_from_target, shown, rng, noise_px
    )


def ring(
    points: KnownPoints | None = None,
    *,
    count: int = 4,
    frames: int = 14,
    radius_mm: float = 600.0,
    noise_px: float = 0.1,
    seed: int = 0,
    models: Sequence[str] = ("opencv",),
) -> RigScene:
    """Cameras all around an icosahedron (or other points) that is turned in their middle."""
    angle = 2 * np.pi * np.arange(count) / count
    eye = radius_mm * np.stack([np.cos(angle), np.sin(angle), 0.2 * np.cos(2 * angle)], axis=1)
    rng = np.random.default_rng(seed)
    cameras = tuple(camera(1000.0 + 40 * k, models[k % len(models)]) for k in range(count))
    names = ("front", "left", "back", "right") if count == 4 else tuple(f"cam{k}" for k in range(count))
    shown = points or solver_scenes.icosahedron(100.0, 5)
    return scene_of(
        names, cameras, look_at(eye, np.zeros((count, 3))), _held(frames, rng, 40.0, 3.0), shown, rng, noise_px
    )


def scene_of(
    names: Sequence[str],
    cameras: Sequence[Camera],
    cam_from_world: Array,
    world_from_target: Array,
    points: KnownPoints,
    rng: np.random.Generator,
    noise_px: float = 0.1,
) -> RigScene:
    """What cameras anywhere see of a target anywhere; the first camera's frame becomes the rig's."""
    cam_from_rig = cam_from_world @ invert(cam_from_world[0])
    cam_from_rig[0] = np.eye(4)
    rig_from_target = cam_from_world[0] @ world_from_target
    observations = seen_by_all(names, cameras, cam_from_rig[:, None] @ rig_from_target, points, rng, noise_px)
    return RigScene(tuple(cameras), cam_from_rig, rig_from_target, observations, noise_px)


def camera_in_hand(turns: Array, *, noise_px: float = 0.02) -> tuple[RigObservations, Mechanism, Array]:
    """A camera that a robot turns by rotation vectors (V, 3) above a board: sightings, what the robot says, the truth.

    The robot's own noise is .2 mrad and .1 mm, the target 3 % smaller than its file says.
    """
    rng = np.random.default_rng(0)
    count = len(turns)
    cam_from_flange = make_pose(exp_rotation(np.array([0.1, -0.2, 1.0])), np.array([30.0, -20.0, 60.0]))
    base_from_target = make_pose(exp_rotation(np.array([0.3, 0.1, -0.4])), np.array([400.0, 100.0, 50.0]))
    first = look_at(np.array([0.0, -500.0, 0.0]), np.zeros(3)) @ make_pose(
        exp_rotation(np.array([1.5, 0.0, 0.0])), np.zeros(3)
    )
    frames = make_pose(exp_rotation(turns), rng.uniform(-60, 60, (count, 3))) @ first
    points = solver_scenes.board(9, 7, 20.0)
    scene = scene_of(("cam",), (camera(),), np.eye(4)[None], frames, points, rng, noise_px)
    seen = scene.observations.sightings[0]
    told = replace(seen, points=replace(points, position_mm=points.position_mm / 0.97))
    flange_from_base = invert(cam_from_flange) @ frames @ invert(base_from_target)
    wobble = make_pose(exp_rotation(rng.normal(0, 2e-4, (count, 3))), rng.normal(0, 0.1, (count, 3)))
    rows = scene.observations.frame[0]
    observations = keep_frames(replace(scene.observations, sightings=(told,)), np.isin(np.arange(count), rows))
    carrier = Mechanism(
        "robot, camera in hand", (wobble @ flange_from_base)[rows], is_camera_in_hand=True, size_sigma=FREE_SIZE
    )
    return observations, carrier, cam_from_flange


def seen_by_all(
    names: Sequence[str],
    cameras: Sequence[Camera],
    cam_from_target: Array,
    points: KnownPoints,
    rng: np.random.Generator,
    noise_px: float = 0.1,
    stamp_s: Array | None = None,
) -> RigObservations:
    """What cameras see of a target in frames.

    Args:
        names: of the cameras.
        cameras: likewise (C,).
        cam_from_target: where each stands to it in each frame (C, V, 4, 4).
        points: of the target.
        rng: for the noise.
        noise_px: of a coordinate.
        stamp_s: time stamps (C, V).
    """
    frame_names = tuple(f"frame{v:03d}" for v in range(cam_from_target.shape[1]))
    sightings, frames = [], []
    for one, poses in zip(cameras, cam_from_target, strict=True):
        seen = solver_scenes.observe(one, points, poses, rng, noise_px=noise_px)
        enough = sightings_per_view(seen) >= LEAST_POINTS
        seen = keep_views(seen, enough)
        covariance = np.tile(max(noise_px, 1e-3) ** 2 * np.eye(2), (len(seen.view), 1, 1))
        rows = np.flatnonzero(enough)
        view_names = tuple(f"{frame_names[row]}.png" for row in rows.tolist())
        sightings.append(replace(seen, cov_px2=covariance, view_names=view_names))
        frames.append(rows)
    times = None if stamp_s is None else tuple(stamp[rows] for stamp, rows in zip(stamp_s, frames, strict=True))
    return RigObservations(tuple(names), frame_names, tuple(sightings), tuple(frames), times)


def solved_slowly(scene: RigScene, *, refined: Sequence[bool] | None = None, steps: int = 3) -> RigCalibration:
    """The joint adjustment by dense normal equations, from the truth: cameras, their poses, and the target's."""
    is_refined = tuple(refined or [True] * len(scene.cameras))
    cameras, cam_from_rig, rig_from_target = list(scene.cameras), scene.cam_from_rig.copy(), scene.rig_from_target
    for number in range(steps + 1):
        design, residual, free = _equations(scene.observations, cameras, cam_from_rig, rig_from_target, is_refined)
        scale = 1 / np.sqrt(np.maximum((design[:, free] ** 2).sum(axis=0), 1e-300))
        scaled = design[:, free] * scale
        if number < steps:
            step = np.zeros(len(free))
            step[free] = -scale * np.linalg.solve(scaled.T @ scaled, scaled.T @ residual)
            cameras, cam_from_rig, rig_from_target = _moved(cameras, cam_from_rig, rig_from_target, step)
    left = np.sqrt(float(residual @ residual) / (len(residual) - int(free.sum())))
    covariance = np.zeros((len(free),) * 2)
    covariance[np.ix_(free, free)] = left**2 * np.linalg.inv(scaled.T @ scaled) * np.outer(scale, scale)
    own = sum(len(one.params) + POSE for one in cameras)
    rows = [slice(own + POSE * v, own + POSE * (v + 1)) for v in range(len(rig_from_target))]
    seen = scene.observations
    return RigCalibration(
        observations=seen, cameras=tuple(cameras), cam_from_rig=cam_from_rig, rig_from_target=rig_from_target,
        residual_px=tuple(
            residuals_of(one, pose, rig_from_target[frame], sightings)
            for one, pose, frame, sightings in zip(cameras, cam_from_rig, seen.frame, seen.sightings, strict=True)
        ),
        is_outlier=tuple(np.zeros(len(one.view), dtype=bool) for one in seen.sightings),
        scale=np.full(len(cameras), left), covariance=covariance[:own, :own],
        frame_covariance=np.stack([covariance[one, one] for one in rows]),
        pose_covariance=tuple(
            _view_covariances(covariance, own, stop, pose, rig_from_target, frame)
            for stop, pose, frame in zip(
                np.cumsum([len(one.params) + POSE for one in cameras]).tolist(), cam_from_rig, seen.frame, strict=True
            )
        ),
        reference=0, rig_frame="",
        fixed=tuple(
            () if free else parameter_names(one.model) for one, free in zip(cameras, is_refined, strict=True)
        ),
        weighted=True, status="converged", remarks=(),
        iterations=steps, seconds=0.1, priors=((),) * len(cameras),
    )  # fmt: skip


def _view_covariances(
    covariance: Array, own: int, stop: int, cam_from_rig: Array, rig_from_target: Array, frames: Rows
) -> Array:
    """Of one camera's `cam_from_target`, whose own pose's unknowns stop somewhere: `J V J'`, differences for J."""
    told = []
    for frame in frames.tolist():
        rows = np.concatenate([np.arange(stop - POSE, stop), own + POSE * frame + np.arange(POSE)])
        at = cam_from_rig @ rig_from_target[frame]
        moved = [
            _stepped(cam_from_rig, step[:POSE]) @ _stepped(rig_from_target[frame], step[POSE:])
            for step in 1e-6 * np.eye(2 * POSE)
        ]
        by = steps_between(at, np.stack(moved)).T / 1e-6
        told.append(by @ covariance[np.ix_(rows, rows)] @ by.T)
    return np.stack(told)


def residuals_of(one: Camera, cam_from_rig: Array, rig_from_target: Array, seen: Observations) -> Array:
    """Predicted less measured of a camera's sightings, whose views are these poses of the target.  # (M, 2)"""
    pose = cam_from_rig @ rig_from_target
    return project(one, transform(pose[seen.view], seen.points.position_mm[seen.point])) - seen.center_px


def _equations(
    observations: RigObservations, cameras: Sequence[Camera], cam_from_rig: Array, rig_from_target: Array,
    refined: Sequence[bool],
) -> tuple[Array, Array, Flags]:  # fmt: skip
    """Whitened derivatives (2 M, N) and residuals (2 M,) of all cameras, and which unknowns are free (N,)."""
    sizes = [len(one.params) + POSE for one in cameras]
    first = np.concatenate([[0], np.cumsum(sizes)])
    total = int(first[-1]) + POSE * len(rig_from_target)
    designs, residuals = [], []
    free = np.ones(total, dtype=bool)
    free[first[1] - POSE : first[1]] = False
    for k, (one, seen) in enumerate(zip(cameras, observations.sightings, strict=True)):
        frame = observations.frame[k][seen.view]
        in_rig = transform(rig_from_target[frame], seen.points.position_mm[seen.point])
        in_camera = transform(cam_from_rig[k], in_rig)
        at = linearise(one, np.ascontiguousarray(in_camera.T))
        by_point = at.by_point.transpose(2, 0, 1)
        parameters = len(one.params)
        design = np.zeros((len(frame), 2, total))
        design[:, :, first[k] : first[k] + parameters] = at.by_params.transpose(2, 0, 1)
        turned = in_camera - cam_from_rig[k, :3, 3]
        design[:, :, first[k] + parameters : first[k + 1]] = _by_pose(by_point, turned)
        moved = _by_pose(by_point @ cam_from_rig[k, :3, :3], in_rig - rig_from_target[frame, :3, 3])
        columns = first[-1] + POSE * frame[:, None] + np.arange(POSE)
        np.put_along_axis(design, np.repeat(columns[:, None], 2, axis=1), moved, axis=2)
        assert seen.cov_px2 is not None
        whitener = np.linalg.inv(np.linalg.cholesky(seen.cov_px2))
        designs.append((whitener @ design).reshape(-1, total))
        residuals.append((whitener @ (at.pixel.T - seen.center_px)[..., None]).reshape(-1))
        free[first[k] : first[k] + parameters] = refined[k]
    return np.concatenate(designs), np.concatenate(residuals), free


def _by_pose(by_point: Array, turned: Array) -> Array:
    """Derivatives (M, 2, 6) by a turn w about the frame's origin, `w x turned`, and a shift."""
    return np.concatenate([np.cross(turned[:, None], by_point), by_point], axis=2)


def _moved(
    cameras: Sequence[Camera], cam_from_rig: Array, rig_from_target: Array, step: Array
) -> tuple[list[Camera], Array, Array]:
    """All unknowns a step further."""
    moved, poses, begin = [], [], 0
    for one, pose in zip(cameras, cam_from_rig, strict=True):
        end = begin + len(one.params)
        moved.append(replace(one, params=one.params + step[begin:end]))
        poses.append(_stepped(pose, step[end : end + POSE]))
        begin = end + POSE
    frames = step[begin:].reshape(-1, POSE)
    return moved, np.stack(poses), np.stack([_stepped(*pair) for pair in zip(rig_from_target, frames, strict=True)])


def _stepped(pose: Array, step: Array) -> Array:
    return make_pose(exp_rotation(step[:3]) @ pose[:3, :3], pose[:3, 3] + step[3:])


def _held(frames: int, rng: np.random.Generator, shift_mm: float, turn_rad: float) -> Array:
    """How a target is held in turn, about the middle.  # (V, 4, 4)"""
    axis = rng.standard_normal((frames, 3))
    turn = axis / np.linalg.norm(axis, axis=1, keepdims=True) * rng.uniform(0, turn_rad, (frames, 1))
    return make_pose(exp_rotation(turn), rng.uniform(-shift_mm, shift_mm, (frames, 3)))


def _pose(turn_rad: Sequence[float], shift_mm: Sequence[float]) -> Array:
    return make_pose(exp_rotation(np.array(turn_rad, dtype=np.float64)), np.array(shift_mm, dtype=np.float64))

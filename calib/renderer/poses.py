"""Where the camera stands: Fibonacci grids around the target, or poses from a file."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.core.csv_table import read_table
from calib.core.se3 import exp_rotation, look_at, make_pose, rigid_fault, rotation_between
from calib.renderer.options import Region
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.files import JsonValue, parse_json, read_small_text
from designer.target import TargetGeometry, bounding_radius_mm

MAX_VIEWS = 100_000
HALF_ANGLE_RAD: Mapping[Region, float] = {"hemisphere": math.pi / 2, "sphere": math.pi, "cap": math.pi / 3}
"""Of a region, unless another is wanted of a cap."""
MAX_DRAWS, DRAWN_AT_ONCE = 200, 2000
MAX_FILE_BYTES = 64 * 2**20
GOLDEN_ANGLE_RAD = math.pi * (3 - math.sqrt(5))
COLUMNS = ("rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm")
MAX_TURN_RAD = 1000.0
"""Farther turns lose digits, and are likely no radians."""


@dataclass(frozen=True)
class PoseGrid:
    """Cameras around the target's z axis that look at its origin."""

    views: int
    half_angle_rad: float  # of the cap around +z: pi / 2 is a hemisphere, pi the sphere
    distance_mm: tuple[float, float]  # drawn evenly between the two
    random_roll: bool
    aim_offset_mm: float  # the camera looks at a random point of a ball of this radius
    is_two_sided: bool = False  # every second camera stands opposite, below the plane z = 0
    aside: Array | None = None  # (V, 3) directions in which the cameras see what they aim at; None: straight ahead


def grid_around(
    target: TargetGeometry, views: int, distance_mm: float | tuple[float, float], region: Region | None,
    cap_rad: float | None, aim_offset_mm: float, *, random_roll: bool,
) -> PoseGrid:  # fmt: skip
    """A grid of cameras that all stand off a target.

    Args:
        target: in the middle.
        views: how many.
        distance_mm: from the target's origin, or the nearest and farthest.
        region: None: a cap for a flat target and a corner, else the sphere.
        cap_rad: half angle of a cap; None: the usual one.
        aim_offset_mm: as `PoseGrid` has it.
        random_roll: as `PoseGrid` has it.

    Raises:
        InputError: cameras within the target, or a cap's angle without a cap.
    """
    near, far = distance_mm if isinstance(distance_mm, tuple | list) else (distance_mm, distance_mm)
    inside = bounding_radius_mm(target)
    if not inside + aim_offset_mm < near:
        raise InputError(
            f"--distance {near:g}mm: the target reaches {inside:.0f}mm from its origin, "
            f"and the aim {aim_offset_mm:g}mm; stay farther away"
        )
    where: Region = region or ("cap" if target.faces_up else "sphere")
    if cap_rad is not None and where != "cap":
        raise InputError(f"--cap-angle: says nothing of a {where}; add --region cap")
    half_angle = HALF_ANGLE_RAD[where] if cap_rad is None else cap_rad
    is_two_sided = where == "cap" and target.has_back
    return PoseGrid(views, half_angle, (near, far), random_roll, aim_offset_mm, is_two_sided)


def fibonacci_cap(count: int, half_angle_rad: float) -> Array:
    """Unit vectors (count, 3), evenly spread over a cap around +z.

    Equal steps of height and of the golden angle (Swinbank and Purser 2006).
    """
    step = np.arange(count) + 0.5
    z = 1 - (1 - math.cos(half_angle_rad)) * step / count
    radius = np.sqrt(np.maximum(0.0, 1 - z**2))
    angle = GOLDEN_ANGLE_RAD * step
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def grid_poses(grid: PoseGrid, rng: np.random.Generator) -> Array:
    """Poses `cam_from_target` (V, 4, 4) of a grid."""
    direction = fibonacci_cap(grid.views, grid.half_angle_rad)
    if grid.is_two_sided:
        direction[1::2, 2] *= -1
    distance = rng.uniform(*grid.distance_mm, size=grid.views)
    roll = rng.uniform(-np.pi, np.pi, size=grid.views) if grid.random_roll else np.zeros(grid.views)
    step = rng.standard_normal((grid.views, 3))
    length = grid.aim_offset_mm * rng.uniform(size=(grid.views, 1)) ** (1 / 3)
    aim = length * step / np.linalg.norm(step, axis=1, keepdims=True)
    poses = look_at(aim + distance[:, None] * direction, aim, roll)
    if grid.aside is None:
        return poses
    return make_pose(rotation_between(np.array([0.0, 0.0, 1.0]), grid.aside), np.zeros(3)) @ poses


def photo_poses(grid: PoseGrid, camera: Camera, seed: int, aside_rad: float | None = None) -> tuple[Array, float]:
    """Poses `cam_from_target` (V, 4, 4) of a grid, and how far off the axis the camera sees what it aims at.

    Args:
        grid: without directions aside.
        camera: that takes the photos.
        seed: of all that is random.
        aside_rad: how far off the axis at most; None: anywhere in a wide lens's image, else straight ahead.
    """
    limit = (math.pi if camera.has_dark_corners else 0.0) if aside_rad is None else aside_rad
    if limit:
        rng = np.random.default_rng([seed, grid.views])
        grid = replace(grid, aside=directions_over_image(camera, grid.views, limit, rng))
    return grid_poses(grid, np.random.default_rng(seed)), limit


def directions_over_image(camera: Camera, count: int, limit_rad: float, rng: np.random.Generator) -> Array:
    """Directions (count, 3) of light, drawn evenly over the part of the image that sees up to an angle off the axis.

    Raises:
        InputError: no pixel sees there.
    """
    seen = np.zeros((0, 3))
    for _ in range(MAX_DRAWS):
        ray = rays(camera, rng.uniform(-0.5, np.array(camera.image_size) - 0.5, (DRAWN_AT_ONCE, 2)))
        seen = np.concatenate([seen, ray[ray[:, 2] >= math.cos(limit_rad)]])  # false where there is no light
        if len(seen) >= count:
            return seen[:count]
    raise InputError(f"--aside {math.degrees(limit_rad):g}deg: this camera sees hardly anything there; give more")


def poses_of(poses: Array | str | PathLike[str]) -> Array:
    """Poses `cam_from_target` (V, 4, 4) of a file, or of an array of one or several.

    Raises:
        InputError: as `load_poses`, or an array of another shape, or of no rigid motions.
    """
    if isinstance(poses, str | PathLike):
        return load_poses(Path(poses))
    try:
        where = np.asarray(poses, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("poses are no numbers: give cam_from_target (V, 4, 4)") from None
    where = where[None] if where.ndim == 2 else where
    if where.shape[1:] != (4, 4) or not len(where):
        raise InputError(f"poses of shape {where.shape}: give cam_from_target (V, 4, 4)")
    if fault := rigid_fault(where):
        raise InputError(f"pose {fault[0]}: {fault[1]}; it must be a rigid motion")
    return where


def load_poses(path: Path) -> Array:
    """Poses `cam_from_target` (V, 4, 4) from a file.

    JSON: a list of 4 x 4 matrices, or a `truth.json`. CSV: a header line `rx_rad,ry_rad,rz_rad,tx_mm,ty_mm,tz_mm`,
    then a rotation vector and a translation a line.

    Raises:
        InputError: the file cannot be read or holds no rigid motions; the message names it.
    """
    text = read_small_text(path, MAX_FILE_BYTES, "a file of poses")
    try:
        if path.suffix.lower() == ".csv":
            poses = _poses_from_csv(path, text)
        else:
            poses = _poses_from_json(parse_json(text, path, "a file of poses"))
        if not 0 < len(poses) <= MAX_VIEWS:
            raise ValueError(f"{len(poses)} poses; give 1 to {MAX_VIEWS}")
        if fault := rigid_fault(poses):
            raise ValueError(f"pose {fault[0]} (from 0) {fault[1]}; give a rotation, a translation in mm, and 0 0 0 1")
    except ValueError as error:
        raise error if isinstance(error, InputError) else InputError(f"{path}: {error}") from None
    return poses


def _poses_from_json(document: JsonValue) -> Array:
    if isinstance(document, dict):
        views = document.get("views")
        if not isinstance(views, list):
            raise ValueError("no poses; give a list of 4 x 4 matrices, or a truth.json")
        document = [view.get("cam_from_target") if isinstance(view, dict) else None for view in views]
    try:
        poses = np.array(document, dtype=np.float64)
    except (ValueError, TypeError, OverflowError):
        raise ValueError("no poses; give a list of 4 x 4 matrices of numbers") from None
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"an array of shape {poses.shape}; poses are a list of 4 x 4 matrices")
    return poses


def _poses_from_csv(path: Path, text: str) -> Array:
    wanted = f"the columns must be {','.join(COLUMNS)}"
    table = read_table(path, text, lambda names: "" if names == COLUMNS else wanted)
    values = table.columns(COLUMNS)
    turn = np.abs(values[:, :3]).max(axis=1, initial=0)
    table.require(turn <= MAX_TURN_RAD, f"turns by more than {MAX_TURN_RAD:g} rad; rx, ry, rz are in rad")
    return make_pose(exp_rotation(values[:, :3]), values[:, 3:])

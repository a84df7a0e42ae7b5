"""Where a known camera stood before a target, how surely, and the files that say so."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.se3 import log_rotation, skew
from calib.core.types import Detections
from calib.observe.observations import observations_for_poses
from calib.solver.pose import solve_poses
from designer.base.errors import InputError
from designer.base.own_files import require_ours
from designer.target import TargetGeometry

Array = NDArray[np.float64]

FORMAT = "ringsolid.poses"
VERSION = 1
CSV_COLUMNS = (
    "image", "rings", "rms_px", "x_mm", "y_mm", "z_mm", "sx_mm", "sy_mm", "sz_mm", "distance_mm", "sdistance_mm",
    "srotation_deg", "rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm",
    *(f"c{row}{column}" for row in range(6) for column in range(row, 6)),
)  # fmt: skip
CSV_EXPLAINED = (
    f"# ringsolid poses, version {VERSION}",
    "# x y z: the camera in the target's frame; s: standard deviations, that of the rotation about its least sure axis",
    "# r t: cam_from_target as rotation vector and translation, camera x right, y down, z forward",
    "# c00..c55: covariance of a further rotation vector (rad) and translation (mm), both in the camera's axes",
)
SUFFIXES = (".json", ".csv")


@dataclass(frozen=True, eq=False)
class TargetPose:
    """The pose in one photo. Standard deviations hold if errors of the rings' centres are independent."""

    image: str
    rings: int  # that were used
    cam_from_target: Array  # (4, 4)
    covariance: Array  # (6, 6) rotation vector (rad) and translation (mm), both in the camera's axes
    rms_px: float  # of the distances between measured and predicted centres
    camera_mm: Array  # (3,) the camera's centre in the target's frame
    camera_sigma_mm: Array  # (3,)
    distance_mm: float  # from the camera to the target's origin
    distance_sigma_mm: float
    rotation_sigma_rad: float  # about the axis it is least sure about


def check_output(path: Path) -> None:
    """Refuse a place that holds something else, before any work is done.

    Raises:
        InputError: not a .json or .csv, a folder, or an existing file of another kind.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: poses are a .json or a .csv file; name it so, such as poses.json")
    require_ours(path, kind=FORMAT)


@dataclass(frozen=True, eq=False)
class FoundPoses:
    """What came of several photos."""

    poses: tuple[TargetPose, ...]  # in the order of the photos
    too_few: tuple[str, ...]  # photos with too few rings for a pose, or all on a line
    not_solved: tuple[str, ...]  # photos whose rings no pose fits


def target_poses(photos: Sequence[Detections], target: TargetGeometry, camera: Camera, *, weighted: bool) -> FoundPoses:
    """The poses in the photos that show enough of the target.

    Args:
        photos: what was seen in photos of the camera.
        target: of the same layout.
        camera: is taken as it is.
        weighted: by the covariances of the centres.
    """
    seen = observations_for_poses(photos, target)
    if seen is None:
        return FoundPoses((), tuple(one.image for one in photos), ())
    solved = solve_poses(camera, seen, weighted=weighted)
    is_solved = [
        bool(np.isfinite(pose).all() and np.isfinite(covariance).all())
        for pose, covariance in zip(solved.cam_from_target, solved.covariance, strict=True)
    ]
    usable = set(seen.view_names)
    poses = (
        _target_pose(name, solved.cam_from_target[view], solved.covariance[view], solved.residual_px[seen.view == view])
        for view, name in enumerate(seen.view_names)
        if is_solved[view]
    )
    return FoundPoses(
        poses=tuple(poses),
        too_few=tuple(one.image for one in photos if one.image not in usable),
        not_solved=tuple(name for name, ok in zip(seen.view_names, is_solved, strict=True) if not ok),
    )


def _target_pose(image: str, cam_from_target: Array, covariance: Array, residual_px: Array) -> TargetPose:
    """One pose with what follows from it.

    The camera's centre is `-R' t`; turned by w and shifted by s in the camera's axes, R becomes `exp(w) R` and t
    becomes `t + s`, so the centre moves by `-R' (s + t x w)`.
    """
    residual_px = residual_px[np.isfinite(residual_px).all(axis=1)]  # the others lie where the camera has no image
    rotation, translation = cam_from_target[:3, :3], cam_from_target[:3, 3]
    by_pose = -rotation.T @ np.hstack([skew(translation), np.eye(3)])
    distance = float(np.linalg.norm(translation))
    sight = translation / distance
    return TargetPose(
        image=image,
        rings=len(residual_px),
        cam_from_target=cam_from_target,
        covariance=covariance,
        rms_px=float(np.sqrt((residual_px**2).sum(axis=1).mean())),
        camera_mm=-rotation.T @ translation,
        camera_sigma_mm=np.sqrt(np.diag(by_pose @ covariance @ by_pose.T)),
        distance_mm=distance,
        distance_sigma_mm=float(np.sqrt(sight @ covariance[3:, 3:] @ sight)),
        rotation_sigma_rad=float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])),
    )


def poses_to_json(
    poses: Sequence[TargetPose], target: TargetGeometry, camera: Camera, failed: Sequence[tuple[str, str]]
) -> bytes:
    """The content of a poses file, one line a view; `calib render --poses` reads it, too.

    Args:
        poses: what was found.
        target: the target.
        camera: the camera.
        failed: images without a pose, and why.
    """
    head: dict[str, object] = {
        "format": FORMAT,
        "version": VERSION,
        "geometry_id": target.geometry_id,
        "camera": {"model": camera.model, "image_size": list(camera.image_size), "params": camera.params.tolist()},
        "covariance": "rotation vector (rad), translation (mm), in the camera's axes",
    }
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    lines += [_json_rows("views", [_view(pose) for pose in poses])]
    lines += [_json_rows("failed", [{"file": image, "reason": reason} for image, reason in failed])]
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def _json_rows(key: str, rows: Sequence[dict[str, object]]) -> str:
    body = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    return f'"{key}": [\n{body}\n]' if rows else f'"{key}": []'


def _view(pose: TargetPose) -> dict[str, object]:
    return {
        "file": pose.image,
        "rings": pose.rings,
        "rms_px": pose.rms_px,
        "camera_mm": pose.camera_mm.tolist(),
        "camera_sigma_mm": pose.camera_sigma_mm.tolist(),
        "distance_mm": pose.distance_mm,
        "distance_sigma_mm": pose.distance_sigma_mm,
        "rotation_sigma_deg": float(np.degrees(pose.rotation_sigma_rad)),
        "cam_from_target": pose.cam_from_target.tolist(),
        "covariance": pose.covariance.tolist(),
    }


def poses_to_csv(poses: Sequence[TargetPose]) -> bytes:
    """The poses as a table, one line a photo."""
    stream = io.StringIO(newline="")
    stream.writelines(f"{line}\n" for line in CSV_EXPLAINED)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for pose in poses:
        numbers = [
            pose.rms_px,
            *pose.camera_mm.tolist(),
            *pose.camera_sigma_mm.tolist(),
            pose.distance_mm,
            pose.distance_sigma_mm,
            float(np.degrees(pose.rotation_sigma_rad)),
            *log_rotation(pose.cam_from_target[:3, :3]).tolist(),
            *pose.cam_from_target[:3, 3].tolist(),
            *pose.covariance[np.triu_indices(6)].tolist(),
        ]
        writer.writerow([pose.image, pose.rings, *map(repr, numbers)])
    return stream.getvalue().encode("utf-8", "surrogatepass")

"""Where a known camera stood before a target, how surely, and the files that say so."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.cameras.camera import Camera
from calib.core.csv_table import csv_bytes, csv_cell
from calib.core.linear_algebra import rms_length
from calib.core.se3 import log_rotation, skew
from calib.core.types import Detections
from calib.observe.observations import observations_for_poses
from calib.observe.photos import Search
from calib.solver.start import solve_poses
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import place_of, write_files
from designer.base.marks import Hash, Key, Shape
from designer.base.own_files import require_ours
from designer.target import TargetGeometry

POSES_VERSION = 1
CSV_COLUMNS = (
    "image", "rings", "rms_px", "x_mm", "y_mm", "z_mm", "sx_mm", "sy_mm", "sz_mm", "distance_mm", "sdistance_mm",
    "srotation_deg", "rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm",
    *(f"c{row}{column}" for row in range(6) for column in range(row, 6)),
)  # fmt: skip
CSV_EXPLAINED = (
    f"# ringsolid poses, version {POSES_VERSION}",
    "# x y z: the camera in the target's frame; s: standard deviations, that of the rotation about its least sure axis",
    "# r t: cam_from_target as rotation vector and translation, camera x right, y down, z forward",
    "# c00..c55: covariance of a further rotation vector (rad) and translation (mm), both in the camera's axes",
)
SUFFIXES = (".json", ".csv")
TOO_FEW = "too few points for a pose, or all on a line"
NOT_SOLVED = "no pose fits the points that were found; check the camera file"


@dataclass(frozen=True, eq=False)
class TargetPose:
    """The pose in one photo. Standard deviations hold if errors of the rings' centres are independent."""

    image: Annotated[str, Key("file")]
    rings: int  # that were used
    rms_px: float  # of the distances between measured and predicted centres
    camera_mm: Annotated[Array, Shape(3)]  # the camera's centre in the target's frame
    camera_sigma_mm: Annotated[Array, Shape(3)]
    distance_mm: float  # from the camera to the target's origin
    distance_sigma_mm: float
    rotation_sigma_rad: float  # about the axis it is least sure about
    cam_from_target: Annotated[Array, Shape(4, 4)]
    covariance: Annotated[Array, Shape(6, 6)]  # rotation vector (rad) and translation (mm), both in the camera's axes


@dataclass(frozen=True)
class PhotoWithoutPose:
    """A photo that gives none."""

    image: Annotated[str, Key("file")]
    reason: str


@dataclass(frozen=True, eq=False)
class PosesDocument:
    """The keys of `poses.json`."""

    geometry_id: Hash
    camera: Camera
    views: tuple[TargetPose, ...]
    failed: tuple[PhotoWithoutPose, ...]
    covariance: str = "rotation vector (rad), translation (mm), in the camera's axes"


POSES = FileKind(
    PosesDocument, "poses", "a poses.json", "find the poses again", POSES_VERSION, largest_bytes=256 * 2**20
)
"""`calib render --poses` reads it, too."""


@dataclass(frozen=True, eq=False)
class PoseResult:
    """The poses in some photos: `found.save("poses.csv")`."""

    target: TargetGeometry
    camera: Camera
    search: Search
    poses: tuple[TargetPose, ...]  # in the order of the photos
    without_pose: tuple[PhotoWithoutPose, ...]

    @property
    def usual_px(self) -> float:
        """The RMS residual of the median photo; nan without one."""
        known = [pose.rms_px for pose in self.poses if np.isfinite(pose.rms_px)]
        return float(np.median(known)) if known else np.nan

    def save(self, path: str | PathLike[str]) -> Path:
        """Write `poses.json` or `poses.csv`, by the suffix; return its place.

        Raises:
            InputError: another suffix, or a file of somebody else's.
        """
        place = place_of(path, "a file to write, such as poses.csv")
        check_output(place)
        document = PosesDocument(self.target.geometry_id, self.camera, self.poses, self.without_pose)
        write_files({place: poses_to_csv(self.poses) if place.suffix.lower() == ".csv" else POSES.text(document)})
        return place

    @property
    def failures(self) -> tuple[str, ...]:
        """What could not be read or searched, one line each."""
        return self.search.failures


@dataclass(frozen=True, eq=False)
class FoundPoses:
    """What came of several photos."""

    poses: tuple[TargetPose, ...]  # in the order of the photos
    failed: tuple[PhotoWithoutPose, ...]  # the other photos


def check_output(path: Path, kind: str = POSES.format) -> None:
    """Refuse a place that holds something else, before any work is done.

    Raises:
        InputError: not a .json or .csv, a folder, or an existing file of another kind.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: poses are a .json or a .csv file; name it so, such as poses.json")
    require_ours(path, kind=kind.replace("_", "-") if path.suffix.lower() == ".csv" else kind)


def target_poses(photos: Sequence[Detections], target: TargetGeometry, camera: Camera, *, weighted: bool) -> FoundPoses:
    """The poses in the photos that show enough of the target.

    Args:
        photos: what was seen in photos of the camera.
        target: of the same layout.
        camera: is taken as it is.
        weighted: by the covariances of the centres.
    """

    def why_not(one: Detections) -> str:
        return TOO_FEW if len(one.ring) else "; ".join(one.remarks) or "the target was not found"

    seen = observations_for_poses(photos, target)
    if seen is None:
        return FoundPoses((), tuple(PhotoWithoutPose(one.image, why_not(one)) for one in photos))
    solved = solve_poses(camera, seen, weighted=weighted)
    is_solved = [
        bool(np.isfinite(pose).all() and np.isfinite(covariance).all())
        for pose, covariance in zip(solved.cam_from_target, solved.covariance, strict=True)
    ]
    poses = tuple(
        target_pose(name, solved.cam_from_target[view], solved.covariance[view], solved.residual_px[seen.view == view])
        for view, name in enumerate(seen.view_names)
        if is_solved[view]
    )
    fits = dict(zip(seen.view_names, is_solved, strict=True))
    failed = (
        PhotoWithoutPose(one.image, NOT_SOLVED if one.image in fits else why_not(one))
        for one in photos
        if not fits.get(one.image, False)
    )
    return FoundPoses(poses, tuple(failed))


def target_pose(image: str, cam_from_target: Array, covariance: Array, residual_px: Array) -> TargetPose:
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
        rms_px=rms_length(residual_px),
        camera_mm=-rotation.T @ translation,
        camera_sigma_mm=np.sqrt(np.diag(by_pose @ covariance @ by_pose.T)),
        distance_mm=distance,
        distance_sigma_mm=float(np.sqrt(sight @ covariance[3:, 3:] @ sight)),
        rotation_sigma_rad=float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])),
    )


def poses_to_csv(poses: Sequence[TargetPose]) -> bytes:
    """The poses as a table, one line a photo."""
    rows = []
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
        rows.append([csv_cell(pose.image), str(pose.rings), *map(repr, numbers)])
    return csv_bytes(CSV_EXPLAINED, CSV_COLUMNS, rows)

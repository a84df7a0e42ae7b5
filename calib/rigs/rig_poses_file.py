"""Where a target is in a rig's frame, frame by frame, and the files that say so: `rig_poses.json`, or a table."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.cameras.rig import Rig
from calib.core.se3 import log_rotation
from calib.observe.photos import Search
from calib.observe.rig_photos import RigPhotos
from calib.observe.target_poses import SUFFIXES
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import place_of, write_files
from designer.base.marks import Gap, Hash, Shape
from designer.base.own_files import require_ours
from designer.target import TargetGeometry

RIG_POSES_VERSION = 1
COLUMNS = (
    "frame", "cameras", "rings", "rms_px", "x_mm", "y_mm", "z_mm", "sx_mm", "sy_mm", "sz_mm", "srotation_deg",
    "excess", "rx_rad", "ry_rad", "rz_rad", *(f"c{row}{column}" for row in range(6) for column in range(row, 6)),
)  # fmt: skip
EXPLAINED = (
    f"# ringsolid rig-poses, version {RIG_POSES_VERSION}",
    "# x y z: the target's origin in the rig's frame",
    "# s: standard deviations, that of the rotation about its least sure axis",
    "# r: the rotation vector of rig_from_target, whose translation is x y z",
    "# c00..c55: covariance of a further rotation vector (rad) and translation (mm), both in the rig's axes",
    "# excess: residuals in what noise and rig let expect, where that is no chance; it is in s and c",
    "# rings_, rms_px_: of each camera",
)


@dataclass(frozen=True)
class CameraResidual:
    """What one camera leaves over in a frame."""

    camera: str
    image: str
    rings: int  # that were used
    rms_px: Gap  # of the distances between measured and predicted centres


@dataclass(frozen=True, eq=False)
class RigTargetPose:
    """The pose in one frame; its covariance is by the noise of the centres and by the rig's own errors."""

    frame: str
    cameras: tuple[CameraResidual, ...]  # that saw the target
    rings: int
    rms_px: float
    target_mm: Annotated[Array, Shape(3)]  # the target's origin in the rig's frame
    target_sigma_mm: Annotated[Array, Shape(3)]
    rotation_sigma_rad: float  # about the axis it is least sure about
    rig_from_target: Annotated[Array, Shape(4, 4)]
    covariance: Annotated[Array, Shape(6, 6)]
    noise_covariance: Annotated[Array, Shape(6, 6)]  # its part by the noise alone
    excess: float  # by which residuals exceed what is expected, beyond chance; it is in both covariances

    @property
    def noise_sigma_mm(self) -> float:
        """Root mean square length of the error of the target's place by the noise alone."""
        return float(np.sqrt(np.trace(self.noise_covariance[3:, 3:])))

    @property
    def sigma_mm(self) -> float:
        """Likewise by all that is known."""
        return float(np.sqrt(np.trace(self.covariance[3:, 3:])))


@dataclass(frozen=True)
class FrameWithoutPose:
    """A frame that gives none."""

    frame: str
    reason: str


@dataclass(frozen=True, eq=False)
class RigPosesDocument:
    """The keys of a file of poses in a rig's frame."""

    geometry_id: Hash
    cameras: tuple[str, ...]  # of the rig
    rig_frame: str  # whose frame the rig's is
    has_rig_covariance: bool  # else covariances are by the noise alone
    frames: tuple[RigTargetPose, ...]
    failed: tuple[FrameWithoutPose, ...]
    covariance: str = "rotation vector (rad), translation (mm), in the rig's axes"


RIG_POSES = FileKind(
    RigPosesDocument, "rig_poses", "a file of poses in a rig's frame", "find the poses again", RIG_POSES_VERSION,
    largest_bytes=256 * 2**20,
)  # fmt: skip


def rig_poses_csv(poses: Sequence[RigTargetPose], cameras: Sequence[str]) -> bytes:
    """The poses as a table, one line a frame."""
    stream = io.StringIO(newline="")
    stream.writelines(f"{line}\n" for line in EXPLAINED)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*COLUMNS, *(f"{what}_{name}" for name in cameras for what in ("rings", "rms_px"))])
    for pose in poses:
        numbers = [
            pose.rms_px, *pose.target_mm.tolist(), *pose.target_sigma_mm.tolist(),
            float(np.degrees(pose.rotation_sigma_rad)), pose.excess,
            *log_rotation(pose.rig_from_target[:3, :3]).tolist(), *pose.covariance[np.triu_indices(6)].tolist(),
        ]  # fmt: skip
        of_camera = {one.camera: one for one in pose.cameras}
        own = [
            (of_camera[name].rings, repr(of_camera[name].rms_px)) if name in of_camera else (0, "") for name in cameras
        ]
        writer.writerow(
            [pose.frame, len(pose.cameras), pose.rings, *map(repr, numbers), *(cell for pair in own for cell in pair)]
        )
    return stream.getvalue().encode("utf-8", "surrogatepass")


@dataclass(frozen=True, eq=False)
class RigPoseResult:
    """The poses of a target in a rig's frame: `found.poses[0].rig_from_target`, `found.save("poses.csv")`."""

    target: TargetGeometry
    rig: Rig
    photos: RigPhotos  # joined to frames
    searches: tuple[Search, ...]  # of each camera's photos
    poses: tuple[RigTargetPose, ...]  # in the order of the frames
    without_pose: tuple[FrameWithoutPose, ...]

    @property
    def usual_px(self) -> float:
        """The RMS residual of the median frame; nan without one."""
        return float(np.median([pose.rms_px for pose in self.poses])) if self.poses else np.nan

    @property
    def failures(self) -> tuple[str, ...]:
        """What could not be read or searched, one line each."""
        return tuple(line for one in self.searches for line in one.failures)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the poses as .json or .csv, by the suffix; return the file's place.

        Raises:
            InputError: another suffix, or a file of somebody else's.
        """
        place = place_of(path, "a file to write, such as poses.csv")
        check_rig_poses_output(place)
        is_table = place.suffix.lower() == ".csv"
        write_files({place: rig_poses_csv(self.poses, self.rig.names) if is_table else self._json()})
        return place

    def _json(self) -> bytes:
        rig = self.rig
        return RIG_POSES.text(RigPosesDocument(
            self.target.geometry_id, rig.names, rig.rig_frame or rig.names[0], rig.covariance is not None, self.poses,
            self.without_pose,
        ))  # fmt: skip


def check_rig_poses_output(path: Path) -> None:
    """Refuse a place that holds something else, before any work is done.

    Raises:
        InputError: not a .json or .csv, a folder, or an existing file of another kind.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: poses are a .json or a .csv file; name it so, such as poses.json")
    kind = "ringsolid.rig-poses" if path.suffix.lower() == ".csv" else RIG_POSES.format
    require_ours(path, kind=kind)

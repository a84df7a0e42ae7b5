"""Where a target is in a rig's frame, frame by frame, and the files that say so: `rig_poses.json`, or a table."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.cameras.rig import Rig
from calib.core.csv_table import csv_bytes, csv_cell
from calib.core.linear_algebra import rms_length
from calib.core.se3 import log_rotation, transform
from calib.observe.observations import known_points
from calib.observe.photos import Search, images_in
from calib.observe.rig_photos import RigPhotos
from calib.observe.rig_search import Place, RigSearch, photos_of_rig, rig_input, search_cameras
from calib.observe.target_poses import TOO_FEW, PoseResult, check_output, target_pose, target_poses
from calib.rigs.target_pose import CameraSight, RigPose, pose_in_rig
from calib.rigs.turned_names import turned_in_rig
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import place_of, write_files
from designer.base.marks import Gap, Hash, Shape
from designer.base.words import printable
from designer.page.progress import Progress
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


NOT_SEEN = "no camera shows the target"
"""Why a frame has no pose."""


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
    rows = []
    for pose in poses:
        numbers = [
            pose.rms_px, *pose.target_mm.tolist(), *pose.target_sigma_mm.tolist(),
            float(np.degrees(pose.rotation_sigma_rad)), pose.excess,
            *log_rotation(pose.rig_from_target[:3, :3]).tolist(), *pose.covariance[np.triu_indices(6)].tolist(),
        ]  # fmt: skip
        residuals = {one.camera: (str(one.rings), repr(one.rms_px)) for one in pose.cameras}
        own = (cell for name in cameras for cell in residuals.get(name, ("0", "")))
        rows.append([csv_cell(pose.frame), str(len(pose.cameras)), str(pose.rings), *map(repr, numbers), *own])
    of_cameras = (csv_cell(f"{what}_{name}") for name in cameras for what in ("rings", "rms_px"))
    return csv_bytes(EXPLAINED, (*COLUMNS, *of_cameras), rows)


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
        check_output(place, RIG_POSES.format)
        is_table = place.suffix.lower() == ".csv"
        write_files({place: rig_poses_csv(self.poses, self.rig.names) if is_table else self._json()})
        return place

    def _json(self) -> bytes:
        rig = self.rig
        return RIG_POSES.text(RigPosesDocument(
            self.target.geometry_id, rig.names, rig.rig_frame or rig.names[0], rig.covariance is not None, self.poses,
            self.without_pose,
        ))  # fmt: skip

    def of_camera(self, number: int) -> PoseResult:
        """What one camera saw, with the poses that all cameras together tell: for pictures of its photos."""
        name, search = self.photos.camera_names[number], self.searches[number]
        row = self.rig.row(name)
        camera, cam_from_rig = self.rig.cameras[row], self.rig.cam_from_rig[row]
        turn = np.kron(np.eye(2), cam_from_rig[:3, :3])
        seen = {one.image: one for one in search.detections}
        poses = []
        for pose in self.poses:
            for one in (one for one in pose.cameras if one.camera == name):
                cam_from_target = cam_from_rig @ pose.rig_from_target
                place = transform(cam_from_target, self.target.center_mm[seen[one.image].ring])
                off = camera.project(place) - seen[one.image].center_px
                poses.append(target_pose(one.image, cam_from_target, turn @ pose.covariance @ turn.T, off))
        return PoseResult(self.target, camera, search, tuple(poses), ())


def poses_before_rig(
    target: TargetGeometry, rig: Rig, photos: Sequence[Place] | RigPhotos, *, weighted: bool, jobs: int | None,
    progress: Progress,
) -> RigPoseResult:  # fmt: skip
    """Where a target is in the rig's frame, in each frame of its cameras' photos.

    Raises:
        InputError: photos that cannot be read, or a camera that is not in the rig.
    """
    if not photos:
        raise InputError("no photos; give a folder a camera, named as in the rig, or one folder that holds these")
    given = rig_input(() if isinstance(photos, RigPhotos) else photos)
    if len(given.photos) == 1 and images_in(Path(given.photos[0])):
        raise InputError(
            f"{given.photos[0]}: one folder of images; give a folder a camera, named as in the rig (one camera alone: "
            "calib pose TARGET rig.json#NAME PHOTOS)"
        )
    taken = photos if isinstance(photos, RigPhotos) else photos_of_rig(given)
    lenses = {name: rig.cameras[rig.row(name)] for name in taken.camera_names}
    search = search_cameras(target, taken, lenses, None, jobs, progress)
    sights, said = _sights(rig, search, weighted=weighted)
    poses, failed = list[RigTargetPose](), list[FrameWithoutPose]()
    for frame in taken.frame_names:
        own = sights.get(frame, [])
        found = pose_in_rig(rig, own, target.center_mm, weighted=weighted) if own else None
        if found is None:
            failed.append(FrameWithoutPose(frame, TOO_FEW if own else NOT_SEEN + said.get(frame, "")))
        else:
            poses.append(_pose(frame, rig, own, found))
    return RigPoseResult(target, rig, taken, search.searches, tuple(poses), tuple(failed))


def _sights(rig: Rig, search: RigSearch, *, weighted: bool) -> tuple[dict[str, list[CameraSight]], dict[str, str]]:
    """What was seen in each frame, with the poses that each camera tells alone; and what is said of empty photos.

    Of each frame that of its first camera.
    """
    sights, said = dict[str, list[CameraSight]](), dict[str, str]()
    for name, one in zip(search.photos.camera_names, search.searches, strict=True):
        row, seen = rig.row(name), one.with_target
        told = target_poses(seen, search.target, rig.cameras[row], weighted=weighted).poses if seen else ()
        alone = {pose.image: pose.cam_from_target for pose in told}
        frame_of = {photo.path: photo.frame for photo in search.photos.of(name)}
        frames = {result.photo.name: frame_of[result.photo.path] for result in one.results}
        for shown in seen:
            sights.setdefault(frames[shown.image], []).append(CameraSight(row, shown, alone.get(shown.image)))
        for result in one.results:
            if result.seen is not None and not len(result.seen.ring) and result.seen.remarks:
                said.setdefault(frames[result.photo.name], f"; {printable(name)}: {result.seen.remarks[0]}")
    return {frame: _named_alike(rig, search.target, own) for frame, own in sights.items()}, said


def _named_alike(rig: Rig, target: TargetGeometry, sights: list[CameraSight]) -> list[CameraSight]:
    """The sights of a frame; of a board that looks the same turned, all as the first camera names it."""
    points = known_points(target)
    if points.turned is None or len(sights) < 2:
        return sights
    each = turned_in_rig(
        points, rig.cam_from_rig[[one.camera for one in sights]], [one.cam_from_target for one in sights]
    )
    named = []
    for sight, (name, turn) in zip(sights, each, strict=True):
        order = np.argsort(name[sight.seen.ring])
        ring = name[sight.seen.ring][order]
        seen = replace(sight.seen.keep(order), ring=ring, position_mm=target.center_mm[ring])
        pose = sight.cam_from_target
        named.append(replace(sight, seen=seen, cam_from_target=None if pose is None else pose @ turn))
    return named


def _pose(frame: str, rig: Rig, sights: list[CameraSight], found: RigPose) -> RigTargetPose:
    """A pose with what follows from it."""
    used = [residual[np.isfinite(residual).all(axis=1)] for residual in found.residual_px]
    every, covariance = np.concatenate(used), found.covariance
    return RigTargetPose(
        frame=frame,
        cameras=tuple(
            CameraResidual(rig.names[sight.camera], sight.seen.image, len(own), rms_length(own))
            for sight, own in zip(sights, used, strict=True)
        ),
        rings=len(every),
        rms_px=rms_length(every),
        target_mm=found.rig_from_target[:3, 3],
        target_sigma_mm=np.sqrt(np.diag(covariance)[3:]),
        rotation_sigma_rad=float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])),
        rig_from_target=found.rig_from_target,
        covariance=covariance,
        noise_covariance=found.excess**2 * found.noise,
        excess=found.excess,
    )

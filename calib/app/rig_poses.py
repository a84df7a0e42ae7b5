"""Where a target is before a known rig, frame by frame."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from calib.app.inputs import Place, rig_of, target_of
from calib.cameras.rig import Rig
from calib.core.se3 import transform
from calib.core.types import Detections
from calib.observe.photos import images_in
from calib.observe.rig_photos import RigPhotos
from calib.observe.rig_search import RigSearch, photos_of_rig, rig_input, search_cameras
from calib.observe.target_poses import TOO_FEW, PoseResult, target_pose, target_poses
from calib.rigs.rig_poses_file import CameraResidual, FrameWithoutPose, RigPoseResult, RigTargetPose
from calib.rigs.target_pose import CameraSight, RigPose, pose_in_rig
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import printable
from designer.page.progress import Progress
from designer.target import TargetGeometry

NOT_SEEN = "no camera shows the target"
"""Why a frame has no pose."""


def poses_before_rig(
    target: TargetGeometry | Place,
    rig: Rig | Place,
    photos: Place | Iterable[Place],
    *,
    weighted: bool,
    jobs: int | None,
    progress: Progress,
) -> RigPoseResult:
    """What `calib.pose` does of a rig.

    Raises:
        InputError: files that cannot be read, or a camera that is not in the rig.
    """
    geometry, known = target_of(target, "rings"), rig_of(rig)
    given = rig_input(photos, None, None, None, None)
    if not given.photos:
        raise InputError("no photos; give a folder a camera, named as in the rig, or one folder that holds these")
    if len(given.photos) == 1 and images_in(Path(given.photos[0])):
        raise InputError(
            f"{given.photos[0]}: one folder of images; give a folder a camera, named as in the rig (one camera alone: "
            "calib pose TARGET rig.json#NAME PHOTOS)"
        )
    taken = photos_of_rig(given)
    lenses = {name: known.cameras[known.row(name)] for name in taken.camera_names}
    search = search_cameras(geometry, taken, lenses, None, jobs, progress)
    sights, said = _sights(known, search, weighted=weighted), _said(search)
    poses: list[RigTargetPose] = []
    failed: list[FrameWithoutPose] = []
    for frame in taken.frame_names:
        own = sights.get(frame, [])
        found = pose_in_rig(known, own, geometry.center_mm, weighted=weighted) if own else None
        if found is None:
            failed.append(FrameWithoutPose(frame, TOO_FEW if own else NOT_SEEN + said.get(frame, "")))
        else:
            poses.append(_pose(frame, known, own, found))
    return RigPoseResult(geometry, known, taken, search.searches, tuple(poses), tuple(failed))


def _sights(rig: Rig, search: RigSearch, *, weighted: bool) -> dict[str, list[CameraSight]]:
    """What was seen in each frame, with the poses that each camera tells alone."""
    sights: dict[str, list[CameraSight]] = {}
    for name, one in zip(search.photos.camera_names, search.searches, strict=True):
        row = rig.row(name)
        seen = one.with_target
        alone = {
            pose.image: pose.cam_from_target
            for pose in (target_poses(seen, search.target, rig.cameras[row], weighted=weighted).poses if seen else ())
        }
        frames = frames_of(search.photos, name, {result.photo.path: result.photo.name for result in one.results})
        for shown in seen:
            sights.setdefault(frames[shown.image], []).append(CameraSight(row, shown, alone.get(shown.image)))
    return sights


def _said(search: RigSearch) -> dict[str, str]:
    """What the detector says of photos that show no target to it, of each frame that of its first camera."""
    said: dict[str, str] = {}
    for name, one in zip(search.photos.camera_names, search.searches, strict=True):
        frames = frames_of(search.photos, name, {result.photo.path: result.photo.name for result in one.results})
        for result in one.results:
            if result.seen is not None and not len(result.seen.ring) and result.seen.remarks:
                said.setdefault(frames[result.photo.name], f"; {printable(name)}: {result.seen.remarks[0]}")
    return said


def frames_of(photos: RigPhotos, camera: str, names: Mapping[Path, str]) -> dict[str, str]:
    """The frame of each photo of a camera, by the name that its detections have."""
    return {names[photo.path]: photo.frame for photo in photos.of(camera) if photo.path in names}


def _pose(frame: str, rig: Rig, sights: list[CameraSight], found: RigPose) -> RigTargetPose:
    """A pose with what follows from it."""
    cameras = tuple(
        _residual(rig.names[sight.camera], sight.seen, residual)
        for sight, residual in zip(sights, found.residual_px, strict=True)
    )
    every = np.concatenate(found.residual_px)
    used = np.isfinite(every).all(axis=1)
    covariance = found.covariance
    return RigTargetPose(
        frame=frame,
        cameras=cameras,
        rings=int(used.sum()),
        rms_px=_rms(every),
        target_mm=found.rig_from_target[:3, 3],
        target_sigma_mm=np.sqrt(np.diag(covariance)[3:]),
        rotation_sigma_rad=float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])),
        rig_from_target=found.rig_from_target,
        covariance=covariance,
        noise_covariance=found.excess**2 * found.noise,
        excess=found.excess,
    )


def _residual(camera: str, seen: Detections, residual_px: Array) -> CameraResidual:
    used = int(np.isfinite(residual_px).all(axis=1).sum())
    return CameraResidual(camera, seen.image, used, _rms(residual_px))


def _rms(residual_px: Array) -> float:
    """Root mean square length, of the sightings that count; nan of none."""
    known = residual_px[np.isfinite(residual_px).all(axis=1)]
    return float(np.sqrt((known**2).sum(axis=1).mean())) if len(known) else np.nan


def posed_alone(found: RigPoseResult, number: int) -> PoseResult:
    """What one camera saw, with the poses that all cameras together tell: for pictures of its photos."""
    name, search = found.photos.camera_names[number], found.searches[number]
    row = found.rig.row(name)
    camera, cam_from_rig = found.rig.cameras[row], found.rig.cam_from_rig[row]
    turn = np.kron(np.eye(2), cam_from_rig[:3, :3])
    seen = {one.image: one for one in search.detections}
    poses = []
    for pose in found.poses:
        for one in (one for one in pose.cameras if one.camera == name):
            cam_from_target = cam_from_rig @ pose.rig_from_target
            place = transform(cam_from_target, found.target.center_mm[seen[one.image].ring])
            off = camera.project(place) - seen[one.image].center_px
            poses.append(target_pose(one.image, cam_from_target, turn @ pose.covariance @ turn.T, off))
    return PoseResult(found.target, camera, search, tuple(poses), ())

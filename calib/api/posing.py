"""Where a known camera stood before a target, photo by photo; or where a target is before a known rig."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, overload

from calib.app.inputs import (
    Place,
    camera_of,
    photos_of,
    target_of,
)
from calib.cameras.camera import Camera
from calib.cameras.rig import Rig
from calib.observe.search import PhotoSearch
from calib.observe.target_poses import PhotoWithoutPose, PoseResult, target_poses
from designer.base.errors import InputError
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from calib.records.rig_poses_file import RigPoseResult


@overload
def pose(
    target: TargetGeometry | Place, camera: Camera | Place, photos: Place | Iterable[Place], *,
    weighted: bool = True, jobs: int | None = None, progress: Progress = unheard,
) -> PoseResult: ...  # fmt: skip


@overload
def pose(
    target: TargetGeometry | Place, *, photos: Place | Iterable[Place], rig: Rig | Place,
    weighted: bool = True, jobs: int | None = None, progress: Progress = unheard,
) -> "RigPoseResult": ...  # fmt: skip


def pose(
    target: TargetGeometry | Place,
    camera: Camera | Place | None = None,
    photos: Place | Iterable[Place] = (),
    *,
    rig: Rig | Place | None = None,
    weighted: bool = True,
    jobs: int | None = None,
    progress: Progress = unheard,
) -> "PoseResult | RigPoseResult":
    """Find where a known camera stood, and how surely: `pose("ico.target.json", "camera.json", "photos")`.

    >>> calib.pose("ico.target.json", photos=["left", "right"], rig="rig.json").poses[0].rig_from_target

    Args:
        target: what the photos show: a geometry, or its file.
        camera: that took them: a camera, a file of ours or another tool's, or a template.
        photos: images, folders of images, or patterns; of a rig a folder a camera, named as in it.
        rig: instead of a camera: the pose of the target in its frame, from what its cameras saw at once.
        weighted: weigh rings by the covariances of their centres, or all alike.
        jobs: photos at a time; None: one per core.
        progress: is told how many photos are searched.

    Raises:
        InputError: files that cannot be read, not one photo that can be searched, or a camera that is not in the rig.
    """
    if rig is not None:
        if camera is not None:
            raise InputError("a camera and a rig: give one of them; the rig has its own cameras")
        from calib.api.rig_posing import pose_before_rig

        return pose_before_rig(target, rig, photos, weighted=weighted, jobs=jobs, progress=progress)
    if camera is None:
        raise InputError("no camera: give the one that took the photos, or the rig that did")
    geometry, known = target_of(target, "rings"), camera_of(camera)
    search = PhotoSearch(geometry, photos_of(photos), jobs=jobs, progress=progress).once(known)
    found = target_poses(search.detections, geometry, known, weighted=weighted)
    unread = (PhotoWithoutPose(one.photo.name, one.failure) for one in search.results if one.seen is None)
    return PoseResult(geometry, known, search, found.poses, (*unread, *found.failed))

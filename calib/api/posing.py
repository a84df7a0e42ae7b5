"""Where a known camera stood before a target, photo by photo."""

from collections.abc import Iterable

from calib.api.loading import Place, Progress, camera_of, photos_of, target_of, unheard
from calib.api.searching import PhotoSearch
from calib.cameras.camera import Camera
from calib.observe.target_poses import PhotoWithoutPose, PoseResult, target_poses
from designer.target import TargetGeometry


def pose(
    target: TargetGeometry | Place,
    camera: Camera | Place,
    photos: Place | Iterable[Place],
    *,
    weighted: bool = True,
    jobs: int | None = None,
    progress: Progress = unheard,
) -> PoseResult:
    """Find where a known camera stood, and how surely: `pose("ico.target.json", "camera.json", "photos")`.

    Args:
        target: what the photos show: a geometry, or its file.
        camera: that took them: a camera, a file of ours or another tool's, or a template.
        photos: images, folders of images, or patterns.
        weighted: weigh rings by the covariances of their centres, or all alike.
        jobs: photos at a time; None: one per core.
        progress: is told how many photos are searched.

    Raises:
        InputError: files that cannot be read, or not one photo that can be searched.
    """
    geometry, known = target_of(target, "rings"), camera_of(camera)
    search = PhotoSearch(geometry, photos_of(photos), jobs=jobs, progress=progress).once(known)
    found = target_poses(search.detections, geometry, known, weighted=weighted)
    unread = (PhotoWithoutPose(one.photo.name, one.failure) for one in search.results if one.seen is None)
    return PoseResult(geometry, known, search, found.poses, (*unread, *found.failed))

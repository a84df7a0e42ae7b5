"""Where a known camera stood before a target, photo by photo."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calib.api.loading import Place, camera_of, photos_of, target_of
from calib.api.progress import Progress, unheard
from calib.api.searching import Search, search_once
from calib.cameras.camera import Camera
from calib.core.files import write_files
from calib.pipeline.target_poses import TargetPose, check_output, poses_to_csv, poses_to_json, target_poses
from designer.target import TargetGeometry

TOO_FEW = "too few rings for a pose, or all on a line"
NOT_SOLVED = "no pose fits the rings that were found; check the camera file"


@dataclass(frozen=True, eq=False)
class PoseResult:
    """The poses in some photos: `found.save("poses.csv")`."""

    target: TargetGeometry
    camera: Camera
    search: Search
    poses: tuple[TargetPose, ...]  # in the order of the photos
    without_pose: tuple[tuple[str, str], ...]  # the other photos, and why

    def save(self, path: str | Path) -> Path:
        """Write `poses.json` or `poses.csv`, by the suffix; return its place.

        Raises:
            InputError: another suffix, or a file of somebody else's.
        """
        place = Path(path)
        check_output(place)
        is_table = place.suffix.lower() == ".csv"
        content = (
            poses_to_csv(self.poses)
            if is_table
            else poses_to_json(self.poses, self.target, self.camera, self.without_pose)
        )
        write_files({place: content})
        return place


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
    search = search_once(geometry, photos_of(photos), camera=known, jobs=jobs, progress=progress)
    found = target_poses(search.detections, geometry, known, weighted=weighted)
    reasons = {result.photo.name: result.failure for result in search.results if result.seen is None}
    for seen in search.detections:
        if not len(seen.ring):
            reasons[seen.image] = "; ".join(seen.remarks) or "the target was not found"
        elif seen.image in found.too_few:
            reasons[seen.image] = TOO_FEW
        elif seen.image in found.not_solved:
            reasons[seen.image] = NOT_SOLVED
    return PoseResult(geometry, known, search, found.poses, tuple(reasons.items()))

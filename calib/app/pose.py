"""Where a known camera stood, or a target before a known rig: `calib pose`, `calib.pose(target, camera, photos)`."""

from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app.cameras_told import remarks_on
from calib.app.options import PhotoJobs, Target, Weighted
from designer.base.codec import encode_written
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.options import argument, option
from designer.base.words import NAME
from designer.kinds.presets import camera_templates
from designer.page.capability import OUTPUT, capability, written_to
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.cameras.rig import Rig
    from calib.observe.target_poses import PhotoWithoutPose, PoseResult, TargetPose
    from calib.rigs.target_poses import FrameWithoutPose, RigPoseResult, RigTargetPose
    from designer.base.files import JsonValue
    from designer.page.blocks import Page


@dataclass(frozen=True, eq=False)
class TargetPoses(Result, kind="poses", title="Poses", is_written=False):
    """Poses of a camera, or of a target before a rig: `found.poses[0].cam_from_target`, `found.save("poses.csv")`."""

    found: "PoseResult | RigPoseResult"
    target_named: str
    taken_by: str  # the camera, or the rig, as it was given
    place: Path | None  # of the poses; None: they are in no file
    folder: Path | None = None  # of pictures, and of the page
    overlays: Mapping[tuple[str, str], str] = field(default_factory=dict)  # paths, by camera, "" if alone, and photo
    undrawn: tuple[str, ...] = ()  # why others have no picture, a line each
    remarks: tuple[str, ...] = ()

    @property
    def poses(self) -> "tuple[TargetPose, ...] | tuple[RigTargetPose, ...]":
        """In the order of photos, or of frames."""
        return self.found.poses

    @property
    def without_pose(self) -> "tuple[PhotoWithoutPose, ...] | tuple[FrameWithoutPose, ...]":
        """The others, with the reason."""
        return self.found.without_pose

    @property
    def is_negative(self) -> bool:
        """Whether there is no pose."""
        return not self.poses

    def document(self) -> "dict[str, JsonValue]":
        """Each pose with its standard deviations, or why there is none."""
        from calib.observe.target_poses import PoseResult

        found, each = self.found, [encode_written(one) for one in self.found.poses]
        without = [encode_written(one) for one in self.found.without_pose]
        if isinstance(found, PoseResult):
            head = {"photos": len(found.search.results), "with_pose": len(each), "failures": found.search.failures}
            each, without = ([{"image": one.pop("file"), **one} for one in rows] for rows in (each, without))
        else:
            head = {
                "frames": len(each) + len(without), "with_pose": len(each),
                "has_rig_covariance": found.rig.covariance is not None, "failures": found.failures,
            }  # fmt: skip
        failures = list(cast("tuple[str, ...]", head["failures"]))
        told = {"target_id": found.target.geometry_id, **head, "failures": failures}
        return cast("dict[str, JsonValue]", {**told, "poses": each, "without_pose": without})

    def page(self) -> "Page":
        """Whether the poses can be used, photo by photo, and where they are."""
        from calib.app.pose_page import poses_page

        return poses_page(self)

    def save(self, place: str | PathLike[str], *, command: str = "", has_page: bool = False) -> tuple[Path, ...]:
        """Write the poses as .json or .csv, by the suffix; return the file.

        Raises:
            InputError: another suffix, or a file of somebody else's.
        """
        return (self.found.save(place),)


@capability
def pose(
    target: Target,
    camera: Annotated[
        "Camera | Place | None",
        argument(
            "camera file of ours or of another tool, or a camera template; with --rig a folder of photos",
            complete=camera_templates,
        ),
    ] = None,
    photos: Annotated[
        "Place | Iterable[Place]", argument("images, folders of images, clips, or patterns: 'run/*.png'", is_many=True)
    ] = (),
    *,
    rig: Annotated[
        "Rig | Place | None",
        option(
            "instead of a camera: the target in the frame of this rig, from a folder a camera, or one that holds "
            "these: calib pose --rig rig.json TARGET FOLDER..."
        ),
    ] = None,
    out: Annotated["Output | Place | None", written_to("poses to write, .json or .csv")] = None,
    overlay: Annotated[
        "Place | None", option("folder for pictures with the axes and the residuals", metavar="DIR", group=OUTPUT)
    ] = None,
    weighted: Weighted = True,
    jobs: PhotoJobs = None,
    progress: Progress = unheard,
) -> TargetPoses:
    """Find where a known camera stood, and how surely: `pose("ico.target.json", "camera.json", "photos")`.

    Photo by photo; or where the target is before a rig, frame by frame. The exit code is 1 if no photo gives a pose.

    >>> calib.pose("ico.target.json", photos=["left", "right"], rig="rig.json").poses[0].rig_from_target

    Raises:
        InputError: files that cannot be read, not one photo that can be searched, or a camera that is not in the rig.
    """
    from calib.app.inputs import in_order, load_rig, opened_camera, photos_of, target_of
    from calib.capture.clips import clips_of_rig, holds_photos
    from calib.observe.search import PhotoSearch
    from calib.observe.target_poses import PhotoWithoutPose, PoseResult, check_output, target_poses

    output = Output(Path(), is_asked=False) if out is None else output_of(out)
    folder = None if overlay is None else place_of(overlay, "a folder")
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder; choose another with --overlay")
    if not isinstance(photos, str | PathLike | Iterable):
        raise InputError(f"photos: {type(photos).__name__}: give files, folders or patterns")
    given = [photos] if isinstance(photos, str | PathLike) else list(photos)
    if rig is not None and isinstance(camera, str | PathLike) and holds_photos(Path(camera)):
        given, camera = [camera, *given], None  # in a shell the first folder or clip stands where a camera would
    if rig is not None and camera is not None:
        raise InputError("a camera and a rig: give one of them; the rig has its own cameras")
    if rig is None and camera is None:
        raise InputError("no camera: give the one that took the photos, or the rig that did")
    if output.is_asked:
        check_output(output.place, f"{NAME}.{'poses' if rig is None else 'rig_poses'}")
    found: PoseResult | RigPoseResult
    if rig is not None:
        from calib.observe.rig_search import rig_input
        from calib.rigs.target_poses import poses_before_rig

        geometry = target_of(target, "rings")
        taken = clips_of_rig(rig_input(given), geometry, progress) or given
        found = poses_before_rig(geometry, load_rig(rig), taken, weighted=weighted, jobs=jobs, progress=progress)
        remarks = found.photos.remarks
    else:
        if not given:
            raise InputError("no photos; give images, folders of images, or patterns, after the camera's file")
        geometry, read = (
            target_of(
                in_order(target, "calib pose TARGET CAMERA PHOTO...", target=target, camera=camera, photos=photos),
                "rings",
            ),
            opened_camera(cast("Camera | Place", camera)).read,
        )
        asked = photos_of(given, None, geometry, progress)
        search = PhotoSearch(geometry, asked, jobs=jobs, progress=progress).once(read.camera)
        told = target_poses(search.detections, geometry, read.camera, weighted=weighted)
        unread = (PhotoWithoutPose(one.photo.name, one.failure) for one in search.results if one.seen is None)
        found = PoseResult(geometry, read.camera, search, told.poses, (*unread, *told.failed))
        remarks = (*asked.remarks, *remarks_on(_name(camera), read))
    if output.is_asked:
        output.files.append(found.save(output.place))
        output.finished.append(output.place)
    place = output.place if output.is_asked else None
    made = TargetPoses(found, _name(target), _name(camera if rig is None else rig), place, folder, remarks=remarks)
    if folder is not None:
        made, pictures = _drawn(made, folder)
        output.files += pictures
        output.page = folder if pictures else None
        if pictures and output is not out:  # a command draws the page when all is said
            made.draw_page(folder)
    return made


def _name(given: object) -> str:
    return fspath(given) if isinstance(given, str | PathLike) else f"a {type(given).__name__}"


def _drawn(made: TargetPoses, folder: Path) -> tuple[TargetPoses, tuple[Path, ...]]:
    """Draw the photos that have a pose, of a rig in a folder a camera; and where the pictures are."""
    from calib.draw.pose_overlay import draw_poses
    from calib.observe.photos import keep_pictures, no_empty_folders, staging_folder
    from calib.observe.target_poses import PoseResult
    from calib.rigs.rig_calibration_file import folder_names

    if isinstance(made.found, PoseResult):
        each = [("", "", made.found)]
    else:
        names, found = made.found.photos.camera_names, made.found
        places = zip(names, folder_names(names), strict=True)
        each = [(name, place, found.of_camera(row)) for row, (name, place) in enumerate(places)]
    overlays, undrawn, pictures = dict[tuple[str, str], str](), list[str](), list[Path]()
    with no_empty_folders(folder):
        for name, place, alone in each:
            with ExitStack() as stack:
                if place:
                    stack.enter_context(no_empty_folders(folder / place))
                staging = stack.enter_context(staging_folder(folder / place))
                drawn, failures = draw_poses(alone, staging)
                pictures += keep_pictures(staging, folder / place)
            overlays |= {(name, image): f"{place}/{picture}".lstrip("/") for image, picture in drawn.items()}
            undrawn += failures
    return replace(made, overlays=overlays, undrawn=tuple(undrawn)), tuple(pictures)

"""Where a camera sits on a robot: `calib hand-eye`, `calib.hand_eye("t.json", "photos", robot="poses.csv")`."""

from collections.abc import Iterable, Mapping, Sequence
from os import PathLike, fspath
from typing import TYPE_CHECKING, Annotated

from calib.app.hand_eye_poses import Euler, Inverted, PoseUnit, TargetInHand, hand_eye_poses
from calib.app.options import Fix, FreeBend, Limits, Made, Minimise, Model, PhotoJobs, Points, Priors
from calib.app.solved_rig import SolvedRig, begun, finished, folder_for, settings_of
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.options import argument, option
from designer.base.units import parse_angle_rad, parse_length_mm
from designer.base.words import shown
from designer.page.capability import capability, instead, written_to
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from pathlib import Path

    from calib.app.inputs import Pixels, Place
    from calib.cameras.camera import Camera
    from calib.core.types import Observations
    from calib.judge.joint_solution import CameraWishes, RigSeen
    from calib.observe.photos import FoundPhotos
    from calib.observe.robot_poses import RobotPoses
    from designer.page.output import Output
    from designer.target import TargetGeometry

TargetShown = Annotated[
    "TargetGeometry | Place | None", argument("the target file of what the photos show (a table needs none)")
]
PhotosTaken = Annotated[
    "Place | Iterable[Place]", argument("photos: files, folders, clips or patterns, or a robot's bag", is_many=True)
]
Table = Annotated[
    "Observations | Place | None", option("instead of photos: detections.csv, or a CSV with image,u,v,X,Y,Z")
]
Lens = Annotated["Camera | Place | None", option("the lens from an earlier run, which is kept")]
Refine = Annotated[bool, option("solve that lens on")]


def _noise(text: str) -> tuple[float, float]:
    """The robot's noise: rad, mm."""
    parts = text.split(",")
    if len(parts) != 2:
        raise ValueError("give a length and an angle, such as 0.1mm,0.02deg")
    return parse_angle_rad(parts[1].strip()), parse_length_mm(parts[0].strip())


@instead(target_poses=hand_eye_poses)
@capability(folder=lambda given: folder_for("hand-eye", given))
def hand_eye(
    target: TargetShown = None,
    photos: PhotosTaken = (),
    *,
    images: "Iterable[Pixels] | None" = None,
    robot: Annotated[
        "RobotPoses | Place | None",
        option("base_from_flange of each photo, or over time: .csv, .yaml, .json, or run.mcap#/pose"),
    ] = None,
    tf: Annotated[
        tuple[str, str] | None,
        option("instead of --robot: frames of base and flange in a bag's tf", metavar="BASE FLANGE"),
    ] = None,
    image: Annotated[str | None, option("topic of a bag's images (default: the only one)", metavar="TOPIC")] = None,
    table: Table = None,
    points: Points = None,
    diameter_mm: float | None = None,
    target_in_hand: TargetInHand = False,
    inverted: Inverted = False,
    unit: PoseUnit = None,
    euler: Euler = None,
    camera: Lens = None,
    refine: Refine = False,
    model: Model = "all",
    fix: Fix = (),
    priors: Priors = (),
    minimise: Minimise = "image",
    target_size: Annotated[
        bool | None,
        option(
            "solve the target's size by the robot's ways alone, or keep it (default: as sure as it was made so)",
            off="--no-target-size",
        ),
    ] = None,
    free_bend: FreeBend = None,
    robot_noise: Annotated[
        tuple[float, float] | None, option("the robot's own errors, if they are known: 0.1mm,0.02deg", parse=_noise)
    ] = None,
    made: Made = None,
    criteria: Limits = "standard",
    jobs: PhotoJobs = None,
    out: Annotated["Output | Place | None", written_to("folder (default: exports/NAME/hand-eye, or hand-eye)")] = None,
    progress: Progress = unheard,
) -> SolvedRig:
    """Solve where a camera sits on a robot, or beside it: `hand_eye("t.json", "photos", robot="poses.csv")`.

    Camera, the robot's noise and the target's size in one adjustment. The exit code is 1 if the poses do not determine
    it, or if the verdict is: do not use.

    >>> found = calib.hand_eye("ico.target.json", "photos", robot="poses.csv")
    >>> found.hand_eye.flange_from_cam, found.hand_eye.robot_sigma_mm

    Args:
        images: instead of photos arrays (H, W) or (H, W, 3) in blue, green, red; they are named image-1, image-2, ...
        robot: base_from_flange of each photo, or a stream with times, or the file that holds it.
        tf: of photos that are a bag: the frames of the robot's base and of its flange.
        diameter_mm: of circles.
        robot_noise: standard deviations of a coordinate of the robot's errors, rad and mm; None: estimated.

    Raises:
        InputError: files or options that break a rule, or poses that look inverted or in another unit.
    """
    from calib.app.inputs import criteria_of, photos_given, points_of
    from calib.judge.joint_solution import RobotSetting, judged_on_robot
    from calib.observe.robot_poses import RobotPoses

    to = begun(out)
    if robot_noise is not None and min(robot_noise) <= 0:
        raise InputError(f"--robot-noise {robot_noise}: both must be more than 0; leave it out to have it estimated")
    if tf is not None and robot is not None:
        raise InputError("--tf: tells the robot's poses, and so does --robot; leave one out")
    if isinstance(robot, RobotPoses) and (inverted or unit is not None or euler is not None):
        raise InputError("inverted, unit, euler: tell how a file of robot poses is read; these poses are read already")
    poses = robot if isinstance(robot, RobotPoses) else _poses(photos, robot, tf, unit, euler, inverted=inverted)
    limits = criteria_of(criteria)
    wishes = wishes_of_one(camera, model, fix, priors, minimise, free_bend, refine=refine)
    taken = photos_given(photos, images, image) if images is not None else _photos(photos, image, poses)
    seen = seen_by_one(target, taken, table, points_of(points, diameter_mm), wishes, jobs, progress).with_made(made)
    setting = RobotSetting(target_in_hand, target_size, *(robot_noise or (None, None)))
    settings = settings_of(("target", target), ("table", table), ("robot", robot))
    run = judged_on_robot(seen, poses, setting, wishes, limits, settings, progress)
    return finished(SolvedRig(*run), to, out, progress)


def _poses(
    photos: "Place | Iterable[Place] | FoundPhotos", robot: "Place | None", tf: tuple[str, str] | None,
    unit: str | None, euler: str | None, *, inverted: bool,
) -> "RobotPoses":  # fmt: skip
    """The robot's poses of a file, a bag's topic, or between two frames of a bag."""
    from dataclasses import replace

    from calib.core.se3 import invert
    from calib.images.bag import Bag, bag_named
    from calib.observe.robot_poses import read_robot_poses
    from calib.observe.transforms import poses_in, transforms_in

    named = None if robot is None else bag_named(fspath(place_of(robot, "a file of robot poses")))
    if robot is not None and named is None:
        return read_robot_poses(place_of(robot, "a file of robot poses"), unit=unit, euler=euler, is_inverted=inverted)
    if odd := "--unit" if unit is not None else "--euler" if euler is not None else "":
        raise InputError(f"{odd}: a bag's poses are in metres and quaternions; leave it out")
    if named is not None:
        found = poses_in(Bag(named[0]), named[1])
    else:
        if tf is None or len(tf) != 2:
            raise InputError("no robot poses; give --robot with their file, or of a bag its frames: --tf BASE FLANGE")
        place = _bag_of(photos)
        if place is None:
            raise InputError("--tf: is of a robot's bag, which the photos have to be then; else give --robot")
        found = transforms_in(Bag(place)).poses(*tf)
    return replace(found, base_from_flange=invert(found.base_from_flange), is_inverted=True) if inverted else found


def _bag_of(photos: "Place | Iterable[Place] | FoundPhotos") -> "Path | None":
    """The one bag that the photos are in."""
    from calib.images.bag import bag_named

    each = [photos] if isinstance(photos, str | PathLike) else list(photos) if isinstance(photos, tuple | list) else []
    named = bag_named(fspath(each[0])) if len(each) == 1 else None
    return None if named is None else named[0]


def _photos(
    photos: "Place | Iterable[Place]", image: str | None, poses: "RobotPoses"
) -> "Place | Iterable[Place] | FoundPhotos":
    """The photos as they are given, or the images of a bag: of a robot that moves over time, where it is still."""
    from calib.observe.bag_photos import photos_in

    if _bag_of(photos) is not None:
        (place,) = [photos] if isinstance(photos, str | PathLike) else photos
        return photos_in(fspath(place), image, "--image", poses.sorted_by_time() if poses.step_s else None)
    if image is not None:
        raise InputError(f"--image {shown(image)}: is a topic of a robot's bag, and none is given; leave it out")
    return photos


def wishes_of_one(
    camera: "Camera | Place | None", model: str, fix: Sequence[str],
    priors: "Mapping[str, tuple[float, float]] | Sequence[str]", minimise: str, free_bend: bool | None, *, refine: bool,
) -> "CameraWishes":  # fmt: skip
    """What was asked for of the one camera; InputError: what it cannot have."""
    from calib.app.inputs import load_camera
    from calib.cameras.rig import ALONE
    from calib.judge.joint_solution import require_wishes, wishes_of
    from calib.solver.plan import ALL, plan_from_words
    from calib.solver.priors import texts_of

    if refine and camera is None:
        raise InputError("--refine: there is no lens to solve on from; give --camera, or leave it out")
    given = {} if camera is None else {ALONE: load_camera(camera)}
    options = plan_from_words(ALL, minimise=minimise, free_bend=free_bend).options
    wishes = wishes_of(model, given, refine, fix, options, texts_of(priors))
    require_wishes(wishes, (ALONE,))
    return wishes


def seen_by_one(
    target: "TargetGeometry | Place | None", photos: "FoundPhotos | Place | Iterable[Place]",
    table: "Observations | Place | None", kind: tuple[str | None, float | None], wishes: "CameraWishes",
    jobs: int | None, progress: Progress,
) -> "RigSeen":  # fmt: skip
    """What one camera saw, from photos or a table: a frame a photo.

    Raises:
        InputError: neither or both are given, or they cannot be read.
    """
    from calib.app.inputs import photos_of, require_photos_for_jobs, target_of
    from calib.cameras.rig import ALONE
    from calib.core.types import Observations
    from calib.judge.joint_solution import RigSeen
    from calib.observe.photos import FoundPhotos
    from calib.observe.rig_observations import alone_as_rig
    from calib.observe.rig_search import observations_of_rig, photos_of_one, search_cameras

    if kind != (None, None) and (table is None or isinstance(table, Observations)):
        raise InputError("--points: says what the points of a table are; leave it out")
    shown_in_photos = None if target is None or table is not None else target_of(target, "rings")
    found = photos if isinstance(photos, FoundPhotos) else photos_of(photos, None, shown_in_photos, progress)
    if table is not None:
        require_photos_for_jobs(jobs)
        if found.paths or found.failures:
            first = found.failures[0] if found.failures else shown(found.paths[0].name)
            raise InputError(f"--table: says what was seen in the photos; leave these out: {first}")
        geometry = None if target is None else target_of(target)
        one = table if isinstance(table, Observations) else _of_table(table, geometry, *kind)
        return RigSeen(alone_as_rig(ALONE, one), geometry)
    if shown_in_photos is None:
        raise InputError("no target; give the target file of what the photos show, or a table of observations")
    if not found.paths:
        raise InputError(found.failures[0] if found.failures else "no photos; give files or a folder")
    search = search_cameras(shown_in_photos, photos_of_one(found), wishes.given, wishes.plan_of, jobs, progress)
    return RigSeen(observations_of_rig(search), shown_in_photos, search)


def _of_table(
    table: "Place", geometry: "TargetGeometry | None", points: str | None, diameter_mm: float | None
) -> "Observations":
    """What one camera saw, of a table of one camera, or of the sightings that a rig's folder holds."""
    from calib.app.inputs import load_observations
    from calib.observe.rig_observations import read_rig_sightings
    from calib.observe.rig_photos import tells_cameras

    path = place_of(table, "a table of observations")
    if not (path.is_file() and tells_cameras(path)):
        return load_observations(path, geometry, points=points, diameter_mm=diameter_mm)
    seen = read_rig_sightings(path, geometry, points=points, diameter_mm=diameter_mm, fewest=1)
    if len(seen.sightings) > 1:
        raise InputError(f"{path}: holds the sightings of {len(seen.sightings)} cameras; give those of one")
    return seen.sightings[0]

"""What public functions take: a value, or the file that it stands in."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar, cast

from calib.app.options import grid_of
from calib.cameras.formats import ACCEPTED_PX, FORMATS, OWN, RIG_FORMATS
from calib.core.types import Detections, Observations, RigObservations
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.words import shown
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calib.cameras.camera import Camera
    from calib.cameras.formats.reading import OpenedCamera, OpenedRig
    from calib.cameras.rig import Rig
    from calib.judge.verdict import Criteria
    from calib.observe.corners_vnl import PointGrid
    from calib.observe.photos import FoundPhotos
    from calib.observe.rig_search import RigInput
    from calib.renderer.truth import Truth
    from designer.target import Needs, TargetGeometry

    Pixels: TypeAlias = NDArray[np.generic]

T = TypeVar("T")
Place: TypeAlias = str | PathLike[str]
Observed: TypeAlias = Observations | Place | Iterable[Detections]
"""What a camera is solved from: observations, a file of them, or what was found in photos."""


def load_camera(name: "Camera | Place") -> "Camera":
    """Read a camera: `load_camera("camera.json")`.

    Args:
        name: a file of ours or of another tool, `chain.yaml#cam1` of a file with several, the folder of a
            `camera.json`, or a template; a camera stays as it is.

    Raises:
        InputError: no such file, of no known kind, or not valid.
    """
    return opened_camera(name).read.camera


def load_observations(
    path: Place,
    target: "TargetGeometry | Place | None" = None,
    *,
    image_size: tuple[int, int] | None = None,
    grid: "PointGrid | None" = None,
    points: str | None = None,
    diameter_mm: float | None = None,
) -> Observations:
    """Read what a camera is solved from: `load_observations("detections.csv", "ico.target.json")`.

    Args:
        path: a `detections.csv`, a table with image,u,v,X,Y,Z, or a `corners.vnl`.
        target: that detections show, whose X, Y, Z are taken; a table may show one too.
        image_size: width and height in px of a file that does not say it.
        grid: of a `corners.vnl`.
        points: what was measured of a table's points: `corner`, `ring` (the image of its centre), or `circle` (the
            centre of its image, as blob and circle-grid detectors give it); None: as the table or target says, if one
            does.
        diameter_mm: of circles; None: as the table or target says.

    Raises:
        InputError: the file cannot be read, something else is needed, or nothing is left to solve from.
    """
    from calib.observe.correspondences import read_observations
    from designer.target import TargetGeometry

    place = place_of(path, "a file of observations")
    if not place.is_file():
        why = "is a folder" if place.is_dir() else "no such file"
        raise InputError(f"{place}: {why}; give a detections.csv, a CSV with image,u,v,X,Y,Z, or a corners.vnl")
    geometry = (
        target if target is None or isinstance(target, TargetGeometry) else place_of(target, "a target, or its file")
    )
    return read_observations(place, geometry, image_size=image_size, grid=grid, points=points, diameter_mm=diameter_mm)


def load_rig_observations(path: Place, target: "TargetGeometry | Place | None" = None) -> RigObservations:
    """Read what several cameras saw: `load_rig_observations("sightings.csv")`.

    Args:
        path: a table with camera,frame,u,v,X,Y,Z, and a line `# camera NAME 1280 x 720` for each camera.
        target: whose points were seen; None: the table's own.

    Raises:
        InputError: the file cannot be read, or nothing is left of a camera to solve from.
    """
    from calib.observe.rig_observations import read_rig_sightings

    return read_rig_sightings(place_of(path, "a table of sightings"), None if target is None else target_of(target))


def observations_of(observed: Observed, target: "TargetGeometry | Place | None") -> Observations:
    """Observations, whatever they are given as.

    Raises:
        InputError: as for `load_observations`, or detections without the target they show.
    """
    from calib.observe.observations import observations_from_detections

    if isinstance(observed, Observations):
        return observed
    if isinstance(observed, str | PathLike):
        return load_observations(observed, target)
    if not isinstance(observed, Iterable):
        raise InputError(f"{type(observed).__name__}: give observations, their file, or detections")
    if target is None:
        raise InputError("detections: give the target they show too")
    geometry = target_of(target)
    found = _with_names_of_their_own(tuple(observed))
    for one in found:
        if one.layout_id != geometry.layout_id:
            raise InputError(
                f"{one.image}: found with a target of layout {one.layout_id}, but the target has {geometry.layout_id}; "
                "give the target that the photos show"
            )
    return observations_from_detections(found, geometry)


def file_or_observations(
    observed: Observed,
    target: "TargetGeometry | Place | None",
    image_size: tuple[int, int] | None = None,
    grid: tuple[int, int] | None = None,
    pitch_mm: float | None = None,
    points: str | None = None,
) -> Observations:
    """Observations, with what some kinds of files need besides: `circle:13mm` are points with their diameter.

    Raises:
        InputError: as for `load_observations`, or what is no file has such an option.
    """
    if not isinstance(observed, str | PathLike):
        told = (("--image-size", image_size), ("--grid", grid), ("--pitch", pitch_mm), ("--points", points))
        if odd := next((option for option, value in told if value is not None), ""):
            raise InputError(f"{odd}: is of a file; leave it out")
        return observations_of(observed, target)
    corners, (kind, diameter_mm) = grid_of(grid, pitch_mm), points_of(points, None)
    return load_observations(
        observed, target, image_size=image_size, grid=corners, points=kind, diameter_mm=diameter_mm
    )


def _with_names_of_their_own(found: tuple[Detections, ...]) -> tuple[Detections, ...]:
    """The detections, repeated names numbered, as arrays have none; InputError: something else is among them."""
    for one in found:
        if not isinstance(one, Detections):
            raise InputError(f"{type(one).__name__}: give detections, or the file of a table")
    count = Counter(one.image for one in found)
    return tuple(
        replace(one, image=f"{one.image}-{number}") if count[one.image] > 1 else one
        for number, one in enumerate(found, start=1)
    )


def truth_from(truth: "Truth | Place | None") -> "Truth | None":
    """The truth of rendered photos, or that in a file; InputError: the file cannot be read; the message names it."""
    if truth is None:
        return None
    from calib.renderer.truth import TRUTH, Truth

    return truth if isinstance(truth, Truth) else TRUTH.read(place_of(truth, "a truth.json"))


def rendered_id_of(observed: Observed) -> str:
    """The geometry that the photos behind a file were rendered of, if the records beside it say so."""
    from calib.observe.dataset import RECORDS, records_path

    if not isinstance(observed, str | PathLike):
        return ""
    try:
        return RECORDS.read(records_path(Path(observed))).rendered_id
    except InputError:
        return ""


def target_of(target: "TargetGeometry | Place", needs: "Needs" = "points") -> "TargetGeometry":
    """A target, or that of a file.

    Raises:
        InputError: neither, a file that cannot be read, or several boards of which one looks the same turned.
    """
    from designer.target import TargetGeometry, load_target

    if isinstance(target, TargetGeometry):
        found = target
    else:
        found = load_target(place_of(target, "a target geometry, or its file"), needs)
    turned = [marks for marks in found.marks or () if marks.is_ambiguous]
    if needs == "rings" and turned and not found.is_planar:
        raise InputError(
            f"its {turned[0].words} looks the same turned, which faces of one target must not: take ChArUco boards, "
            "AprilGrids, or chessboards whose columns and rows of squares sum to an odd number"
        )
    return found


def require_told_apart(target: "TargetGeometry", what: str) -> None:
    """Refuse a board that looks the same turned where each of its points is to be the same one in all photos."""
    if target.marks is not None and any(marks.is_ambiguous for marks in target.marks):
        raise InputError(
            f"{what}: its {target.marks[0].words} looks the same turned, so that photos may name its points either "
            "way; take a board that tells, such as a ChArUco board"
        )


def opened_camera(camera: "Camera | Place", kind: str | None = None, accept_px: float = ACCEPTED_PX) -> "OpenedCamera":
    """A camera with the kind of file that it comes from, which is ours for one that comes from none.

    Raises:
        InputError: neither a camera, nor a file that can be read, or whose lens is off by more than is accepted.
    """
    from calib.cameras.camera import Camera
    from calib.cameras.formats.format import ReadCamera
    from calib.cameras.formats.reading import OpenedCamera, open_camera

    if isinstance(camera, Camera):
        return OpenedCamera(FORMATS[OWN], ReadCamera(camera))
    place_of(camera, "a camera, its file, or a template")
    return _camera_of_bag(fspath(camera), kind) or open_camera(fspath(camera), kind, accept_px)


def _camera_of_bag(name: str, kind: str | None) -> "OpenedCamera | None":
    """The camera that a bag's CameraInfo tells of, as in `run.mcap#/left/camera_info`; None: it is no bag."""
    from calib.cameras.formats.reading import OpenedCamera
    from calib.images.bag import Bag, bag_named, camera_info

    named = bag_named(name)
    if named is None:
        return None
    if kind not in (None, "ros"):
        raise InputError(f"--from {kind}: {named[0]} is a robot's bag; leave it out")
    text, doubt = camera_info(Bag(named[0]), named[1])
    read = FORMATS["ros"].read(text, name, None)
    return OpenedCamera(FORMATS["ros"], replace(read, remarks=(*read.remarks, *filter(None, (doubt,)))), named[0])


def load_rig(name: "Rig | Place", *, unit: str | None = None) -> "Rig":
    """Read a rig: `load_rig("rig.json").cam_from_rig`.

    Args:
        name: a rig.json, a file of another tool, or a folder with one or with a file a camera; of one camera its file
            is a rig's of that camera alone; a rig stays as it is.
        unit: "mm" or "m", of lengths in a file of a tool that takes any and does not say; None: the usual one.

    Raises:
        InputError: no such file, of no known kind, or not valid.
    """
    from calib.cameras.formats.reading import open_rig
    from calib.cameras.rig import Rig

    return name if isinstance(name, Rig) else open_rig(place_of(name, "a rig, or its file"), unit=unit).read.rig


def points_of(points: str | None, diameter_mm: float | None) -> tuple[str | None, float | None]:
    """What a table's points are, and the diameter of circles: `circle:13mm` says both.

    Raises:
        InputError: no such diameter, or two.
    """
    from calib.renderer.quantities import parsed
    from designer.base.units import parse_length_mm

    kind, _, diameter = (points or "").partition(":")
    if not diameter:
        return points, diameter_mm
    if diameter_mm is not None:
        raise InputError(f"--points {shown(points)}: says the diameter; leave diameter_mm out")
    return kind, parsed("--points", diameter, parse_length_mm)


def opened_rig(rig: "Rig") -> "OpenedRig":
    """A rig that comes from no file, with the kind that is ours."""
    from calib.cameras.formats.reading import OpenedRig
    from calib.cameras.formats.rig_format import ReadRig

    return OpenedRig(RIG_FORMATS[OWN], ReadRig(rig, (None,) * len(rig.cameras)))


def rig_named(
    name: Place, kind: str | None = None, unit: str | None = None, accept_px: float = ACCEPTED_PX
) -> "OpenedRig | None":
    """The rig of a file or a folder; None: it is a camera's, or nobody's.

    Raises:
        InputError: a rig's file that cannot be read.
    """
    from calib.cameras.formats.reading import open_rig, rig_format_of

    place = place_of(name, "a camera, a rig, or the file of one")
    if place.is_dir() and (place / FORMATS[OWN].file_name).exists():
        return None
    if kind in RIG_FORMATS and kind not in FORMATS:
        return open_rig(place, kind, unit, accept_px)
    found = rig_format_of(place)
    return None if found is None or kind not in (None, found.name) else open_rig(place, found.name, unit, accept_px)


def require_photos_for_jobs(jobs: int | None) -> None:
    """Refuse a number of photos to be searched at a time where there are none; InputError: it is given."""
    if jobs is not None:
        raise InputError("--jobs: says how many photos are searched at a time; a table needs none, leave it out")


def photos_of(
    photos: Place | Iterable[Place], topic: str | None = None, target: "TargetGeometry | None" = None,
    progress: Progress = unheard,
) -> "FoundPhotos":  # fmt: skip
    """The photos that one argument or several stand for; of a bag the images of a topic.

    Of clips the frames in which the target is seen best; without a target they are refused.
    """
    from calib.images.bag import bag_named
    from calib.observe.bag_photos import photos_in
    from calib.observe.photos import find_photos

    def of_clip(path: Path) -> "FoundPhotos":
        from calib.capture.clips import photos_of_clip

        return photos_of_clip(path, cast("TargetGeometry", target), progress)

    try:
        each = [fspath(one) for one in ([photos] if isinstance(photos, str | PathLike) else photos)]
    except TypeError as error:
        raise InputError(
            f"photos: {error}; give files, folders or patterns (arrays go to images=[...], one to calib.detect)"
        ) from None
    found = [photos_in(one, topic) for one in each if bag_named(one)]
    if topic is not None and not found:
        raise InputError(f"--topic {shown(topic)}: is of a robot's bag, and none is given; leave it out")
    files = find_photos([one for one in each if not bag_named(one)], None if target is None else of_clip)
    return replace(
        files, photos=(*files.photos, *(photo for one in found for photo in one.photos)),
        remarks=(*files.remarks, *(remark for one in found for remark in one.remarks)),
    )  # fmt: skip


def with_bag(given: "RigInput", topics: Sequence[str] | None = None) -> "RigInput":
    """What is given for a rig, with the photos of a bag's topics, if it is a bag: `run.mcap#/left run.mcap#/right`.

    Raises:
        InputError: it is no bag though topics are told, more than one, or has no such topics.
    """
    from calib.images.bag import bag_named
    from calib.observe.bag_photos import rig_photos_in
    from calib.observe.rig_search import USUAL_TOLERANCE_S

    bags = [one for one in map(bag_named, given.photos) if one is not None]
    if not bags and topics is None:
        return given
    if len({path for path, _ in bags}) != 1 or len(bags) < len(given.photos) or given.pattern or given.times:
        raise InputError("--topics: are of one robot's bag (.bag, .mcap, .db3, or a rosbag2 folder) instead of folders")
    named = [topic for _, topic in bags if topic is not None] if topics is None else topics
    photos = rig_photos_in(str(bags[0][0]), named, given.tolerance_s or USUAL_TOLERANCE_S)
    return replace(given, images=photos, tolerance_s=None)


def photos_given(
    photos: Place | Iterable[Place], images: "Iterable[Pixels] | None", topic: str | None = None,
    target: "TargetGeometry | None" = None, progress: Progress = unheard,
) -> "FoundPhotos":  # fmt: skip
    """The photos, or images in memory instead; InputError: neither or both are given, or an image is none."""
    from calib.observe.photos import photos_of_arrays

    if images is None:
        if isinstance(photos, tuple | list) and not photos:
            raise InputError("no photos; give files, folders or patterns, or arrays as images=[...]")
        return photos_of(photos, topic, target, progress)
    if topic is not None:
        raise InputError("--topic: is of a robot's bag; leave it out")
    if not isinstance(photos, tuple | list) or photos:
        raise InputError("photos and images: give one of them; images are arrays, photos files")
    return photos_of_arrays(images)


def criteria_of(criteria: "Criteria | Place") -> "Criteria":
    """Limits, or those of a template or a file; InputError: neither."""
    from calib.judge.checks import read_criteria
    from calib.judge.verdict import Criteria

    return criteria if isinstance(criteria, Criteria) else read_criteria(str(place_of(criteria, "limits")))


KINDS_OF_FILES = {"target": "a target", "camera": "a camera", "rig": "a rig", "photos": "photos"}


def in_order(first: T, order: str, **given: object) -> T:
    """The first, or a refusal of files in another order than a command's, which `order` says, where they tell it.

    Raises:
        InputError: a file is of another kind than its place; the message names both.
    """
    from calib.images.photo import SUFFIXES_OF
    from designer.base.own_files import kind_of

    images = {suffix for group in SUFFIXES_OF.values() for suffix in group}
    for role, value in given.items():
        one = value[0] if isinstance(value, list | tuple) and value else value
        path = Path(one) if isinstance(one, str | PathLike) else None
        if path is None or not path.is_file():
            continue
        with path.open("rb") as stream:
            kind = kind_of(stream.read(4096)).decode().rpartition(".")[2]
        kind = "photos" if path.suffix.lower() in images else kind
        if kind in KINDS_OF_FILES and kind not in role.split("_"):
            raise InputError(f"{path}: is {KINDS_OF_FILES[kind]}; the order is {order}")
    return first

"""From the photos of several cameras, or a table of what they saw, to what a rig is solved from.

Photos of several cameras joined to frames by their time stamps, each photo once.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calib.cameras.rig import ALONE
from calib.core.csv_table import stamps_s
from calib.core.types import RigObservations
from calib.observe.photos import FoundPhotos, named_photos
from calib.observe.rig_photos import (
    RigPhoto,
    RigPhotos,
    framed,
    is_sightings,
    joined_by_name,
    photos_by_pattern,
    photos_in_folders,
    read_photo_table,
    read_stamps,
    with_stamps,
)
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError, NoAnswerError
from designer.base.files import place_of
from designer.base.words import shown
from designer.page.progress import Progress
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.observe.photos import Search
    from calib.observe.rig_observations import RigSightings
    from calib.solver.plan import SolvePlan

Place: TypeAlias = str | PathLike[str]
USUAL_TOLERANCE_S = 0.02
TRIED_MIRRORED = 3
"""Photos of a camera that sees nothing, which are looked at in a mirror."""


@dataclass(frozen=True)
class RigInput:
    """Where the photos of a rig's cameras are, and what tells which were taken at once."""

    photos: tuple[str, ...] = ()  # folders
    table: Path | None = None  # of files, or of sightings
    pattern: str | None = None  # of file names
    times: Path | None = None  # time stamps of the files
    tolerance_s: float | None = None  # of time stamps of one frame
    images: RigPhotos | None = None  # that are in memory, joined already

    @property
    def is_anything(self) -> bool:
        """Whether there is something to solve from."""
        return bool(self.photos) or self.table is not None or self.images is not None

    @property
    def needless(self) -> str:
        """What is given and is of photos alone: the option; "" if nothing is."""
        given = {"--pattern": self.pattern, "--times": self.times, "--tolerance": self.tolerance_s}
        return next((name for name, value in given.items() if value is not None), "")

    @property
    def has_sightings(self) -> bool:
        """Whether the table is all there is to solve from."""
        return self.table is not None and is_sightings(self.table)


@dataclass(frozen=True, eq=False)
class RigSearch:
    """What was found in the photos of a rig."""

    target: TargetGeometry
    photos: RigPhotos
    searches: "tuple[Search, ...]"  # of each camera

    @property
    def rendered_id(self) -> str:
        """Of the geometry that the photos were rendered of; "": real photos, or not all of one."""
        ids = {one.rendered_id for one in self.searches}
        return next(iter(ids)) if len(ids) == 1 else ""


class BlindCameraError(NoAnswerError):
    """A camera of a rig sees the target in none of its photos."""


def rig_input(
    photos: Place | Iterable[Place] = (),
    table: Place | None = None,
    pattern: str | None = None,
    times: Place | None = None,
    tolerance_s: float | None = None,
) -> RigInput:
    """What a person gave, if it fits together; InputError: it does not."""
    try:
        folders = tuple(fspath(one) for one in ([photos] if isinstance(photos, str | PathLike) else photos))
    except TypeError as error:
        raise InputError(f"photos: {error}; give folders, one a camera") from None
    found = RigInput(
        folders, None if table is None else place_of(table, "a table of files or of sightings"), pattern,
        None if times is None else place_of(times, "a table of time stamps"), tolerance_s,
    )  # fmt: skip
    if found.table is not None and folders:
        raise InputError(f"--table {found.table}: says which photos there are; leave {shown(folders[0])} out")
    if pattern is not None and found.table is not None:
        raise InputError("--pattern: is of the files in folders; leave it or --table out")
    return found


def photos_of_rig(given: RigInput) -> RigPhotos:
    """The photos, joined to frames; InputError: they cannot be; the message names them."""
    if given.images is not None:
        return given.images
    if given.table is not None:
        table = read_photo_table(given.table)
        found, is_framed = table, bool(table[0].frame)
    elif given.pattern is not None:
        joined = photos_by_pattern(given.photos, given.pattern)
        if given.times is None and given.tolerance_s is None:
            return joined
        found, is_framed = joined.photos, True
    else:
        found, is_framed = photos_in_folders(given.photos), False
        if given.times is None:
            found = stamped_by_name(found)
    if given.times is not None:
        found = with_stamps(found, read_stamps(given.times, found))
    is_timed = all(photo.time_s is not None for photo in found)
    if given.tolerance_s is not None and not is_timed:
        raise InputError("--tolerance: is of time stamps; give them in a column time_s, or with --times")
    if is_timed and (given.tolerance_s is not None or not is_framed):
        return joined_by_time(found, given.tolerance_s or USUAL_TOLERANCE_S)
    return framed(found) if is_framed else joined_by_name(found)


def photos_of_one(photos: FoundPhotos) -> RigPhotos:
    """The photos of a camera that is solved as a rig is: each is a frame."""
    named = named_photos(photos.photos)
    taken = tuple(RigPhoto.taken(ALONE, one, one.name) for one in named)
    return RigPhotos(taken, tuple(one.frame for one in taken), (*photos.remarks, *photos.failures))


def search_cameras(
    target: TargetGeometry, photos: RigPhotos, lenses: "Mapping[str, Camera]",
    plan_of: "Callable[[str], SolvePlan] | None", jobs: int | None, progress: Progress,
) -> RigSearch:  # fmt: skip
    """Search each camera's photos: with its lens if it is given, else twice, with the lens known the second time.

    Args:
        target: what they show.
        photos: of the cameras.
        lenses: that are given, by the cameras' names.
        plan_of: how another camera is to be solved; None: all lenses are given.
        jobs: photos at a time.
        progress: told camera by camera.

    Raises:
        InputError: a photo of another size than its lens, or a camera whose photos cannot be read.
    """
    from calib.observe.search import PhotoSearch, with_truth

    _require_given_sizes(photos, lenses)
    searches: list[Search] = []
    for name in photos.camera_names:

        def told(what: str, done: float, total: int, of: str = _named(photos, name, " {}")) -> None:
            progress(what + of, done, total)

        files, _ = with_truth(FoundPhotos(tuple(photo.file for photo in photos.of(name))), None)
        search = PhotoSearch(target, files, None, jobs, told)
        searches.append(search.twice(plan_of(name))[0] if plan_of and name not in lenses else search.once(lenses[name]))
    return RigSearch(target, photos, tuple(searches))


def observations_of_rig(search: RigSearch) -> RigObservations:
    """What the cameras saw, of which each sees the target.

    Raises:
        InputError: a camera whose photos are of two sizes.
        BlindCameraError: a camera that sees the target in no photo.
    """
    from calib.observe.rig_observations import rig_observations

    photos = search.photos
    each = list(zip(photos.camera_names, search.searches, strict=True))
    cameras = [_sightings_of(name, photos, one) for name, one in each]
    said = [_named(photos, name, "{}: ") + line for name, one in each for line in (*one.remarks, *one.failures)]
    return rig_observations(cameras, photos.frame_names, (*photos.remarks, *said), fewest=len(each))


def _named(photos: RigPhotos, name: str, words: str) -> str:
    """Words with a camera's name in them; none where there is no other."""
    return words.format(name) if len(photos.camera_names) > 1 else ""


def _sightings_of(name: str, photos: RigPhotos, search: "Search") -> "RigSightings":
    """What can be used of one camera's photos."""
    from calib.observe.observations import observations_from_detections
    from calib.observe.rig_observations import RigSightings

    if not search.with_target:
        count = len(search.results)
        of = _named(photos, shown(name), "camera {}: ")
        raise BlindCameraError(f"{of}none of {count} photos shows the target{_why_blind(search)}")
    _require_one_size(name, search)
    seen = observations_from_detections(search.with_target, search.target, origin=f"camera {name}")
    of_path = {photo.path: photo for photo in photos.of(name)}
    photo_of = {result.photo.name: of_path[result.photo.path] for result in search.results}
    times = {view: photo.time_s for view, photo in photo_of.items() if photo.time_s is not None}
    return RigSightings(name, seen, {view: photo.frame for view, photo in photo_of.items()}, times)


def _why_blind(search: "Search") -> str:
    """Why no photo of a camera shows the target: they are mirrored, or what is said of the first; "" if nothing is."""
    from calib.observe.search import look_for

    readable = [result for result in search.results if result.seen is not None]
    for result in readable[:TRIED_MIRRORED]:
        pixels = result.photo.read().pixels[:, ::-1].copy()
        if len(look_for(search.target)(result.photo, pixels).ring):
            return (
                ", but they do when they are flipped: the camera, or who saved its photos, mirrors them; flip them back"
            )
    said = [remark for result in readable if result.seen is not None for remark in result.seen.remarks]
    return f"; of the first is said: {said[0]}" if said else ""


def _require_one_size(name: str, search: "Search") -> None:
    """Refuse a camera whose photos are not of one size."""
    first: dict[tuple[int, int], str] = {}
    for one in search.detections:
        first.setdefault(one.image_size, one.image)
    if len(first) > 1:
        each = " and ".join(f"{image} has {size[0]} x {size[1]} px" for size, image in list(first.items())[:2])
        raise InputError(f"camera {shown(name)}: {each}; a camera of a rig has one image size: keep the photos of one")


def _require_given_sizes(photos: RigPhotos, given: "Mapping[str, Camera]") -> None:
    """Refuse a lens of another image size than its photos, and say whose it may be."""
    for name, camera in given.items():
        size = next((size for photo in photos.of(name) if (size := _size_of(photo.path)) is not None), None)
        if size is None or size == camera.image_size:
            continue
        fitting = [other for other, one in given.items() if other != name and one.image_size == size]
        swapped = f"; the files or folders of {shown(name)} and {shown(fitting[0])} may be swapped" if fitting else ""
        raise InputError(
            f"camera {shown(name)}: its photos have {size[0]} x {size[1]} px, its camera file "
            f"{camera.image_size[0]} x {camera.image_size[1]} px{swapped}"
        )


def _size_of(path: Path) -> tuple[int, int] | None:
    """Of a photo; None if it cannot be read, which is said when it is searched."""
    from calib.images.headers import DamagedError, read_header

    try:
        header = read_header(path.read_bytes()) if path.is_file() else None
    except (DamagedError, OSError):
        return None
    return (header.width, header.height) if header and header.width else None


def stamped_by_name(photos: Sequence[RigPhoto]) -> tuple[RigPhoto, ...]:
    """Photos that are named by the time of their taking, with time stamps; as they are if others are among them.

    Names of 16 to 19 digits are seconds since 1970 of ten digits and a fraction. Those that all cameras have alike need
    no clock.
    """
    stamps = stamps_s([photo.path.name for photo in photos])
    of_camera = [{one.path.stem for one in photos if one.camera == name} for name in {one.camera for one in photos}]
    if stamps is None or any(photo.opened for photo in photos) or set.intersection(*of_camera):
        return tuple(photos)
    return tuple(replace(photo, time_s=time_s) for photo, time_s in zip(photos, stamps[0].tolist(), strict=True))


def joined_by_time(photos: Sequence[RigPhoto], tolerance_s: float) -> RigPhotos:
    """Photos of different cameras that were taken within a tolerance are a frame, the nearest ones first.

    Frames are named by the time of their first photo. What is joined does not depend on the order of the photos.

    Args:
        photos: each with its time stamp.
        tolerance_s: that all photos of a frame lie within.

    Raises:
        InputError: no two photos lie so near.
    """
    cameras = list(dict.fromkeys(photo.camera for photo in photos))
    photos = sorted(photos, key=lambda one: (one.time_s or 0.0, one.camera, str(one.path)))
    time_s = np.array([photo.time_s for photo in photos], dtype=np.float64)
    frame = _joined(time_s, [photo.camera for photo in photos], tolerance_s)
    first: dict[int, int] = {}
    for row, one in enumerate(frame):
        first.setdefault(one, row)
    count = np.bincount(frame, minlength=len(photos))
    if count.max() < 2:
        raise InputError(_why_none(photos, time_s, tolerance_s))
    start_s = float(time_s[0])
    names = {one: f"{time_s[row] - start_s:.6f}s" for one, row in first.items()}
    if len(set(names.values())) < len(names):
        names = {one: f"{place + 1:06d}" for place, one in enumerate(first)}
    named = [replace(photo, frame=names[one]) for photo, one in zip(photos, frame, strict=True)]
    found = framed(sorted(named, key=lambda photo: cameras.index(photo.camera)))
    order = tuple(names[one] for one in first)
    return replace(found, frame_names=order, remarks=tuple(_said(time_s, np.array(frame), photos, tolerance_s)))


def _joined(time_s: Array, cameras: Sequence[str], tolerance_s: float) -> list[int]:
    """The frame of each photo: the row of one of its photos.  # (N,)"""
    parent = list(range(len(time_s)))
    members: dict[int, list[int]] = {row: [row] for row in parent}
    for first, second in _links(time_s, cameras, tolerance_s):
        a, b = parent[first], parent[second]
        both = members[a] + members[b] if a != b else []
        names = [cameras[row] for row in both]
        if not both or len(set(names)) < len(names) or np.ptp(time_s[both]) > tolerance_s:
            continue
        for row in members.pop(b):
            parent[row] = a
        members[a] = both
    return parent


def _links(time_s: Array, cameras: Sequence[str], tolerance_s: float) -> list[tuple[int, int]]:
    """Pairs of photos of two cameras, each nearest to the other before or after it, the nearest pairs first."""
    rows_of: dict[str, Rows] = {
        name: np.array([row for row, one in enumerate(cameras) if one == name]) for name in sorted(set(cameras))
    }
    pairs: set[tuple[int, int]] = set()
    for a, b in combinations(rows_of.values(), 2):
        after = np.searchsorted(time_s[b], time_s[a])
        for step in (-1, 0):
            near = b[np.clip(after + step, 0, len(b) - 1)]
            ok = np.abs(time_s[a] - time_s[near]) <= tolerance_s
            pairs.update(zip(a[ok].tolist(), near[ok].tolist(), strict=True))
    return sorted(pairs, key=lambda pair: (abs(time_s[pair[0]] - time_s[pair[1]]), min(pair), max(pair)))


def _said(time_s: Array, frame: Rows, photos: Sequence[RigPhoto], tolerance_s: float) -> Iterator[str]:
    """How far apart the photos of a frame lie, and how many have no partner."""
    _, place, count = np.unique(frame, return_inverse=True, return_counts=True)
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, place, time_s)
    np.maximum.at(high, place, time_s)
    apart_ms = 1e3 * (high - low)[count > 1]
    yield (
        f"joined by time stamps: {len(apart_ms)} frames of two cameras or more, their photos "
        f"{np.median(apart_ms):.3g} ms apart (median), {apart_ms.max():.3g} ms at most"
    )
    if alone := int((count == 1).sum()):
        yield f"{alone} of {len(photos)} photos have none of another camera within {1e3 * tolerance_s:g} ms"
    steps = [np.diff([one.time_s for one in photos if one.camera == name]) for name in {one.camera for one in photos}]
    least_s = min((float(step.min()) for step in steps if len(step)), default=np.inf)
    if tolerance_s > 0.5 * least_s:
        yield (
            f"the tolerance, {1e3 * tolerance_s:g} ms, is more than half of the {1e3 * least_s:.3g} ms between two "
            "photos of a camera: which of them a frame takes may be chance"
        )


def _why_none(photos: Sequence[RigPhoto], time_s: Array, tolerance_s: float) -> str:
    """No frame: how far the clocks are apart."""
    spans = []
    for name in dict.fromkeys(photo.camera for photo in photos):
        own = [one for one, photo in zip(time_s.tolist(), photos, strict=True) if photo.camera == name]
        spans.append(f"{name} from {min(own):.6g} to {max(own):.6g} s")
    return (
        f"no photos of two cameras lie within {1e3 * tolerance_s:g} ms of each other: {'; '.join(spans)}; give a "
        "larger --tolerance, or set the clocks right"
    )

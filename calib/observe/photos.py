"""Many photos: each is read, searched and drawn on its own; what goes wrong with one is kept with it.

A photo need not be a file: an array, a frame of a clip and a message of a bag are searched, named and drawn alike,

    PhotoFile(Path("run.bag/left/image_raw/1700000000.25"), time_s=1700000000.25, opened=lambda: Photo(pixels, ()))

`opened` is called when the photo is searched, once or twice and from some thread, so that few are in memory; what it
raises becomes the photo's failure. `path` is what messages call it: what holds it, and what it is in there.

Pictures of photos that were searched: drawn aside, and kept in the place of earlier ones when all are there.
"""

import glob
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.types import Detections
from calib.images import video
from calib.images.more_formats import EXTRAS, needed_extra
from calib.images.photo import SUFFIXES_OF, Photo, grey_of, read_image, require_image
from calib.observe.dataset import ImageRecord, image_record
from designer.base.errors import InputError
from designer.base.files import check_folder, distinct_stems
from designer.base.own_files import is_ours, require_ours
from designer.target import TargetGeometry

OVERLAY_MARK = ".overlay"
"""Stands in the name of each overlay, so that one is not taken for a photo."""

MOST_KEPT_BYTES = 2**29
"""Of photos that are kept in memory between two searches; the others are read again."""

_CONVERT = "convert to PNG, or to JPEG at full size and highest quality"
NOT_READ: Mapping[str, tuple[tuple[str, ...], str]] = {
    "AVIF image": ((".avif",), _CONVERT),
    "JPEG 2000, JPEG XL, GIF or OpenEXR image": ((".jp2", ".j2k", ".jxl", ".gif", ".exr"), _CONVERT),
    "video": (video.SUFFIXES, "give a clip by its own name, not by its folder's"),
}
"""What cameras and phones make that is not read of a folder, by kind: its suffixes, and what to do."""

Pixels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class PhotoFile:
    """A photo to search, under the name its detections get: a file, or what `opened` reads."""

    path: Path  # of the file; of what is none: that which holds it, and what it is in there
    name: str = ""  # "": not named yet
    time_s: float | None = None  # when it was taken, by a clock of its camera
    opened: Callable[[], Photo] | None = None  # None: it is a file
    is_kept: bool = False  # a run keeps it as a file, as it is one of many in a clip

    def read(self) -> Photo:
        """Its pixels in grey; InputError: they cannot be read; it names the photo."""
        return read_image(self.path) if self.opened is None else self.opened()


Read = Callable[[PhotoFile], Photo]


Look: TypeAlias = Callable[[PhotoFile, Pixels], Detections]
"""Finds and names a target's features in a photo; InputError says why that cannot be."""


@dataclass(frozen=True)
class PhotoResult:
    """What came of one photo: detections, or why there are none."""

    photo: PhotoFile
    seen: Detections | None
    failure: str = ""  # one line that names the file
    overlay: Path | None = None
    overlay_failure: str = ""  # why it was not drawn, in one line that names the photo

    @property
    def record(self) -> ImageRecord:
        """What happened to it."""
        if self.seen is None:
            return ImageRecord(self.photo.name, None, 0, 0, (), (), self.failure)
        return image_record(self.seen)


@dataclass(frozen=True, eq=False)
class Search:
    """What was found in photos."""

    target: TargetGeometry
    results: tuple[PhotoResult, ...]  # of each photo, in order
    missing: tuple[str, ...]  # arguments that stood for no photo, one line each
    overlays_left_out: int  # of an earlier run among the photos
    seconds: float
    rendered_id: str = ""  # of the geometry that the photos were rendered of; "": real photos
    remarks: tuple[str, ...] = ()  # on the search as a whole

    @property
    def detections(self) -> tuple[Detections, ...]:
        """Of each photo that could be searched."""
        return tuple(result.seen for result in self.results if result.seen is not None)

    @property
    def with_target(self) -> tuple[Detections, ...]:
        """Of each photo that shows the target."""
        return tuple(seen for seen in self.detections if len(seen.ring))

    @property
    def counts(self) -> tuple[int, int]:
        """Features that were found, and that could have been measured of the faces that show."""
        records = [image_record(seen) for seen in self.detections]
        return sum(record.features for record in records), sum(record.expected for record in records)

    @property
    def failures(self) -> tuple[str, ...]:
        """What could not be read or searched, one line each."""
        return (*self.missing, *(result.failure for result in self.results if result.failure))


@dataclass(frozen=True)
class FoundPhotos:
    """The photos that a person's arguments stand for."""

    photos: tuple[PhotoFile, ...]
    failures: tuple[str, ...] = ()  # arguments that stand for none, one line each
    overlays: int = 0  # earlier overlays among them, which are left out
    rendered_id: str = ""  # of the geometry that they were rendered of; "": real photos
    remarks: tuple[str, ...] = ()  # on them

    @property
    def paths(self) -> tuple[Path, ...]:
        """Where they are."""
        return tuple(photo.path for photo in self.photos)


def find_photos(arguments: Sequence[str], of_clip: Callable[[Path], FoundPhotos] | None = None) -> FoundPhotos:
    """Files as they are, all images of folders, and patterns that the shell left alone.

    Args:
        arguments: files, folders and patterns.
        of_clip: gives frames of a video file; None: it is refused.

    Raises:
        InputError: an argument is empty.
    """
    paths: list[Path] = []
    failures = []
    for argument in arguments:
        if not argument:
            raise InputError("'' is no photo; give files, folders or patterns, or '.' for the current folder")
        path = Path(argument)
        if os.path.isdir(path):
            inside = images_in(path)
            left_out = not_read_in(path)
            if left_out:
                failures.append(f"{path}: {'; '.join(left_out)}")
            elif not inside:
                failures.append(f"{path}: no images in this folder; they are known by suffixes such as .png or .jpg")
            paths += inside
        elif glob.has_magic(argument) and not os.path.exists(path):
            matches = [Path(match) for match in glob.glob(argument, recursive=True) if Path(match).is_file()]
            if not matches:
                failures.append(f"{argument}: no file matches this pattern; check the path")
            paths += sorted(matches, key=in_order)
        else:
            paths.append(path)
    files = [path for path in paths if not path.stem.endswith(OVERLAY_MARK)]
    found = [_photos_at(path, of_clip) for path in files]
    return FoundPhotos(
        tuple(photo for one in found for photo in one.photos),
        (*failures, *(line for one in found for line in one.failures)), len(paths) - len(files),
        remarks=tuple(line for one in found for line in one.remarks),
    )  # fmt: skip


def _photos_at(path: Path, of_clip: Callable[[Path], FoundPhotos] | None) -> FoundPhotos:
    """A file as a photo, or the frames of a clip."""
    if not video.calls_itself_clip(path):
        return FoundPhotos((PhotoFile(path),))
    if of_clip is None:
        return FoundPhotos((), (f"{path}: is a video; give photos here",))
    try:
        return of_clip(path)
    except InputError as error:
        return FoundPhotos((), (str(error),))


def photos_of_arrays(images: Iterable[NDArray[np.generic]]) -> FoundPhotos:
    """Images in memory, named image-1, image-2, ... in their order; InputError: one is no image; it names the first."""
    photos = []
    for number, image in enumerate(images, start=1):
        name = f"image-{number}"
        try:
            pixels = grey_of(require_image(image))
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
        photos.append(PhotoFile(Path(name), opened=partial(Photo, pixels, ())))
    if not photos:
        raise InputError("images: there are none; give a list of numpy arrays")
    return FoundPhotos(tuple(photos))


def images_in(folder: Path) -> list[Path]:
    """The images of a folder by their names' suffixes, without hidden files."""
    raw = SUFFIXES_OF["raw"]
    suffixes = {suffix for name, group in SUFFIXES_OF.items() if not needed_extra(name) for suffix in group}
    try:
        files = [path for path in folder.iterdir() if path.suffix.lower() in suffixes and not path.name.startswith(".")]
    except OSError:
        return []
    # Cameras keep a raw photo beside its JPEG, which is another image of the same.
    developed = [path for path in files if path.suffix.lower() not in raw]
    return sorted((path for path in developed or files if path.is_file()), key=in_order)


def not_read_in(folder: Path) -> tuple[str, ...]:
    """What a folder holds that a camera may have made and that is not read, by kind: how many, and what to do."""
    try:
        suffixes = Counter(path.suffix.lower() for path in folder.iterdir() if not path.name.startswith("."))
    except OSError:
        return ()
    told = []
    kinds, raw = dict(NOT_READ), SUFFIXES_OF["raw"]
    for name in EXTRAS:
        if install := needed_extra(name):
            kinds[f"{name} photo"] = SUFFIXES_OF[name], f"{install}, or {_CONVERT}"
    if "raw photo" not in kinds and any(path.suffix.lower() not in raw for path in images_in(folder)):
        kinds["raw photo"] = raw, "developed ones stand beside them; name them, or give a folder of them alone"
    for kind, (known, remedy) in kinds.items():
        count = sum(suffixes[suffix] for suffix in known)
        if count:
            told.append(f"{count} {kind}{'s are' if count > 1 else ' is'} not read: {remedy}")
    return tuple(told)


def in_order(path: Path) -> list[tuple[int, str]]:
    """Key that sorts img2 before img10."""
    parts = re.split(r"([0-9]+)", str(path))
    return [(int(part), "") if k % 2 else (0, part) for k, part in enumerate(parts)]


def named_photos(photos: Iterable[PhotoFile]) -> tuple[PhotoFile, ...]:
    """The photos with names that differ: the file's name, with as many of its folders as tell it from the others.

    A file given twice is taken once, through a link too: seen twice, it would count twice in a calibration.
    """
    once: dict[str, PhotoFile] = {}
    for photo in photos:
        once.setdefault(os.path.realpath(photo.path), photo)
    given = {Path(os.path.abspath(photo.path)): photo for photo in once.values()}
    depth = dict.fromkeys(given, 1)
    while True:
        name = {path: "/".join(path.parts[-depth[path] :]) for path in given}
        count = Counter(name.values())
        alike = [path for path in given if count[name[path]] > 1]
        if not alike:
            return tuple(replace(photo, name=name[path]) for path, photo in given.items())
        for path in alike:
            depth[path] += 1


def reading_once(most_bytes: int = MOST_KEPT_BYTES) -> Read:
    """A reader for two searches: what it has read it keeps for the second time, as much as may be in memory.

    A photo is read by one thread at a time.
    """
    kept: dict[Path, Photo] = {}

    def read(photo: PhotoFile) -> Photo:
        image = kept.pop(photo.path, None)
        if image is not None:
            return image
        image = photo.read()
        if sum(one.pixels.nbytes for one in list(kept.values())) + image.pixels.nbytes <= most_bytes:
            kept[photo.path] = image
        return image

    return read


def searched_photos(
    photos: Sequence[PhotoFile],
    target: TargetGeometry,
    look: Look,
    *,
    overlay_folder: Path | None = None,
    jobs: int = 1,
    read: Read = PhotoFile.read,
) -> Iterator[PhotoResult]:
    """Search photos, `jobs` at a time, so that no more are in memory; results come in the order of the photos.

    No fault of a photo, not even of the detector on it, ends the search. Threads do: decoding and the compiled kernels
    release the interpreter's lock.
    """
    stems = distinct_stems([photo.name for photo in photos])

    def work(photo: PhotoFile, stem: str) -> PhotoResult:
        try:
            image = read(photo)
            seen = look(photo, image.pixels)
        except Exception as error:
            return PhotoResult(photo, None, why_failed(error, f"{photo.path}: the search failed"))
        seen = replace(seen, remarks=(*image.remarks, *seen.remarks), time_s=photo.time_s)
        if overlay_folder is None:
            return PhotoResult(photo, seen)
        from calib.detector.overlay import draw_overlay, write_overlay

        try:
            picture = draw_overlay(image.pixels, seen, target)
            return PhotoResult(photo, seen, overlay=write_overlay(overlay_folder / f"{stem}{OVERLAY_MARK}", picture))
        except Exception as error:
            return PhotoResult(photo, seen, overlay_failure=f"no overlay for {photo.name}: {why_failed(error)}")

    if min(jobs, len(photos)) == 1:
        yield from map(work, photos, stems)
        return
    pool = ThreadPoolExecutor(jobs)
    try:
        yield from pool.map(work, photos, stems)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def kept_frames(results: Iterable[PhotoResult], place: Path) -> dict[Path, bytes]:
    """The frames of clips that were searched, as files in a folder; {}: there are none."""
    import cv2

    photos = [one.photo for one in results if one.photo.is_kept]
    files = {}
    for photo, stem in zip(photos, distinct_stems([one.name for one in photos]), strict=True):
        done, data = cv2.imencode(".png", photo.read().pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if done:
            files[place / f"{stem}.png"] = data.tobytes()
    return files


def why_failed(error: Exception, what: str = "") -> str:
    """Why something failed, in a line: what a person did wrong, or the kind of a fault of the program's."""
    if isinstance(error, InputError):
        return str(error)
    return f"{what}{': ' if what else ''}{type(error).__name__}: {error}"


def require_size(name: str, pixels: NDArray[np.generic], camera: Camera | None) -> None:
    """Refuse a photo of another size than the camera's that took it; InputError: the message names it."""
    height, width = pixels.shape[:2]
    if camera is not None and camera.image_size != (width, height):
        raise InputError(
            f"{name}: has {width} x {height} px, but the camera is of one with "
            f"{camera.image_size[0]} x {camera.image_size[1]} px; give photos and camera of one size"
        )


AT_ONCE = 4
"""Photos that are drawn at a time."""


@contextmanager
def staging_folder(place: Path, option: str = "--overlay") -> Iterator[Path]:
    """A folder inside the pictures' final place, gone afterwards; InputError: the place takes no files."""
    check_folder(place, option)
    try:
        place.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=place))
    except OSError as error:
        raise InputError(f"{place}: cannot be written: {error.strerror}; choose another folder with {option}") from None
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def keep_pictures(staging: Path, place: Path) -> tuple[Path, ...]:
    """Put finished pictures in their place, which is returned; InputError: one would replace somebody else's file."""
    pictures = sorted(staging.iterdir())
    for picture in pictures:
        require_ours(place / picture.name, picture.read_bytes())
    return tuple(picture.replace(place / picture.name) for picture in pictures)


@contextmanager
def no_empty_folders(place: Path) -> Iterator[None]:
    """Remove the folders that were made for nothing, if it comes to that."""
    made = [folder for folder in (place, *place.parents) if not folder.exists()]
    try:
        yield
    finally:
        with suppress(OSError):  # the first that is not empty
            for folder in made:
                folder.rmdir()


def with_overlays(search: Search, staging: Path) -> Search:
    """The search with a picture of each photo, drawn from its file."""
    known = {result.photo.name: result for result in search.results}

    def found_before(photo: PhotoFile, _: object) -> Detections:
        seen = known[photo.name].seen
        if seen is None:
            raise InputError(known[photo.name].failure)
        return seen

    photos = [result.photo for result in search.results]
    drawn = searched_photos(photos, search.target, found_before, overlay_folder=staging, jobs=AT_ONCE)
    return replace(
        search, results=tuple(_drawn(before, now) for before, now in zip(search.results, drawn, strict=True))
    )


def _drawn(before: PhotoResult, now: PhotoResult) -> PhotoResult:
    gone = now.failure if before.seen is not None else ""
    failure = f"no overlay for {before.photo.name}: {gone}" if gone else now.overlay_failure
    return replace(before, overlay=now.overlay, overlay_failure=failure)


def remove_ours(kinds: Mapping[Path, str] | Iterable[Path]) -> None:
    """Remove files that this program made, each of its kind, "" for any; others stay."""
    of_kind = kinds if isinstance(kinds, Mapping) else dict.fromkeys(kinds, "")
    for path, kind in of_kind.items():
        if path.is_file() and is_ours(path, kind):
            path.unlink()

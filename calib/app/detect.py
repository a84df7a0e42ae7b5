"""A target's rings in photos: `calib detect`, `calib.detect(image, "ico.target.json")`, `calib.detect_photos(...)`."""

from contextlib import nullcontext
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app.cameras_told import remarks_on
from calib.app.options import PhotoJobs, Photos, Target, exports_folder
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.options import option
from designer.base.words import shown
from designer.kinds.presets import camera_templates
from designer.page.capability import capability, written_to
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    import numpy as np

    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.core.types import Detections
    from calib.observe.photos import PhotoResult, Search
    from designer.base.answer import Value
    from designer.base.arrays import Image
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

    Pixels = np.typing.NDArray[np.generic]

DETECTIONS_FILE = "detections.csv"


@dataclass(frozen=True, eq=False)
class DetectedPhotos(Result, kind="detections", title="Detections"):
    """What many photos show of a target: `found.search.detections`, `found.save("detections.csv")`."""

    search: "Search"
    target_file: str  # as it was given; "" for one that comes from no file
    table: Path | None = None  # of the detections, as it was written
    overlays: Path | None = None  # folder of the pictures
    remarks: tuple[str, ...] = ()  # on the photos as a whole, and the camera that they were searched with

    def page(self) -> "Page":
        """Whether enough was found, why rings are missing, and what to do about it."""
        from calib.app.detect_page import detected_page

        return detected_page(self)

    def page_beside(self, folder: Path) -> "Page":
        """The same with the pictures."""
        from calib.app.detect_page import detected_page

        return detected_page(self, folder)

    def purposes(self, folder: Path) -> tuple[tuple[str, str], ...]:
        """The table and its records, where they can be linked."""
        from calib.app.detect_page import way_to

        table = way_to(self.table, folder)
        records = Path(table).with_suffix(".records.json").as_posix()
        return (
            (table, "the detections, a line a feature: what a calibration reads"),
            (records, "what was read of each face, and why features are missing"),
        )

    @property
    def is_negative(self) -> bool:
        """No photo shows the target."""
        return not self.search.with_target

    @property
    def remedy(self) -> str:
        """Nothing but this helps."""
        return "take the right target file, or other photos" if self.is_negative else ""

    def answer(self) -> "dict[str, Value]":
        """Sums, and the counts of each photo with the reasons of what is missing."""
        return detections_answer(self.search)

    def save(self, place: str | PathLike[str], *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """Write the detections, a `.csv`, and their records beside it; return both.

        Raises:
            InputError: no such name, or somebody else's file.
        """
        from calib.observe.dataset import check_output, records_path
        from calib.observe.search import write_search

        table = place_of(place, "a .csv file")
        check_output(table)
        write_search(table, self.search)
        return table, records_path(table)


def detections_answer(search: "Search") -> "dict[str, Value]":
    """What was found in photos, as programs are told of it."""
    found, expected = search.counts
    return {
        "target_id": search.target.geometry_id, "layout_id": search.target.layout_id, "photos": len(search.results),
        "searched": len(search.detections), "with_target": len(search.with_target), "found": found,
        "expected": expected, "failures": list(search.failures), "overlays_left_out": search.overlays_left_out,
        "seconds": search.seconds, "per_photo": [_photo_answer(result) for result in search.results],
    }  # fmt: skip


def _photo_answer(result: "PhotoResult") -> "dict[str, Value]":
    from calib.observe.dataset import median_sigma_px

    seen, record = result.seen, result.record
    head: dict[str, Value] = {"image": result.photo.name, "path": str(result.photo.path)}
    if seen is None:
        return {**head, "failure": result.failure}
    return {
        **head, "failure": None, "image_size_px": seen.image_size, "found": record.features,
        "expected": record.expected, "faces": sorted(face.face for face in record.named if face.face is not None),
        "missing": dict(record.missing), "median_sigma_px": median_sigma_px(seen), "time_s": seen.time_s,
        "remarks": [*seen.remarks, *filter(None, [result.overlay_failure])],
    }  # fmt: skip


@capability(folder=lambda given: exports_folder(cast(Path, given["target"])) / DETECTIONS_FILE)
def detect_photos(
    target: Target,
    photos: Photos,
    *,
    camera: Annotated[
        "Camera | Place | None",
        option(
            "camera file (of ours or another tool) or template: centres become surer where its lens is known",
            complete=camera_templates,
        ),
    ] = None,
    overlay: Annotated[
        "Place | None", option("folder for pictures that show what was and was not found, and the page", metavar="DIR")
    ] = None,
    jobs: PhotoJobs = None,
    out: Annotated[
        "Output | Place | None", written_to(f"detections to write (default: exports/NAME/{DETECTIONS_FILE})")
    ] = None,
    progress: Progress = unheard,
) -> DetectedPhotos:
    """Find a target's rings or corners in photos, name them, and measure their places: `detect_photos(target, photos)`.

    The exit code is 1 if nothing at all was found.

    >>> found = calib.detect_photos("ico.target.json", "photos/*.jpg", out="detections.csv")
    >>> run = calib.solve(found.search.detections, "ico.target.json")

    Raises:
        InputError: a file that cannot be read, no photos, or a place that takes no such file.
    """
    from calib.app.inputs import in_order, opened_camera, photos_of, target_of
    from calib.observe.dataset import check_output
    from calib.observe.photos import keep_pictures, staging_folder
    from calib.observe.search import PhotoSearch, with_truth

    geometry = target_of(in_order(target, "calib detect TARGET PHOTO...", target=target, photos=photos), "rings")
    read = None if camera is None else opened_camera(camera).read
    to, folder = None if out is None else output_of(out), None if overlay is None else place_of(overlay, "a folder")
    if to is not None:
        to.place, to.page = to.place / DETECTIONS_FILE if to.place.is_dir() else to.place, folder
        check_output(to.place)
    given = photos_of(photos, None, geometry, progress)
    asked, _ = with_truth(given, None)  # a truth that is none does not matter here
    with nullcontext() if folder is None else staging_folder(folder) as staging:
        search = PhotoSearch(geometry, asked, staging, jobs, progress).once(None if read is None else read.camera)
        found = DetectedPhotos(
            search, "" if not isinstance(target, str | PathLike) else str(target), None if to is None else to.place,
            folder, (*given.remarks, *(() if read is None else remarks_on(str(camera), read))),
        )  # fmt: skip
        if to is not None:
            to.files += found.save(to.place)
            to.finished.append(to.place)
        pictures = () if staging is None or folder is None else keep_pictures(staging, folder)
    if to is not None:
        to.files += pictures
    if folder is not None and to is not out:  # a command draws it when all is said
        found.draw_page(folder)
    return found


class Detector:
    """Finds one target in many photos: `Detector(target).detect(image)`.

    >>> detector = calib.Detector("ico.target.json", camera="camera.json")
    >>> found = detector.detect(frame)

    Args:
        target: what the photos show: a geometry, or its file.
        camera: that takes them, if it is known: a camera, a file, or a template; centres become surer with its lens.

    Raises:
        InputError: a file that cannot be read, or a target without rings.
    """

    def __init__(self, target: "TargetGeometry | Place", camera: "Camera | Place | None" = None) -> None:
        from calib.app.inputs import load_camera, target_of
        from calib.observe.search import look_for

        self.target = target_of(target, "rings")
        self.camera = None if camera is None else load_camera(camera)
        self._look = look_for(self.target, self.camera)

    def detect(self, image: "Pixels | Place", name: str = "") -> "Detections":
        """The target's rings and dots in a photo; none, with the reason in `remarks`, if it does not show the target.

        Args:
            image: grey (H, W), or blue, green, red (H, W, 3) as OpenCV reads it, of 8 or 16 bits or float32; or a file.
            name: what the photo is called in the result; "": a file's own name.

        Raises:
            InputError: no such file, no image, or one of another size than the camera's.
        """
        from calib.images.photo import grey_pixels
        from calib.observe.photos import PhotoFile

        if isinstance(image, str | PathLike):
            name = name or Path(image).name
        return self._look(PhotoFile(Path(name or "the image"), name or "image"), grey_pixels(image))

    def glance(self, image: "Pixels | Place", name: str = "", likely: "Camera | None" = None) -> "Detections":
        """The same in a third of the time, for live video: the same names, and centres to about .2 px.

        >>> seen = detector.glance(frame)

        Each frame is looked at afresh: nothing is kept from the one before. Names are told as `detect` tells them, and
        fewer of them; `cov_px2` says how rough the centres are. Where another target is in view, `remarks` say so;
        why it is taken for another, `detect` says at more length.

        Args:
            image: as for `detect`.
            name: what the frame is called in the result.
            likely: a camera that is not sure to be the one, as one from few photos: its lens is tried before another
                is guessed from the frame.

        Raises:
            InputError: no such file, no image, or one of another size than the camera's.
        """
        from calib.detector.glance import look_quickly
        from calib.detector.lens import CameraLens
        from calib.images.photo import grey_pixels
        from calib.observe.photos import require_size

        pixels = grey_pixels(image)
        require_size(name or "the image", pixels, self.camera)
        lens = None if self.camera is None else CameraLens(self.camera)
        is_same_size = likely is not None and likely.image_size == (pixels.shape[1], pixels.shape[0])
        hint = CameraLens(likely) if likely is not None and is_same_size else None
        return look_quickly(pixels, self.target, name or "image", lens, hint)

    def draw(self, image: "Pixels | Place", found: "Detections") -> "Image":
        """A picture of what was found in a photo and what was not, for a person: red, green, blue.  # (H', W', 3)

        Raises:
            InputError: no such file, no image, or found in a photo of another size or with another target.
        """
        import numpy as np

        from calib.core.types import Detections
        from calib.detector.overlay import draw_overlay
        from calib.images.photo import grey_pixels

        pixels = grey_pixels(image)
        if not isinstance(found, Detections):
            raise InputError(f"{shown(found)}: is of type {type(found).__name__}; give what was detected in the photo")
        if found.image_size != (pixels.shape[1], pixels.shape[0]) or found.layout_id != self.target.layout_id:
            raise InputError(f"{found.image}: was detected in another photo, or with another target; give its own")
        if pixels.dtype == np.float32:  # of any scale: a picture shows what lies between its darkest and its lightest
            low, high = float(pixels.min()), float(pixels.max())
            pixels = ((pixels - low) * (255 / max(high - low, 1e-9))).astype(np.uint8)
        return draw_overlay(pixels, found, self.target)


def detect(
    image: "Pixels | Place", target: "TargetGeometry | Place", *, camera: "Camera | Place | None" = None, name: str = ""
) -> "Detections":
    """Find a target's rings or corners in one photo, and measure their places: `detect(image, "ico.target.json")`.

    >>> found = calib.detect(cv2.imread("a.png"), geometry)
    >>> cv2.solvePnP(found.object_points, found.image_points, matrix, distortion)

    Args:
        image: as `Detector.detect` has it.
        target: what it shows: a geometry, or its file. For many photos of one target a `Detector` reads it once.
        camera: that took it, if it is known.
        name: what the photo is called in the result.

    Raises:
        InputError: a file that cannot be read, an array that is no image, or a camera of another size.
    """
    return Detector(target, camera).detect(image, name)

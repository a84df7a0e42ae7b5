"""Photos searched for a target: once, or twice with the lens known the second time."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib.api.loading import processes_of
from calib.api.progress import Progress, unheard
from calib.cameras import COMMON
from calib.cameras.camera import Camera
from calib.core.types import Detections
from calib.detector import pipeline
from calib.detector.pipeline import Found
from calib.observe.image_headers import exif_focal_px
from calib.observe.images import read_image
from calib.observe.observations import observations_from_detections
from calib.observe.photos import (
    Detect,
    FoundPhotos,
    PhotoResult,
    Pixels,
    Read,
    Search,
    detect_photos,
    named_photos,
    reading_once,
)
from calib.observe.truth import Truth, read_truth
from calib.pipeline.solving import SolvePlan
from calib.show.photos.why_nothing import explained
from calib.solver.solve import solve
from designer.base.errors import InputError
from designer.target import TargetGeometry

NOTHING_LEFT = "no photos left to search"


def search_once(
    target: TargetGeometry,
    photos: FoundPhotos,
    *,
    camera: Camera | None = None,
    overlay_folder: Path | None = None,
    jobs: int | None = None,
    rendered_id: str = "",
    progress: Progress = unheard,
) -> Search:
    """Search photos.

    Args:
        target: what they show.
        photos: where they are.
        camera: that took them, if it is known.
        overlay_folder: for pictures of what was found; None: none are drawn.
        jobs: photos at a time; None: one per core.
        rendered_id: of the geometry that they were rendered of.
        progress: is told how many are done.

    Raises:
        InputError: not one photo could be searched.
    """
    start = time.perf_counter()

    def search(pixels: Pixels, target: TargetGeometry, *, name: str, camera: Camera | None = None) -> Detections:
        return explained(pipeline.detect(pixels, target, name=name, camera=camera), pixels, target)

    results = _search(search, target, photos, camera, overlay_folder, jobs, read_image, progress)
    _require_some(photos, results)
    seconds = time.perf_counter() - start
    return Search(target, results, photos.failures, photos.overlays, seconds, rendered_id)


def search_twice(
    target: TargetGeometry,
    photos: FoundPhotos,
    plan: SolvePlan,
    *,
    overlay_folder: Path | None = None,
    jobs: int | None = None,
    rendered_id: str = "",
    remarks: tuple[str, ...] = (),
    progress: Progress = unheard,
) -> tuple[Search, SolvePlan]:
    """Search photos, solve a first camera, and search again with its lens: centres are surer where it is known.

    Args:
        target: what they show.
        photos: where they are.
        plan: how they are to be solved.
        overlay_folder: for pictures of what was found; None: none are drawn.
        jobs: photos at a time; None: one per core.
        rendered_id: of the geometry that they were rendered of.
        remarks: on the photos, known already.
        progress: is told how many are done.

    Returns:
        What was found, and the plan with a first guess of the focal length if the photos state one.

    Raises:
        InputError: not one photo could be searched.
    """
    start = time.perf_counter()
    read, first = reading_once(), _FirstPass()
    results = _search(first, target, photos, None, None, jobs, read, progress)
    plan, guess = _with_stated_focal(plan, results)
    camera, why = _first_camera(results, target, plan)
    results = _search(first.again(camera), target, photos, None, overlay_folder, jobs, read, progress)
    _require_some(photos, results)
    without = f"searched without the lens, which a first solution does not give: {why}" if why else ""
    remarks = (*remarks, *filter(None, (without, guess)))
    seconds = time.perf_counter() - start
    return Search(target, results, photos.failures, photos.overlays, seconds, rendered_id, remarks), plan


def _search(
    detect: Detect,
    target: TargetGeometry,
    photos: FoundPhotos,
    camera: Camera | None,
    overlay_folder: Path | None,
    jobs: int | None,
    read: Read,
    progress: Progress,
) -> tuple[PhotoResult, ...]:
    named = named_photos(photos.paths)
    results: list[PhotoResult] = []
    for result in detect_photos(
        named, target, detect=detect, camera=camera, overlay_folder=overlay_folder, jobs=processes_of(jobs),
        read=read,
    ):  # fmt: skip
        results.append(result)
        progress("searching", len(results), len(named))
    return tuple(results)


def _require_some(photos: FoundPhotos, results: Sequence[PhotoResult]) -> None:
    """Refuse photos of which not one could be searched."""
    if not any(result.seen is not None for result in results):
        refuse_nothing([*photos.failures, *(result.failure for result in results)], NOTHING_LEFT)


def refuse_nothing(failures: Sequence[str], otherwise: str) -> None:
    """End what has nothing to work on: with the first failure, or with a word if nothing failed.

    Raises:
        InputError: always.
    """
    others = f" (and {len(failures) - 1} more like it)" if len(failures) > 1 else ""
    raise InputError(f"{failures[0] if failures else otherwise}{others}")


@dataclass(frozen=True, eq=False)
class _SeenFirst:
    """What the first search found in a photo."""

    named: Found | None  # which no lens has a part in
    seen: Detections


class _FirstPass:
    """The detector, which remembers what it found in each photo."""

    def __init__(self) -> None:
        self._first: dict[str, _SeenFirst] = {}

    def __call__(
        self, pixels: Pixels, target: TargetGeometry, *, name: str, camera: Camera | None = None
    ) -> Detections:
        named = pipeline.find(pixels, target)
        seen = explained(pipeline.detect(pixels, target, name=name, camera=camera, found=named), pixels, target)
        self._first[name] = _SeenFirst(named, seen)
        return seen

    def again(self, known: Camera | None) -> Detect:
        """The detector with the lens known; photos of another size, or all without a camera, are as they were."""

        def search(pixels: Pixels, target: TargetGeometry, *, name: str, camera: Camera | None = None) -> Detections:
            del camera
            before, (height, width) = self._first.get(name), pixels.shape
            lens = known if known is not None and known.image_size == (width, height) else None
            if before is not None and lens is None:
                return before.seen
            named = None if before is None else before.named
            return explained(pipeline.detect(pixels, target, name=name, camera=lens, found=named), pixels, target)

        return search


def _with_stated_focal(plan: SolvePlan, results: Sequence[PhotoResult]) -> tuple[SolvePlan, str]:
    """The plan with a first guess of the focal length, if a photo states one and nobody gave one, and a word on it."""
    if plan.options.focal_px is not None:
        return plan, ""
    for result in results:
        if result.seen is not None and len(result.seen.ring):
            guess = exif_focal_px(result.photo.path)
            if guess is not None:
                said = f"first guess of the focal length: {guess:.0f} px, from what {result.photo.name} says"
                return replace(plan, options=replace(plan.options, focal_px=guess)), said
    return plan, ""


def _first_camera(results: Sequence[PhotoResult], target: TargetGeometry, plan: SolvePlan) -> tuple[Camera | None, str]:
    """A camera good enough to see rings through its lens, or why the photos do not determine one."""
    seen = [result.seen for result in results if result.seen is not None and len(result.seen.ring)]
    if not seen:
        return None, ""
    options = replace(plan.options_of(COMMON), weighted=False)
    if COMMON not in plan.models:  # another model's parameters are other numbers
        options = replace(options, fixed=(), shared=())
    try:
        observations = observations_from_detections(seen, target, origin="the photos")
        calibration = solve(observations, COMMON, options)
    except InputError as error:
        return None, str(error)
    if calibration.status != "converged":
        return None, calibration.remarks[0]
    return calibration.camera, ""


def truth_beside(paths: Iterable[Path]) -> Path | None:
    """The truth of rendered photos, if all are of one rendered set."""
    folders = {path.parent for path in paths}
    beside = next(iter(folders)) / "truth.json" if len(folders) == 1 else None
    return beside if beside is not None and beside.is_file() else None


def truth_of(photos: FoundPhotos, asked: Path | None) -> tuple[Truth | None, str]:
    """The truth of rendered photos, or a remark on one that lies there by chance and is none.

    Raises:
        InputError: the one that was asked for cannot be read.
    """
    path = asked or truth_beside(photos.paths)
    if path is None:
        return None, ""
    try:
        return read_truth(path), ""
    except InputError as error:
        if asked is not None:
            raise
        return None, f"not used: {error}"

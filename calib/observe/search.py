"""Photos searched for a target: once, or twice with the lens known the second time.

Where the light of a wide lens ends, as photos show it: `with_image_circle(camera, brightest_of(photos, size))`.

A model of a lens says where a direction is seen, not whether light arrives there. In many photos of different scenes
every part of the image is bright at some time, but for the dark around an image circle.
"""

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.cameras import COMMON, MODELS, WIDE, rays
from calib.cameras.camera import Camera
from calib.core.types import Detections, Observations
from calib.detector import pipeline
from calib.detector.boards import FoundBoards
from calib.detector.pipeline import NamedRings
from calib.detector.why_nothing import explained
from calib.images.headers import DamagedError, exif_focal_px
from calib.images.photo import MAX_PIXELS, grey_of, read_preview
from calib.observe.dataset import Records, write_detections
from calib.observe.photos import (
    FoundPhotos,
    Look,
    PhotoFile,
    PhotoResult,
    Pixels,
    Read,
    Search,
    named_photos,
    reading_once,
    require_size,
    searched_photos,
)
from calib.renderer.options import TRUTH_FILE
from calib.renderer.quantities import processes_of
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from calib.renderer.truth import Truth
    from calib.solver.calibration import Calibration
    from calib.solver.plan import SolvePlan

LOOSE_PX, MUCH_LESS = 0.3, 0.5
"""Rings are measured to hundredths of a pixel: a lens that leaves more (root mean square) is not theirs, and another
is that leaves less than half of it."""
MOST_OFF_PX = 5.0
"""Rings that lie farther off, or that a lens does not show, count as so far."""
NOTHING_LEFT = "no photos left to search"


@dataclass(frozen=True, eq=False)
class PhotoSearch:
    """Photos to be searched for a target: `PhotoSearch(target, photos).once()`."""

    target: TargetGeometry  # what they show
    photos: FoundPhotos
    overlay_folder: Path | None = None  # for pictures of what was found; None: none are drawn
    jobs: int | None = None  # photos at a time, all in memory; None: one per core
    progress: Progress = unheard

    def once(self, camera: "Camera | None" = None) -> Search:
        """Search with the lens of a camera, if it is known; InputError: not one photo could be searched."""
        start = time.perf_counter()
        return self._found(
            self._looked(look_for(self.target, camera), self.overlay_folder, PhotoFile.read), start, self.photos.remarks
        )

    def twice(self, plan: "SolvePlan") -> "tuple[Search, SolvePlan]":
        """Search, solve a first camera, and search again with its lens: centres are surer where it is known.

        Args:
            plan: how the photos are to be solved.

        Returns:
            What was found, and the plan with a first guess of the focal length if the photos state one.

        Raises:
            InputError: not one photo could be searched.
        """
        start = time.perf_counter()
        read, first = reading_once(), _FirstPass(self.target)
        plan, guess = _with_stated_focal(plan, results := self._looked(first.look, None, read))
        camera, why = _first_camera(results, self.target, plan)
        results = self._looked(first.again(camera), self.overlay_folder, read)
        without = f"searched without the lens, which a first solution does not give: {why}" if why else ""
        said = (*self.photos.remarks, *filter(None, (without, guess)))
        return self._found(results, start, said), plan

    def _looked(self, look: Look, overlay_folder: Path | None, read: Read) -> tuple[PhotoResult, ...]:
        named = named_photos(self.photos.photos)
        results: list[PhotoResult] = []
        jobs = processes_of(self.jobs)
        for result in searched_photos(named, self.target, look, overlay_folder=overlay_folder, jobs=jobs, read=read):
            results.append(result)
            self.progress("searching", len(results), len(named))
        return tuple(results)

    def _found(self, results: tuple[PhotoResult, ...], start: float, said: tuple[str, ...] = ()) -> Search:
        """The search, if one photo at least could be searched."""
        search = Search(
            self.target, results, self.photos.failures, self.photos.overlays, time.perf_counter() - start,
            self.photos.rendered_id, said,
        )  # fmt: skip
        if not search.detections:
            refuse_nothing(search.failures, NOTHING_LEFT)
        return search


def look_for(target: TargetGeometry, camera: "Camera | None" = None) -> Look:
    """How a photo is searched for a target, with the lens of a camera if it is known."""

    def look(photo: PhotoFile, pixels: Pixels) -> Detections:
        require_size(str(photo.path), pixels, camera)
        found = pipeline.detect(pixels, target, name=photo.name, camera=camera)
        return explained(found, pixels, target)

    return look


def write_search(table: Path, search: Search) -> Records:
    """Write the detections and their records, photos that could not be searched among them; the records."""
    failed = [result.record for result in search.results if result.seen is None]
    return write_detections(table, search.detections, search.target, failed=failed, rendered_id=search.rendered_id)


def refuse_nothing(failures: Sequence[str], otherwise: str) -> None:
    """End what has nothing to work on: with the first failure, or with a word if nothing failed; InputError: always."""
    others = f" (and {len(failures) - 1} more like it)" if len(failures) > 1 else ""
    raise InputError(f"{failures[0] if failures else otherwise}{others}")


class _FirstPass:
    """The detector without a lens, which remembers what it found in each photo: which rings are which needs no lens."""

    def __init__(self, target: TargetGeometry) -> None:
        self._target = target
        self._named: dict[str, NamedRings | FoundBoards | None] = {}
        self._seen: dict[str, Detections] = {}

    def look(self, photo: PhotoFile, pixels: Pixels, camera: "Camera | None" = None) -> Detections:
        """What is found in a photo."""
        name = photo.name
        if name not in self._named:
            self._named[name] = pipeline.find(pixels, self._target)
        found = pipeline.detect(pixels, self._target, name=name, camera=camera, found=self._named[name])
        return self._seen.setdefault(name, explained(found, pixels, self._target))

    def again(self, camera: "Camera | None") -> Look:
        """The same with the lens known; photos of another size, or all without a camera, are as they were."""

        def look(photo: PhotoFile, pixels: Pixels) -> Detections:
            is_known = camera is not None and camera.image_size == (pixels.shape[1], pixels.shape[0])
            before = self._seen.pop(photo.name, None)
            return before if before is not None and not is_known else self.look(photo, pixels, camera)

        return look


def _with_stated_focal(plan: "SolvePlan", results: Sequence[PhotoResult]) -> "tuple[SolvePlan, str]":
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


def _first_camera(
    results: Sequence[PhotoResult], target: TargetGeometry, plan: "SolvePlan"
) -> "tuple[Camera | None, str]":
    """A camera good enough to see rings through its lens, or why the photos do not determine one.

    The common model first; where that leaves much, that of wide lenses, if it leaves much less.
    """
    from calib.observe.observations import observations_from_detections

    seen = [result.seen for result in results if result.seen is not None and len(result.seen.ring)]
    if not seen:
        return None, ""
    try:
        observations = observations_from_detections(seen, target, origin="the photos")
    except InputError as error:
        return None, str(error)
    common, why = _first_solution(observations, COMMON, plan)
    left_px = _left_px(common, observations)
    if left_px > LOOSE_PX:
        wide, _ = _first_solution(observations, WIDE, plan)
        if _left_px(wide, observations) < MUCH_LESS * left_px:
            common = wide
    return (None, why) if common is None else (common.camera, "")


def _first_solution(observations: Observations, model: str, plan: "SolvePlan") -> "tuple[Calibration | None, str]":
    """A model's solution, or why there is none."""
    from calib.solver.solve import solve

    options = replace(plan.options_of(model), weighted=False)
    if model not in plan.models:  # another model's parameters are other numbers
        options = replace(options, fixed=(), shared=())
    try:
        calibration = solve(observations, model, options)
    except InputError as error:
        return None, str(error)
    return (calibration, "") if calibration.status == "converged" else (None, calibration.remarks[0])


def _left_px(solved: "Calibration | None", observations: Observations) -> float:
    """How far rings lie from where a camera shows them (root mean square)."""
    off = np.full(len(observations.view), MOST_OFF_PX)
    if solved is not None:
        off[: len(solved.residual_px)] = np.linalg.norm(solved.residual_px, axis=1)
    return float(np.sqrt(np.mean(np.fmin(off, MOST_OFF_PX) ** 2)))


def truth_beside(paths: Iterable[Path]) -> Path | None:
    """The truth of rendered photos, if all are of one rendered set."""
    folders = {path.parent for path in paths}
    beside = next(iter(folders)) / TRUTH_FILE if len(folders) == 1 else None
    return beside if beside is not None and beside.is_file() else None


def with_truth(photos: FoundPhotos, asked: Path | None) -> "tuple[FoundPhotos, Truth | None]":
    """The photos with what they were rendered of, and their truth; a remark on one that lies there and is none.

    Raises:
        InputError: the one that was asked for cannot be read.
    """
    path = asked or truth_beside(photos.paths)
    if path is None:
        return photos, None
    from calib.renderer.truth import TRUTH

    try:
        truth = TRUTH.read(path)
    except InputError as error:
        if asked is not None:
            raise
        return replace(photos, remarks=(*photos.remarks, f"not used: {error}")), None
    return replace(photos, rendered_id=truth.rendered_id(photo.name for photo in photos.paths)), truth


COLUMNS = 240
"""Of the grid of cells."""
MOST_PHOTOS = 24
"""So many, evenly spread over their order, are looked at."""
DARK = 0.3
"""Of the light in the middle: a part of the image that is lighter than this in some photo is not dark."""
LIT = 0.15
"""Of the way from the dark to the light in the middle: what is lighter is lit."""
MIDDLE_RAD = math.radians(30)
SURE = 0.8
"""Of the cells beyond the circle, so many must be dark."""
STEP_RAD = math.radians(1)
FEW_CELLS = 0.01
"""Of all cells: so few without a ray are no part of the image that is worth a word."""


@dataclass(frozen=True, eq=False)
class EndOfLight:
    """A camera with the end of its light, or what keeps that from being known."""

    camera: Camera
    remark: str = ""


def brightest_of(photos: Sequence[PhotoFile], image_size: tuple[int, int]) -> Array | None:
    """The most light that each cell of the image has in any of some photos, of full scale; None if none is read.

    Args:
        photos: of the camera.
        image_size: width, height in px.

    Returns:
        (R, C) means over cells, about square.
    """
    import cv2

    width, height = image_size
    shape = max(1, round(COLUMNS * height / width)), COLUMNS
    picked = np.unique(np.linspace(0, len(photos) - 1, min(len(photos), MOST_PHOTOS)).round().astype(int)).tolist()
    most = np.full(shape, np.nan)
    for photo in (photos[row] for row in picked):
        try:
            preview = read_preview(photo.path, COLUMNS, MAX_PIXELS) if photo.opened is None else photo.opened()
            grey = grey_of(preview.pixels)
        except (DamagedError, InputError):
            continue
        scale = float(np.iinfo(grey.dtype).max)
        small = cv2.resize(grey, (shape[1], shape[0]), interpolation=cv2.INTER_AREA).astype(np.float64)
        most = np.fmax(most, small / scale)
    return None if np.isnan(most).all() else most


def with_image_circle(camera: Camera, brightest: Array) -> EndOfLight:
    """The camera of a wide lens with the angle across its image circle, to about a degree.

    Where no part of the image is dark it is that of the farthest pixel; cameras of other models stay as they are then.

    Args:
        camera: as it was solved.
        brightest: of `brightest_of`.
    """
    rows, columns = brightest.shape
    size = np.array(camera.image_size)
    cell = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1)
    ray = rays(replace(camera, field_rad=None), cell * size / (columns, rows) - 0.5)
    angle = np.arctan2(np.hypot(ray[..., 0], ray[..., 1]), ray[..., 2])
    middle = brightest[angle < MIDDLE_RAD]
    if not middle.size:
        return EndOfLight(camera)
    light, dark = float(np.median(middle)), float(np.percentile(brightest, 1))
    is_lit = brightest > dark + LIT * (light - dark) if dark < DARK * light else np.ones(brightest.shape, dtype=bool)
    end = _end_rad(angle, is_lit)
    if end is None and not camera.has_dark_corners:
        return EndOfLight(camera)
    unseen = np.isnan(angle)
    if end is None and (is_lit & unseen).mean() > FEW_CELLS:
        part = f"{100 * (is_lit & unseen).mean():.0f} % of the image"
        remedy = MODELS[camera.model].remedy
        return EndOfLight(camera, f"the photos show light in {part} where model {camera.model} has no ray: {remedy}")
    end = float(np.nanmax(angle)) + STEP_RAD if end is None else end
    return EndOfLight(replace(camera, field_rad=min(2 * end, 2 * math.pi)))


def _end_rad(angle: Array, is_lit: Flags) -> float | None:
    """The angle off the axis at which half of the cells cease to be lit, and beyond which they are dark; None: none."""
    known = np.isfinite(angle)
    step = (angle[known] / STEP_RAD).astype(np.int64)
    count, lit = np.bincount(step), np.bincount(step, is_lit[known])
    share = np.where(count > 0, lit / np.maximum(count, 1), np.nan)
    bright = np.flatnonzero(share >= 1 / 2)
    last = int(bright[-1]) if len(bright) else -1
    if last < 0 or last + 1 >= len(share):
        return None
    beyond = angle > (last + 1) * STEP_RAD
    if not beyond.any() or is_lit[beyond].mean() > 1 - SURE:
        return None
    # From the share of this degree to that of the next one, at half.
    first, then = share[last], np.nan_to_num(share[last + 1])
    return float((last + 0.5 + (first - 0.5) / max(first - then, 1e-9)) * STEP_RAD)

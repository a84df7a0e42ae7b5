"""The paper's study made again from nothing: its two targets, photos from 400 mm, detections, and the views of samples.

Each step leaves files, and is not done again where they are.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.cameras import COMMON
from calib.cameras.camera import Camera, camera_or_preset
from calib.core.types import Detections, Observations, keep_sightings, keep_views, sightings_per_view
from calib.detector.pipeline import detect
from calib.observe.dataset import read_detections, write_detections
from calib.observe.observations import observations_from_detections
from calib.observe.photos import PhotoFile, Pixels, named_photos, searched_photos
from calib.renderer.job import RenderJob, run_jobs
from calib.renderer.options import TRUTH_FILE, RenderOptions
from calib.renderer.poses import PoseGrid, grid_poses
from calib.renderer.truth import TRUTH, Truth
from calib.solver.problem import AS_THE_PAPER
from calib.solver.solve import solve
from calib.studies.bootstrap import make_pool
from calib.studies.identity import StudyIdentity, identity_of
from calib.studies.runner import Tell, after
from calib.studies.samples import Case
from calib.studies.statistics import BOARD, ICOSAHEDRON, POOL, SAMPLES, SIZES, TARGETS
from calib.studies.workers import CaseSpec
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.spec.kind import spec_from_mapping
from designer.spec.spec import SpecValue
from designer.target import TargetGeometry, load_target, target_to_json

MODEL = "luhmann"
"""The camera model of the paper's table."""
LIMITS_DEG = {"all": 90.0, "<= 75 deg": 75.0}
"""Which sightings count, by the angle between line of sight and normal; rings seen flatter are hardly measured."""
DISTANCE_MM = 400.0
CAMERA = "machine-vision"
"""The paper gives no image size; its errors in mm and px fit 2500 px of focal length and 5 megapixels."""
FIRST_PHOTOS = 30
"""At most so many give the lens that all are searched with."""
LEAST_SIGHTINGS = 10
"""Of a view; one with fewer is not used."""

SAMPLINGS = {"binary": RenderOptions(sampling="binary"), "area": RenderOptions(blur_px=0.7, contrast_to_noise=100)}
"""As the paper renders, one ray a pixel, black or white; and as a good camera sees: anti-aliased, blurred, noisy."""

_RINGS: Mapping[str, SpecValue] = {"ring_diameter_mm": 7, "ring_ratio": 0.45, "pitch_mm": 10, "margin_mm": 1}
PAPER_SPECS: Mapping[str, Mapping[str, SpecValue]] = {
    BOARD: {
        "kind": "board", "size_mm": [220, 220], "thickness_mm": 5, "columns": 21, "rows": 21, "lattice": "square",
        "border_mm": 0, "dots": True, **_RINGS,
    },
    ICOSAHEDRON: {"kind": "ico", "edge_mm": 100, "rings_per_side": 8, "border_mm": 2, **_RINGS},
}  # fmt: skip
"""The targets of the paper's study, as target files have their specs."""


def paper_targets() -> dict[str, TargetGeometry]:
    """A board of 220 mm and an icosahedron of 100 mm edge, both with rings of 7 mm every 10 mm."""
    return {name: spec_from_mapping(spec).lay_out() for name, spec in PAPER_SPECS.items()}


@dataclass(frozen=True)
class PhotoSet:
    """One target photographed with one sampling."""

    target: str
    sampling: str
    views: int
    seed: int = 1

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.target}-{self.sampling}-{self.views}-views-seed-{self.seed}"


def photograph(photos: PhotoSet, target: TargetGeometry, folder: Path, *, jobs: int, tell: Tell) -> None:
    """Render what is missing of a set, from a hemisphere of poses that look at the target."""
    grid = PoseGrid(photos.views, np.pi / 2, (DISTANCE_MM, DISTANCE_MM), random_roll=False, aim_offset_mm=0.0)
    poses = grid_poses(grid, np.random.default_rng(photos.seed))
    job = RenderJob(target, camera_or_preset(CAMERA), poses, SAMPLINGS[photos.sampling], seed=photos.seed)
    run_jobs({folder: job}, processes=jobs, overwrite=False, on_view=lambda done, _: tell(done))


def search(
    target: TargetGeometry, photos: Sequence[PhotoFile], camera: Camera | None, *, jobs: int, tell: Tell
) -> list[Detections]:
    """What the detector finds in photos, those without the target left out."""
    seen = []

    def look(photo: PhotoFile, pixels: Pixels) -> Detections:
        return detect(pixels, target, name=photo.name, camera=camera)

    found = searched_photos(photos, target, look, jobs=jobs)
    for done, result in enumerate(found, start=1):
        tell(done)
        if result.seen is not None and len(result.seen.ring):
            seen.append(result.seen)
    return seen


def photos_in(folder: Path) -> tuple[PhotoFile, ...]:
    """The photos of a set."""
    return named_photos(map(PhotoFile, sorted(folder.glob("*.png"))))


def search_with_lens(target: TargetGeometry, folder: Path, *, jobs: int, tell: Tell) -> list[Detections]:
    """What the detector finds with the lens of a first solution, which comes from some of the photos."""
    photos = photos_in(folder)
    # Neighbours in the grid of poses are alike; photos far apart in it tell more.
    some = photos[:: math.ceil(len(photos) / FIRST_PHOTOS)]
    first = sightings(search(target, some, None, jobs=jobs, tell=lambda _: None), target, folder)
    return search(target, photos, solve(first, COMMON).camera, jobs=jobs, tell=tell)


def sightings(seen: Sequence[Detections], target: TargetGeometry, folder: Path) -> Observations:
    """What a camera is solved from."""
    if not seen:
        raise InputError(f"{folder}: no photo shows the target; render them again in another folder")
    return observations_from_detections(seen, target, origin=str(folder))


def incidence_deg(seen: Observations, truth: Truth) -> Array:
    """Angle between the line of sight and the face's normal, of each sighting by the true poses.  # (M,)"""
    pose = truth.poses_of(seen.view_names)[seen.view]
    position = seen.points.position_mm[seen.point]
    normal = seen.points.plane[seen.points.face[seen.point], :3]
    eye = -np.einsum("mji,mj->mi", pose[:, :3, :3], pose[:, :3, 3])
    sight = eye - position
    cosine = (sight * normal).sum(axis=1) / np.linalg.norm(sight, axis=1)
    angle: Array = np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))
    return angle


def only(seen: Observations, rows: Flags) -> Observations:
    """Some of the sightings, without views that keep too few."""
    kept = keep_sightings(seen, rows)
    return keep_views(kept, sightings_per_view(kept) >= LEAST_SIGHTINGS)


@dataclass(frozen=True)
class PaperStudy:
    """How much of it, and where."""

    folder: Path
    views: int  # photos of each target in each way of sampling
    samples: int  # of each case
    seed: int

    @property
    def sets(self) -> tuple[PhotoSet, ...]:
        """The sets of photos."""
        return tuple(PhotoSet(name, sampling, self.views, self.seed) for sampling in SAMPLINGS for name in TARGETS)

    @property
    def photo_count(self) -> int:
        """Of all sets."""
        return self.views * len(self.sets)

    def target_path(self, name: str) -> Path:
        """The target's file."""
        return self.folder / "targets" / f"{name}.target.json"

    def photo_folder(self, photos: PhotoSet) -> Path:
        """Where a set of photos lies, its truth with it."""
        return self.folder / "photos" / photos.name

    def detections_path(self, photos: PhotoSet) -> Path:
        """What was detected in a set."""
        return self.folder / "detections" / f"{photos.name}.csv"


def full_study(folder: Path, seed: int) -> PaperStudy:
    """As the paper has it."""
    return PaperStudy(folder, POOL, SAMPLES, seed)


def quick_study(folder: Path, seed: int) -> PaperStudy:
    """Enough to see which way it goes."""
    return PaperStudy(folder, 60, 300, seed)


def missing_targets(study: PaperStudy) -> dict[Path, bytes]:
    """The targets' files that are not there, and their contents."""
    files = {study.target_path(name): target_to_json(target).encode() for name, target in paper_targets().items()}
    for path, content in files.items():
        if path.exists() and (not path.is_file() or path.read_bytes() != content):
            raise InputError(f"{path}: is not this study's target; choose another folder with -o")
    return {path: content for path, content in files.items() if not path.exists()}


def _unsearched(study: PaperStudy, tell: Tell) -> Iterator[tuple[PhotoSet, TargetGeometry, Tell]]:
    """The sets that have no detections yet, and whom to tell of what is done of each."""
    targets = paper_targets()
    for place, photos in enumerate(study.sets):
        if not study.detections_path(photos).exists():
            yield photos, targets[photos.target], after(place * study.views, tell)
        tell((place + 1) * study.views)


def make_photos(study: PaperStudy, *, jobs: int, tell: Tell) -> None:
    """Render the photos that are missing, but for sets that have been searched."""
    for photos, target, told in _unsearched(study, tell):
        photograph(photos, target, study.photo_folder(photos), jobs=jobs, tell=told)


def make_detections(study: PaperStudy, *, jobs: int, tell: Tell) -> None:
    """Search the photos of sets that have no detections yet."""
    for photos, target, told in _unsearched(study, tell):
        seen = search_with_lens(target, study.photo_folder(photos), jobs=jobs, tell=told)
        write_detections(study.detections_path(photos), seen, target)


def settings_of(study: PaperStudy) -> StudyIdentity:
    """What makes it this study before there are files."""
    return StudyIdentity(study.seed, (("model", MODEL), ("study", "paper"), ("views", str(study.views))), ())


def identity(study: PaperStudy) -> StudyIdentity:
    """What makes it this study."""
    begun = settings_of(study)
    inputs = {f"target {name}": study.target_path(name) for name in TARGETS}
    for photos in study.sets:
        inputs[f"detections {photos.name}"] = study.detections_path(photos)
        inputs[f"truth {photos.name}"] = study.photo_folder(photos) / TRUTH_FILE
    return identity_of(begun.seed, dict(begun.settings), inputs)


def cases_of(study: PaperStudy) -> Iterator[CaseSpec]:
    """The cases: ways of sampling and of counting sightings, targets, and sizes of samples.

    Raises:
        InputError: files that were changed, and give no camera any more.
    """
    for photos in study.sets:
        path = study.target_path(photos.target)
        target = load_target(path)
        found = read_detections(study.detections_path(photos), target, target_path=path)
        seen = observations_from_detections(found, target, origin=str(study.detections_path(photos)))
        truth = TRUTH.read(study.photo_folder(photos) / TRUTH_FILE)
        angle_deg = incidence_deg(seen, truth)
        for sightings, limit_deg in LIMITS_DEG.items():
            pool = make_pool(only(seen, angle_deg <= limit_deg), MODEL, AS_THE_PAPER, truth)
            for size in SIZES:
                case = Case(photos.target, size, pool.view_count, photos.sampling, sightings)
                yield CaseSpec(case, pool, study.samples)

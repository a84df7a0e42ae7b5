"""The paper's study made again from nothing: targets, photos, detections, and the views that samples are drawn from.

Each step leaves files, and is not done again where they are.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from calib.observe.dataset import read_detections, write_detections
from calib.observe.observations import observations_from_detections
from calib.observe.truth import read_truth
from calib.renderer.job import TRUTH_FILE
from calib.solver.options import AS_THE_PAPER
from calib.studies.bootstrap import make_pool
from calib.studies.identity import StudyIdentity, identity_of
from calib.studies.paper_sets import (
    SAMPLINGS,
    PhotoSet,
    incidence_deg,
    only,
    paper_targets,
    photograph,
    search_with_lens,
)
from calib.studies.paper_table import POOL, SAMPLES, SIZES, TARGETS
from calib.studies.progress import Tell, after
from calib.studies.statistics import Case
from calib.studies.workers import CaseSpec
from designer.base.errors import InputError
from designer.target import TargetGeometry, load_target, target_to_json

MODEL = "luhmann"
"""The camera model of the paper's table."""
LIMITS_DEG = {"all": 90.0, "<= 75 deg": 75.0}
"""Which sightings count, by the angle between line of sight and normal; rings seen flatter are hardly measured."""


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
    """The targets' files that are not there, and their contents.

    Raises:
        InputError: a file holds another target.
    """
    files = {study.target_path(name): target_to_json(target).encode() for name, target in paper_targets().items()}
    for path, content in files.items():
        if path.exists() and (not path.is_file() or path.read_bytes() != content):
            raise InputError(f"{path}: is not this study's target; choose another folder with -o")
    return {path: content for path, content in files.items() if not path.exists()}


def make_photos(study: PaperStudy, *, jobs: int, tell: Tell) -> None:
    """Render the photos that are missing, but for sets that have been searched.

    Raises:
        InputError: a folder holds other photos.
    """
    for place, (photos, target) in enumerate(_with_targets(study)):
        if not study.detections_path(photos).exists():
            told = after(place * study.views, tell)
            photograph(photos, target, study.photo_folder(photos), jobs=jobs, tell=told)
        tell((place + 1) * study.views)


def make_detections(study: PaperStudy, *, detector: str, jobs: int, tell: Tell) -> None:
    """Search the photos of sets that have no detections yet.

    Args:
        study: the study.
        detector: name and version of this program, for the record.
        jobs: photos at a time.
        tell: told of progress.
    """
    for place, (photos, target) in enumerate(_with_targets(study)):
        path = study.detections_path(photos)
        if not path.exists():
            told = after(place * study.views, tell)
            seen = search_with_lens(target, study.photo_folder(photos), jobs=jobs, tell=told)
            write_detections(path, seen, target, detector=detector)
        tell((place + 1) * study.views)


def settings_of(study: PaperStudy) -> StudyIdentity:
    """What makes it this study before there are files."""
    return StudyIdentity(study.seed, (("model", MODEL), ("study", "paper"), ("views", str(study.views))), ())


def identity(study: PaperStudy) -> StudyIdentity:
    """What makes it this study.

    Raises:
        InputError: a file is missing.
    """
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
        truth = read_truth(study.photo_folder(photos) / TRUTH_FILE)
        angle_deg = incidence_deg(seen, truth)
        for sightings, limit_deg in LIMITS_DEG.items():
            pool = make_pool(only(seen, angle_deg <= limit_deg), MODEL, AS_THE_PAPER, truth)
            for size in SIZES:
                yield CaseSpec(Case(photos.target, size, pool.view_count, photos.sampling, sightings), pool)


def _with_targets(study: PaperStudy) -> Iterator[tuple[PhotoSet, TargetGeometry]]:
    targets = paper_targets()
    return ((photos, targets[photos.target]) for photos in study.sets)

"""What a folder of `calib run` or `calib solve` stores, read once for its page."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from calib.cameras import MODELS
from calib.metrics.errors import summarise
from calib.metrics.evaluation import Evaluation, evaluate
from calib.observe.records import Records, read_records
from calib.pipeline.solving import preference
from calib.records.calibration_file import CALIBRATION_FILE, Provenance, read_calibration
from calib.records.evaluation_files import METRICS, METRICS_FILE, Metrics
from calib.solver.calibration import Calibration
from calib.verdict.coverage import Coverage, coverage_of
from designer.base.errors import InputError
from designer.base.words import printable
from designer.target import TargetGeometry, load_target

RECORDS_FILE, TARGET_FILE = "detections.records.json", "target.json"


@dataclass(frozen=True, eq=False)
class Solved:
    """A camera of one model, as it lies in a folder."""

    folder: Path
    path: str  # of that folder from the page, "" or with a "/" at its end
    evaluation: Evaluation
    provenance: Provenance
    stored: Metrics | None

    @property
    def calibration(self) -> Calibration:
        """The solution."""
        return self.evaluation.calibration

    @property
    def model(self) -> str:
        """The camera model's name."""
        return self.calibration.camera.model

    @cached_property
    def rmse_px(self) -> float:
        """What the camera leaves over, root mean square; nan if nothing counts."""
        errors = self.evaluation.of("reprojection")
        return np.nan if errors is None else summarise(errors).rmse

    @cached_property
    def coverage(self) -> Coverage:
        """What of the image the sightings surround."""
        return coverage_of(self.calibration)


@dataclass(frozen=True, eq=False)
class RunFolder:
    """A calibration's folder."""

    folder: Path
    solved: tuple[Solved, ...]  # one of each model, at least one
    records: Records | None  # of the search; None: there are none, as after `calib solve`
    target: TargetGeometry | None  # as it was used
    faults: tuple[str, ...]  # what is there and could not be read, one line each

    def best(self, model: str = "") -> Solved:
        """The camera to go on with: of the model asked for, or else the recommended one."""
        return min(self.solved, key=lambda one: (one.model != model, *preference(one.evaluation)))


def is_run_folder(folder: Path) -> bool:
    """Whether a folder holds a calibration, readable or not."""
    return any((place / CALIBRATION_FILE).is_file() for place in (folder, *(folder / model for model in MODELS)))


def read_run(folder: Path) -> RunFolder:
    """Read all that a calibration's page is built from. What cannot be read but one camera is left out, and said.

    Raises:
        InputError: no camera can be read; the message names the first.
    """
    faults: list[str] = []
    solved = _read_cameras(folder, faults)
    records = target = None
    if (folder / RECORDS_FILE).exists():
        try:
            records = read_records(folder / RECORDS_FILE)
        except InputError as error:
            faults.append(_within(folder, error))
    if (folder / TARGET_FILE).exists():
        try:
            target = load_target(folder / TARGET_FILE)
        except InputError as error:
            faults.append(_within(folder, error))
    if target is not None and target.geometry_id != solved[0].calibration.observations.points.geometry_id:
        faults.append(f"{TARGET_FILE}: not the target that the camera was solved with; the rings are drawn without it")
        target = None
    return RunFolder(folder, tuple(solved), records, target, tuple(faults))


def _read_cameras(folder: Path, faults: list[str]) -> list[Solved]:
    """The cameras of the folder and of its models' folders, of the same photos."""
    solved: list[Solved] = []
    errors: list[InputError] = []
    for path in ("", *(f"{model}/" for model in sorted(MODELS))):
        place = folder / path
        if not (place / CALIBRATION_FILE).is_file():
            continue
        try:
            calibration, provenance = read_calibration(place / CALIBRATION_FILE)
            one = solved_of(place, path, evaluate(calibration), provenance, folder, faults)
        except InputError as error:
            errors.append(error)
            continue
        if any(one.model == other.model for other in solved):
            faults.append(f"{path}: a second camera of model {one.model}, left out")
        elif solved and not _is_of_same_photos(one.calibration, solved[0].calibration):
            faults.append(f"{path}: solved from other sightings than {solved[0].model}, so left out; solve it again")
        else:
            solved.append(one)
    if not solved:
        raise errors[0] if errors else InputError(f"{folder}: holds no {CALIBRATION_FILE}; give a folder of calib run")
    faults += [_within(folder, error) for error in errors]
    return solved


def solved_of(
    place: Path, path: str, evaluation: Evaluation, provenance: Provenance, folder: Path, faults: list[str]
) -> Solved:
    """A camera with what only its tables tell: errors against a truth that is not stored.

    Args:
        place: the camera's folder.
        path: of it from the page.
        evaluation: of the camera, without what only a truth tells.
        provenance: where it comes from.
        folder: of the page.
        faults: what cannot be read is added to them.
    """
    return Solved(place, path, evaluation, provenance, _read_metrics(place, folder, faults))


def _read_metrics(place: Path, folder: Path, faults: list[str]) -> Metrics | None:
    if not (place / METRICS_FILE).exists():
        return None
    try:
        return METRICS.read(place / METRICS_FILE)
    except InputError as error:
        faults.append(_within(folder, error))
        return None


def _is_of_same_photos(a: Calibration, b: Calibration) -> bool:
    """Whether the sightings of one calibration are among those of the other; a learned map does not reach all."""
    few, many = sorted((a.observations, b.observations), key=lambda seen: len(seen.view))
    row_of = {name: row for row, name in enumerate(many.view_names)}
    if few.image_size != many.image_size or any(name not in row_of for name in few.view_names):
        return False
    row = np.array([row_of[name] for name in few.view_names], dtype=np.int64)
    points = 1 + max(int(many.point.max(initial=0)), int(few.point.max(initial=0)))
    key, key_of_few = many.view * points + many.point, row[few.view] * points + few.point
    order = np.argsort(key, kind="stable")
    place = order[np.searchsorted(key[order], key_of_few).clip(max=len(order) - 1)]
    return np.array_equal(key[place], key_of_few) and np.array_equal(many.center_px[place], few.center_px)


def _within(folder: Path, error: InputError) -> str:
    """What is wrong, with paths as they are from the page."""
    return printable(str(error).replace(f"{folder}/", ""))


def models_of(run: RunFolder, best: Solved) -> Sequence[Solved]:
    """All cameras, the best first."""
    return [best, *(one for one in run.solved if one is not best)]

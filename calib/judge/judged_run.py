"""Cameras of one or several models from the same photos with the verdict on the best, in memory or in a folder."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from calib.cameras import MODELS
from calib.judge.halves import Halves, half_split
from calib.judge.judge import VERDICT, VERDICT_FILE, Judged, inputs_of, judge_cameras
from calib.judge.next_views import NEXT_VIEWS, NEXT_VIEWS_FILE, NextView, NextViews
from calib.judge.solutions import Solution
from calib.judge.verdict import Criteria
from calib.observe.calibration_file import CALIBRATION_FILE, read_calibration
from calib.observe.dataset import RECORDS, Records
from calib.solver.calibration import Calibration
from calib.solver.metrics.evaluation import evaluate
from calib.solver.metrics.evaluation_files import METRICS, METRICS_FILE
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import write_files
from designer.base.own_files import is_ours
from designer.base.words import printable
from designer.target import FORMAT, TargetGeometry, load_target, target_to_json

T = TypeVar("T")

RECORDS_FILE, TARGET_FILE = "detections.records.json", "target.json"


@dataclass(frozen=True, eq=False)
class JudgedRun:
    """Cameras of several models from the same photos, and what is known of them."""

    solutions: tuple[Solution, ...]  # of each model, at least one of them solved
    judged: Judged | None  # the best; None: nobody judged
    next_views: tuple[NextView, ...]  # photos that would make it better
    records: Records | None  # of the search for the target; None: there are none, as after `calib solve`
    target: TargetGeometry | None  # as it was used; None: the points came from elsewhere
    faults: tuple[str, ...] = ()  # what is there and could not be read or written, one line each

    @property
    def solved(self) -> tuple[Solution, ...]:
        """Those with a camera, by their models' names."""
        return tuple(sorted((one for one in self.solutions if one.evaluation is not None), key=lambda one: one.model))

    @cached_property
    def best(self) -> Solution:
        """The camera to go on with: the one that was judged, or else the recommended one."""
        model = "" if self.judged is None else self.judged.verdict.model
        return min(self.solved, key=lambda one: (one.model != model, *one.rank))

    @property
    def others(self) -> tuple[Solution, ...]:
        """All cameras but the best."""
        return tuple(one for one in self.solved if one is not self.best)


def is_run_folder(folder: Path) -> bool:
    """Whether a folder holds a calibration, readable or not."""
    return any((place / CALIBRATION_FILE).is_file() for place in (folder, *(folder / model for model in MODELS)))


def read_run(folder: Path) -> JudgedRun:
    """Read a run's folder. What cannot be read but one camera is left out, and said.

    Raises:
        InputError: no camera can be read; the message names the first.
    """
    faults: list[str] = []
    solved = _read_cameras(folder, faults)
    judged = _read(VERDICT, folder / VERDICT_FILE, folder, faults)
    views = _read(NEXT_VIEWS, folder / NEXT_VIEWS_FILE, folder, faults)
    records = records_in(folder, solved[0].calibration.observations.view_names, faults)
    target, wrong = kept_target(folder, solved[0].calibration.observations.points.geometry_id)
    faults += wrong
    run = JudgedRun(tuple(solved), judged, () if views is None else views.views, records, target, tuple(faults))
    if judged is None or judged.solution_sha256 == run.best.provenance.observations_sha256:
        return run
    word = f"{VERDICT_FILE}: on another camera or other photos; calib report with --criteria judges again"
    return replace(run, judged=None, faults=(*faults, word))


def records_in(folder: Path, photos: Sequence[str], faults: list[str]) -> Records | None:
    """The records of the search for the target in these photos; None: they are not there, or of other photos."""
    records = _read(RECORDS, folder / RECORDS_FILE, folder, faults)
    is_of_these = records is not None and set(photos) <= {one.image for one in records.images}
    return records if is_of_these else None


def judge_again(folder: Path, criteria: Criteria) -> Judged:
    """Judge the best camera of a folder, and write `verdict.json` and `next_views.json`, both or none.

    Half solutions that an earlier verdict stored are used again.

    Raises:
        InputError: the folder holds no camera that can be read, or takes no files; the message names it.
    """
    run = read_run(folder)
    best = replace(run, judged=None).best
    stored = run.judged is not None and best is run.best and isinstance(run.judged.halves, Halves)
    halves = run.judged.halves if stored and run.judged else half_split(best.calibration, best.provenance.options)
    judged, views = judge_cameras(
        [one.calibration for one in run.solved], run.solved.index(best), halves, criteria, run.target,
        inputs_of(best.provenance.settings),
    )  # fmt: skip
    judged = replace(judged, solution_sha256=best.provenance.observations_sha256)
    write_files(
        {folder / VERDICT_FILE: VERDICT.text(judged), folder / NEXT_VIEWS_FILE: NEXT_VIEWS.text(NextViews(views))}
    )
    return judged


def _read_cameras(folder: Path, faults: list[str]) -> list[Solution]:
    """The cameras of the folder and of its models' folders, of the same photos."""
    solved: list[Solution] = []
    errors: list[InputError] = []
    for path in ("", *(f"{model}/" for model in sorted(MODELS))):
        place = folder / path
        if not (place / CALIBRATION_FILE).is_file():
            continue
        try:
            calibration, provenance = read_calibration(place / CALIBRATION_FILE)
        except InputError as error:
            errors.append(error)
            continue
        metrics = _read(METRICS, place / METRICS_FILE, folder, faults)
        one = Solution(
            calibration.camera.model, evaluate(calibration), provenance=provenance, stored=metrics, path=path
        )
        if any(one.model == other.model for other in solved):
            faults.append(f"{path}: a second camera of model {one.model}, left out")
        elif solved and not _is_of_same_photos(one.calibration, solved[0].calibration):
            faults.append(f"{path}: solved from other observations than {solved[0].model}, so left out; solve it again")
        else:
            solved.append(one)
    if not solved:
        raise errors[0] if errors else InputError(f"{folder}: holds no {CALIBRATION_FILE}; give a folder of calib run")
    faults += [within(folder, error) for error in errors]
    return solved


def _read(kind: FileKind[T], path: Path, folder: Path, faults: list[str]) -> T | None:
    """What a file says; None if it is not there, or cannot be read, which is added to the faults."""
    try:
        return kind.read(path) if path.exists() else None
    except InputError as error:
        faults.append(within(folder, error))
        return None


def _is_of_same_photos(a: Calibration, b: Calibration) -> bool:
    """Whether the observations of one calibration are among those of the other; a learned map does not reach all."""
    few, many = sorted((a.observations, b.observations), key=lambda seen: len(seen.view))
    if few.image_size != many.image_size:
        return False
    small, large = (
        {
            (seen.view_names[view], point, u, v)
            for view, point, (u, v) in zip(
                seen.view.tolist(), seen.point.tolist(), seen.center_px.tolist(), strict=True
            )
        }
        for seen in (few, many)
    )
    return small <= large


def within(folder: Path, error: InputError) -> str:
    """What is wrong, with paths as they are from the page."""
    return printable(str(error).replace(f"{folder}/", ""))


def keep_target(folder: Path, target: TargetGeometry, *, is_again: bool) -> tuple[Path, ...]:
    """Write `target.json`; its path, or nothing where somebody's own file has that name and stays.

    Args:
        folder: of the photos.
        target: as it was used.
        is_again: whether the same command left results here before: then the target there came with them, while one
            in another folder was put there by somebody, though this program made it.
    """
    path = folder / TARGET_FILE
    if kept_target(folder, target.geometry_id)[0] is not None:
        return (path,)
    if path.exists() and not (is_again and is_ours(path, FORMAT)):
        return ()
    write_files({path: target_to_json(target).encode()})
    return (path,)


def kept_target(folder: Path, geometry_id: str) -> tuple[TargetGeometry | None, tuple[str, ...]]:
    """The target of a folder's photos; None if it is not there, and why it is not used if it is, a line."""
    try:
        target = load_target(folder / TARGET_FILE) if (folder / TARGET_FILE).exists() else None
    except InputError as error:
        return None, (within(folder, error),)
    if target is not None and target.geometry_id != geometry_id:
        return None, (f"{TARGET_FILE}: not the target of these photos, so it is not drawn",)
    return target, ()

"""Folders of what was solved: cameras of one or several models from the same photos, or a rig, with the verdict on it.

Any of them is read by `read_solved`, and judged again by `judge_again`. What is of rigs is loaded for these alone.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

from calib.cameras import MODELS
from calib.cameras.rig import RIG
from calib.judge.halves import NOT_COMPARED, Halves, half_split
from calib.judge.judge import (
    EARLIER_RIG_VERDICT_FILE,
    VERDICT,
    VERDICT_FILE,
    Judged,
    inputs_of,
    judge_cameras,
    judge_rig,
    read_verdict,
)
from calib.judge.next_views import NEXT_VIEWS, NEXT_VIEWS_FILE, NextView, NextViews
from calib.judge.solutions import Solution
from calib.judge.verdict import Criteria, Verdict
from calib.observe.calibration_file import CALIBRATION_FILE, RIG_CALIBRATION_FILE, Provenance, read_calibration
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

if TYPE_CHECKING:
    from calib.judge.evidence import JointEvidence
    from calib.rigs.result import RigCalibration

T = TypeVar("T")

RECORDS_FILE, TARGET_FILE, RIG_FILE = "detections.records.json", "target.json", "rig.json"


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


@dataclass(frozen=True, eq=False)
class RigRun:
    """A solved rig, and what is known of it."""

    found: "RigCalibration"
    provenance: Provenance
    judged: Judged | None = None  # None: nobody judged
    target: TargetGeometry | None = None  # as it was used
    faults: tuple[str, ...] = ()  # what is there and could not be read or written, one line each

    @property
    def verdict(self) -> Verdict | None:
        """On the rig."""
        return None if self.judged is None else self.judged.verdict

    @cached_property
    def stated(self) -> "RigCalibration":
        """With deviations as they are told: enlarged as halves of the frames tell."""
        from calib.judge.joint_halves import enlarged

        return enlarged(self.found, self.evidence.halves)

    @cached_property
    def evidence(self) -> "JointEvidence":
        """What it was, or would be, judged by."""
        from calib.judge.evidence import joint_evidence

        return joint_evidence(self.found, NOT_COMPARED if self.judged is None else self.judged.rig_halves)


def kind_in(folder: Path) -> Literal["rig", "calibration", ""]:
    """What a folder holds, readable or not: a solved rig, cameras of several models, or neither."""
    if (folder / RIG_CALIBRATION_FILE).is_file():
        return "rig"
    places = (folder, *(folder / model for model in MODELS))
    return "calibration" if any((place / CALIBRATION_FILE).is_file() for place in places) else ""


def read_solved(folder: Path) -> JudgedRun | RigRun:
    """Read a folder of either kind. What cannot be read but one camera, or the rig, is left out, and said.

    Raises:
        InputError: no camera, or no rig, can be read; the message names the file.
    """
    return read_rig_run(folder) if kind_in(folder) == "rig" else read_run(folder)


def read_run(folder: Path) -> JudgedRun:
    """Likewise, of cameras."""
    faults: list[str] = []
    solved = _read_cameras(folder, faults)
    judged = _read_judged(folder, faults)
    views = _read(NEXT_VIEWS, folder / NEXT_VIEWS_FILE, folder, faults)
    seen = solved[0].calibration.observations
    records = records_in(folder, seen.view_names, faults)
    target, wrong = kept_target(folder, seen.points.geometry_id)
    run = JudgedRun(tuple(solved), judged, () if views is None else views.views, records, target)
    faults += wrong
    judged = _if_on(judged, run.best.provenance.observations_sha256, "another camera or other photos", faults)
    return replace(run, judged=judged, faults=tuple(faults))


def read_rig_run(folder: Path) -> RigRun:
    """Likewise, of a rig."""
    from calib.rigs.rig_calibration_file import read_rig

    found, provenance = read_rig(folder)
    faults: list[str] = []
    judged = _if_on(_read_judged(folder, faults), _rig_digest(folder), "another solution", faults)
    target, wrong = kept_target(folder, found.observations.points.geometry_id)
    return RigRun(found, provenance, judged, target, (*faults, *wrong))


def _read_judged(folder: Path, faults: list[str]) -> Judged | None:
    try:
        return read_verdict(folder)
    except InputError as error:
        faults.append(within(folder, error))
        return None


def _if_on(judged: Judged | None, digest: str, other: str, faults: list[str]) -> Judged | None:
    """The verdict if it is on that solution; None if not, which is added to the faults."""
    if judged is None or judged.solution_sha256 == digest:
        return judged
    faults.append(f"{VERDICT_FILE}: on {other}; calib report with --criteria judges again")
    return None


def _rig_digest(folder: Path) -> str:
    return hashlib.sha256((folder / RIG_CALIBRATION_FILE).read_bytes()).hexdigest()


def records_in(folder: Path, photos: Sequence[str], faults: list[str]) -> Records | None:
    """The records of the search for the target in these photos; None: they are not there, or of other photos."""
    records = _read(RECORDS, folder / RECORDS_FILE, folder, faults)
    is_of_these = records is not None and set(photos) <= {one.image for one in records.images}
    return records if is_of_these else None


def judge_again(folder: Path, criteria: Criteria) -> Judged:
    """Judge the best camera of a folder, or its rig, and write `verdict.json` and `next_views.json`, both or none.

    Half solutions that an earlier verdict stored are used again.

    Raises:
        InputError: the folder holds neither that can be read, or takes no files; the message names it.
    """
    run = read_solved(folder)
    if isinstance(run, RigRun):
        judged = judge_rig(run.found, run.evidence.halves, criteria)
        judged = replace(judged, solution_sha256=_rig_digest(folder))
        write_files({folder / VERDICT_FILE: VERDICT.text(judged)})
        _remove_earlier_verdict(folder)
        return judged
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


def write_rig(
    folder: Path, found: "RigCalibration", provenance: Provenance, judged: Judged | None = None
) -> tuple[Path, ...]:
    """Write a solved rig's files, all or none; their places.

    Args:
        folder: of the rig.
        found: the rig.
        provenance: where it comes from.
        judged: the verdict on it, whose halves may enlarge what `rig.json` states; None: there is none.

    Raises:
        InputError: they cannot be written, or hold what `read_rig` refuses.
    """
    from calib.judge.joint_halves import enlarged
    from calib.rigs.rig_calibration_file import rig_files

    files = rig_files(folder, found, provenance)
    if judged is not None:
        digest = hashlib.sha256(files[folder / RIG_CALIBRATION_FILE]).hexdigest()
        files[folder / VERDICT_FILE] = VERDICT.text(replace(judged, solution_sha256=digest))
    stated = found if judged is None else enlarged(found, judged.rig_halves)
    files[folder / RIG_FILE] = RIG.text(stated.rig)
    write_files(files)
    _remove_earlier_verdict(folder)
    return tuple(files)


def _remove_earlier_verdict(folder: Path) -> None:
    """Remove the verdict of a rig that an earlier version wrote under another name."""
    path = folder / EARLIER_RIG_VERDICT_FILE
    if path.is_file() and is_ours(path, ""):
        path.unlink()


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

"""What manufacturing errors cost a calibration, and how large they may be: what `design tolerance` does."""

import os
import shlex
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from os import fspath
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.api.loading import Place, camera_of, target_of
from calib.api.page_shown import ShownAsPage
from calib.api.progress import Progress, unheard
from calib.cameras import DEFAULT
from calib.cameras.camera import Camera
from calib.core.files import check_folder, write_files
from calib.renderer.poses import MAX_VIEWS
from calib.renderer.quantities import whole
from calib.solver.options import SolveOptions
from calib.studies.progress import Tell, after
from calib.studies.tolerance.budget import checked_quantity
from calib.studies.tolerance.control import control_of
from calib.studies.tolerance.explore import (
    AGAINST_FILE,
    OTHER_FACTORS,
    STUDY_FILE,
    SWEEP_DRAWS,
    Keeping,
    budgets_of,
    check_unused,
    reaches,
    searched,
    sweep_controls,
    sweep_draws,
)
from calib.studies.tolerance.first_order import FirstOrder, first_order
from calib.studies.tolerance.linear import linear_table
from calib.studies.tolerance.report import (
    Against,
    Requirement,
    ToleranceReport,
    all_crossovers,
    default_vary,
    sweeps_from,
    with_drawn,
)
from calib.studies.tolerance.requirement import parse_requirements
from calib.studies.tolerance.result import table_of_draws
from calib.studies.tolerance.setting import Setting, make_setting
from calib.studies.tolerance.view_fit import view_fit
from designer.base.errors import InputError
from designer.base.words import printable
from designer.target import TargetGeometry, bounding_radius_mm, target_to_json
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel
from designer.tolerance.registry import source_named

MAX_DRAWS = 1_000_000
MAX_SEED = 2**63 - 1
DISTANCES_MM = (1.0, 10_000.0)
LONGEST_NAME = 60


@dataclass(frozen=True)
class DrawCount:
    """How many draws were computed, and how long that took."""

    new: int = 0
    before: int = 0  # that the folder had
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class ToleranceResult(ShownAsPage):
    """What errors cost, and how large they may be: `found.report.table`, `found.is_kept`, `found.save("tolerance")`.

    In a notebook the result shows its page.
    """

    report: ToleranceReport
    drawn: DrawCount

    @property
    def is_kept(self) -> bool:
        """Whether all limits are kept."""
        return all(self.report.is_kept(one.budget) for one in self.report.budgets)

    def save(self, folder: Place, *, formats: Sequence[str] = ()) -> tuple[Path, ...]:
        """Write the tables and figures; return the files.

        Args:
            folder: for them; the draws are in the folder that `tolerance` was given, if it was.
            formats: of the figures besides PNG: `pdf`, `svg`.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        from calib.studies.tolerance.files import report_files

        place = Path(folder)
        check_folder(place)
        files = report_files(self.report, place, formats)
        write_files(files)
        return tuple(files)

    def _write_all(self, folder: Path) -> tuple[Path, ...]:
        from calib.show.folder import write_folder_page

        return (*self.save(folder), *write_folder_page(folder, "tolerance", "")[0])


@dataclass(frozen=True, eq=False)
class _Photographed:
    """A target with its errors in front of a camera."""

    name: str
    setting: Setting
    errors: ErrorModel
    lines: tuple[str, ...]


@dataclass(frozen=True)
class _Asked:
    """What is to be computed, and what is the same for both targets."""

    draws: int
    seed: int
    requirements: tuple[Requirement, ...]
    by: str
    full: bool
    linear: bool
    views: int
    camera: Camera
    camera_name: str
    model: str
    weighted: bool
    progress: Progress = field(repr=False)

    def tell(self, what: str, total: int) -> Tell:
        """Tells of one kind of work."""
        self.progress(what, 0, total)
        return lambda done: self.progress(what, done, total)


def tolerance(
    target: TargetGeometry | Place,
    errors: str,
    *,
    changes: Sequence[str] = (),
    views: int = 90,
    distance_mm: float = 400.0,
    camera: Camera | Place = "machine-vision",
    model: str = DEFAULT,
    weighted: bool = False,
    draws: int = 200,
    full: bool = False,
    linear: bool = False,
    require: Sequence[str] = (),
    by: str | None = None,
    against: TargetGeometry | Place | None = None,
    against_errors: str | None = None,
    against_distance_mm: float | None = None,
    vary: str | None = None,
    seed: int = 1,
    jobs: int | None = None,
    dask: str | None = None,
    resume: bool = False,
    out: Place | None = None,
    progress: Progress = unheard,
) -> ToleranceResult:
    """What errors of a target cost a calibration: `tolerance("ico.target.json", "fdm-dual", linear=True)`.

    >>> found = calib.tolerance("ico.target.json", "fdm-dual", require=["intersection=0.05mm"])
    >>> found.is_kept, found.save("tolerance")

    Args:
        target: a geometry, or its file.
        errors: an error template, or a TOML file.
        changes: other sizes of single errors: `face_tilt=0.1deg`.
        views: how many photos.
        distance_mm: of the cameras from the target's origin.
        camera: a camera, a file, or a template.
        model: that is solved: `luhmann`, `opencv` or `pinhole`.
        weighted: weigh observations by their covariances, or all alike.
        draws: how many made targets to draw.
        full: render and detect real images in each draw, which takes minutes a draw.
        linear: no draws: predict from Jacobians, in seconds.
        require: limits, `intersection=0.05mm`, for which the largest errors are told.
        by: the quantity to rank errors by; None: the first that is required.
        against: another target to compare with.
        against_errors: the errors of that target.
        against_distance_mm: to that target; None: the same.
        vary: the error to compare by; None: the worst one of faces.
        seed: of all that is random.
        jobs: processes; None: one per core.
        dask: address of a cluster's scheduler, which computes the draws instead.
        resume: go on with the study in the folder.
        out: a folder to keep the draws in, so that a stopped study goes on; None: they are not kept.
        progress: is told what is being done.

    Raises:
        InputError: files or options that break a rule; the message names it.
        StudyStoppedError: interrupted, or no workers are left; the draws in a folder are kept.
    """
    requirements = parse_requirements(require)
    chosen = by or (requirements[0].quantity if requirements else "intersection")
    name = camera.model if isinstance(camera, Camera) else fspath(camera)
    asked = _Asked(
        whole("--draws", draws, 2, MAX_DRAWS), whole("--seed", seed, 0, MAX_SEED), requirements,
        checked_quantity(chosen), full, linear, whole("--views", views, 1, MAX_VIEWS), camera_of(camera), name, model,
        weighted, progress,
    )  # fmt: skip
    processes = os.cpu_count() or 1 if jobs is None else whole("--jobs", jobs, 1, 1024)
    _check_together(asked, against, against_errors, against_distance_mm, vary, dask, resume=resume)
    if out is not None:
        check_folder(Path(out))
    progress("setting up", 0, 0)
    first = _photographed(target, errors, changes, distance_mm, asked)
    other = None
    if against is not None and against_errors is not None:
        other = _photographed(against, against_errors, (), against_distance_mm or distance_mm, asked)
        other = replace(other, name=other.name if other.name != first.name else f"{other.name} (other)")
    if vary is not None and first.errors.amount(source_named(vary).name).sigma == 0:
        raise InputError(f"--vary {vary}: has no size in {first.errors.name}; give it one, such as with --set")
    if full:
        first = replace(first, lines=(*first.lines, "photos of every draw are rendered, detected and calibrated"))
    with ExitStack() as stack:
        place = Path(stack.enter_context(TemporaryDirectory())) if out is None else Path(out)
        check_unused(place, resume=resume, predicts=linear)
        keeping = Keeping(place, {"target": _file_of(target, stack)}, asked.seed, processes, dask, resume, full)
        report, drawn = _explored(first, asked, keeping)
        if other is not None and against is not None:
            keeping = replace(keeping, inputs={"target": _file_of(against, stack)})
            report = replace(report, against=_compared(report, other, asked, keeping, vary))
    return ToleranceResult(report, drawn)


def _check_together(
    asked: _Asked,
    against: TargetGeometry | Place | None,
    against_errors: str | None,
    against_distance_mm: float | None,
    vary: str | None,
    dask: str | None,
    *,
    resume: bool,
) -> None:
    """Refuse options that say nothing without another one."""
    if asked.full and asked.linear:
        raise InputError("--full does not fit --linear, which draws nothing; leave one of them out")
    if against is not None and against_errors is None:
        raise InputError(f"--against {_path_of(against)}: say how it is made too, such as --against-errors fdm-board")
    distance = None if against_distance_mm is None else f"{against_distance_mm:g}mm"
    for option, value in (("--against-errors", against_errors), ("--against-distance", distance), ("--vary", vary)):
        if value is not None and against is None:
            raise InputError(f"{option} {value} says nothing without --against; name the other target's file")
    if asked.linear and (resume or dask is not None):
        option = "--resume" if resume else f"--dask {dask}"
        raise InputError(f"{option} does not fit --linear, which draws nothing; leave one of them out")
    if dask is not None:
        from calib.studies.dask_cluster import check_cluster

        asked.progress("asking the cluster", 0, 0)
        check_cluster(dask)


def _photographed(
    target: TargetGeometry | Place, errors: str, changes: Sequence[str], distance_mm: float, asked: _Asked
) -> _Photographed:
    """Read a target and its errors, and set up its photos.

    Raises:
        InputError: a file, a quantity or an option that breaks a rule.
    """
    geometry = target_of(target, "rings")
    made = error_model(errors, changes)
    low, high = DISTANCES_MM
    if not low <= distance_mm <= high:
        raise InputError(f"--distance {distance_mm:g}mm: must be from {low:g}mm to {high:g}mm")
    inside = bounding_radius_mm(geometry)
    if distance_mm <= inside:
        raise InputError(
            f"--distance {distance_mm:g}mm: the target reaches {inside:.0f}mm from its origin; stay farther away"
        )
    fit = view_fit(geometry, asked.camera, distance_mm).remark
    try:
        setting = make_setting(
            geometry, asked.camera, views=asked.views, distance_mm=distance_mm, model=asked.model, seed=asked.seed,
            options=SolveOptions(weighted=asked.weighted),
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{error}{f' ({fit})' if fit else ''}") from None
    name = _name_of(_path_of(target))
    line = (
        f"{name}: {_count(geometry.face_count, 'face')}, {geometry.ring_count} rings; "
        f"{_count(asked.views, 'view')} from {distance_mm:g}mm by {asked.camera_name}, "
        f"{len(setting.observations.view)} sightings; solved: {asked.model}{', weighted' if asked.weighted else ''}"
    )
    return _Photographed(
        name, setting, made, (line, f"errors {made.name}: {made.title}", *_remarks(geometry, setting, fit))
    )


def _remarks(target: TargetGeometry, setting: Setting, fit: str) -> Iterator[str]:
    """What to know of a setting."""
    if target.source != "nominal":
        yield f"the target file is a {target.source} one; its shape is taken as the drawing"
    if not target.is_planar:
        yield "layers and axes are those of a print that lies on its last face"
    yield from setting.remarks
    if fit:
        yield f"warning: {fit}"


def _explored(scene: _Photographed, asked: _Asked, keeping: Keeping) -> tuple[ToleranceReport, DrawCount]:
    """Costs, sweeps, how far the prediction holds, and budgets."""
    setting, errors = scene.setting, scene.errors
    asked.progress("predicting", 0, 0)
    linear = linear_table(setting, errors)
    report = ToleranceReport(scene.name, scene.lines, setting.target.face_count, linear, linear, asked.by)
    if asked.linear:
        return replace(report, budgets=budgets_of(report, asked.requirements)), DrawCount()
    first, seen = first_order(setting), [time.perf_counter()]
    tell = _noted(asked.tell("drawing", asked.draws), seen)
    found = keeping.draws(setting, errors, STUDY_FILE, asked.draws, tell)
    before = int(seen[1]) if len(seen) > 1 else asked.draws
    drawn = DrawCount(asked.draws - before, before, time.perf_counter() - seen[0])
    asked.progress("comparing with the prediction", 0, 0)
    control = control_of(first, linear, asked.seed, range(asked.draws), has_noise=not asked.full)
    report = replace(report, table=table_of_draws(errors, found, control))
    if asked.full:
        return replace(report, budgets=budgets_of(report, asked.requirements)), drawn
    tell = asked.tell("sweeping", len(OTHER_FACTORS) * min(SWEEP_DRAWS, asked.draws))
    swept = sweep_draws(keeping, setting, errors, found, tell)
    asked.progress("comparing with the prediction", 0, 0)
    controls = sweep_controls(first, linear, swept, asked.seed)
    report = replace(report, sweeps=sweeps_from(report.table, linear, swept, controls))
    tell = asked.tell("checking the prediction", len(report.ranking))
    held = reaches(first, errors, report.ranking, linear.baseline.value, asked.seed, tell)
    report = replace(report, reaches=held)
    report = replace(report, budgets=budgets_of(report, asked.requirements))
    return _searched(report, first, errors, asked), drawn


def _noted(tell: Tell, seen: list[float]) -> Tell:
    """Tells of progress, and notes how many draws were there at first."""

    def told(done: float) -> None:
        if len(seen) == 1:
            seen.append(done)
        tell(done)

    return told


def _searched(report: ToleranceReport, first: FirstOrder, errors: ErrorModel, asked: _Asked) -> ToleranceReport:
    """The budgets, searched with draws where errors are no longer small."""
    total, done, budgets = sum(len(one.beyond) for one in report.budgets), 0, []
    if not total:
        return report
    tell = asked.tell("searching limits", total)
    for checked in report.budgets:
        found = searched(first, checked, errors, asked.seed, asked.draws, after(done, tell))
        budgets.append(with_drawn(checked, found))
        done += len(checked.beyond)
    return replace(report, budgets=tuple(budgets))


def _compared(
    report: ToleranceReport, other: _Photographed, asked: _Asked, keeping: Keeping, vary: str | None
) -> Against:
    """The other target's costs, and where the first loses to it."""
    asked.progress("predicting the other", 0, 0)
    table = linear_table(other.setting, other.errors)
    if not asked.linear:
        tell = asked.tell("drawing the other", asked.draws)
        found = keeping.draws(other.setting, other.errors, AGAINST_FILE, asked.draws, tell)
        first, numbers = first_order(other.setting), range(asked.draws)
        control = control_of(first, table, asked.seed, numbers, has_noise=not asked.full)
        table = table_of_draws(other.errors, found, control)
    chosen = vary or default_vary(report.table, asked.by)
    return Against(other.name, table, other.lines, chosen, all_crossovers(report.table, table))


def _file_of(target: TargetGeometry | Place, stack: ExitStack) -> Path:
    """A file with the target, which tells a study from another."""
    if not isinstance(target, TargetGeometry):
        return Path(target)
    place = Path(stack.enter_context(TemporaryDirectory())) / "target.json"
    place.write_text(target_to_json(target))
    return place


def _path_of(target: TargetGeometry | Place) -> Path:
    return Path("target") if isinstance(target, TargetGeometry) else Path(target)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _name_of(path: Path) -> str:
    """What a target is called in tables."""
    name = printable(path.name.removesuffix(".json").removesuffix(".target")) or shlex.quote(str(path))
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 3]}..."

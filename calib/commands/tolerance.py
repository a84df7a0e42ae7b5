"""The command `design tolerance`: what manufacturing errors cost a calibration, and how large they may be."""

import os
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.figure_formats import FiguresOption, figure_formats
from calib.commands.folder_page import say_next, with_page
from calib.commands.study import kept_when_stopped, stopped_in_a_line, table_answer
from calib.commands.tolerance_screen import say_files, say_report
from calib.core.files import check_folder
from calib.show.screen import progress_bar, quoted, waiting
from designer.answer import Summary
from designer.completion import camera_templates, error_templates, one_of
from designer.errors import InputError
from designer.words import printable

if TYPE_CHECKING:
    from calib.cameras.camera import Camera
    from calib.studies.tolerance.explore import Keeping
    from calib.studies.tolerance.first_order import FirstOrder
    from calib.studies.tolerance.report import Against, Requirement, ToleranceReport
    from calib.studies.tolerance.setting import Setting
    from designer.target import TargetGeometry
    from designer.tolerance.model import ErrorModel

MAX_DRAWS = 1_000_000
LONGEST_NAME = 60
LIMIT_MISSED = 1


def tolerance(
    target: Annotated[Path, typer.Argument(help="a target file (NAME.target.json)")],
    *,
    errors: Annotated[
        str,
        typer.Option(
            help="error template (fdm-dual, hand-stickers, ...), or a TOML file", autocompletion=error_templates
        ),
    ],
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="another size of one error: face_tilt=0.1deg", metavar="ERROR=SIZE"),
    ] = None,
    views: Annotated[int, typer.Option(help="how many photos")] = 90,
    distance: Annotated[str, typer.Option(help="of the cameras from the target's origin")] = "400mm",
    camera: Annotated[
        str, typer.Option(help="camera template, or a camera file", autocompletion=camera_templates)
    ] = "machine-vision",
    model: Annotated[
        str,
        typer.Option(
            help="camera model that is solved: luhmann, opencv or pinhole",
            autocompletion=one_of(("luhmann", "opencv", "pinhole")),
        ),
    ] = "luhmann",
    weighted: Annotated[
        bool, typer.Option("--weighted/--unweighted", help="weigh observations by their covariances, or all alike")
    ] = False,
    draws: Annotated[int, typer.Option(help="how many made targets to draw")] = 200,
    full: Annotated[
        bool, typer.Option("--full", help="render and detect real images in each draw: minutes a draw")
    ] = False,
    linear: Annotated[bool, typer.Option("--linear", help="no draws: predict from Jacobians, in seconds")] = False,
    require: Annotated[
        list[str] | None,
        typer.Option(help="how good must it be: the largest errors for intersection=0.05mm", metavar="QUANTITY=LIMIT"),
    ] = None,
    by: Annotated[str | None, typer.Option(help="quantity to rank errors by (default: --require's)")] = None,
    against: Annotated[Path | None, typer.Option(help="target file of another target to compare with")] = None,
    against_errors: Annotated[
        str | None, typer.Option(help="errors of that target, as --errors", autocompletion=error_templates)
    ] = None,
    against_distance: Annotated[str | None, typer.Option(help="distance to that target (default: --distance)")] = None,
    vary: Annotated[str | None, typer.Option(help="error to compare by (default: the worst one of faces)")] = None,
    seed: Annotated[int, typer.Option(help="of all that is random")] = 1,
    jobs: Annotated[int | None, typer.Option(help="processes (default: one per core)")] = None,
    dask: Annotated[
        str | None, typer.Option(help="have the draws computed by the Dask cluster of this scheduler: tcp://host:8786")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on with the study in the folder")] = False,
    figures: FiguresOption = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for tables, figures and draws")],
) -> Summary:
    """What if a print is off by this much? What manufacturing errors cost a calibration, and how large they may be.

    The exit code is 1 if a limit of --require is missed.
    """
    if full and linear:
        raise InputError("--full does not fit --linear, which draws nothing; leave one of them out")
    asked = _asked(draws=draws, seed=seed, jobs=jobs, require=require, by=by, predicts=linear, full=full)
    _check_together(asked, against, against_errors, against_distance, vary, dask, resume=resume)
    formats = figure_formats(figures)
    view = _BothTargets(views, camera, model, weighted)
    check_folder(out)
    with waiting("setting up"):
        scene = _scene(target, errors, changes or [], distance, view, asked.seed)
        other = None
        if against is not None and against_errors is not None:
            other = _scene(against, against_errors, [], against_distance or distance, view, asked.seed)
            other = replace(other, name=other.name if other.name != scene.name else f"{other.name} (other)")
    _check_vary(scene, vary)
    with nullcontext() if linear else kept_when_stopped():
        from calib.studies.tolerance.explore import Keeping, check_unused

        check_unused(out, resume=resume, predicts=linear)
        keeping = Keeping(out, {"target": target}, asked.seed, asked.jobs, dask, resume, full)
        if full:
            scene = replace(scene, lines=(*scene.lines, "photos of every draw are rendered, detected and calibrated"))
        for line in scene.lines:
            print(printable(line))
        report = _explored(scene, asked, keeping)
        if other is not None and against is not None:
            keeping = replace(keeping, inputs={"target": against})
            report = replace(report, against=_compared(report, other, asked, keeping, vary))
        return say_next(with_page(_write(report, out, target, formats), out, "tolerance"), out)


@dataclass(frozen=True)
class _BothTargets:
    """What is the same for both targets."""

    views: int
    camera: str
    model: str
    weighted: bool


@dataclass(frozen=True)
class _Asked:
    """What is to be computed."""

    draws: int
    seed: int
    jobs: int
    requirements: "tuple[Requirement, ...]"
    by: str
    predicts: bool
    full: bool


@dataclass(frozen=True, eq=False)
class _Scene:
    """A target with its errors in front of a camera."""

    name: str
    setting: "Setting"
    errors: "ErrorModel"
    lines: tuple[str, ...]


def _asked(
    *, draws: int, seed: int, jobs: int | None, require: list[str] | None, by: str | None, predicts: bool, full: bool
) -> _Asked:
    from calib.renderer.quantities import whole
    from calib.studies.tolerance.budget import checked_quantity
    from calib.studies.tolerance.requirement import parse_requirements

    requirements = parse_requirements(require or [])
    chosen = by or (requirements[0].quantity if requirements else "intersection")
    return _Asked(
        whole("--draws", draws, 2, MAX_DRAWS), whole("--seed", seed, 0, 2**63 - 1),
        os.cpu_count() or 1 if jobs is None else whole("--jobs", jobs, 1, 1024),
        requirements, checked_quantity(chosen), predicts, full,
    )  # fmt: skip


def _check_together(
    asked: _Asked,
    against: Path | None,
    against_errors: str | None,
    against_distance: str | None,
    vary: str | None,
    dask: str | None,
    *,
    resume: bool,
) -> None:
    """Refuse options that say nothing without another one."""
    if against is not None and against_errors is None:
        raise InputError(f"--against {against}: say how it is made too, such as --against-errors fdm-board")
    for option, value in (
        ("--against-errors", against_errors), ("--against-distance", against_distance), ("--vary", vary)
    ):  # fmt: skip
        if value is not None and against is None:
            raise InputError(f"{option} {value} says nothing without --against; name the other target's file")
    if asked.predicts and (resume or dask is not None):
        option = "--resume" if resume else f"--dask {dask}"
        raise InputError(f"{option} does not fit --linear, which draws nothing; leave one of them out")
    if dask is not None:
        from calib.studies.dask_cluster import check_cluster

        with waiting("asking the cluster"):
            check_cluster(dask)


def _check_vary(scene: _Scene, vary: str | None) -> None:
    from designer.tolerance.registry import source_named

    if vary is not None and scene.errors.amount(source_named(vary).name).sigma == 0:
        raise InputError(f"--vary {vary}: has no size in {scene.errors.name}; give it one, such as with --set")


def _scene(path: Path, errors: str, changes: list[str], distance: str, view: _BothTargets, seed: int) -> _Scene:
    """Read a target and its errors, and set up its photos.

    Raises:
        InputError: a file, a quantity or an option that breaks a rule.
    """
    from calib.commands.camera_argument import read_camera
    from calib.renderer.poses import MAX_VIEWS
    from calib.renderer.quantities import length, whole
    from calib.studies.tolerance.view_fit import view_fit
    from designer.target import bounding_radius_mm, load_target
    from designer.tolerance.error_file import error_model

    geometry = load_target(path, "rings")
    model = error_model(errors, changes)
    distance_mm = length("--distance", distance, 1, 10_000)
    inside = bounding_radius_mm(geometry)
    if distance_mm <= inside:
        raise InputError(
            f"--distance {distance_mm:g}mm: the target reaches {inside:.0f}mm from its origin; stay farther away"
        )
    whole("--views", view.views, 1, MAX_VIEWS)
    lens = read_camera(view.camera).camera
    fit = view_fit(geometry, lens, distance_mm)
    setting = _setting(geometry, lens, distance_mm, view, seed, fit.remark)
    first = (
        f"{_name_of(path)}: {_count(geometry.face_count, 'face')}, {geometry.ring_count} rings; "
        f"{_count(view.views, 'view')} from {distance_mm:g}mm by {view.camera}, "
        f"{len(setting.observations.view)} sightings; solved: {view.model}{', weighted' if view.weighted else ''}"
    )
    lines = [first, f"errors {model.name}: {model.title}", *_remarks(geometry, setting, fit.remark)]
    return _Scene(_name_of(path), setting, model, tuple(lines))


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _setting(
    target: "TargetGeometry", camera: "Camera", distance_mm: float, view: _BothTargets, seed: int, remark: str
) -> "Setting":
    from calib.solver.options import SolveOptions
    from calib.studies.tolerance.setting import make_setting

    try:
        return make_setting(
            target, camera, views=view.views, distance_mm=distance_mm, model=view.model, seed=seed,
            options=SolveOptions(weighted=view.weighted),
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{error}{f' ({remark})' if remark else ''}") from None


def _remarks(target: "TargetGeometry", setting: "Setting", fit: str) -> Iterator[str]:
    """What to know of a setting."""
    if target.source != "nominal":
        yield f"the target file is a {target.source} one; its shape is taken as the drawing"
    if not target.is_planar:
        yield "layers and axes are those of a print that lies on its last face"
    yield from setting.remarks
    if fit:
        yield f"warning: {fit}"


def _explored(scene: _Scene, asked: _Asked, keeping: "Keeping") -> "ToleranceReport":
    """Costs, sweeps, how far the prediction holds, and budgets."""
    from calib.studies.tolerance.control import control_of
    from calib.studies.tolerance.explore import (
        OTHER_FACTORS,
        STUDY_FILE,
        SWEEP_DRAWS,
        budgets_of,
        reaches,
        sweep_controls,
        sweep_draws,
    )
    from calib.studies.tolerance.first_order import first_order
    from calib.studies.tolerance.linear import linear_table
    from calib.studies.tolerance.report import ToleranceReport, sweeps_from
    from calib.studies.tolerance.result import table_of_draws

    setting, errors = scene.setting, scene.errors
    with waiting("predicting"):
        linear = linear_table(setting, errors)
    report = ToleranceReport(scene.name, scene.lines, setting.target.face_count, linear, linear, asked.by)
    if asked.predicts:
        return replace(report, budgets=budgets_of(report, asked.requirements))
    first = first_order(setting)
    with stopped_in_a_line(), progress_bar("drawing", asked.draws, rate=True) as tell:
        found = keeping.draws(setting, errors, STUDY_FILE, asked.draws, _timed(tell, asked))
    with waiting("comparing with the prediction"):
        control = control_of(first, linear, asked.seed, range(asked.draws), has_noise=not asked.full)
    report = replace(report, table=table_of_draws(errors, found, control))
    if asked.full:
        return replace(report, budgets=budgets_of(report, asked.requirements))
    count = len(OTHER_FACTORS) * min(SWEEP_DRAWS, asked.draws)
    with stopped_in_a_line(), progress_bar("sweeping", count, rate=True) as tell:
        swept = sweep_draws(keeping, setting, errors, found, tell)
    with waiting("comparing with the prediction"):
        controls = sweep_controls(first, linear, swept, asked.seed)
    report = replace(report, sweeps=sweeps_from(report.table, linear, swept, controls))
    with progress_bar("checking the prediction", len(report.ranking)) as tell:
        held = reaches(first, errors, report.ranking, linear.baseline.value, asked.seed, tell)
    report = replace(report, reaches=held)
    report = replace(report, budgets=budgets_of(report, asked.requirements))
    return _searched(report, first, errors, asked)


def _searched(report: "ToleranceReport", first: "FirstOrder", errors: "ErrorModel", asked: _Asked) -> "ToleranceReport":
    """The budgets, searched with draws where errors are no longer small."""
    from calib.studies.progress import after
    from calib.studies.tolerance.explore import searched
    from calib.studies.tolerance.report import with_drawn

    total, done, budgets = sum(len(one.beyond) for one in report.budgets), 0, []
    if not total:
        return report
    with progress_bar("searching limits", total) as tell:
        for checked in report.budgets:
            found = searched(first, checked, errors, asked.seed, asked.draws, after(done, tell))
            budgets.append(with_drawn(checked, found))
            done += len(checked.beyond)
    return replace(report, budgets=tuple(budgets))


def _compared(
    report: "ToleranceReport", other: _Scene, asked: _Asked, keeping: "Keeping", vary: str | None
) -> "Against":
    """The other target's costs, and where the first loses to it."""
    from calib.studies.tolerance.control import control_of
    from calib.studies.tolerance.explore import AGAINST_FILE
    from calib.studies.tolerance.first_order import first_order
    from calib.studies.tolerance.linear import linear_table
    from calib.studies.tolerance.report import Against, all_crossovers, default_vary
    from calib.studies.tolerance.result import table_of_draws

    with waiting("predicting the other"):
        table = linear_table(other.setting, other.errors)
    if not asked.predicts:
        with stopped_in_a_line(), progress_bar("drawing the other", asked.draws, rate=True) as tell:
            found = keeping.draws(other.setting, other.errors, AGAINST_FILE, asked.draws, tell)
        first, numbers = first_order(other.setting), range(asked.draws)
        control = control_of(first, table, asked.seed, numbers, has_noise=not asked.full)
        table = table_of_draws(other.errors, found, control)
    chosen = vary or default_vary(report.table, asked.by)
    return Against(other.name, table, other.lines, chosen, all_crossovers(report.table, table))


def _timed(tell: Callable[[float], None], asked: _Asked) -> Callable[[float], None]:
    """Show progress, and say at the end how long it took."""
    start, first = time.perf_counter(), [-1.0]

    def told(done: float) -> None:
        tell(done)
        if first[0] < 0:
            first[0] = done
        if done == asked.draws and done > first[0]:
            before = f", {first[0]:g} were there" if first[0] else ""
            print(f"{done - first[0]:g} draws in {time.perf_counter() - start:.1f} s{before}")

    return told


def _write(report: "ToleranceReport", folder: Path, target: Path, formats: tuple[str, ...]) -> Summary:
    """Print the tables and what they say, write the files, and say what to look at."""
    from calib.core.files import write_files
    from calib.studies.table_files import JSON_FILE
    from calib.studies.tolerance.explore import AGAINST_FILE, STUDY_FILE
    from calib.studies.tolerance.files import report_files

    say_report(report)
    with waiting("drawing figures"):
        files = report_files(report, folder, formats)
        write_files(files)
    step = f"calib measure {quoted(target)} DETECTIONS -o measured/{quoted(Path(target.name))}"
    step += "   # takes the errors of your own print back, from photos of it"
    say_files(report, folder, list(files))
    names = (STUDY_FILE,) if report.against is None else (STUDY_FILE, AGAINST_FILE)
    draws = [folder / name for name in names if report.table.draws]
    kept = all(report.is_kept(one.budget) for one in report.budgets)
    answer = table_answer(files[folder / JSON_FILE])
    return Summary(answer, (*files, *draws), (step,), report.lines, 0 if kept else LIMIT_MISSED)


def _name_of(path: Path) -> str:
    """What a target is called in tables."""
    name = printable(path.name.removesuffix(".json").removesuffix(".target")) or shlex.quote(str(path))
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 3]}..."

"""What errors of a target cost a calibration: `design tolerance`, `calib.tolerance("ico.target.json", ...)`."""

import hashlib
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app import options
from calib.app.study_result import (
    STUDY_OUT,
    TABLES,
    StudyResult,
    figure_formats,
    kept_samples,
    rows_to_csv,
    sampling_in,
)
from calib.cameras import DEFAULT
from designer.base.answer import command_line, program
from designer.base.errors import InputError
from designer.base.marks import INLINE, NOT_IN_FILE, Gap
from designer.base.options import option
from designer.base.words import cut, printable, several
from designer.kinds.presets import error_templates
from designer.page.capability import OUTPUT, capability, instead
from designer.page.output import Output
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.draw.style import FigureSheet
    from calib.studies.runner import DrawCount
    from calib.studies.tolerance.explore import PhotographedTarget, Photographing
    from calib.studies.tolerance.record import ToleranceStudy
    from calib.studies.tolerance.rig_costs import RigCost
    from calib.studies.tolerance.what_if import WhatIf
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

MOST_DRAWS = 1_000_000
STUDIES = {"study.sqlite": "every draw", "against.sqlite": "every draw of the other target"}


@dataclass(frozen=True, eq=False)
class Tolerance(
    StudyResult, kind="tolerance", title="Tolerance study", doing="predicting", files={**TABLES, **STUDIES}
):
    """What errors cost, and how large they may be: `found.study.cost("scale", "pose").cost`, `found.save("tolerance")`.

    In a notebook the result shows its page.
    """

    columns = "error,distribution"
    study: Annotated["ToleranceStudy", INLINE]
    drawn: Annotated["DrawCount", NOT_IN_FILE]
    seed: Annotated[int, NOT_IN_FILE]
    layer_height_mm: Annotated[float | None, NOT_IN_FILE]
    target_file: Annotated[str, NOT_IN_FILE]
    camera_remarks: Annotated[tuple[str, ...], NOT_IN_FILE]
    formats: Annotated[Sequence[str], NOT_IN_FILE]
    made_by: Annotated[str, NOT_IN_FILE]  # the command line; "": none

    @property
    def is_kept(self) -> bool:
        """Whether all limits are kept."""
        return self.study.is_kept

    @property
    def is_negative(self) -> bool:
        """Whether a limit is missed."""
        return not self.is_kept

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]  # of the study
        """What a person must know of the numbers."""
        from calib.app.tolerance_page import remarks_of

        return remarks_of(self)

    def what_if(self, errors: str | None = None, **sizes: str) -> "WhatIf":
        """What the calibration would be with other errors: `found.what_if("resin", skew="0.05deg").total("pose")`.

        As `calib.studies.tolerance.record.ToleranceStudy.what_if`: predicted, in less than a millisecond.
        """
        return self.study.what_if(errors, **sizes)

    def page(self) -> "Page":
        """What errors cost, how large they may be, other sizes and ways, and against another target."""
        from calib.app.tolerance_page import tolerance_page

        return tolerance_page(self)

    def sheets(self) -> "tuple[FigureSheet, ...]":
        """Costs, limits, the crossover, and costs by the size of each error."""
        from calib.draw.tolerance_figures import sheets

        return tuple(sheets(self.study))

    def csv(self) -> bytes:
        """Every cost, a line an error and quantity."""
        from calib.studies.tolerance.record import CostRow

        return rows_to_csv(CostRow, self.study.costs)


@dataclass(frozen=True, eq=False)
class RigTolerance(
    Result, kind="rig_tolerance", title="Tolerance study of a rig", doing="predicting",
    files={"study.sqlite": "every drawn print"},
):  # fmt: skip
    """What errors of a target cost a rig: `found.together.baseline_mm`, `found.save("tolerance")`.

    In a notebook the result shows its page.
    """

    program: str
    settings: dict[str, str]
    target: str
    rig: str
    errors: str  # the way of making, in words
    cameras: tuple[str, ...]
    frames: int  # in which a camera sees the target
    sightings: int
    length_mm: float  # whose error is told
    away_mm: Gap  # of the point that is told of, from the nearest camera; nan: no two cameras see the middle
    costs: "tuple[RigCost, ...]"  # of each error source, the largest first
    together: "RigCost"  # all errors
    noise: "RigCost"
    draws: int
    drawn: "RigCost | None"  # prints that were drawn, with noise
    remarks: tuple[str, ...]
    target_file: Annotated[str, NOT_IN_FILE]

    def page(self) -> "Page":
        """What all errors together cost, each of them, and whether draws bear it out."""
        from calib.app.tolerance_page import rig_tolerance_page

        return rig_tolerance_page(self)


@capability
def rig_tolerance(
    target: options.TargetFile,
    errors: options.Errors,
    rig: options.RigTemplate,
    *,
    changes: options.Changes = (),
    frames: Annotated[int, option("of a rig: how many", 1, options.MOST_VIEWS)] = 30,
    distance_mm: Annotated[
        tuple[float, float] | float | None,
        option(
            "of the target from the camera that it is held to (default: the template's)", 1.0, options.MOST_DISTANCE_MM
        ),
    ] = None,
    draws: Annotated[int, option("prints that are drawn as a check", 0, 10_000)] = 20,
    linear: Annotated[bool, option("no draws: predict from Jacobians, in seconds")] = False,
    seed: options.Seed = 1,
    jobs: options.Jobs = None,
    dask: options.Dask = None,
    resume: options.Resume = False,
    out: Annotated["Place | Output | None", STUDY_OUT] = None,
    progress: Progress = unheard,
) -> RigTolerance:
    """What errors of a target cost a rig: `rig_tolerance("ico.target.json", "fdm-dual", "stereo-pair")`.

    >>> found = calib.rig_tolerance("ico.target.json", "fdm-dual", "four-webcams")
    >>> found.together.baseline_mm, found.costs[0].name

    Frames of the target before the rig are simulated, and the rig is solved as if the target were as drawn. What each
    error then does is predicted from the Jacobians, and checked by prints that are drawn and solved.

    Args:
        rig: a template's name, a TOML file, a `rig.json`, or a rig.

    Raises:
        InputError: files or options that break a rule, or frames that do not determine the rig.
        StudyStoppedError: interrupted; the prints in a folder are kept.
    """
    import numpy as np

    from calib.app.inputs import target_of
    from calib.renderer.held_target import held_poses
    from calib.renderer.rig_template import held_before, simulated_rig
    from calib.rigs.relative import middle_error
    from calib.studies.samples import Case
    from calib.studies.tolerance import rig_costs
    from calib.studies.workers import CaseSpec
    from designer.tolerance.error_file import error_model

    geometry, made, count = target_of(target, "rings"), error_model(errors, changes), 0 if linear else draws
    for name, is_given in (("--resume", resume), (f"--dask {dask}", dask is not None)):
        if is_given and not count:
            raise InputError(f"{name}: no prints are drawn that it could be used for; leave it out, or draw some")
    output = RigTolerance.begun(out)
    simulated = simulated_rig(rig)
    if len(simulated.rig.names) < 2:
        raise InputError("--rig: one camera is no rig; leave it out")
    held = held_before(simulated, distance_mm)
    progress("setting up", 0, 0)
    rng = np.random.default_rng(seed)
    before = rig_costs.SimulatedFrames(simulated.rig, geometry, held_poses(simulated.rig, geometry, held, frames, rng))
    found = before.solved(geometry, rng)
    *costs, together, noise = rig_costs.predicted_costs(found, geometry, made)
    middle, drawn = middle_error(found), None
    if count:
        pool = rig_costs.PrintPool(before, None if middle is None else middle.point_mm, made)
        case, identity = CaseSpec(Case("rig", frames, frames), pool, count), rig_costs.print_identity(pool, seed)
        kept = kept_samples(
            case, identity, output, jobs, dask, resume=resume, progress=progress, doing="drawing prints"
        )
        drawn = rig_costs.drawn_cost(before, kept)
    remarks = () if geometry.source == "nominal" else (
        f"the target file is a {geometry.source} one; its shape is taken as the drawing",
    )  # fmt: skip
    near, far = held.distance_mm
    result = RigTolerance(
        program=program(),
        settings={
            "errors": printable(fspath(errors)), "set": " ".join(changes), "frames": str(frames), "seed": str(seed),
            "distance": f"{near:g}..{far:g}mm",
        },
        target=_name_of(_path_of(target)), rig=printable(simulated.name), errors=f"{made.name}: {made.title}",
        cameras=tuple(map(printable, simulated.rig.names)), frames=found.observations.frame_count,
        sightings=sum(map(len, found.residual_px)), length_mm=rig_costs.LENGTH_MM,
        away_mm=math.nan if middle is None else middle.away_mm, costs=tuple(costs), together=together, noise=noise,
        draws=count, drawn=drawn, remarks=remarks,
        target_file=_file_of(target),
    )  # fmt: skip
    return result.saved(output, progress)


@instead(rig=rig_tolerance)
@capability
def tolerance(
    target: options.TargetFile,
    errors: options.Errors,
    *,
    changes: options.Changes = (),
    views: options.Views = 90,
    distance_mm: options.Distance = None,
    aim_offset_mm: options.AimOffset = None,
    camera: options.CameraTemplate = "machine-vision",
    model: options.FittedModel = DEFAULT,
    weighted: options.Weighted = False,
    draws: Annotated[int, option("how many made targets to draw", 2, MOST_DRAWS)] = 200,
    full: Annotated[bool, option("render and detect real images in each draw: minutes a draw")] = False,
    linear: Annotated[bool, option("no draws: predict from Jacobians, in seconds")] = False,
    require: Annotated[
        Sequence[str],
        option(
            "how good must it be: the largest errors for intersection=0.05mm", metavar="QUANTITY=LIMIT", is_many=True
        ),
    ] = (),
    by: Annotated[str | None, option("quantity to rank errors by (default: --require's)")] = None,
    against: Annotated["TargetGeometry | Place | None", option("target file of another target to compare with")] = None,
    against_errors: Annotated[
        str | None, option("errors of that target, as --errors", complete=error_templates)
    ] = None,
    against_changes: Annotated[
        Sequence[str],
        option(
            "another size of one error of that target, as --set",
            flag="--against-set",
            metavar="ERROR=SIZE",
            is_many=True,
        ),
    ] = (),
    against_distance_mm: Annotated[
        tuple[float, float] | float | None, option("distance to that target (default: --distance)", 1.0, 10_000.0)
    ] = None,
    vary: Annotated[str | None, option("error to compare by (default: the worst one of faces)")] = None,
    seed: options.Seed = 1,
    jobs: options.Jobs = None,
    dask: options.Dask = None,
    resume: options.Resume = False,
    formats: Annotated[
        Sequence[str],
        option(
            "draw figures as PDF or SVG besides PNG: pdf,svg", flag="--figures", metavar="FORMATS", parse=figure_formats
        ),
    ] = (),
    out: Annotated[
        "Place | Output | None",
        option("folder for the draws, tables, figures and page (default: exports/tolerance)", short="-o", group=OUTPUT),
    ] = None,
    progress: Progress = unheard,
) -> Tolerance:
    """What manufacturing errors cost a calibration, and how large they may be: `tolerance("t.json", "fdm-dual")`.

    What if a print is off by this much? The command's exit code is 1 if a limit of --require is missed.

    >>> found = calib.tolerance("ico.target.json", "fdm-dual", require=["intersection=0.05mm"])
    >>> found.is_kept, found.study.total("intersection"), found.save("tolerance")

    Raises:
        InputError: files or options that break a rule, or no workers are left; the draws in a folder are kept.
        StudyStoppedError: interrupted; so they are.
    """
    from calib.app.cameras_told import remarks_on
    from calib.app.inputs import opened_camera
    from calib.cameras.camera import Camera
    from calib.studies.runner import ask_cluster
    from calib.studies.tolerance.explore import Photographing, TolerancePlan, compared, explore
    from calib.studies.tolerance.quantities import parse_requirements, quantity_named
    from calib.studies.tolerance.stored import check_unused
    from designer.tolerance.sources import source_named

    requirements = parse_requirements(require)
    by = quantity_named(by or (requirements[0].quantity if requirements else "intersection")).name
    read = opened_camera(camera).read
    camera_name = read.camera.model if isinstance(camera, Camera) else fspath(camera)
    photographing = Photographing(views, read.camera, camera_name, model, weighted, seed, aim_offset_mm)
    for name, is_given in (("--full", full), ("--resume", resume), (f"--dask {dask}", dask is not None)):
        if linear and is_given:
            raise InputError(f"{name} does not fit --linear, which draws nothing; leave one of them out")
    _check_against(against, against_errors, against_changes, against_distance_mm, vary)
    ask_cluster(dask, progress)
    output = Tolerance.begun(out)
    progress("setting up", 0, 0)
    with sampling_in(output, jobs, dask, resume=resume, progress=progress) as sampling:
        plan = TolerancePlan(draws, seed, requirements, by, full, linear, sampling)
        first = _photographed(target, errors, changes, distance_mm, photographing)
        other = None
        if against is not None and against_errors is not None:
            far = distance_mm if against_distance_mm is None else against_distance_mm
            other = _photographed(against, against_errors, against_changes, far, photographing)
            if other.name == first.name:
                same = other.errors.name == first.errors.name
                other = replace(other, name=f"{other.name} ({'other' if same else other.errors.name})")
        if vary is not None and first.errors.amount(source_named(vary).name).sigma == 0:
            raise InputError(f"--vary {vary}: has no size in {first.errors.name}; give it one, such as with --set")
        if full:
            remarks = (*first.words.remarks, "photos of every draw are rendered, detected and calibrated")
            first = replace(first, words=replace(first.words, remarks=remarks))
        check_unused(sampling, predicts=linear)
        if output is not None:
            output.finished.append(sampling.path)
        study, table, drawn = explore(first, plan)
        if other is not None:
            study = compared(study, table, other, plan, vary)
    found = Tolerance(
        study, drawn, seed, first.errors.layer_height_mm, _file_of(target), remarks_on(camera_name, read),
        tuple(formats), command_line(),
    )  # fmt: skip
    return found.saved(output, progress)


def _check_against(
    against: "TargetGeometry | Place | None", against_errors: str | None, against_changes: Sequence[str],
    against_distance_mm: tuple[float, float] | float | None, vary: str | None,
) -> None:  # fmt: skip
    """Refuse options that say nothing without another one."""
    if against is not None and against_errors is None:
        raise InputError(f"--against {_path_of(against)}: say how it is made too, such as --against-errors fdm-board")
    sizes = " ".join(map(str, several("--against-set", against_changes))) or None
    for name, value in (
        ("--against-errors", against_errors), ("--against-set", sizes), ("--against-distance", against_distance_mm),
        ("--vary", vary),
    ):  # fmt: skip
        if value is not None and against is None:
            raise InputError(f"{name} {value} says nothing without --against; name the other target's file")


def _photographed(
    target: "TargetGeometry | Place", errors: str, changes: Sequence[str],
    distance_mm: tuple[float, float] | float | None, by: "Photographing",
) -> "PhotographedTarget":  # fmt: skip
    """Read a target and its errors, and set up its photos."""
    from calib.app.inputs import target_of
    from calib.studies.identity import sha256_of
    from calib.studies.tolerance.explore import photographed
    from designer.target import TargetGeometry, target_to_json

    geometry, place = target_of(target, "rings"), _path_of(target)
    made = isinstance(target, TargetGeometry)
    digest = hashlib.sha256(target_to_json(geometry).encode()).hexdigest() if made else sha256_of(place)
    both = distance_mm if distance_mm is None or isinstance(distance_mm, tuple) else (distance_mm, distance_mm)
    return photographed(geometry, _name_of(place), digest, errors, changes, both, by)


def _path_of(target: "TargetGeometry | Place") -> Path:
    from designer.base.files import place_of
    from designer.target import TargetGeometry

    return Path("target") if isinstance(target, TargetGeometry) else place_of(target, "a target geometry, or its file")


def _file_of(target: "TargetGeometry | Place") -> str:
    """As it is typed."""
    path = _path_of(target)
    return printable(str(path if path.suffix else path.with_suffix(".target.json")))


def _name_of(path: Path) -> str:
    """What a target is called in tables."""
    return cut(printable(path.name.removesuffix(".json").removesuffix(".target")) or shlex.quote(str(path)))

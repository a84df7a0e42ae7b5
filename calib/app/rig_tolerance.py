"""What errors of a target cost a rig: `design tolerance --rig`, `calib.rig_tolerance("t.json", "fdm-dual", "pair")`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from os import fspath
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

from calib.app.options import (
    MOST_DISTANCE_MM,
    MOST_VIEWS,
    Changes,
    Dask,
    Errors,
    Jobs,
    Resume,
    RigTemplate,
    Seed,
    TargetFile,
)
from calib.app.study_result import STUDY_OUT, kept_samples
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE, Gap
from designer.base.options import option
from designer.base.words import cut, printable
from designer.page.capability import capability
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.studies.tolerance.rig_costs import RigCost
    from designer.page.blocks import Finding, Page

QUESTION = (
    "What do errors of manufacturing cost a rig that is solved as if the target were as drawn? Frames are simulated "
    "and solved; what each error then does is predicted from the solver's Jacobians, and drawn prints are a check."
)
MEANING = (
    "Root mean squares over prints: of the distance of two cameras and of the turn of one against the other, over all "
    "pairs; of a point in the rig's frame and of a length, both in the middle of where the target was held."
)
CHECKED_FROM = 10
"""Draws; fewer say little of a root mean square."""
SURE = 3.0


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
        return _page(self)


@capability
def rig_tolerance(
    target: TargetFile,
    errors: Errors,
    rig: RigTemplate,
    *,
    changes: Changes = (),
    frames: Annotated[int, option("of a rig: how many", 1, MOST_VIEWS)] = 30,
    distance_mm: Annotated[
        tuple[float, float] | float | None,
        option("of the target from the camera that it is held to (default: the template's)", 1.0, MOST_DISTANCE_MM),
    ] = None,
    draws: Annotated[int, option("prints that are drawn as a check", 0, 10_000)] = 20,
    linear: Annotated[bool, option("no draws: predict from Jacobians, in seconds")] = False,
    seed: Seed = 1,
    jobs: Jobs = None,
    dask: Dask = None,
    resume: Resume = False,
    out: Annotated["Place | Output | None", STUDY_OUT] = None,
    progress: Progress = unheard,
) -> RigTolerance:
    """What errors of a target cost a rig: `rig_tolerance("ico.target.json", "fdm-dual", "stereo-pair")`.

    >>> found = calib.rig_tolerance("ico.target.json", "fdm-dual", "four-webcams")
    >>> found.together.baseline_mm, found.costs[0].name

    Frames of the target before the rig are simulated, and the rig is solved as if the target were as drawn. What each
    error then does is predicted from the Jacobians, and checked by prints that are drawn and solved.

    Args:
        target: a geometry, or its file.
        errors: an error template, or a TOML file.
        rig: a template's name, a TOML file, a `rig.json`, or a rig.
        changes: other sizes of single errors: `face_tilt=0.1deg`.
        frames: how many.
        distance_mm: from the camera that the target is held to, or nearest and farthest; None: the template's.
        draws: prints that are drawn as a check; 0: none.
        linear: as `draws` of 0.
        seed: of all that is random.
        jobs: processes; None: one per core.
        dask: address of a cluster's scheduler, which computes the prints instead.
        resume: go on with the study in the folder.
        out: a folder for the prints as they come, so that a stopped study goes on, and the page; None: `save` writes
            that.
        progress: is told what is being done.

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
    from designer.target import TargetGeometry
    from designer.tolerance.error_file import error_model

    geometry, made, count = target_of(target, "rings"), error_model(errors, changes), 0 if linear else draws
    for name, is_given in (("--resume", resume), (f"--dask {dask}", dask is not None)):
        if is_given and not count:
            raise InputError(f"{name}: no prints are drawn that it could be used for; leave it out, or draw some")
    output = None if out is None else output_of(out)
    if output is not None:
        RigTolerance.check(output.place)
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
    file = "target.target.json" if isinstance(target, TargetGeometry) else printable(str(target))
    name = cut(Path(file).name.removesuffix(".json").removesuffix(".target"))
    result = RigTolerance(
        program=program(),
        settings={
            "errors": printable(fspath(errors)), "set": " ".join(changes), "frames": str(frames), "seed": str(seed),
            "distance": f"{near:g}..{far:g}mm",
        },
        target=name, rig=printable(simulated.name), errors=f"{made.name}: {made.title}",
        cameras=tuple(map(printable, simulated.rig.names)), frames=found.observations.frame_count,
        sightings=sum(map(len, found.residual_px)), length_mm=rig_costs.LENGTH_MM,
        away_mm=math.nan if middle is None else middle.away_mm, costs=tuple(costs), together=together, noise=noise,
        draws=count, drawn=drawn, remarks=remarks,
        target_file=file,
    )  # fmt: skip
    if output is not None:
        output.files += result.save(output.place, has_page=False)
    return result


def _page(found: RigTolerance) -> "Page":
    from calib.draw.tolerance_words import amount as size_words
    from calib.draw.tolerance_words import source_title
    from designer.page.blocks import Command, Facts, Findings, Headline, Page, Paragraph, Section
    from designer.page.folders import Shown, table_of
    from designer.tolerance.sources import SOURCES

    all_errors, noise = found.together, found.noise
    worst = f", most of it by {source_title(found.costs[0].name)}" if found.costs else ""
    point = "" if math.isnan(all_errors.point_mm) else f", a point in the middle by {_mm(all_errors.point_mm)}"
    sentence = (
        f"A print by {found.errors.partition(':')[0]} shifts the distances of cameras by {_mm(all_errors.baseline_mm)} "
        f"(RMS){point}{worst}; the noise of {found.frames} frames by {_mm(noise.baseline_mm)}."
    )
    away = "" if math.isnan(found.away_mm) else f"; the middle is {found.away_mm:.0f} mm from the nearest camera"
    facts = Facts((
        ("errors", printable(found.errors)),
        ("rig", f"{found.rig}: {', '.join(found.cameras)}"),
        ("frames", f"{found.frames}, {found.sightings} sightings, at {found.settings['distance']}{away}"),
    ))  # fmt: skip

    def assumed(one: "RigCost") -> str:
        kind = "" if one.distribution in ("", "normal") else f"{one.distribution} "
        return f"{kind}{size_words(SOURCES[one.name].unit, one.size)}" if one.name in SOURCES else ""

    cost = Shown["RigCost"]
    table = table_of(
        (*found.costs, all_errors, noise, *(() if found.drawn is None else (found.drawn,))),
        cost("error", lambda one: printable(source_title(one.name))), cost("assumed", assumed),
        cost("distances mm", lambda one: one.baseline_mm, unknown="-"),
        cost("turns deg", lambda one: math.degrees(one.turn_rad), unknown="-"),
        cost("point mm", lambda one: one.point_mm, unknown="-"),
        cost(f"{found.length_mm:g} mm length mm", lambda one: one.length_mm, unknown="-"), visible_rows=20,
    )  # fmt: skip
    told = tuple(_findings(found))
    costs = Section("What each error costs", (table, *((Findings(told),) if told else ())), lead=MEANING)
    measure = Command(
        f"calib measure {quote(found.target_file)} --rig rig -o {quote(f'measured/{found.target}.target.json')}",
        "measures the print from the frames of a rig, and takes its errors back",
    )
    return Page(
        found.target, "", Headline("note", _mm(all_errors.baseline_mm), sentence), (costs,),
        lead=(Paragraph(QUESTION), facts), next_steps=(measure,),
    )  # fmt: skip


def _findings(found: RigTolerance) -> "Iterator[Finding]":
    """Whether draws bear the prediction out, and remarks."""
    from designer.base.words import capital
    from designer.page.blocks import Finding

    for line in found.remarks:
        yield Finding("note", "", capital(printable(line)))
    if found.drawn is None or found.draws < CHECKED_FROM:
        return
    told = math.hypot(found.together.baseline_mm, found.noise.baseline_mm)
    # One number, such as the size, may stand behind all baselines, so each draw counts once.
    chance = 1 / math.sqrt(2 * found.draws)
    fits = told > 0 and abs(found.drawn.baseline_mm / told - 1) <= SURE * chance
    says = (
        f"{found.draws} drawn prints were simulated and solved: distances off by {_mm(found.drawn.baseline_mm)}, "
        f"predicted {_mm(told)} (such a draw is off by {100 * chance:.0f} % by chance)"
    )
    yield Finding("good" if fits else "usable", "", f"{says}{'' if fits else '; trust the draws'}.")


def _mm(value: float) -> str:
    from designer.base.words import figure

    return f"{figure(value, 2)} mm"

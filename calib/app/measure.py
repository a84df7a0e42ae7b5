"""A print as photos of it show it: `calib measure`, `calib.measure("ico.target.json", "detections.csv")`."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app.measured_print import MeasuredPrint, RescaledTarget, checked_place
from calib.app.options import Fix, ImageSize, MadeWithShrink, MadeWithSkew, Reject, Share, Weighted, exports_folder
from calib.cameras import fitted_models
from designer.base.answer import program
from designer.base.errors import InputError, NoAnswerError
from designer.base.options import argument, option
from designer.base.units import NO_SKEW, format_skew
from designer.base.words import several
from designer.kinds.presets import error_templates, one_of
from designer.page.capability import capability, written_to
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.core.types import Detections, Observations
    from calib.measure_target.deviations import Compensation
    from calib.measure_target.lengths import CaliperLength
    from calib.measure_target.unknowns import AsBuiltOptions
    from calib.rigs.result import RigCalibration
    from calib.solver.plan import SolvePlan
    from calib.solver.problem import SolveOptions
    from designer.page.output import Output
    from designer.target import TargetGeometry
    from designer.tolerance.made import Made

Target = Annotated["TargetGeometry | Place", argument("the target as designed (NAME.target.json)")]
MadeBy = Annotated[
    str | None,
    option(
        "how the target was made, which says what to expect where the photos do not tell: an error template (fdm-dual, "
        "sheet-print, ...) or a TOML file of errors (default: assumed from how it was built)",
        metavar="NAME|FILE",
        complete=error_templates,
    ),
]


@capability(folder=lambda given: exports_folder(cast(Path, given["target"])) / "measured.target.json")
def measure(
    target: Target,
    observed: Annotated[
        "Observations | Place | Iterable[Observations | Detections | Place]",
        argument(
            "detections.csv files of the print, or tables image,u,v,X,Y,Z or image,u,v,id; one a camera",
            metavar="DETECTIONS", is_many=True,
        ),
    ] = (),
    *,
    rig: Annotated[
        "RigCalibration | Place | None",
        option("instead of detections: the folder of calib rig, whose cameras saw the print at once", metavar="FOLDER"),
    ] = None,
    photos: Annotated[
        "Place | Iterable[Place]",
        option(
            "that the detections were found in, of one camera: images, a folder or a pattern; they are searched again "
            "with the lens and the target as measured, so that the camera is right too", metavar="PHOTOS", is_many=True,
        ),
    ] = (),
    lengths: Annotated[
        "str | CaliperLength | Iterable[str | CaliperLength]",
        option(
            "a caliper's length, which tells the size: face-to-face:151.20mm+-0.02mm; also edge, 'face 2 to face 9', "
            "'ring 3 to ring 17' (centres)", flag="--length", is_many=True,
        ),
    ] = (),
    measured_length: Annotated[
        str | None, option("the quick way, without photos: rescale the target to this length")
    ] = None,
    model: Annotated[
        str | None,
        option(
            f"of the cameras: {', '.join(fitted_models())} (default: that of the best camera of the run whose "
            "detections.csv is given, else the one with the smaller residuals)", complete=one_of(fitted_models()),
        ),
    ] = None,
    one_camera: Annotated[bool, option("all files are of one camera, not each of its own")] = False,
    rings: Annotated[
        str,
        option(
            "free: each ring may be off a little; rigid: rings are right, only faces move",
            names=lambda: ("free", "rigid"),
        ),
    ] = "free",
    bow: Annotated[
        bool | None, option("faces may be bent, or not (default: a board may)", off="--flat")
    ] = None,
    made: MadeBy = None,
    weighted: Weighted = True,
    reject_sigma: Reject = None,
    fix: Fix = (),
    share: Share = (),
    shrink_compensation_percent: MadeWithShrink = 0.0,
    skew_compensation_rad: MadeWithSkew = NO_SKEW,
    bed_turn_rad: Annotated[
        float,
        option(
            "by which the print was turned on the bed against `design`: 90deg; for axes and skew", -math.tau, math.tau
        ),
    ] = 0.0,
    image_size: ImageSize = None,
    held_out: Annotated[
        int | None,
        option("hold every N-th photo out in turn to judge the gain (default 5; fewer of few); 0: do not", 0),
    ] = None,
    truth: Annotated[
        "TargetGeometry | Place | None",
        option("of rendered photos: the target file they show, to judge the gain by too"),
    ] = None,
    out: Annotated[
        "Output | Place | None",
        written_to(
            "the measured target, its report and the page beside it (default: exports/NAME/measured.target.json)",
        ),
    ] = None,
    progress: Progress = unheard,
) -> MeasuredPrint:  # fmt: skip
    """Measure a printed target with photos of it: `measure("ico.target.json", "detections.csv").target`.

    What is next calibrates with what was printed. The exit code is 1 if the photos do not determine the camera and the
    target, or if on photos held out the measured target is no better than the designed one, or too few were held out
    to tell; it is written all the same.

    >>> measured = calib.measure("ico.target.json", "detections.csv", lengths=["face-to-face:151.20mm+-0.02mm"])
    >>> measured.target, measured.why_not

    Args:
        observed: in photos of the print: a file, what was found in photos, or observations; several files or
            observations are of a camera each.
        rig: instead: a solved rig, or its folder, whose cameras saw the print in frames; all faces are then measured at
            once, with a pose a frame and not one a photo.
        photos: that `observed` was found in, of one camera: searched again with the lens and the target as measured,
            and measured once more. Centres found through the lens of the target as designed bend the camera.
        measured_length: without photos: raises, in Python `rescale` does it.

    Raises:
        InputError: files or options that break a rule, or photos too few.
    """
    from calib.app import measured_from
    from calib.coupon_reading.ink_of_rings import ink_of_cameras
    from calib.measure_target.cross_validation import cross_validate
    from calib.measure_target.deviations import Compensation
    from calib.measure_target.lengths import asked_lengths
    from calib.measure_target.record import record_of
    from designer.page.output import output_of

    output = None if out is None else output_of(out)
    if output is not None:
        output.page = output.place.parent
        checked_place(output.place, _file_of(target))
    made_with = Compensation(shrink_compensation_percent, skew_compensation_rad)
    if measured_length is not None:
        given = {
            "a file of detections": observed, "--rig": rig, "--photos": photos, "--length": lengths, "--model": model,
            "--one-camera": one_camera, "--rings": rings != "free", "--bow": bow is not None,
            "--unweighted": not weighted, "--reject": reject_sigma, "--fix": fix, "--share": share,
            "--skew-compensation": skew_compensation_rad != NO_SKEW, "--bed-turn": bed_turn_rad,
            "--image-size": image_size, "--held-out": held_out is not None, "--truth": truth,
        }  # fmt: skip
        _rescale(target, measured_length, made, made_with, [name for name, value in given.items() if value], output)
    nominal = measured_from.nominal_of(target)
    way = measured_from.way_of(nominal, made)
    asked = asked_lengths(lengths, nominal)
    fix, share = several("--fix", fix), several("--share", share)
    plan = _plan(model, fix, share, reject_sigma, weighted=weighted)
    shape = None if truth is None else _truth(truth, nominal, target)
    photos = photos if isinstance(photos, str | PathLike) else tuple(photos)
    if rig is None:
        items, cameras = measured_from.items_of(observed), None
        sets = measured_from.sets_of(items, nominal, target, image_size, one_camera=one_camera)
    else:
        beside = (observed, photos, model, one_camera, fix, share, image_size)
        items, cameras = (), measured_from.rig_to_measure_from(rig, nominal, is_alone=not any(beside))
        sets = list(cameras.observations.sightings)
    again = measured_from.photos_to_search(photos, items, nominal)
    parts = measured_from.parts_of(
        held_out, min(one.view_count for one in sets) if cameras is None else len(cameras.rig_from_target)
    )
    progress("measuring", 0, 0)
    by_rig = None if cameras is None else (cameras.cameras[0].model, measured_from.remarks_on_rig(cameras))
    chosen, why = by_rig or measured_from.model_for(plan, items, sets)
    options = _options(plan.options_of(chosen), way, bow, sets, is_rigid=rings == "rigid")
    found, sets, more = measured_from.solved(sets, items, cameras, again, nominal, chosen, options, asked, progress)
    held = None
    if held_out != 0 and found.status != "degenerate":
        held = cross_validate(
            found, chosen, options, parts, rig=cameras, truth=shape,
            done=lambda part: progress("judging parts", part, parts),
        )  # fmt: skip
    record = record_of(
        found, held, made_with, bed_turn_rad=bed_turn_rad, weighted=options.solve.weighted, program=program(),
        made=way.errors,
        remarks=(*why, *more, *measured_from.remarks_on(sets, way, asked, nominal)),
        settings={
            "target": _named(target), "detections": ", ".join(map(_named, measured_from.paths_in(items))),
            **({} if rig is None else {"rig": _named(rig, "a rig")}),
            "model": ", ".join(sorted({one.model for one in found.cameras})), "rings": rings,
            "one-camera": str(one_camera), "weighted": str(options.solve.weighted),
            "reject": f"{reject_sigma or ''}", "bow": {None: "default", True: "bow", False: "flat"}[bow],
            "photos": "" if again is None else "searched again",
            "fix": " ".join(fix), "made": made or "", "share": " ".join(share),
            "shrink-compensation": f"{made_with.shrink_percent:g}%",
            "skew-compensation": format_skew(made_with.skew_rad), "bed-turn": f"{math.degrees(bed_turn_rad):g}deg",
            "length": "; ".join(one.text for one in asked), "held-out": str(parts),
        },
    )  # fmt: skip
    measured = MeasuredPrint(
        found=found, measured_against=_file_of(target), use=_use(measured_from.paths_in(items), rig, photos, output),
        file=None if output is None else output.place, remarks=record.remarks, record=record,
        ink_bleed=ink_of_cameras(measured_from.ink_of_each(items, nominal)),
    )  # fmt: skip
    if output is not None:
        output.files += measured.save(output.place)
        output.finished.append(output.place)
        if output is not out:  # a command draws it when all is said
            measured.draw_page(output.place.parent)
    return measured


def _plan(
    model: str | None, fix: Sequence[str], share: Sequence[str], reject: float | None, *, weighted: bool
) -> "SolvePlan":
    """How cameras are solved; InputError: no such model or parameter, or a model that cannot measure."""
    from calib.solver.plan import ALL, plan_from_words

    plan = plan_from_words(model or ALL, fix=fix, share=share, reject=reject, weighted=weighted)
    if model not in (None, *fitted_models()):
        raise InputError(
            f"--model {model}: its map is learned from the target's own rings, so it cannot measure them; measure with "
            f"one of {', '.join(fitted_models())}, then solve {model} with the measured target"
        )
    return plan


def _options(
    solve: "SolveOptions", way: "Made", bow: bool | None, sets: "Sequence[Observations]", *, is_rigid: bool
) -> "AsBuiltOptions":
    """How the target is."""
    from calib.measure_target.solve import with_known_weights
    from calib.measure_target.unknowns import AsBuiltOptions

    options = AsBuiltOptions(made=way, bow=bow, solve=solve)
    return with_known_weights(replace(options, ring_sigma_mm=None) if is_rigid else options, sets)


def _use(paths: list[Path], rig: object, photos: "Place | Sequence[Place]", output: "Output | None") -> str:
    """The command line that calibrates with the measured target."""
    from designer.page.terminal import quoted

    place = Path("measured.target.json") if output is None else output.place
    out, folder = quoted(place), quoted(place.with_name(place.name.removesuffix(".target.json")))
    named = [photos] if isinstance(photos, str | PathLike) else list(photos)
    if named:
        return f"calib run {out} {' '.join(quoted(Path(one)) for one in named)} -o {folder}"
    if isinstance(rig, str | PathLike):
        return f"calib rig {out} --table {quoted(Path(rig) / 'sightings.csv')} -o {folder}"
    return f"calib solve {quoted(paths[0]) if paths else 'DETECTIONS'} --target {out} -o {folder}"


def _rescale(
    target: "TargetGeometry | Place", length: str, made: str | None, made_with: "Compensation", needless: list[str],
    output: "Output | None",
) -> None:  # fmt: skip
    """The quick way of the command, without photos: NoAnswerError, as no print is measured, with the target instead."""
    if needless:
        raise InputError(
            f"--measured-length rescales without photos, so {needless[0]} does not belong there; with photos give the "
            "length with --length"
        )
    made_so = replace(rescale(target, length, made=made), made_with=made_with)
    if output is not None:
        made_so, output.page = replace(made_so, file=output.place), None
        output.files += made_so.save(output.place)
        output.finished.append(output.place)
    raise NoAnswerError("--measured-length: needs no photos, so no print is measured; call rescale", made_so)


def rescale(
    target: "TargetGeometry | Place", length: "str | CaliperLength", *, made: str | None = None
) -> RescaledTarget:
    """Give a target the size that a caliper shows, without photos: `rescale("ico.target.json", "edge:100.4mm")`.

    Args:
        target: as designed: a geometry, or its file.
        length: of the print.
        made: how it was made, to doubt a length that no such print has.

    Raises:
        InputError: a file that cannot be read, or a length that the target does not have.
    """
    from calib.app import measured_from
    from calib.measure_target.back import tells_thickness, with_thickness
    from calib.measure_target.deviations import Compensation
    from calib.measure_target.lengths import asked_length, rescaled

    nominal = measured_from.nominal_of(target)
    way = measured_from.way_of(nominal, made)
    asked = asked_length("--measured-length", length, nominal)
    is_thickness = tells_thickness(nominal, asked.name)
    made_so = with_thickness(nominal, asked.value_mm) if is_thickness else rescaled(nominal, asked)
    return RescaledTarget(
        nominal, made_so, asked, measured_from.doubts_about([asked], way, nominal), Compensation(), _file_of(target)
    )


def _truth(
    truth: "TargetGeometry | Place", nominal: "TargetGeometry", name: "TargetGeometry | Place"
) -> "TargetGeometry":
    """The geometry that rendered photos show."""
    from calib.app.inputs import target_of

    shape = target_of(truth)
    if shape.layout_id != nominal.layout_id:
        raise InputError(f"--truth {_named(truth)}: has another layout than {_named(name)}; give the one rendered")
    return shape


def _file_of(value: object) -> Path | None:
    """Of a target or a rig, if it comes from one."""
    return Path(value) if isinstance(value, str | PathLike) else None


def _named(value: object, otherwise: str = "NAME.target.json") -> str:
    """What the record calls a file."""
    path = _file_of(value)
    return otherwise if path is None else path.name

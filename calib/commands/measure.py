"""The command `calib measure`."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.measured import measured_answer
from calib.commands.folder_page import with_page
from calib.commands.measured_screen import say_measured, say_next_size
from calib.commands.solve import (
    FixOption,
    ImageSizeOption,
    RejectOption,
    ShareOption,
    WeightedOption,
    read_input,
)
from calib.show.screen import progress_bar, quoted, shown, waiting
from designer.answer import Summary, Value, program
from designer.completion import error_templates, one_of
from designer.errors import InputError
from designer.words import printable

if TYPE_CHECKING:
    from calib.as_built.options import AsBuiltOptions
    from calib.as_built.result import AsBuilt
    from calib.as_built_report.files import FilePlaces
    from calib.as_built_report.held_out import HeldOut
    from calib.as_built_report.length_words import AskedLength
    from calib.core.types import Observations
    from designer.skew import Skew
    from designer.target import TargetGeometry
    from designer.tolerance.made import Made

NOT_TO_BE_USED = 1
MODELS = ("opencv", "luhmann", "pinhole")
LEAST_VIEWS = 3
"""Of a camera: from fewer, a target that may have any shape does not tell the camera."""
USUAL_FOLDS = 5


@dataclass(frozen=True)
class Print:
    """How the print was made, and how its photos are weighed."""

    with_percent: float  # shrinkage compensation
    with_skew_rad: "Skew"
    bed_turn_rad: float
    weighted: bool


def measure(
    target: Annotated[Path, typer.Argument(help="the target as designed (NAME.target.json)")],
    detections: Annotated[
        list[Path] | None,
        typer.Argument(
            help="detections.csv files of the print, or tables image,u,v,X,Y,Z or image,u,v,id; one a camera"
        ),
    ] = None,
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="the measured target: NAME.target.json")],
    length: Annotated[
        list[str] | None,
        typer.Option(
            help="a caliper's length, which tells the size: face-to-face:151.20mm+-0.02mm; also edge, 'face 2 to face "
            "9', 'ring 3 to ring 17' (centres)"
        ),
    ] = None,
    measured_length: Annotated[
        str | None, typer.Option(help="the quick way, without photos: rescale the target to this length")
    ] = None,
    model: Annotated[
        str, typer.Option(help="of the cameras: opencv, luhmann or pinhole", autocompletion=one_of(MODELS))
    ] = "opencv",
    one_camera: Annotated[
        bool, typer.Option("--one-camera", help="all files are of one camera, not each of its own")
    ] = False,
    rings: Annotated[
        str, typer.Option(help="free: each ring may be off a little; rigid: rings are right, only faces move")
    ] = "free",
    bow: Annotated[
        bool | None, typer.Option("--bow/--flat", help="faces may be bent, or not (default: a board may)")
    ] = None,
    made: Annotated[
        str | None,
        typer.Option(
            help="how the target was made, which says what to expect where the photos do not tell: an error template "
            "(fdm-dual, sheet-print, ...) or a TOML file of errors (default: assumed from how it was built)",
            metavar="NAME|FILE",
            autocompletion=error_templates,
        ),
    ] = None,
    weighted: WeightedOption = True,
    reject: RejectOption = None,
    fix: FixOption = None,
    share: ShareOption = None,
    shrink_compensation: Annotated[
        str, typer.Option(help="that this print was made with, to tell that of the next")
    ] = "0%",
    skew_compensation: Annotated[
        str, typer.Option(help="that this print was made with, to tell that of the next: 'xy 0.02deg, yz -0.1deg'")
    ] = "0",
    bed_turn: Annotated[
        str, typer.Option(help="by which the print was turned on the bed against `design`: 90deg; for axes and skew")
    ] = "0deg",
    image_size: ImageSizeOption = None,
    held_out: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="hold every N-th photo out in turn to judge the gain (default 5; fewer of few); 0: do not",
            metavar="N",
        ),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help="of rendered photos: the target file they show, to judge the gain by too")
    ] = None,
) -> Summary:
    """Measure a printed target with photos of it, and calibrate with what was printed.

    The exit code is 1 if the photos do not determine the camera and the target, or if on photos held out the measured
    target is no better than the designed one, or too few were held out to tell; it is written all the same.
    """
    from calib.as_built.solve import with_known_weights
    from calib.as_built_report.files import check_places, places_of
    from calib.as_built_report.length_words import parse_length

    places = places_of(out)
    nominal = _nominal(target)
    way = _way(nominal, made)
    if measured_length is not None:
        _refuse_both(detections, length)
        check_places(places, target)
        asked = parse_length("--measured-length", measured_length, nominal)
        return _rescale(nominal, target, asked, places.target, _compensation(shrink_compensation), way)
    if not detections:
        raise InputError(
            "no detections: give the detections.csv of photos of the print, or --measured-length to rescale without"
        )
    lengths = [parse_length("--length", text, nominal) for text in length or []]
    options = _options(model, rings, fix, share, reject, way, weighted=weighted, bow=bow)
    how = Print(_compensation(shrink_compensation), _skew(skew_compensation), _angle(bed_turn), weighted)
    check_places(places, target)
    shape = None if truth is None else _truth(truth, nominal, target)
    sets = _read(detections, nominal, target, image_size, one_camera=one_camera)
    remarks = (
        *(line for one in sets for line in one.remarks),
        *((way.sentence,) if way.because else ()),
        *_doubts(nominal, lengths, way),
        *_other_pages(places),
    )
    for remark in remarks:
        print(printable(remark))
    options = with_known_weights(options, sets)
    how = replace(how, weighted=options.solve.weighted)
    folds = _folds(held_out, min(one.view_count for one in sets))
    found = _measure(sets, nominal, model, options, lengths)
    held = _held_out(found, model, options, folds, shape)
    settings = (
        ("target", target.name), ("detections", ", ".join(path.name for path in detections)), ("model", model),
        ("rings", rings), ("one-camera", str(one_camera)), ("weighted", str(how.weighted)),
        ("reject", f"{reject or ''}"),
        ("bow", {None: "default", True: "bow", False: "flat"}[bow]), ("fix", " ".join(fix or [])),
        ("made", made or ""),
        ("share", " ".join(share or [])),
        ("shrink-compensation", shrink_compensation), ("skew-compensation", skew_compensation), ("bed-turn", bed_turn),
        ("length", "; ".join(length or [])), ("held-out", str(folds)),
    )  # fmt: skip
    done = with_page(
        _write_and_say(found, held, lengths, how, settings, places, detections, is_judged=held_out != 0),
        places.target.parent,
        "measure",
    )
    return replace(done, remarks=(*remarks, *found.remarks, *done.remarks))


def _nominal(path: Path) -> "TargetGeometry":
    """The target that a print is measured against."""
    from designer.target import load_target

    target = load_target(path)
    if target.source != "nominal":
        raise InputError(
            f"{path}: a {target.source} target; deviations are told against the design: give the nominal target file"
        )
    return target


def _refuse_both(detections: Sequence[Path] | None, length: Sequence[str] | None) -> None:
    if detections or length:
        raise InputError(
            f"--measured-length rescales without photos, so {detections[0] if detections else '--length'} does not "
            "belong there; with photos give the length with --length"
        )


def _doubts(target: "TargetGeometry", lengths: "Sequence[AskedLength]", way: "Made") -> tuple[str, ...]:
    """What to say of lengths that nobody seems to have read off a caliper."""
    from calib.as_built_report.length_words import doubt_about

    return tuple(filter(None, (doubt_about(one, target, way.errors) for one in lengths)))


def _other_pages(places: "FilePlaces") -> tuple[str, ...]:
    """That the folder's page will be of this print, and no longer of another one in it."""
    others = sorted(path for path in places.report.parent.glob("*.as_built.json") if path != places.report)
    if not others:
        return ()
    return (
        f"{shown(others[0])}: another measured target in this folder, whose index.html will be of the new one; measure "
        "each into a folder of its own to keep both pages",
    )


def _way(target: "TargetGeometry", made: str | None) -> "Made":
    """What is taken for granted where the photos do not tell."""
    from designer.tolerance.made import EXACT, how_made

    way = how_made(target, made)
    if way is None or way.name == EXACT:
        raise InputError(f"--made {EXACT}: there is nothing to measure then; give an error template, or leave it out")
    return way


def _rescale(
    target: "TargetGeometry",
    path: Path,
    asked: "AskedLength",
    out: Path,
    made_with_percent: float,
    way: "Made",
) -> Summary:
    """The quick way."""
    from calib.as_built.lengths import length_in, rescaled
    from calib.as_built_report.deviations import Estimate, compensation_percent
    from calib.as_built_report.words import is_plastic
    from calib.core.files import write_files
    from designer.target import target_to_json

    size = asked.length.value_mm / length_in(target, asked.length.name)
    made = rescaled(target, asked.length)
    write_files({out: target_to_json(made).encode()})
    print(f"length {asked.text}")
    off = Estimate(size - 1, asked.length.sigma_mm / asked.length.value_mm)
    print(
        f"size   {100 * off.value:+.3f} +- {100 * off.sigma:.3f} % against the design; the shape is taken as designed"
    )
    print(f"wrote  {shown(out)}: {shown(path)} made {size:.6f} times as large")
    say_next_size(off, made_with_percent, plastic=is_plastic(target))
    doubts = _doubts(target, [asked], way)
    for doubt in doubts:
        print(doubt)
    step = f"calib run {quoted(out)} photos -o camera"
    print(f"next   {step}   # with the folder of your photos")
    answer: dict[str, Value] = {
        "status": "rescaled", "nominal_geometry_id": target.geometry_id, "measured_geometry_id": made.geometry_id,
        "size": {"value": off.value, "sigma": off.sigma},
        "next_shrink_compensation_percent": compensation_percent(off.value, made_with_percent),
    }  # fmt: skip
    return Summary(answer, (out,), (step,), doubts)


def _options(
    model: str,
    rings: str,
    fix: list[str] | None,
    share: list[str] | None,
    reject: float | None,
    made: "Made",
    *,
    weighted: bool,
    bow: bool | None,
) -> "AsBuiltOptions":
    """The options of the command line."""
    from calib.as_built.options import AsBuiltOptions
    from calib.pipeline.settings import plan_from_words
    from designer.words import suggestion

    if model == "virtual":
        raise InputError(
            "--model virtual: its map is learned from the target's own rings, so it cannot measure them; measure with "
            "opencv or luhmann, then solve virtual with the measured target"
        )
    if model not in MODELS:
        hint = suggestion(model, list(MODELS)) or f"; there are {', '.join(MODELS)}"
        raise InputError(f"--model {model!r}: cannot measure a target{hint}")
    if rings not in ("free", "rigid"):
        raise InputError(f"--rings {rings!r}: it must be free or rigid")
    plan = plan_from_words(
        model, fix=fix or [], share=share or [], focal_px=None, loss="squares", reject=reject, weighted=weighted
    )
    options = AsBuiltOptions(made=made, bow=bow, solve=plan.options)
    return options if rings == "free" else replace(options, ring_sigma_mm=None)


def _compensation(text: str) -> float:
    """The compensation of this print, in percent."""
    from designer.units import parse_percent

    try:
        value = parse_percent(text)
    except ValueError as error:
        raise InputError(f"--shrink-compensation {text!r}: {error}") from None
    if not -50 < value < 50:
        raise InputError(f"--shrink-compensation {text!r}: must lie between -50% and 50%")
    return value


def _skew(text: str) -> "Skew":
    from designer.skew import parse_skew_rad

    try:
        return parse_skew_rad(text)
    except ValueError as error:
        raise InputError(f"--skew-compensation {text!r}: {error}") from None


def _angle(text: str) -> float:
    from designer.units import parse_angle_rad

    try:
        return parse_angle_rad(text)
    except ValueError as error:
        raise InputError(f"--bed-turn {text!r}: {error}") from None


def _truth(path: Path, nominal: "TargetGeometry", nominal_path: Path) -> "TargetGeometry":
    """The geometry that rendered photos show."""
    from designer.target import load_target

    target = load_target(path)
    if target.layout_id != nominal.layout_id:
        raise InputError(f"--truth {path}: has another layout than {nominal_path}; give the target that was rendered")
    return target


def _read(
    paths: Sequence[Path], target: "TargetGeometry", target_path: Path, image_size: str | None, *, one_camera: bool
) -> "list[Observations]":
    """What each camera saw."""
    from calib.as_built_report.join import joined
    from calib.observe.dataset import read_detections
    from calib.observe.observations import observations_from_detections

    for path in paths:
        again = [other for other in paths if os.path.realpath(other) == os.path.realpath(path)]
        if len(again) > 1:
            raise InputError(f"{path}: given twice; give each detections file once")
    origins = [str(path) for path in paths]
    if one_camera and len(paths) > 1:
        files = [read_detections(path, target, target_path=target_path) for path in paths]
        origins = [", ".join(origins)]
        whole = joined(files, [path.stem for path in paths])
        sets = [observations_from_detections(whole, target, origin=origins[0])]
    else:
        sets = [read_input(path, target_path, image_size, None, None) for path in paths]
    for one, name in zip(sets, origins, strict=True):
        if one.view_count < LEAST_VIEWS:
            raise InputError(
                f"{name}: {one.view_count} photos can be used; a camera needs at least {LEAST_VIEWS}, and "
                "20 or more from all sides to measure a target well"
            )
    return sets


def _measure(
    sets: "Sequence[Observations]",
    target: "TargetGeometry",
    model: str,
    options: "AsBuiltOptions",
    lengths: "Sequence[AskedLength]",
) -> "AsBuilt":
    from calib.as_built.solve import measure as measure_print

    with waiting("measuring"):
        return measure_print(sets, target, model, options, [asked.length for asked in lengths])


def _folds(asked: int | None, views: int) -> int:
    """In how many parts photos are held out, of the camera with the fewest; 0: not."""
    from calib.as_built_report.held_out import LEAST_FOLDS

    if asked is None:
        return min(USUAL_FOLDS, views) if views > LEAST_VIEWS else 0
    if asked and not LEAST_FOLDS <= asked <= views:
        raise InputError(
            f"--held-out {asked}: {views} photos fall into {LEAST_FOLDS} to {views} parts; give one of these, or 0 for "
            "none"
        )
    return asked


def _held_out(
    found: "AsBuilt", model: str, options: "AsBuiltOptions", folds: int, truth: "TargetGeometry | None"
) -> "HeldOut | None":
    """What is gained on photos that take no part; None if it was not asked for, or is not to be had."""
    from calib.as_built_report.held_out import gain_on_held_out

    if not folds or found.status == "degenerate":
        return None
    with progress_bar("judging parts", folds) as done:
        return gain_on_held_out(found, model, options, folds, truth=truth, done=done)


def _write_and_say(
    found: "AsBuilt",
    held: "HeldOut | None",
    lengths: "Sequence[AskedLength]",
    how: Print,
    settings: tuple[tuple[str, str], ...],
    places: "FilePlaces",
    detections: Sequence[Path],
    *,
    is_judged: bool,
) -> Summary:
    """Write all files, then say what is in them."""
    from calib.as_built_report.files import report_files, report_of
    from calib.as_built_report.picture import report_picture
    from calib.as_built_report.words import UNJUDGED, no_gain_line
    from calib.core.files import write_files

    report = report_of(
        found,
        held,
        lengths,
        made_with_percent=how.with_percent,
        made_with_skew_rad=how.with_skew_rad,
        bed_turn_rad=how.bed_turn_rad,
        weighted=how.weighted,
        program=program(),
        settings=settings,
    )
    files = {**report_files(report, places), places.picture: report_picture(report)}
    write_files(files)
    say_measured(report)
    print(f"wrote {shown(places.target)}: the target as it was printed, with the covariances of its faces")
    print(f"      {shown(places.report)}, {shown(places.table)}: all numbers with their standard deviations")
    print(f"      {shown(places.picture)}: look at it before you trust the numbers")
    if found.status == "degenerate":
        print("next  no camera is determined: do what is said above, and measure again")
        return Summary(measured_answer(report), tuple(files), exit_code=NOT_TO_BE_USED)
    if is_judged and (why := no_gain_line(held)):
        print(f"next  {why}")
        return Summary(measured_answer(report), tuple(files), exit_code=NOT_TO_BE_USED)
    if not is_judged:
        print(f"next  {UNJUDGED}")
        return Summary(measured_answer(report), tuple(files), remarks=(UNJUDGED,))
    folder = quoted(places.target.with_name(places.target.name.removesuffix(".target.json")))
    step = f"calib solve {quoted(detections[0])} --target {quoted(places.target)} -o {folder}"
    print(f"next  {step}")
    return Summary(measured_answer(report), tuple(files), (step,))

"""The command `calib measure`."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.cameras import COMMON, fitted_models
from calib.commands.answers.measured import measured_answer
from calib.commands.folder_page import with_page
from calib.commands.measured_screen import say_measured, say_next_size
from calib.commands.solve import (
    FixOption,
    ImageSizeOption,
    RejectOption,
    ShareOption,
    WeightedOption,
    image_size_of,
)
from calib.show.screen import progress_bars, quoted, shown
from designer.base.answer import Summary, Value
from designer.base.errors import InputError
from designer.base.words import printable
from designer.kinds.presets import error_templates, one_of

if TYPE_CHECKING:
    from calib.api.measuring import MeasureResult
    from calib.as_built_report.files import FilePlaces
    from designer.base.units import Skew

NOT_TO_BE_USED = 1


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
        str, typer.Option(help=f"of the cameras: {', '.join(fitted_models())}", autocompletion=one_of(fitted_models()))
    ] = COMMON,
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
    from calib.api.measuring import measure as measure_print
    from calib.as_built_report.files import check_places, places_of

    places = places_of(out)
    percent, skew_rad, turn_rad = _compensation(shrink_compensation), _skew(skew_compensation), _angle(bed_turn)
    check_places(places, target)
    if measured_length is not None:
        _refuse_both(detections, length)
        return _rescale(target, measured_length, made, places.target, percent)
    if not detections:
        raise InputError(
            "no detections: give the detections.csv of photos of the print, or --measured-length to rescale without"
        )
    with progress_bars() as progress:
        done = measure_print(
            target, detections, lengths=length or (), model=model, one_camera=one_camera, rings=rings, bow=bow,
            made=made, weighted=weighted, reject_sigma=reject, fix=fix or (), share=share or (),
            shrink_compensation_percent=percent, skew_compensation_rad=skew_rad, bed_turn_rad=turn_rad,
            image_size=image_size_of(image_size), held_out=held_out, truth=truth, progress=progress,
            settings=(
                ("shrink-compensation", shrink_compensation), ("skew-compensation", skew_compensation),
                ("bed-turn", bed_turn), ("length", "; ".join(length or [])),
            ),
        )  # fmt: skip
    remarks = (*done.remarks, *_other_pages(places))
    for remark in remarks:
        print(printable(remark))
    summary = with_page(_write_and_say(done, places, detections), places.target.parent, "measure")
    return replace(summary, remarks=(*remarks, *done.found.remarks, *summary.remarks))


def _refuse_both(detections: Sequence[Path] | None, length: Sequence[str] | None) -> None:
    if detections or length:
        raise InputError(
            f"--measured-length rescales without photos, so {detections[0] if detections else '--length'} does not "
            "belong there; with photos give the length with --length"
        )


def _other_pages(places: "FilePlaces") -> tuple[str, ...]:
    """That the folder's page will be of this print, and no longer of another one in it."""
    others = sorted(path for path in places.report.parent.glob("*.as_built.json") if path != places.report)
    if not others:
        return ()
    return (
        f"{shown(others[0])}: another measured target in this folder, whose index.html will be of the new one; measure "
        "each into a folder of its own to keep both pages",
    )


def _rescale(path: Path, length: str, way: str | None, out: Path, made_with_percent: float) -> Summary:
    """The quick way."""
    from calib.api.measuring import rescale
    from calib.as_built_report.deviations import compensation_percent
    from calib.as_built_report.words import is_plastic

    made = rescale(path, length, made=way)
    made.save(out)
    off = made.size
    print(f"length {made.asked.text}")
    print(
        f"size   {100 * off.value:+.3f} +- {100 * off.sigma:.3f} % against the design; the shape is taken as designed"
    )
    print(f"wrote  {shown(out)}: {shown(path)} made {made.factor:.6f} times as large")
    say_next_size(off, made_with_percent, plastic=is_plastic(made.nominal))
    for doubt in made.remarks:
        print(doubt)
    step = f"calib run {quoted(out)} photos -o camera"
    print(f"next   {step}   # with the folder of your photos")
    answer: dict[str, Value] = {
        "status": "rescaled", "nominal_geometry_id": made.nominal.geometry_id,
        "measured_geometry_id": made.target.geometry_id, "size": {"value": off.value, "sigma": off.sigma},
        "next_shrink_compensation_percent": compensation_percent(off.value, made_with_percent),
    }  # fmt: skip
    return Summary(answer, (out,), (step,), made.remarks)


def _compensation(text: str) -> float:
    """The compensation of this print, in percent."""
    from designer.base.units import parse_percent

    try:
        return parse_percent(text)
    except ValueError as error:
        raise InputError(f"--shrink-compensation {text!r}: {error}") from None


def _skew(text: str) -> "Skew":
    from designer.base.units import parse_skew_rad

    try:
        return parse_skew_rad(text)
    except ValueError as error:
        raise InputError(f"--skew-compensation {text!r}: {error}") from None


def _angle(text: str) -> float:
    from designer.base.units import parse_angle_rad

    try:
        return parse_angle_rad(text)
    except ValueError as error:
        raise InputError(f"--bed-turn {text!r}: {error}") from None


def _write_and_say(done: "MeasureResult", places: "FilePlaces", detections: Sequence[Path]) -> Summary:
    """Write all files, then say what is in them."""
    from calib.as_built_report.words import UNJUDGED

    files = done.save(places.target)
    say_measured(done.report)
    print(f"wrote {shown(places.target)}: the target as it was printed, with the covariances of its faces")
    print(f"      {shown(places.report)}, {shown(places.table)}: all numbers with their standard deviations")
    print(f"      {shown(places.picture)}: look at it before you trust the numbers")
    answer = measured_answer(done.report)
    if done.found.status == "degenerate":
        print("next  no camera is determined: do what is said above, and measure again")
        return Summary(answer, files, exit_code=NOT_TO_BE_USED)
    if done.why_not:
        print(f"next  {done.why_not}")
        return Summary(answer, files, exit_code=NOT_TO_BE_USED)
    if not done.is_judged:
        print(f"next  {UNJUDGED}")
        return Summary(answer, files, remarks=(UNJUDGED,))
    folder = quoted(places.target.with_name(places.target.name.removesuffix(".target.json")))
    step = f"calib solve {quoted(detections[0])} --target {quoted(places.target)} -o {folder}"
    print(f"next  {step}")
    return Summary(answer, files, (step,))

"""The command `calib measure`."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.cameras import fitted_models
from calib.commands import options
from calib.commands.options import image_size_of
from designer.base.answer import Summary, command_line
from designer.base.errors import InputError
from designer.kinds.presets import error_templates, one_of
from designer.page.progress import progress_bars, waiting
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.api.measuring import MeasureResult
    from calib.show.measured.next_print import Told

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
    rig: Annotated[
        Path | None,
        typer.Option(
            help="instead of detections: the folder of calib rig, whose cameras saw the print at once", metavar="FOLDER"
        ),
    ] = None,
    photos: Annotated[
        list[str] | None,
        typer.Option(
            help="that the detections were found in, of one camera: images, a folder or a pattern; they are searched "
            "again with the lens and the target as measured, so that the camera is right too",
            metavar="PHOTOS",
        ),
    ] = None,
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
        str | None,
        typer.Option(
            help=f"of the cameras: {', '.join(fitted_models())} (default: that of the best camera of the run whose "
            "detections.csv is given, else the one with the smaller residuals)",
            autocompletion=one_of(fitted_models()),
        ),
    ] = None,
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
    weighted: options.WeightedOption = True,
    reject: options.RejectOption = None,
    fix: options.FixOption = None,
    share: options.ShareOption = None,
    shrink_compensation: Annotated[
        str, typer.Option(help="that this print was made with, to tell that of the next")
    ] = "0%",
    skew_compensation: Annotated[
        str, typer.Option(help="that this print was made with, to tell that of the next: 'xy 0.02deg, yz -0.1deg'")
    ] = "0",
    bed_turn: Annotated[
        str, typer.Option(help="by which the print was turned on the bed against `design`: 90deg; for axes and skew")
    ] = "0deg",
    image_size: options.ImageSizeOption = None,
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
    verbose: options.VerboseOption = False,
) -> Summary:
    """Measure a printed target with photos of it, and calibrate with what was printed.

    The exit code is 1 if the photos do not determine the camera and the target, or if on photos held out the measured
    target is no better than the designed one, or too few were held out to tell; it is written all the same.
    """
    from calib.api.measuring import measure as measure_print
    from calib.renderer.quantities import parsed
    from calib.show.measured.files import check_places, places_of
    from designer.base.units import parse_angle_rad, parse_percent, parse_skew_rad

    check_places(places_of(out), target)
    percent = parsed("--shrink-compensation", shrink_compensation, parse_percent)
    if measured_length is not None:
        of_photos = {
            detections[0] if detections else "": bool(detections), "--rig": rig, "--photos": photos,
            "--length": length, "--model": model,
            "--one-camera": one_camera, "--rings": rings != "free", "--bow": bow is not None,
            "--unweighted": not weighted, "--reject": reject, "--fix": fix, "--share": share,
            "--skew-compensation": skew_compensation != "0", "--bed-turn": bed_turn != "0deg",
            "--image-size": image_size, "--held-out": held_out is not None, "--truth": truth,
        }  # fmt: skip
        if needless := next((name for name, given in of_photos.items() if given), None):
            raise InputError(
                f"--measured-length rescales without photos, so {needless} does not belong there; with photos give the "
                "length with --length"
            )
        return _rescale(target, measured_length, made, out, percent)
    if not detections and rig is None:
        raise InputError(
            "no detections: give the detections.csv of photos of the print, --rig with the folder of calib rig, or "
            "--measured-length to rescale without"
        )
    with progress_bars() as progress:
        measured = measure_print(
            target, detections or (), rig=rig, lengths=length or (), photos=photos or (), model=model,
            one_camera=one_camera, rings=rings,
            bow=bow, made=made, weighted=weighted, reject_sigma=reject, fix=fix or (), share=share or (),
            shrink_compensation_percent=percent,
            skew_compensation_rad=parsed("--skew-compensation", skew_compensation, parse_skew_rad),
            bed_turn_rad=parsed("--bed-turn", bed_turn, parse_angle_rad), image_size=image_size_of(image_size),
            held_out=held_out, truth=truth, progress=progress,
        )  # fmt: skip
    folder = quoted(out.with_name(out.name.removesuffix(".target.json")))
    if photos:
        use = f"calib run {quoted(out)} {' '.join(map(quoted, map(Path, photos)))} -o {folder}"
    elif rig is None and detections:
        use = f"calib solve {quoted(detections[0])} --target {quoted(out)} -o {folder}"
    else:
        use = f"calib rig {quoted(out)} --table {quoted(Path(f'{rig}/sightings.csv'))} -o {folder}"
    return _write_and_say(measured, out, use, verbose=verbose)


def _write_and_say(measured: "MeasureResult", out: Path, use: str, *, verbose: bool) -> Summary:
    """Write all files and the page, then say what is in them.

    Args:
        measured: the print.
        out: the place of the measured target.
        use: the command line that calibrates with it.
        verbose: say all tables.
    """
    from calib.records.as_built_file import AS_BUILT
    from calib.show.folder import write_folder_page
    from calib.show.measured.next_print import USES, next_steps
    from calib.show.measured.tables import cameras_table, faces_table, gains_table, whole_table
    from calib.show.measured.words import facts_of, findings_of, headline_of, is_plastic, validation_findings
    from designer.page.blocks import Command, Paragraph
    from designer.page.terminal import say_facts, say_findings, say_headline, say_lines, say_table, say_written, shown

    record = measured.record
    with waiting("drawing the page"):
        files = measured.save(out)
        page, remark = write_folder_page(out.parent, "measure", command_line())
    say_headline(headline_of(record))
    say_facts(facts_of(record))
    say_findings((*findings_of(record).rows, *validation_findings(record).rows))
    if verbose:
        nominal = measured.found.nominal
        tables = (whole_table(record, nominal), faces_table(record), gains_table(record), cameras_table(record))
        for table in filter(None, tables):
            say_table(table)
    say_written(out.parent, (*files, *page))
    say_lines("note", [remark] if remark else [])
    steps = next_steps(record, use, plastic=is_plastic(measured.target))
    _say_next((*(Paragraph(f"open {shown(one)} in a browser") for one in page if one.suffix == ".html"), *steps))
    return Summary(
        AS_BUILT.document(record), (*files, *page), (use,) if Command(use, USES) in steps else (),
        (*record.remarks, *([remark] if remark else [])), NOT_TO_BE_USED if measured.why_not else 0,
    )  # fmt: skip


def _say_next(steps: "Iterable[Told]") -> None:
    """What to do next: command lines with what they do, and sentences."""
    from designer.page.blocks import Command
    from designer.page.terminal import say_lines

    texts = (f"{one.line}   # {one.purpose}" if isinstance(one, Command) else one.text for one in steps)
    say_lines("next", tuple(texts))


def _rescale(path: Path, length: str, way: str | None, out: Path, made_with_percent: float) -> Summary:
    """The quick way: the size that a caliper shows, and the shape as designed."""
    from calib.api.measuring import rescale
    from calib.as_built.deviations import Compensation, WholePrint, compensation_percent
    from calib.draw.print_errors import percent
    from calib.show.measured.next_print import next_print
    from calib.show.measured.words import is_plastic
    from designer.page.blocks import Command, Facts, Finding
    from designer.page.terminal import say_facts, say_findings, say_written

    made_with = Compensation(made_with_percent)
    made = rescale(path, length, made=way)
    made.save(out)
    off = made.size
    say_facts(Facts((
        ("length", made.length.text),
        ("size", f"{percent(off)} against the design; the shape is taken as designed")
        if off is not None else ("shape", "as designed but for the distance of its two faces"),
    )))  # fmt: skip
    say_findings(Finding("note", "", line) for line in made.remarks)
    say_written(out.parent, (out,))
    step = f"calib run {quoted(out)} photos -o camera"
    whole, plastic = WholePrint(off, {}, {}), is_plastic(made.nominal)
    next_one = next_print(whole, made_with, plastic=plastic)
    _say_next((Command(step, "with the folder of your photos"), *next_one))
    return Summary(
        {"status": "rescaled", "nominal_geometry_id": made.nominal.geometry_id,
         "measured_geometry_id": made.target.geometry_id,
         "size": None if off is None else {"value": off.value, "sigma": off.sigma},
         "next_shrink_compensation_percent":
             None if off is None else compensation_percent(off.value, made_with_percent)},
        (out,), (step,), made.remarks,
    )  # fmt: skip

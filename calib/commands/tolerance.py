"""The command `design tolerance`: what manufacturing errors cost a calibration, and how large they may be."""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.cameras import DEFAULT, fitted_models
from calib.commands import options
from calib.commands.camera_argument import read_camera
from calib.commands.folder_page import say_next, with_page
from calib.commands.study import answer_of, kept_when_stopped
from calib.commands.tolerance_rig import DRAWS, tolerance_of_rig
from designer.base.answer import Summary
from designer.base.command import only_these
from designer.kinds.presets import error_templates, one_of
from designer.page.blocks import Finding
from designer.page.progress import progress_bars, waiting
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.api.tolerancing import ToleranceResult

LIMIT_MISSED = 1
OF_RIGS = {"target", "errors", "changes", "rig", "frames", "distance", "draws", "linear", "seed", "out"}
"""Options of the study of a rig."""


def tolerance(
    context: typer.Context,
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
    rig: options.RigOption = None,
    frames: Annotated[int, typer.Option(help="of a rig: how many")] = 30,
    views: Annotated[int, typer.Option(help="how many photos")] = 90,
    distance: Annotated[
        str | None,
        typer.Option(
            help="of the cameras from the target's origin: 400mm, or 250mm..500mm (default: as the page of a design "
            "advises; of a rig: as its template says)"
        ),
    ] = None,
    aim_offset: options.AimOffsetOption = None,
    camera: options.CameraTemplateOption = "machine-vision",
    model: Annotated[
        str,
        typer.Option(
            help=f"camera model that is solved: {', '.join(fitted_models())}",
            autocompletion=one_of(fitted_models()),
        ),
    ] = DEFAULT,
    weighted: options.WeightedOption = False,
    draws: Annotated[int | None, typer.Option(help="how many made targets to draw (default: 200; of a rig 20)")] = None,
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
    against_changes: Annotated[
        list[str] | None,
        typer.Option("--against-set", help="another size of one error of that target, as --set", metavar="ERROR=SIZE"),
    ] = None,
    against_distance: Annotated[str | None, typer.Option(help="distance to that target (default: --distance)")] = None,
    vary: Annotated[str | None, typer.Option(help="error to compare by (default: the worst one of faces)")] = None,
    seed: options.SeedOption = 1,
    jobs: options.JobsOption = None,
    dask: options.DaskOption = None,
    resume: options.ResumeOption = False,
    figures: options.FiguresOption = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for tables, figures and draws")],
) -> Summary:
    """What if a print is off by this much? What manufacturing errors cost a calibration, and how large they may be.

    The exit code is 1 if a limit of --require is missed.
    """
    from calib.api.tolerancing import tolerance as find_tolerance
    from calib.app.inputs import DISTANCES_MM
    from calib.renderer.quantities import length, length_range

    if rig is not None:
        only_these(context, "--rig", OF_RIGS)
        count = 0 if linear else DRAWS if draws is None else draws
        return tolerance_of_rig(target, errors, rig, changes or (), frames, distance, count, seed, out)
    formats = options.figure_formats(figures)
    far = None if against_distance is None else length_range("--against-distance", against_distance, *DISTANCES_MM)
    read_camera(camera)
    with nullcontext() if linear else kept_when_stopped():
        with progress_bars() as progress:
            found = find_tolerance(
                target, errors, changes=changes or (), views=views,
                distance_mm=None if distance is None else length_range("--distance", distance, *DISTANCES_MM),
                aim_offset_mm=None if aim_offset is None else length("--aim-offset", aim_offset, 0, DISTANCES_MM[1]),
                camera=camera, model=model, weighted=weighted, draws=200 if draws is None else draws, full=full,
                linear=linear, require=require or (), by=by,
                against=against, against_errors=against_errors, against_changes=against_changes or (),
                against_distance_mm=far, vary=vary, seed=seed, jobs=jobs, dask=dask, resume=resume,
                out=out, progress=progress,
            )  # fmt: skip
        return say_next(with_page(_write(found, out, target, formats), out, "tolerance"), out)


def _write(found: "ToleranceResult", folder: Path, target: Path, formats: tuple[str, ...]) -> Summary:
    """Write the files, and say what came out: the answer, what limits allow or else the ranking, and what to do."""
    from calib.show.studies.tolerance_tables import budget_table, ranking_table, totals_table
    from calib.show.studies.tolerance_words import cost_notes, prediction_sentence, tolerance_headline
    from calib.studies.tolerance.stored import AGAINST_FILE, STUDY_FILE
    from designer.page.terminal import say_findings, say_headline, say_line, say_table, say_written

    study, drawn, other = found.study, found.drawn, found.study.crossovers
    with waiting("drawing figures"):
        files = found.save(folder, formats=formats)
    say_headline(tolerance_headline(study))
    settings = [(study.target, study.setting), *([] if other is None else [(other.target, other.setting)])]
    warnings = [f"{name}: {line}" for name, setting in settings for line in setting.warnings]
    remarks = [*study.setting.remarks, prediction_sentence(study)]
    said = [Finding("usable", "", line) for line in warnings] + [Finding("note", "", line) for line in remarks]
    say_findings([*said, *cost_notes(study)])
    print()
    limited = [budget_table(study, one) for one in study.budgets if one.met_by_noise_alone]
    for table in (*(limited or [ranking_table(study)]), *([] if other is None else [totals_table(study, other)])):
        say_table(table)
    if drawn.new:
        before = f", {drawn.before} were there" if drawn.before else ""
        say_line("drawn", f"{drawn.new} draws in {drawn.seconds:.1f} s{before}")
    names = (STUDY_FILE,) if other is None else (STUDY_FILE, AGAINST_FILE)
    written = (*files, *(folder / name for name in names if study.draws))
    say_written(folder, written)
    step = (
        f"calib measure {quoted(target)} camera/detections.csv --photos FOLDER -o measured/{quoted(Path(target.name))}"
    )
    step += "   # takes the errors of your own print back, once calib run -o camera has seen photos of it"
    answer = answer_of(type(study), study)
    return Summary(answer, written, (step,), (*warnings, *remarks), 0 if found.is_kept else LIMIT_MISSED)

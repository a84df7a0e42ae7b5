"""The command `calib solve`."""

import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.detect import WIDE, program
from designer.command import printable
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.inputs.corners_vnl import Grid
    from calib.pipeline.settings import SolvePlan
    from calib.pipeline.solutions import Solution
    from calib.results.truth import Truth
    from calib.types import Calibration, Observations
    from calib.virtual.solve_virtual import Reference

DEGENERATE = 1

ModelOption = Annotated[str, typer.Option(help="luhmann, opencv, virtual, pinhole, or all: the first three")]
FixOption = Annotated[list[str] | None, typer.Option(help="keep a parameter as it starts, or at a value: k3, k3=0")]
ShareOption = Annotated[list[str] | None, typer.Option(help="parameters that have one value: fx_px,fy_px")]
FocalOption = Annotated[str | None, typer.Option(help="first guess of the focal length: 2500px (not needed)")]
LossOption = Annotated[str, typer.Option(help="squares, huber or cauchy: how far-off observations count")]
RejectOption = Annotated[
    float | None, typer.Option(help="leave out what is off by more than so many robust standard deviations, such as 4")
]
WeightedOption = Annotated[
    bool, typer.Option("--weighted/--unweighted", help="weigh observations by their covariances, or all alike")
]
ReferenceOption = Annotated[
    str | None,
    typer.Option(
        help="virtual: the photo that the map is learned from, or all (default: of a board the photo that covers the "
        "image best, of other targets all)"
    ),
]
ReferenceTargetOption = Annotated[
    Path | None, typer.Option(help="virtual: target file of a board that the reference photo shows")
]


def solve(
    detections: Annotated[Path, typer.Argument(help="detections.csv, a CSV with image,u,v,X,Y,Z, or a corners.vnl")],
    *,
    target: Annotated[Path | None, typer.Option(help="the target file of detections.csv")] = None,
    model: ModelOption = "all",
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the results")],
    fix: FixOption = None,
    share: ShareOption = None,
    focal: FocalOption = None,
    loss: LossOption = "squares",
    reject: RejectOption = None,
    weighted: WeightedOption = False,
    reference: ReferenceOption = None,
    reference_target: ReferenceTargetOption = None,
    image_size: Annotated[str | None, typer.Option(help="of files that do not say it: 2448x2048")] = None,
    grid: Annotated[str | None, typer.Option(help="of a corners.vnl: 10x7 corners")] = None,
    pitch: Annotated[str | None, typer.Option(help="of a corners.vnl: distance of its corners, 20mm")] = None,
) -> None:
    """Solve the camera, and where it stood, from what was detected.

    The exit code is 1 if the observations do not determine the camera.
    """
    from calib.inputs.correspondences import parse_pair, read_observations
    from calib.inputs.dataset import MAX_SIDE_PX

    plan = plan_of(model, fix, share, focal, loss, reject, weighted=weighted)
    size = None if image_size is None else parse_pair("--image-size", image_size, MAX_SIDE_PX)
    prepared = read_observations(detections, target, image_size=size, grid=_grid(grid, pitch))
    check_folder(out)
    settings = (
        ("detections", detections.name),
        ("target", "" if target is None else target.name),
        *reference_setting(reference),
    )
    for remark in prepared.remarks:
        print(printable(remark))
    solutions = solve_and_say(
        prepared.observations, plan, out, settings=settings, reference=reference_of(reference, reference_target)
    )
    say_files(out, solutions)
    leave_if_degenerate(solutions)


def plan_of(
    model: str,
    fix: list[str] | None,
    share: list[str] | None,
    focal: str | None,
    loss: str,
    reject: float | None,
    *,
    weighted: bool,
) -> "SolvePlan":
    """The options of the command line."""
    from calib.pipeline.settings import plan_from_words

    return plan_from_words(
        model, fix=fix or [], share=share or [], focal=focal, loss=loss, reject=reject, weighted=weighted
    )


def check_folder(folder: Path) -> None:
    """Refuse a folder that takes no files before any work is done."""
    import tempfile

    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, not a folder; choose another with -o")
    try:
        place = folder if folder.exists() else next(parent for parent in folder.absolute().parents if parent.exists())
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}; choose another folder with -o") from None


def reference_of(reference: str | None, target: Path | None) -> "Reference | None":
    """The photo that a learned map is of: a view's name, or the sightings of a board in a photo of its own."""
    if target is None:
        return reference
    if reference is None:
        raise InputError(f"--reference-target {target}: name the photo of this board too, with --reference PHOTO")
    from calib.detect.pipeline import detect
    from calib.inputs.images import read_image
    from calib.inputs.observations import dataset_of, observations_from_detections
    from designer.target import load_target

    board = load_target(target)
    seen = detect(read_image(Path(reference)).pixels, board, name=Path(reference).name)
    if not len(seen.ring):
        raise InputError(f"{reference}: shows no rings of {target}; give a photo of that board")
    return observations_from_detections(dataset_of([seen]), board, origin=reference).observations


def reference_setting(reference: str | None) -> tuple[tuple[str, str], ...]:
    """The choice of a reference, for the record."""
    return () if reference is None else (("reference", reference),)


def solve_and_say(
    observations: "Observations",
    plan: "SolvePlan",
    folder: Path,
    *,
    settings: tuple[tuple[str, str], ...],
    reference: "Reference | None" = None,
    truth: "Truth | None" = None,
) -> "list[Solution]":
    """Solve and write all models, and print what came of them.

    Raises:
        InputError: no model could be solved.
    """
    from rich.console import Console

    from calib.pipeline.solutions import solve_models
    from calib.results.calibration_file import Provenance
    from calib.results.evaluation_table import comparison_table, parameters_table

    def provenance(model: str) -> Provenance:
        return Provenance(
            program(), geometry_id=observations.points.geometry_id, options=plan.options_of(model),
            settings=(*settings, ("model", model)),
        )  # fmt: skip

    waiting = Console(stderr=True)
    solutions = []
    with waiting.status("solving", spinner="dots") if waiting.is_terminal else nullcontext():
        for solution in solve_models(
            observations, plan, folder, provenance=provenance, reference=reference, truth=truth
        ):
            solutions.append(solution)
    evaluations = [solution.evaluation for solution in solutions if solution.evaluation is not None]
    if not evaluations:
        raise InputError(solutions[0].failure)
    console = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else WIDE)
    for evaluation in evaluations:
        calibration = evaluation.calibration
        print(f"\n{calibration.camera.model}: {_summary(calibration)}")
        console.print(parameters_table(evaluation))
        for remark in (*calibration.remarks, *evaluation.remarks):
            print(f"  {printable(remark)}")
    print(f"\n{observations.view_count} photos, {len(observations.view)} sightings; errors of the photos solved from:")
    console.print(comparison_table(evaluations))
    for solution in solutions:
        if solution.failure:
            print(f"{solution.model}: not solved: {printable(solution.failure)}")
    return solutions


def _summary(calibration: "Calibration") -> str:
    """Status, and what the scale says."""
    scale = f"{calibration.scale:.3g} times the stated sigma" if calibration.weighted else f"{calibration.scale:.4f} px"
    return f"{calibration.status}; an observation's standard deviation is {scale}; {calibration.seconds:.2f} s"


def say_files(folder: Path, solutions: "Sequence[Solution]") -> None:
    """What was written, and what to do next."""
    for solution in solutions:
        if solution.files:
            print(f"wrote {solution.folder}: {', '.join(path.name for path in solution.files)}")
    best = _best(solutions)
    print(f"next  calib evaluate {best.folder / 'calibration.json'}")
    print(f"      calib convert {best.folder / 'camera.json'} --to colmap -o cameras.txt   (opencv, ros, kalibr, ...)")


def _best(solutions: "Sequence[Solution]") -> "Solution":
    """The one that is determined and leaves least, sightings it does not know counted out."""
    from calib.metrics.errors import summarise

    def left(solution: "Solution") -> tuple[bool, float]:
        evaluation = solution.evaluation
        errors = None if evaluation is None else evaluation.of("reprojection")
        if evaluation is None or errors is None:
            return True, float("inf")
        return evaluation.calibration.status != "converged", summarise(errors).rmse

    return min((solution for solution in solutions if solution.evaluation is not None), key=left)


def leave_if_degenerate(solutions: "Sequence[Solution]") -> None:
    """Exit code 1 if the camera of no model is determined."""
    statuses = [one.evaluation.calibration.status for one in solutions if one.evaluation is not None]
    if all(status == "degenerate" for status in statuses):
        raise typer.Exit(DEGENERATE)


def _grid(grid: str | None, pitch: str | None) -> "Grid | None":
    """The corners' grid, if one is given."""
    from calib.inputs.corners_vnl import Grid
    from calib.inputs.correspondences import MAX_GRID, parse_pair
    from designer.units import parse_length_mm

    if grid is None and pitch is None:
        return None
    if grid is None or pitch is None:
        raise InputError("--grid and --pitch belong together: --grid 10x7 --pitch 20mm")
    columns, rows = parse_pair("--grid", grid, MAX_GRID)
    try:
        pitch_mm = parse_length_mm(pitch)
    except ValueError as error:
        raise InputError(f"--pitch {pitch!r}: {error}") from None
    if not pitch_mm > 0:
        raise InputError(f"--pitch {pitch!r}: must be more than 0")
    return Grid(columns, rows, pitch_mm)

"""The command `calib solve`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.cameras import learned_models, models_of_all, solved_models
from calib.commands.answers.solutions import run_answer
from calib.commands.running import negative, report_of, stopped
from calib.core.files import named_in_files
from calib.show.screen import progress_bars, quoted
from designer.base.answer import Summary
from designer.base.errors import InputError
from designer.kinds.presets import error_templates, one_of

if TYPE_CHECKING:
    from calib.core.types import Observations
    from calib.observe.corners_vnl import PointGrid
    from calib.virtual.solve_virtual import Reference

_SOLVED, _ALL, _LEARNED = (", ".join(names) for names in (solved_models(), models_of_all(), learned_models()))
ModelOption = Annotated[
    str,
    typer.Option(help=f"{_SOLVED}, or all: {_ALL}", autocompletion=one_of((*solved_models(), "all"))),
]
FixOption = Annotated[list[str] | None, typer.Option(help="keep a parameter as it starts, or at a value: k3, k3=0")]
ShareOption = Annotated[list[str] | None, typer.Option(help="parameters that have one value: fx_px,fy_px")]
FocalOption = Annotated[str | None, typer.Option(help="first guess of the focal length: 2500px (not needed)")]
LossOption = Annotated[
    str,
    typer.Option(
        help="squares, huber or cauchy: how far-off observations count",
        autocompletion=one_of(("squares", "huber", "cauchy")),
    ),
]
RejectOption = Annotated[
    float | None, typer.Option(help="leave out what is off by more than so many robust standard deviations, such as 4")
]
WeightedOption = Annotated[
    bool, typer.Option("--weighted/--unweighted", help="weigh observations by the covariances they state, or all alike")
]
MadeOption = Annotated[
    str | None,
    typer.Option(
        help="how the target was made: an error template (fdm-board, sheet-print, ...), a TOML file of errors, or "
        "exact (default: assumed from how it was built; exact if the photos were rendered)",
        metavar="NAME|FILE",
        autocompletion=error_templates,
    ),
]
ImageSizeOption = Annotated[str | None, typer.Option(help="of files that do not say it: 2448x2048")]
GridOption = Annotated[str | None, typer.Option(help="of a corners.vnl: 10x7 corners")]
PitchOption = Annotated[str | None, typer.Option(help="of a corners.vnl: distance of its corners, 20mm")]
ReferenceOption = Annotated[
    str | None,
    typer.Option(
        help=f"{_LEARNED}: the photo that the map is learned from, or all (default: of a board the photo that covers "
        "the image best, of other targets all)"
    ),
]
ReferenceTargetOption = Annotated[
    Path | None, typer.Option(help=f"{_LEARNED}: target file of a board that the reference photo shows")
]
DEFAULT_CRITERIA = "standard"


def criteria_templates(incomplete: str) -> list[str]:
    """Templates of limits, for a shell."""
    from designer.kinds.presets import preset_names

    return [name for name in preset_names("criteria") if name.startswith(incomplete)]


CriteriaOption = Annotated[
    str,
    typer.Option(
        help="limits of the verdict: a template (standard, metrology, robotics), or a TOML file of one's own",
        metavar="NAME|FILE",
        autocompletion=criteria_templates,
    ),
]

PageOption = Annotated[
    bool, typer.Option("--page/--no-page", help="write the folder's index.html, or save the seconds that takes")
]

VerboseOption = Annotated[
    bool, typer.Option("--verbose", "-v", help="say all tables: photos, parameters, models, checks")
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
    weighted: WeightedOption = True,
    reference: ReferenceOption = None,
    reference_target: ReferenceTargetOption = None,
    image_size: ImageSizeOption = None,
    grid: GridOption = None,
    pitch: PitchOption = None,
    made: MadeOption = None,
    criteria: CriteriaOption = DEFAULT_CRITERIA,
    page: PageOption = True,
    verbose: VerboseOption = False,
) -> Summary:
    """Solve the camera, and where it stood, from what was detected, and judge it.

    The exit code is 1 if the verdict is: do not use.
    """
    from calib.api.loading import rendered_id_of
    from calib.api.run_result import RunWriter
    from calib.api.running import models_of
    from calib.api.running import solve as solve_all
    from calib.solver.accuracy import UndeterminedError

    writer = RunWriter(out, models_of(model))
    observations = read_input(detections, target, image_size, grid, pitch)
    settings = (
        ("detections", named_in_files(detections)),
        ("target", "" if target is None else named_in_files(target)),
        *made_settings(made),
        *reference_settings(reference, reference_target),
    )
    try:
        with progress_bars() as progress:
            found = solve_all(
                observations, target, model=model, fix=fix or (), share=share or (), focal_px=focal_of(focal),
                loss=loss, reject_sigma=reject, weighted=weighted,
                reference=reference_of(reference, reference_target), made=made,
                rendered_id=rendered_id_of(detections), criteria=criteria, progress=progress, out=writer,
                settings=settings,
            )  # fmt: skip
    except KeyboardInterrupt:
        stopped(writer)
    except UndeterminedError as error:
        negative(writer, error)
    return report_of(
        found, writer, run_answer, page=page, verbose=verbose, more="and add what they show to the file",
        evaluate=f"calib evaluate {quoted(writer.place_of(found.best.model))}",
    )  # fmt: skip


def made_settings(made: str | None) -> tuple[tuple[str, str], ...]:
    """The way of making that was asked for, for the record."""
    return () if made is None else (("made", made),)


def read_input(
    detections: Path, target: Path | None, image_size: str | None, grid: str | None, pitch: str | None
) -> "Observations":
    """What a camera is solved from, of a file of any kind, with the options that some kinds need."""
    from calib.api.loading import load_observations

    return load_observations(detections, target, image_size=image_size_of(image_size), grid=grid_of(grid, pitch))


def image_size_of(text: str | None) -> tuple[int, int] | None:
    """Width and height of photos."""
    from calib.observe.correspondences import parse_pair
    from calib.observe.dataset import MAX_SIDE_PX

    return None if text is None else parse_pair("--image-size", text, MAX_SIDE_PX)


def focal_of(text: str | None) -> float | None:
    """A first guess of the focal length."""
    from calib.api.solving import parse_focal_px

    return None if text is None else parse_focal_px(text)


def reference_of(reference: str | None, target: Path | None) -> "Reference | None":
    """The photo that a map is learned from: the name of a view, or what a photo of another board shows.

    Args:
        reference: the photo.
        target: the board that it shows, if it is another than the run's.
    """
    if target is None:
        return reference
    if reference is None:
        raise InputError(f"--reference-target {target}: name the photo of this board too, with --reference PHOTO")
    from calib.detector.pipeline import detect
    from calib.observe.images import read_image
    from calib.observe.observations import observations_from_detections
    from designer.target import load_target

    board = load_target(target, "rings")
    seen = detect(read_image(Path(reference)).pixels, board, name=Path(reference).name)
    if not len(seen.ring):
        raise InputError(f"{reference}: shows no rings of {target}; give a photo of that board")
    return observations_from_detections([seen], board, origin=reference)


def reference_settings(reference: str | None, target: Path | None) -> tuple[tuple[str, str], ...]:
    """The choice of a reference, for the record."""
    named = () if reference is None else (("reference", reference),)
    return named if target is None else (*named, ("reference-target", target.name))


def grid_of(grid: str | None, pitch: str | None) -> "PointGrid | None":
    """The corners' grid, if one is given."""
    from calib.observe.corners_vnl import PointGrid
    from calib.observe.correspondences import MAX_GRID, parse_pair
    from designer.base.units import parse_length_mm

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
    return PointGrid(columns, rows, pitch_mm)

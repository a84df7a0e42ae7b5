"""The command `calib solve`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands import options
from calib.commands.running import negative, report_of, stopped
from calib.solver.costs import IMAGE
from designer.base.answer import Summary
from designer.base.errors import InputError
from designer.base.files import named_in_files
from designer.page.progress import progress_bars
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.core.types import Observations
    from calib.observe.corners_vnl import PointGrid
    from calib.virtual.solve_virtual import Reference


def solve(
    detections: Annotated[Path, typer.Argument(help="detections.csv, a CSV with image,u,v,X,Y,Z, or a corners.vnl")],
    *,
    target: Annotated[Path | None, typer.Option(help="the target file of detections.csv")] = None,
    model: options.ModelOption = "all",
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the results")],
    fix: options.FixOption = None,
    share: options.ShareOption = None,
    focal: options.FocalOption = None,
    loss: options.LossOption = "squares",
    reject: options.RejectOption = None,
    weighted: options.WeightedOption = True,
    minimise: options.MinimiseOption = IMAGE,
    free_bend: options.FreeBendOption = False,
    reference: options.ReferenceOption = None,
    reference_target: options.ReferenceTargetOption = None,
    image_size: options.ImageSizeOption = None,
    grid: options.GridOption = None,
    pitch: options.PitchOption = None,
    points: options.PointsOption = None,
    made: options.MadeOption = None,
    capture: options.CaptureOption = None,
    criteria: options.CriteriaOption = options.DEFAULT_CRITERIA,
    page: options.PageOption = True,
    verbose: options.VerboseOption = False,
) -> Summary:
    """Solve the camera, and where it stood, from what was detected, and judge it.

    The exit code is 1 if the verdict is: do not use.
    """
    from calib.api.run_result import RunWriter
    from calib.api.running import solve as solve_all
    from calib.app.inputs import rendered_id_of
    from calib.solver.accuracy import UndeterminedError
    from calib.solver.plan import models_of

    writer = RunWriter(out, models_of(model))
    observations = read_input(detections, target, image_size, grid, pitch, points)
    settings = (
        ("detections", named_in_files(detections)),
        ("target", "" if target is None else named_in_files(target)),
        *(() if points is None else (("points", points),)),
        *made_settings(made, capture),
        *reference_settings(reference, reference_target),
    )
    try:
        with progress_bars() as progress:
            found = solve_all(
                observations, target, model=model, fix=fix or (), share=share or (), focal_px=focal_of(focal),
                loss=loss, reject_sigma=reject, weighted=weighted, minimise=minimise, free_bend=free_bend,
                reference=reference_of(reference, reference_target), made=made, capture=capture,
                rendered_id=rendered_id_of(detections), criteria=criteria, progress=progress, out=writer,
                settings=settings,
            )  # fmt: skip
    except KeyboardInterrupt:
        stopped(writer)
    except UndeterminedError as error:
        negative(writer, error)
    return report_of(
        found, writer, page=page, verbose=verbose, more="and add what they show to the file",
        evaluate=f"calib evaluate {quoted(writer.place_of(found.best.model))}",
    )  # fmt: skip


def made_settings(made: str | None, capture: str | None = None) -> tuple[tuple[str, str], ...]:
    """The ways of making and of capture that were asked for, for the record."""
    return tuple((name, value) for name, value in (("made", made), ("capture", capture)) if value is not None)


def read_input(
    detections: Path,
    target: Path | None,
    image_size: str | None,
    grid: str | None,
    pitch: str | None,
    points: str | None = None,
) -> "Observations":
    """What a camera is solved from, of a file of any kind, with the options that some kinds need."""
    from calib.app.inputs import load_observations

    kind, diameter_mm = points_of(points)
    return load_observations(
        detections, target, image_size=image_size_of(image_size), grid=grid_of(grid, pitch), points=kind,
        diameter_mm=diameter_mm,
    )  # fmt: skip


def points_of(text: str | None) -> tuple[str | None, float | None]:
    """What a table's points are, and the diameter of circles: `circle:13mm`."""
    from calib.renderer.quantities import parsed
    from designer.base.units import parse_length_mm

    kind, _, diameter = (text or "").partition(":")
    diameter_mm = parsed("--points", diameter, parse_length_mm) if diameter else None
    return (None if text is None else kind), diameter_mm


def image_size_of(text: str | None, option: str = "--image-size") -> tuple[int, int] | None:
    """Width and height of photos."""
    from calib.observe.correspondences import parse_pair
    from calib.observe.dataset import MAX_SIDE_PX

    return None if text is None else parse_pair(option, text, MAX_SIDE_PX)


def focal_of(text: str | None) -> float | None:
    """A first guess of the focal length."""
    from calib.solver.plan import parse_focal_px

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
    from calib.images.photo import read_image
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
    from calib.renderer.quantities import parsed
    from designer.base.units import parse_length_mm

    if grid is None and pitch is None:
        return None
    if grid is None or pitch is None:
        raise InputError("--grid and --pitch belong together: --grid 10x7 --pitch 20mm")
    columns, rows = parse_pair("--grid", grid, MAX_GRID)
    pitch_mm = parsed("--pitch", pitch, parse_length_mm)
    if not pitch_mm > 0:
        raise InputError(f"--pitch {pitch!r}: must be more than 0")
    return PointGrid(columns, rows, pitch_mm)

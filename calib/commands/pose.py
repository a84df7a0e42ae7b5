"""The command `calib pose`."""

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.photos import poses_answer
from calib.commands.camera_argument import CameraArgument, read_camera
from calib.commands.detect import (
    NOTHING_LEFT,
    keep_pictures,
    no_empty_folders,
    refuse_nothing,
    search_photos,
    staging_folder,
)
from calib.commands.folder_page import folder_page
from calib.commands.screen import table_console
from calib.commands.solve import WeightedOption
from designer.answer import Summary
from designer.command import printable
from designer.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from calib.detect.batch import Detect, PhotoResult
    from calib.pose import FoundPoses, TargetPose
    from calib.types import Camera
    from designer.target import TargetGeometry

NO_POSE = 1
POSES = "poses"
"""The kind of a folder's page."""
TOO_FEW = "too few rings for a pose, or all on a line"
NOT_SOLVED = "no pose fits the rings that were found; check the camera file"


def pose(
    target: Annotated[Path, typer.Argument(help="the target file (NAME.target.json) of what the photos show")],
    camera: CameraArgument,
    photos: Annotated[list[str], typer.Argument(help="images, folders of images, or patterns such as 'run/*.png'")],
    *,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="poses to write, .json or .csv")] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="folder for pictures with the axes and what is left over", metavar="DIR")
    ] = None,
    weighted: WeightedOption = True,
    jobs: Annotated[
        int | None, typer.Option(min=1, max=1024, help="photos at a time, all in memory (default: one per core)")
    ] = None,
) -> Summary:
    """Find where a known camera stood before the target, and how surely, photo by photo.

    The exit code is 1 if no photo gives a pose.
    """
    from calib.detect.pipeline import detect

    return run_pose(
        detect, target, camera, photos, out=out, overlay=overlay, weighted=weighted, jobs=jobs or os.cpu_count() or 1
    )


def run_pose(
    detect_one: "Detect",
    target: Path,
    camera_name: str,
    arguments: Sequence[str],
    *,
    out: Path | None,
    overlay: Path | None,
    weighted: bool,
    jobs: int,
) -> Summary:
    """The command with a detector of choice."""
    from calib.detect.batch import find_photos
    from calib.pose import check_output, target_poses
    from calib.report.kept_target import keep_target
    from calib.report.origin import is_of_kind
    from calib.report.photos_file import write_photos
    from calib.report.posed_photos import Posed, told_posed
    from designer.target import load_target

    geometry = load_target(target, "rings")
    named = read_camera(camera_name)
    camera = named.camera
    if out is not None:
        check_output(out)
    if overlay is not None and overlay.exists() and not overlay.is_dir():
        raise InputError(f"{overlay}: is a file, not a folder; choose another with --overlay")
    found = find_photos(arguments)
    results = search_photos(detect_one, found, geometry, camera, None, jobs)
    seen = [result.seen for result in results if result.seen is not None]
    failures = [*found.failures, *(result.failure for result in results if result.seen is None)]
    if not seen:
        refuse_nothing(failures, NOTHING_LEFT)
    found_poses = target_poses(seen, geometry, camera, weighted=weighted)
    poses = {one.image: one for one in found_poses.poses}
    reasons = _reasons(results, found_poses)
    with no_empty_folders(overlay), staging_folder(overlay) as staging:
        drawn = {} if staging is None else _draw(staging, results, poses, geometry, camera)
        if out is not None:
            _write(out, poses, geometry, camera, reasons)
        pictures = keep_pictures(staging, overlay)
    _summarise(results, poses, reasons, failures)
    _say_files(out, overlay, len(pictures))
    pages: tuple[Path, ...] = ()
    remarks = named.remarks
    if overlay is not None and pictures:
        place = overlay
        names = [result.photo.name for result in results]
        made = Posed(target, geometry, camera_name, camera, out, names, poses, reasons, drawn, found.failures)
        pages, more = folder_page(
            place, POSES, lambda: (
                write_photos(place, told_posed(made)),
                *keep_target(place, geometry, is_again=is_of_kind(place, POSES)),
            )
        )  # fmt: skip
        remarks = (*remarks, *more)
    return Summary(
        poses_answer(geometry, results, poses, reasons, failures),
        (*(() if out is None else (out,)), *pictures, *pages),
        remarks=remarks,
        exit_code=0 if poses else NO_POSE,
    )


def _reasons(results: "Sequence[PhotoResult]", found: "FoundPoses") -> dict[str, str]:
    """Why photos have no pose, by their names."""
    reasons = {result.photo.name: result.failure for result in results if result.seen is None}
    for one in (result.seen for result in results if result.seen is not None):
        if not len(one.ring):
            reasons[one.image] = "; ".join(one.remarks) or "the target was not found"
        elif one.image in found.too_few:
            reasons[one.image] = TOO_FEW
        elif one.image in found.not_solved:
            reasons[one.image] = NOT_SOLVED
    return reasons


def _write(
    out: Path,
    poses: "Mapping[str, TargetPose]",
    geometry: "TargetGeometry",
    camera: "Camera",
    reasons: Mapping[str, str],
) -> None:
    from calib.files import write_files
    from calib.pose import poses_to_csv, poses_to_json

    found = list(poses.values())
    is_table = out.suffix.lower() == ".csv"
    content = poses_to_csv(found) if is_table else poses_to_json(found, geometry, camera, list(reasons.items()))
    write_files({out: content})


def _draw(
    folder: Path,
    results: "Sequence[PhotoResult]",
    poses: "Mapping[str, TargetPose]",
    geometry: "TargetGeometry",
    camera: "Camera",
) -> dict[str, str]:
    """Draw the photos that have a pose; the pictures' names. What goes wrong with one does not stop the others."""
    from calib.detect.batch import OVERLAY_MARK
    from calib.detect.overlay import write_overlay
    from calib.files import distinct_stems
    from calib.inputs.images import read_image
    from calib.pose_overlay import draw_pose

    drawn: dict[str, str] = {}
    stems = distinct_stems([result.photo.name for result in results])
    for result, stem in zip(results, stems, strict=True):
        one = poses.get(result.photo.name)
        if one is None or result.seen is None:
            continue
        try:
            picture = draw_pose(read_image(result.photo.path).pixels, result.seen, geometry, camera, one)
            drawn[one.image] = write_overlay(folder / f"{stem}.pose{OVERLAY_MARK}", picture).name
        except Exception as error:
            why = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            print(f"no overlay for {printable(result.photo.name)}: {printable(why)}")
    return drawn


def _summarise(
    results: "Sequence[PhotoResult]",
    poses: "Mapping[str, TargetPose]",
    reasons: Mapping[str, str],
    failures: Sequence[str],
) -> None:
    """A table of the poses, what failed, and the sums."""
    from calib.inputs.records import common_remarks

    console = table_console()
    searched = [result for result in results if result.seen is not None]
    common = common_remarks([result.seen.remarks for result in searched if result.seen is not None])
    if searched:
        console.print(_table(searched, poses, reasons, common))
    for remark in common:
        print(f"all images: {printable(remark)}")
    for failure in failures:
        print(f"skipped {printable(failure)}")
    print(f"\n{len(searched)} images searched, {len(poses)} with a pose; {len(failures)} failures")
    print("camera: its centre in the target's frame")
    print("sigma: standard deviation, if the camera file is exact and errors of the rings are independent")


def _table(
    searched: "Sequence[PhotoResult]",
    poses: "Mapping[str, TargetPose]",
    reasons: Mapping[str, str],
    common: Sequence[str],
) -> "Table":
    """One line an image, with the remarks that are not common to all."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("image", overflow="fold")
    for name in ("rings", "camera x y z mm", "sigma mm", "distance mm", "sigma mm", "sigma deg", "RMS px"):
        table.add_column(name, justify="right")
    table.add_column("remark", overflow="fold")
    for result in searched:
        name = result.photo.name
        one = poses.get(name)
        remarks = () if result.seen is None else result.seen.remarks
        if one is None:
            count = 0 if result.seen is None else len(result.seen.ring)
            cells = [str(count) if count else "none", "", "", "", "", "", ""]
            remarks = (*remarks, reasons[name]) if count else (reasons[name],)
        else:
            if result.seen is not None and one.rings < len(result.seen.ring):
                remarks = (
                    *remarks,
                    f"{len(result.seen.ring) - one.rings} more rings lie where the camera knows no light",
                )
            place = " ".join(_rounded(*pair) for pair in zip(one.camera_mm, one.camera_sigma_mm, strict=True))
            spread = " ".join(_rounded(sigma, sigma) for sigma in one.camera_sigma_mm)
            distance = _rounded(one.distance_mm, one.distance_sigma_mm)
            angle = math.degrees(one.rotation_sigma_rad)
            cells = [
                str(one.rings), place, spread, distance, _rounded(one.distance_sigma_mm, one.distance_sigma_mm),
                _rounded(angle, angle), f"{one.rms_px:.4f}",
            ]  # fmt: skip
        table.add_row(
            Text(printable(name)),
            *map(Text, cells),
            Text("; ".join(printable(remark) for remark in remarks if remark not in common)),
        )
    return table


def _rounded(value: float, sigma: float) -> str:
    """A value with as many digits as show two of its standard deviation."""
    if not (math.isfinite(sigma) and sigma > 0):
        return f"{value:.3f}"
    return f"{value:.{min(max(0, 1 - math.floor(math.log10(sigma))), 9)}f}"


def _say_files(out: Path | None, overlay: Path | None, pictures: int) -> None:
    """What was written, and what it is for."""
    if out is not None:
        print(f"wrote {out}: cam_from_target and its covariance, photo by photo")
    if pictures:
        print(f"wrote {overlay}: {pictures} pictures with the target's axes and what is left over, enlarged")
    if out is None:
        print("next  the same command with -o poses.json keeps the poses")

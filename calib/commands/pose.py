"""The command `calib pose`."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.answers.photos import poses_answer
from calib.commands.camera_argument import CameraArgument, read_camera
from calib.commands.folder_page import folder_page
from calib.commands.solve import WeightedOption
from calib.core.number_text import with_digits
from calib.show.screen import progress_bars, table_console
from designer.base.answer import Summary
from designer.base.errors import InputError
from designer.base.words import printable

if TYPE_CHECKING:
    from rich.table import Table

    from calib.cameras.camera import Camera
    from calib.observe.photos import PhotoResult
    from calib.pipeline.target_poses import TargetPose
    from designer.target import TargetGeometry

NO_POSE = 1
POSES = "poses"
"""The kind of a folder's page."""


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
    from calib.api.posing import pose as find_poses
    from calib.api.staging import keep_pictures, no_empty_folders, staging_folder
    from calib.pipeline.target_poses import check_output
    from calib.show.parts.kept_target import keep_target
    from calib.show.parts.origin import is_of_kind
    from calib.show.photos.photos_file import write_photos
    from calib.show.photos.posed_photos import Posed, told_posed

    named = read_camera(camera)
    if out is not None:
        check_output(out)
    if overlay is not None and overlay.exists() and not overlay.is_dir():
        raise InputError(f"{overlay}: is a file, not a folder; choose another with --overlay")
    with progress_bars() as progress:
        found = find_poses(target, named.camera, photos, weighted=weighted, jobs=jobs, progress=progress)
    results, geometry = found.search.results, found.target
    poses, reasons = {one.image: one for one in found.poses}, dict(found.without_pose)
    if out is not None:
        found.save(out)
    drawn: dict[str, str] = {}
    pictures: tuple[Path, ...] = ()
    if overlay is not None:
        with no_empty_folders(overlay), staging_folder(overlay) as staging:
            drawn = _draw(staging, results, poses, geometry, named.camera)
            pictures = keep_pictures(staging, overlay)
    _summarise(results, poses, reasons, found.search.failures)
    _say_files(out, overlay, len(pictures))
    pages: tuple[Path, ...] = ()
    remarks = named.remarks
    if overlay is not None and pictures:
        place = overlay
        names = [result.photo.name for result in results]
        made = Posed(target, geometry, camera, named.camera, out, names, poses, reasons, drawn, found.search.missing)
        pages, more = folder_page(
            place, POSES, lambda: (
                write_photos(place, told_posed(made)),
                *keep_target(place, geometry, is_again=is_of_kind(place, POSES)),
            )
        )  # fmt: skip
        remarks = (*remarks, *more)
    return Summary(
        poses_answer(geometry, results, poses, reasons, found.search.failures),
        (*(() if out is None else (out,)), *pictures, *pages),
        remarks=remarks,
        exit_code=0 if poses else NO_POSE,
    )


def _draw(
    folder: Path,
    results: "Sequence[PhotoResult]",
    poses: "Mapping[str, TargetPose]",
    geometry: "TargetGeometry",
    camera: "Camera",
) -> dict[str, str]:
    """Draw the photos that have a pose; the pictures' names. What goes wrong with one does not stop the others."""
    from calib.core.files import distinct_stems
    from calib.detector.overlay import write_overlay
    from calib.observe.images import read_image
    from calib.observe.photos import OVERLAY_MARK
    from calib.pipeline.pose_overlay import draw_pose

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
    from calib.observe.records import common_remarks

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
            place = " ".join(with_digits(*pair) for pair in zip(one.camera_mm, one.camera_sigma_mm, strict=True))
            spread = " ".join(with_digits(sigma, sigma) for sigma in one.camera_sigma_mm)
            distance = with_digits(one.distance_mm, one.distance_sigma_mm)
            angle = math.degrees(one.rotation_sigma_rad)
            cells = [
                str(one.rings), place, spread, distance, with_digits(one.distance_sigma_mm, one.distance_sigma_mm),
                with_digits(angle, angle), f"{one.rms_px:.4f}",
            ]  # fmt: skip
        table.add_row(
            Text(printable(name)),
            *map(Text, cells),
            Text("; ".join(printable(remark) for remark in remarks if remark not in common)),
        )
    return table


def _say_files(out: Path | None, overlay: Path | None, pictures: int) -> None:
    """What was written, and what it is for."""
    if out is not None:
        print(f"wrote {out}: cam_from_target and its covariance, photo by photo")
    if pictures:
        print(f"wrote {overlay}: {pictures} pictures with the target's axes and what is left over, enlarged")
    if out is None:
        print("next  the same command with -o poses.json keeps the poses")

"""The command `calib detect`."""

import math
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from calib.commands.answers.photos import detections_answer, expected_features, median_sigma_px
from calib.commands.folder_page import folder_page, say_next
from calib.commands.screen import progress_bar, quoted, table_console
from calib.files import check_folder
from designer.answer import Summary, program
from designer.command import printable
from designer.completion import camera_templates
from designer.errors import InputError
from designer.own_files import require_ours

if TYPE_CHECKING:
    from rich.table import Table

    from calib.detect.batch import Detect, FoundPhotos, PhotoResult, Pixels, Read
    from calib.types import Camera, Detections
    from designer.target import TargetGeometry

NOTHING_FOUND = 1
DETECTIONS = "detections"
"""The kind of a folder's page."""
NOTHING_LEFT = "no photos left to search"
MAX_ROWS = 60
"""Images in the table; of a larger set only those are shown that need a look."""


def detect(
    target: Annotated[Path, typer.Argument(help="the target file (NAME.target.json) of what the photos show")],
    photos: Annotated[list[str], typer.Argument(help="images, folders of images, or patterns such as 'run/*.png'")],
    *,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="detections to write (default: exports/NAME/detections.csv)")
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="folder for pictures that show what was and was not found", metavar="DIR")
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="camera file (of ours or another tool) or template: centres become surer where its lens is known",
            autocompletion=camera_templates,
        ),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, max=1024, help="photos at a time, all in memory (default: one per core)")
    ] = None,
) -> Summary:
    """Find a target's rings in photos, name them, and measure their centres.

    The exit code is 1 if nothing at all was found.
    """
    from calib.detect.pipeline import detect as detect_one
    from calib.report.why_nothing import explained

    def search(
        pixels: "Pixels", target: "TargetGeometry", *, name: str, camera: "Camera | None" = None
    ) -> "Detections":
        return explained(detect_one(pixels, target, name=name, camera=camera), pixels, target)

    return run_detect(
        search, target, photos, out=out, overlay=overlay, camera_name=camera, jobs=jobs or os.cpu_count() or 1
    )


def run_detect(
    detect_one: "Detect",
    target: Path,
    arguments: Sequence[str],
    *,
    out: Path | None,
    overlay: Path | None,
    camera_name: str | None,
    jobs: int,
) -> Summary:
    """The command with a detector of choice."""
    from calib.commands.camera_argument import read_camera
    from calib.detect.batch import find_photos
    from calib.inputs.dataset import check_output
    from calib.inputs.records import records_path
    from designer.target import load_target

    geometry = load_target(target, "rings")
    named = None if camera_name is None else read_camera(camera_name)
    table = _table_path(out, target)
    check_output(table)
    found = find_photos(arguments)
    start = time.perf_counter()
    with staging_folder(overlay) as staging:
        results = search_photos(detect_one, found, geometry, None if named is None else named.camera, staging, jobs)
        seen = [result.seen for result in results if result.seen is not None]
        if not seen:
            refuse_nothing([*found.failures, *(result.failure for result in results)], NOTHING_LEFT)
        seconds = time.perf_counter() - start
        write_results(table, results, seen, geometry, _rendered_id(results))
        pictures = keep_pictures(staging, overlay)
    summarise(geometry, found, results, seconds)
    _say_files(table, overlay, results)
    pages: tuple[Path, ...] = ()
    remarks = () if named is None else named.remarks
    if overlay is not None:
        pages, more = overlays_page(overlay, target, geometry, table, results, found.failures)
        remarks = (*remarks, *more)
    is_found = any(len(one.ring) for one in seen)
    summary = Summary(
        detections_answer(geometry, found, results, seconds),
        (table, records_path(table), *pictures, *pages),
        (f"calib solve {quoted(table)} --target {quoted(target)} -o DIR",) if is_found else (),
        remarks,
        exit_code=0 if is_found else NOTHING_FOUND,
    )
    return summary if overlay is None else say_next(summary, overlay)


def overlays_page(
    folder: Path,
    target: Path,
    geometry: "TargetGeometry",
    table: Path,
    results: "Sequence[PhotoResult]",
    failures: Sequence[str],
    *,
    overlays: Path | None = None,
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write the page of what was found; its files, or a remark that says why there is none.

    Args:
        folder: of the page.
        target: its file.
        geometry: the target.
        table: the detections.
        results: of each photo.
        failures: arguments that stood for no photo.
        overlays: the pictures' folder (default: the page's).
    """
    from calib.report.detected_photos import detected, told_detected
    from calib.report.photos_file import write_photos

    def keep() -> tuple[Path, ...]:
        sigmas_px = [math.nan if result.seen is None else median_sigma_px(result.seen) for result in results]
        made = detected(folder, target, geometry, table, results, sigmas_px, failures, overlays=overlays)
        return (write_photos(folder, told_detected(made)),)

    return folder_page(folder, DETECTIONS, keep)


def _table_path(out: Path | None, target: Path) -> Path:
    """Where the detections go."""
    if out is None:
        return exports_folder(target) / "detections.csv"
    return out / "detections.csv" if out.is_dir() else out


@contextmanager
def staging_folder(overlay: Path | None) -> Iterator[Path | None]:
    """A folder beside the overlays' final place, gone afterwards, so that a stopped run leaves no pictures."""
    if overlay is None:
        yield None
        return
    check_folder(overlay, "--overlay")
    try:
        overlay.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=overlay))
    except OSError as error:
        raise InputError(
            f"{overlay}: cannot be written: {error.strerror}; choose another folder with --overlay"
        ) from None
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def search_photos(
    detect_one: "Detect",
    found: "FoundPhotos",
    geometry: "TargetGeometry",
    camera: "Camera | None",
    staging: Path | None,
    jobs: int,
    read: "Read | None" = None,
) -> "list[PhotoResult]":
    """Search all photos, with a progress bar on standard error while there is a screen."""
    from calib.detect.batch import detect_photos, named_photos
    from calib.inputs.images import read_image

    photos = named_photos(found.paths)
    results: list[PhotoResult] = []
    with progress_bar("searching", len(photos)) as tell:
        for result in detect_photos(
            photos,
            geometry,
            detect=detect_one,
            camera=camera,
            overlay_folder=staging,
            jobs=jobs,
            read=read or read_image,
        ):
            results.append(result)
            tell(len(results))
    return results


def refuse_nothing(failures: Sequence[str], otherwise: str) -> NoReturn:
    """End a command that has nothing to work on: with the first failure, or with a word if nothing failed.

    Raises:
        InputError: always.
    """
    others = f" (and {len(failures) - 1} more like it)" if len(failures) > 1 else ""
    raise InputError(f"{failures[0] if failures else otherwise}{others}")


def keep_pictures(staging: Path | None, folder: Path | None) -> tuple[Path, ...]:
    """Put finished pictures in their place, which is returned."""
    if staging is None or folder is None:
        return ()
    pictures = sorted(staging.iterdir())
    for picture in pictures:
        require_ours(folder / picture.name, picture.read_bytes())
    return tuple(picture.replace(folder / picture.name) for picture in pictures)


@contextmanager
def no_empty_folders(folder: Path | None) -> Iterator[None]:
    """Remove the folders that were made for nothing, if it comes to that."""
    made = [] if folder is None else [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        yield
    finally:
        with suppress(OSError):  # the first that is not empty
            for place in made:
                place.rmdir()


def exports_folder(target: Path) -> Path:
    """Where a target's results go if nobody says otherwise."""
    return Path("exports") / target.name.removesuffix(".json").removesuffix(".target")


def truth_beside(paths: "Sequence[Path]") -> Path | None:
    """The truth of rendered photos, if all are of one rendered set."""
    folders = {path.parent for path in paths}
    beside = next(iter(folders)) / "truth.json" if len(folders) == 1 else None
    return beside if beside is not None and beside.is_file() else None


def _rendered_id(results: "Sequence[PhotoResult]") -> str:
    """The geometry that photos were rendered of, if a truth beside them says so; "" for real photos."""
    truth = truth_beside([result.photo.path for result in results])
    if truth is None:
        return ""
    from calib.results.truth import read_truth

    try:
        return read_truth(truth).rendered_id(result.photo.path.name for result in results)
    except InputError:  # what lies there by chance does not matter
        return ""


def write_results(
    table: Path,
    results: "Sequence[PhotoResult]",
    seen: "Sequence[Detections]",
    geometry: "TargetGeometry",
    rendered_id: str,
) -> None:
    """Write the table and the records, photos that could not be searched among them.

    Args:
        table: the detections' file.
        results: of each photo.
        seen: in those that could be searched.
        geometry: the target.
        rendered_id: of the geometry that the photos were rendered of; "": real photos.
    """
    from calib.inputs.dataset import write_detections
    from calib.inputs.records import ImageRecord

    failed = [
        ImageRecord(result.photo.name, None, 0, 0, (), (), result.failure) for result in results if result.seen is None
    ]
    write_detections(table, seen, geometry, detector=program(), failed=failed, rendered_id=rendered_id)


def summarise(
    geometry: "TargetGeometry", found: "FoundPhotos", results: "Sequence[PhotoResult]", seconds: float
) -> None:
    """A table of the images, what failed, and the sums."""
    from calib.inputs.records import common_remarks

    console = table_console()
    seen = [result.seen for result in results if result.seen is not None]
    shown = seen if len(seen) <= MAX_ROWS else [one for one in seen if one.remarks or not len(one.ring)][:MAX_ROWS]
    common = [printable(remark) for remark in common_remarks([one.remarks for one in seen])]
    if shown:
        console.print(_images_table(shown, geometry, common))
    for remark in common:
        print(f"all images: {remark}")
    if len(shown) < len(seen):
        print(f"{len(seen) - len(shown)} more images: their counts are in the records")
    for failure in [*found.failures, *(result.failure for result in results if result.failure)]:
        console.print(f"[yellow]skipped[/] {_plain(failure)}", markup=True)
    for result in results:
        if result.overlay_failure:
            console.print(f"[yellow]{_plain(result.overlay_failure)}[/]", markup=True)
    if found.overlays:
        print(f"left out: {found.overlays} overlays of an earlier run")
    with_target = [one for one in seen if len(one.ring)]
    features = sum(len(one.ring) for one in seen)
    expected = sum(expected_features(one) for one in seen)
    images = "1 image" if len(seen) == 1 else f"{len(seen)} images"
    counts = f"{features} of {expected} features of the faces seen that could be measured; " if with_target else ""
    print(
        f"\n{images} searched, {len(with_target) or 'none'} with the target; {counts}"
        f"{len(found.failures) + len(results) - len(seen)} {'failures' if with_target else 'could not be read'}; "
        f"{seconds:.1f} s"
    )


def _images_table(seen: "Sequence[Detections]", geometry: "TargetGeometry", said: Sequence[str]) -> "Table":
    """One line an image, with the remarks that are not said elsewhere."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("image", overflow="fold")
    if geometry.face_count > 1:
        table.add_column("faces")
    table.add_column("found", justify="right")
    table.add_column("sigma px", justify="right")
    table.add_column("remark", overflow="fold")
    for one in seen:
        named = sorted(record.face for record in one.faces if record.face is not None)
        faces = [Text(" ".join(map(str, named)))] if geometry.face_count > 1 else []
        count = Text(
            f"{len(one.ring)}/{expected_features(one)}" if len(one.ring) else "none", "" if len(one.ring) else "red"
        )
        remarks = "; ".join(remark for remark in _remarks(one) if remark not in said)
        table.add_row(
            Text(printable(one.image)),
            *faces,
            count,
            f"{median_sigma_px(one):.4f}" if len(one.ring) else "",
            Text(remarks),
        )
    return table


def _remarks(one: "Detections") -> list[str]:
    """What to know of an image, and why rings of seen faces are missing that could have been measured."""
    from calib.types import NOT_MEASURABLE

    missing: dict[str, int] = {}
    for record in one.faces:
        for reason, count in record.missing if record.face is not None else ():
            missing[reason] = missing.get(reason, 0) + count
    lost = [f"{count} {reason}" for reason, count in missing.items() if count and reason not in NOT_MEASURABLE]
    return [printable(remark) for remark in (*one.remarks, *lost)]


def _say_files(table: Path, overlay: Path | None, results: "Sequence[PhotoResult]") -> None:
    """What was written, and what it is for."""
    from calib.inputs.records import records_path

    print(f"wrote {table}: one line a feature, which is what a calibration reads")
    print(f"      {records_path(table)}: what was read of each face, and why rings are missing")
    pictures = [result.overlay for result in results if result.overlay is not None]
    if overlay is not None and pictures:
        print(f"      {overlay}: {len(pictures)} overlays; look at them before you trust the numbers")
    else:
        print("next  the same command with --overlay DIR draws what was and was not found")


def _plain(text: str) -> str:
    """Text that rich prints as it is."""
    return printable(text).replace("[", r"\[")
